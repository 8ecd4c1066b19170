#!/usr/bin/env python3
"""Plugin by plugin: does Caustica render what Mitsuba 3 renders?

usage: compare.py [--caustica PROGRAM] [--only WORD]... [--keep DIR]      (needs: pip install mitsuba numpy scipy)

Every case is a small scene, rendered by both: a sphere of each material under a constant and under a point light, and a
scene or two for each texture, light, sensor and shape. 16 images of 16 samples each, with different seeds, give means and
their variances on both sides, whatever they are. To pass, a case must hold
  blocks   over 4x4-pixel blocks the RMS of Welch's t is at most 1.5 (1 is what chance makes of equal images)
  bias     the means of each channel agree within 1 %, or within three of their standard errors
and `photonmap` must agree with `path` in the means within 1 %, or three standard errors, unless a point light shines through
holes, glass or a beam where no path from the eye finds it: there it may be brighter.
One line per case; exit status 1 if one failed."""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

import cases

mi.set_variant("scalar_rgb")
SIZE = cases.SIZE
IMAGES, SAMPLES = 16, 16


def read(path):
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(bitmap).astype("f8")


def mitsuba(path):
    scene = mi.load_file(str(path))
    integrator = mi.load_dict({"type": "path", "rr_depth": 1000})
    return np.stack(
        [
            np.array(mi.render(scene, integrator=integrator, spp=SAMPLES, seed=s)).astype("f8")[..., :3]
            for s in range(IMAGES)
        ]
    )


def caustica(program, path, integrator, folder):
    images = []
    for seed in range(IMAGES):
        out = folder / f"{integrator}-{seed}.exr"
        command = [program, "render", str(path), "-o", str(out), "-q", "--integrator", integrator]
        command += ["--passes", str(SAMPLES), "--seed", str(seed + 1)]
        subprocess.run(command, check=True)
        images.append(read(out))
    return np.stack(images)


def blocks(a, n=4):
    k, h, w, c = a.shape
    h, w = h // n * n, w // n * n
    return a[:, :h, :w].reshape(k, h // n, n, w // n, n, c).mean((2, 4))


def welch(a, b):
    """t of the difference of means, with a floor for what rounding makes of images without noise."""
    variance = a.var(0, ddof=1) / len(a) + b.var(0, ddof=1) / len(b)
    mean = np.abs(b.mean(0))
    return (a.mean(0) - b.mean(0)) / np.sqrt(variance + (1e-4 + 1e-3 * mean) ** 2)


def bias(a, b):
    """Relative difference of the means of each channel, and its standard error."""
    a, b = a.mean((1, 2)), b.mean((1, 2))
    scale = np.maximum(b.mean(0), 1e-9)
    error = np.sqrt(a.var(0, ddof=1) / len(a) + b.var(0, ddof=1) / len(b))
    return (a.mean(0) - b.mean(0)) / scale, error / scale


def agrees(relative, error):
    return bool((np.abs(relative) <= np.maximum(0.01, 3 * error)).all())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    root = pathlib.Path(__file__).resolve().parents[2]
    parser.add_argument("--caustica", default=str(root / "target/release/caustica"))
    parser.add_argument("--only", action="append", default=[], help="only cases whose name contains this")
    parser.add_argument("--keep", type=pathlib.Path, help="write scenes and images here")
    arguments = parser.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        cases.write_files(folder)
        for name, text in cases.scenes():
            if arguments.only and not any(word in name for word in arguments.only):
                continue
            path = folder / f"{name.replace(' ', '-')}.xml"
            path.write_text(text)
            try:
                ours = caustica(arguments.caustica, path, "path", folder)
                photons = caustica(arguments.caustica, path, "photonmap", folder)
            except subprocess.CalledProcessError as error:
                print(f"{name:40} FAIL: {error}")
                failed += 1
                continue
            theirs = mitsuba(path)
            rms = float(np.sqrt((welch(blocks(ours), blocks(theirs)) ** 2).mean()))
            path_bias, path_error = bias(ours, theirs)
            map_bias, map_error = bias(photons, ours)
            if name in cases.HIDDEN_FROM_PATHS:
                map_bias = np.minimum(map_bias, 0)
            ok = rms <= 1.5 and agrees(path_bias, path_error) and agrees(map_bias, map_error)
            failed += not ok
            print(
                f"{name:40} {'pass' if ok else 'FAIL'}: block RMS t {rms:.2f}, path {np.round(100 * path_bias, 2)} %"
                f" ± {100 * path_error.max():.2f}, photonmap {np.round(100 * map_bias, 2)} % ± {100 * map_error.max():.2f}",
                flush=True,
            )
    print(f"{failed} failed" if failed else "all agree")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
