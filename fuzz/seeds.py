#!/usr/bin/env python3
"""Makes the seeds that are images, but for OpenEXR (see examples/seeds.rs). Needs Pillow."""
from pathlib import Path
from PIL import Image

to = Path(__file__).parent / "seeds" / "image"
rgb = Image.new("RGB", (12, 9))
rgb.putdata([(20 * x, 25 * y, 99) for y in range(9) for x in range(12)])
for mode in ["1", "L", "LA", "P", "RGB", "RGBA", "I;16"]:
    image = Image.new(mode, (5, 4), 1) if mode == "I;16" else rgb.convert(mode)
    image.save(to / f"{mode.replace(';', '')}.png")
for mode in ["L", "RGB", "CMYK"]:
    rgb.convert(mode).save(to / f"{mode}.jpg", quality=50)
rgb.save(to / "progressive.jpg", progressive=True, quality=50)
rgb.resize((40, 40)).save(to / "restart.jpg", quality=20, subsampling="4:2:0", restart_marker_blocks=2)
for mode in ["1", "L", "P", "RGB", "RGBA"]:
    rgb.convert(mode).save(to / f"{mode}.bmp")
for mode in ["L", "LA", "P", "RGB", "RGBA"]:
    rgb.convert(mode).save(to / f"{mode}.tga")
    rgb.convert(mode).save(to / f"{mode}-rle.tga", compression="tga_rle")
# A BMP of 8-bit runs: a row, the end of the row, the end.
palette = bytes(range(16))
header = b"BM" + (54 + 16 + 12).to_bytes(4, "little") + bytes(4) + (54 + 16).to_bytes(4, "little")
info = b"".join(n.to_bytes(4, "little") for n in (40, 4, 2, 1 | 8 << 16, 1, 12, 0, 0, 4, 0))
runs = bytes([4, 1, 0, 0, 0, 4, 1, 2, 3, 0, 0, 1])
(to / "runs.bmp").write_bytes(header + info + palette + runs)
