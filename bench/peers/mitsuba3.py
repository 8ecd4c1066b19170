"""Mitsuba 3 as a peer: `mitsuba3.py VARIANT [path|ptracer|path+oidn]`, see README.md."""

import ctypes.util
import glob
import importlib.util
import os
import re
import subprocess
import tempfile
import time

import peer

# Wavefronts of the JIT variants beyond this cost memory and save no more time.
MOST_SAMPLES_AT_ONCE = 1 << 23
METHODS = ("path", "ptracer", "path+oidn")
# What Dr.Jit makes of a scene ends older ones with an abort.
OLDEST_LLVM = 17


def find_llvm():
    """The newest LLVM library installed, by its path; None if there is none that is new enough."""
    libraries = glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*")
    version = lambda path: int(re.search(r"libLLVM\D*(\d+)", path).group(1))
    libraries = [path for path in libraries if re.search(r"libLLVM(-|\.so\.)\d+", path)]
    newest = max(libraries, key=version, default=None)
    if newest is None:
        return ctypes.util.find_library("LLVM")
    return newest if version(newest) >= OLDEST_LLVM else None


def import_mitsuba(variant):
    """Mitsuba and Dr.Jit in the given variant, without kernels that earlier runs have left on the disk."""
    if variant.startswith("llvm") and "DRJIT_LIBLLVM_PATH" not in os.environ:
        library = find_llvm()
        if library is None:
            peer.skip(f"there is no LLVM {OLDEST_LLVM} or later; apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH")
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


def find_oidn():
    """The folder of Open Image Denoise that pyoidn brings; pyoidn itself is not imported."""
    spec = importlib.util.find_spec("pyoidn")
    places = spec.submodule_search_locations if spec else []
    for place in places:
        folder = os.path.join(place, "oidn")
        if os.access(os.path.join(folder, "bin", "oidnDenoise"), os.X_OK):
            return folder
    peer.skip("Open Image Denoise is not installed; pip install pyoidn")


def load(mitsuba, method, variant, arguments):
    """The scene with our film size and sampler put into it, and our integrator."""
    mitsuba.file_resolver().prepend(os.path.dirname(os.path.abspath(arguments.scene)))
    config = mitsuba.parser.ParserConfig(variant)
    state = mitsuba.parser.parse_file(config, arguments.scene, **arguments.defines)
    mitsuba.parser.transform_all(config, state)
    kinds = mitsuba.ObjectType
    parameters = {"max_depth": -1}
    for node in state.nodes:
        props = node.props
        if node.type == kinds.Integrator:
            kept = ("max_depth", "rr_depth", "hide_emitters")
            parameters |= {name: props[name] for name in kept if name in props}
            # The scene's may be one that Mitsuba lacks.
            node.props = mitsuba.Properties("path")
        elif node.type == kinds.Sampler:
            # Passes are added up, so samples must not be stratified within one.
            node.props = mitsuba.Properties("independent")
        elif node.type == kinds.Film:
            props["width"], props["height"] = arguments.size
            props["pixel_format"] = "rgb"
            props["component_format"] = "float32"
    scene = mitsuba.parser.instantiate(config, state)
    integrator = {"type": method.removesuffix("+oidn"), **parameters}
    if method == "path+oidn":
        integrator = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "image": integrator}
    return scene, mitsuba.load_dict(integrator)


def film_sums(numpy, film):
    """The sums of a film over its samples, R, G, B, then albedo and normal if it has them, and of the weights."""
    raw = film.bitmap(raw=True)
    values = numpy.array(raw)
    index = {field.name: i for i, field in enumerate(raw.struct_())}
    names = [*"RGB", *(f"albedo.{c}" for c in "RGB"), *(f"normal.{c}" for c in "XYZ"), "W"]
    return values[:, :, [index[name] for name in names if name in index]].astype(float)


def write_pfm(numpy, path, image):
    height, width = image.shape[:2]
    with open(path, "wb") as file:
        file.write(b"PF\n%d %d\n-1.0\n" % (width, height))
        file.write(numpy.ascontiguousarray(image[::-1], "<f4").tobytes())


def read_pfm(numpy, path):
    with open(path, "rb") as file:
        _, size, _ = file.readline(), file.readline(), file.readline()
        width, height = map(int, size.split())
        return numpy.frombuffer(file.read(), "<f4").reshape(height, width, 3)[::-1].copy()


def denoise(numpy, oidn, threads, image):
    """What Open Image Denoise makes of a picture with albedo and normal as further channels."""
    color, albedo, normal = image[:, :, :3], numpy.clip(image[:, :, 3:6], 0, 1), image[:, :, 6:9]
    with tempfile.TemporaryDirectory() as folder:
        files = {name: os.path.join(folder, f"{name}.pfm") for name in ("hdr", "alb", "nrm", "output")}
        for name, values in (("hdr", color), ("alb", albedo), ("nrm", normal)):
            write_pfm(numpy, files[name], values)
        command = [os.path.join(oidn, "bin", "oidnDenoise"), "--device", "cpu", "--threads", str(threads)]
        for name, path in files.items():
            command += [f"--{name}", path]
        environment = {**os.environ, "LD_LIBRARY_PATH": os.path.join(oidn, "lib")}
        done = subprocess.run(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        if done.returncode != 0 or not os.path.isfile(files["output"]):
            raise SystemExit(f"oidnDenoise: {' '.join(done.stdout.split())[-300:]}")
        return read_pfm(numpy, files["output"])


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
    variant, method = (arguments.words + ["path"])[:2] if arguments.words else (None, None)
    if len(arguments.words) > 2 or method not in METHODS:
        raise SystemExit(f"usage: mitsuba3.py VARIANT [{'|'.join(METHODS)}] SCENE OUTDIR --budgets ...")
    oidn = find_oidn() if method == "path+oidn" else None
    mitsuba, drjit, _home = import_mitsuba(variant)
    import numpy

    peer.say(renderer=f"mitsuba {mitsuba.__version__}", method=method, backend=variant)
    clock = peer.Clock(arguments)
    drjit.set_thread_count(arguments.threads)
    try:
        scene, integrator = load(mitsuba, method, variant, arguments)
    except RuntimeError as error:
        peer.skip(f"mitsuba cannot load this scene: {' '.join(str(error).split())}")
    if not scene.sensors():
        peer.skip("this scene has no sensor")
    sensor = scene.sensors()[0]
    film = sensor.film()
    clock.loaded()

    width, height = arguments.size
    sums = 0.0
    # Mitsuba spaces the random numbers of consecutive seeds apart by the number of pixels.
    seed = (arguments.seed << 20) % (1 << 32)
    passes, samples = 0, 1

    def make():
        image = (sums[:, :, :-1] / sums[:, :, -1:]).astype(numpy.float32)
        return denoise(numpy, oidn, arguments.threads, image) if oidn else image

    while clock.running():
        began = time.perf_counter()
        image = integrator.render(scene, sensor, seed=seed, spp=samples)
        if method == "ptracer":
            sums += numpy.dstack([samples * numpy.array(image), numpy.full((height, width), samples)])
        else:
            # The raw film holds sums of weighted samples and of their weights, which is what adds up.
            sums += film_sums(numpy, film)
        seed, passes = seed + 1, passes + samples
        took = time.perf_counter() - began
        clock.picture(passes, lambda path, picture: mitsuba.Bitmap(picture).write(path), make)
        if clock.running():
            samples = next_samples(samples, took, clock)
            samples = max(min(samples, MOST_SAMPLES_AT_ONCE // (width * height)), 1)


if __name__ == "__main__":
    main()
