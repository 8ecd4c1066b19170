#!/usr/bin/env python3
"""Makes the seeds that are images, but for OpenEXR (see examples/seeds.rs). Needs Pillow."""
import struct
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

# Radiance HDR: every orientation, signatures, lines without compression, with old and with new runs.
flat = b"".join(bytes([x, 5 * y, 7, 134]) for y in range(2) for x in range(3))
for i, size in enumerate(f"{a} 2 {b} 3" for a, b in [
    ("-Y", "+X"), ("-Y", "-X"), ("+Y", "+X"), ("+Y", "-X"), ("+X", "-Y"), ("-X", "-Y"), ("+X", "+Y"), ("-X", "+Y")
]):
    name = ["RADIANCE", "RGBE", "AUTOPANO"][i % 3]
    head = f"#?{name}\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nCOLORCORR=1 2 3\n\n{size}\n"
    (to / f"orientation{i}.hdr").write_bytes(head.encode() + flat)
head = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 9\n"
(to / "old-runs.hdr").write_bytes(head + bytes([1, 5, 7, 134, 1, 1, 1, 2, 2, 5, 7, 134, 1, 1, 1, 5]))
red = bytes([131, 1, 6, 2, 3, 4, 5, 6, 7])
(to / "new-runs.hdr").write_bytes(head + bytes([2, 2, 0, 9]) + red + bytes([137, 5, 137, 7, 137, 134]))


def exr(name, channels, corner, display):
    """Uncompressed, 3x2, of 32-bit floats; `display` is its first and last column and row."""
    def attribute(name, kind, value):
        return f"{name}\0{kind}\0".encode() + struct.pack("<I", len(value)) + value

    data = (*corner, corner[0] + 2, corner[1] + 1)
    listed = b"".join(c.encode() + b"\0" + struct.pack("<4i", 2, 0, 1, 1) for c in channels) + b"\0"
    head = struct.pack("<2I", 20000630, 2) + b"".join(attribute(*a) for a in [
        ("channels", "chlist", listed),
        ("compression", "compression", b"\0"),
        ("dataWindow", "box2i", struct.pack("<4i", *data)),
        ("displayWindow", "box2i", struct.pack("<4i", *display)),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    ]) + b"\0"
    row = 12 * len(channels)
    start = len(head) + 16
    lines = [struct.pack("<2i", corner[1] + y, row) + struct.pack("<f", 0.5 + y) * (row // 4) for y in range(2)]
    (to / f"{name}.exr").write_bytes(head + struct.pack("<2Q", start, start + 8 + row) + b"".join(lines))


exr("lower-case", ["a", "b", "g", "r"], (0, 0), (0, 0, 2, 1))
exr("red", ["R"], (0, 0), (0, 0, 2, 1))
exr("layer", ["d.Z", "l.B", "l.G", "l.R"], (0, 0), (0, 0, 2, 1))
exr("xyz", ["X", "Y", "Z"], (0, 0), (0, 0, 2, 1))
exr("inside", ["Y"], (3, -2), (0, -5, 9, 9))
exr("around", ["B", "G", "R"], (-1, -1), (0, 0, 0, 0))
exr("apart", ["Y"], (-9, 0), (0, 0, 3, 3))
