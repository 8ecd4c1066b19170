"""Mitsuba 3 as a peer: `mitsuba3.py VARIANT [path|ptracer]`, see README.md."""

import ctypes.util
import glob
import os
import re
import tempfile
import time

import peer

# Wavefronts of the JIT variants beyond this cost memory and save no more time.
MOST_SAMPLES_AT_ONCE = 1 << 23


def find_llvm():
    """The newest LLVM library installed, by its path; None if there is none."""
    libraries = glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*")
    version = lambda path: int(re.search(r"libLLVM\D*(\d+)", path).group(1))
    libraries = [path for path in libraries if re.search(r"libLLVM(-|\.so\.)\d+", path)]
    return max(libraries, key=version, default=ctypes.util.find_library("LLVM"))


def import_mitsuba(variant):
    """Mitsuba and Dr.Jit in the given variant, without kernels that earlier runs have left on the disk."""
    if variant.startswith("llvm") and "DRJIT_LIBLLVM_PATH" not in os.environ:
        library = find_llvm()
        if library is None:
            peer.skip("LLVM is not installed; apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH")
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    # Dr.Jit keeps compiled kernels below $HOME. Compiling counts, and should in every run.
    home = tempfile.TemporaryDirectory()
    os.environ["HOME"] = home.name
    try:
        import drjit
        import mitsuba
    except ImportError:
        peer.skip("mitsuba is not installed; pip install mitsuba")
    if variant not in mitsuba.variants():
        peer.skip(f"this mitsuba has no variant {variant}, only {', '.join(mitsuba.variants())}")
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba, drjit, home


def load(mitsuba, variant, method, arguments):
    """The scene with our integrator, film size and sampler put into it."""
    mitsuba.file_resolver().prepend(os.path.dirname(os.path.abspath(arguments.scene)))
    config = mitsuba.parser.ParserConfig(variant)
    state = mitsuba.parser.parse_file(config, arguments.scene, **arguments.defines)
    mitsuba.parser.transform_all(config, state)
    kinds = mitsuba.ObjectType
    for node in state.nodes:
        props = node.props
        if node.type == kinds.Integrator:
            kept = {name: props[name] for name in ("rr_depth", "hide_emitters") if name in props}
            node.props = mitsuba.Properties(method)
            for name, value in {"max_depth": -1, **kept}.items():
                node.props[name] = value
        elif node.type == kinds.Sampler:
            # Passes are added up, so samples must not be stratified within one.
            node.props = mitsuba.Properties("independent")
        elif node.type == kinds.Film:
            props["width"], props["height"] = arguments.size
            props["pixel_format"] = "rgb"
            props["component_format"] = "float32"
    return mitsuba.parser.instantiate(config, state)


def next_samples(samples, took, clock):
    """Samples of the next pass, a power of two since Dr.Jit compiles another kernel for others.

    A pass takes a quarter of the time to the next budget, so that it ends near it, but no less than is
    worth a call; it grows slowly since the first pass says little: it compiles.
    """
    goal = max(clock.remaining() / 4, clock.seconds() / 32)
    if took > goal:
        return max(samples // 2, 1)
    return samples * 2 if took * 2 <= goal else samples


def main():
    arguments = peer.parse_arguments()
    if not 1 <= len(arguments.words) <= 2:
        raise SystemExit("usage: mitsuba3.py VARIANT [path|ptracer] SCENE OUTDIR --budgets ...")
    variant, method = (arguments.words + ["path"])[:2]
    mitsuba, drjit, _home = import_mitsuba(variant)
    import numpy

    peer.say(renderer=f"mitsuba {mitsuba.__version__}", method=method, backend=variant)
    clock = peer.Clock(arguments)
    drjit.set_thread_count(arguments.threads)
    scene = load(mitsuba, variant, method, arguments)
    sensor, integrator = scene.sensors()[0], scene.integrator()
    film = sensor.film()
    clock.loaded()

    width, height = arguments.size
    sums = numpy.zeros((height, width, 4))
    # Mitsuba spaces the random numbers of consecutive seeds apart by the number of pixels.
    seed = (arguments.seed << 20) % (1 << 32)
    passes, samples = 0, 1
    while clock.running():
        began = time.perf_counter()
        image = integrator.render(scene, sensor, seed=seed, spp=samples)
        if method == "ptracer":
            sums += numpy.dstack([samples * numpy.array(image), numpy.full((height, width), samples)])
        else:
            # The raw film holds sums of weighted samples and of their weights, which is what adds up.
            sums += numpy.array(film.bitmap(raw=True))
        seed, passes = seed + 1, passes + samples
        took = time.perf_counter() - began
        picture = (sums[:, :, :3] / sums[:, :, 3:]).astype(numpy.float32)
        clock.picture(passes, lambda path: mitsuba.Bitmap(picture).write(path))
        if clock.running():
            samples = next_samples(samples, took, clock)
            samples = max(min(samples, MOST_SAMPLES_AT_ONCE // (width * height)), 1)


if __name__ == "__main__":
    main()
