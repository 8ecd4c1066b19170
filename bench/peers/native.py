"""Renderers with scene formats of their own, as peers: `native.py pbrt|tungsten|povray`, see README.md."""

import glob
import os
import shutil
import subprocess
import tempfile
import time

import peer


def pbrt(arguments, scene, output, samples):
    """pbrt-v4; the size of the film is the scene's."""
    return [
        *("pbrt", "--quiet", "--nthreads", str(arguments.threads), "--seed", str(arguments.seed)),
        *("--spp", str(samples), "--outfile", output, scene),
    ]


def tungsten(arguments, scene, output, samples):
    """Tungsten, built with OpenEXR; the size of the film is the scene's."""
    return [
        *("tungsten", "--restart", "--threads", str(arguments.threads), "--seed", str(arguments.seed)),
        *("--spp", str(samples), "--hdr-output-file", output, scene),
    ]


def povray(arguments, scene, output, samples):
    """POV-Ray takes a square number of samples, the same ones in every run."""
    width, height = arguments.size
    return [
        *("povray", f"+I{scene}", f"+O{output}", "+FE", "-D", f"+W{width}", f"+H{height}"),
        *(f"+WT{arguments.threads}", "+A0.0", "+AM1", "-J", f"+R{round(samples ** 0.5)}"),
    ]


# Command, extension of its scenes, what prints its version, and the numbers of samples it can take.
RENDERERS = {
    "pbrt": (pbrt, ".pbrt", ["pbrt", "--version"], lambda i: 2**i),
    "tungsten": (tungsten, ".json", ["tungsten", "--version"], lambda i: 2**i),
    "povray": (povray, ".pov", ["povray", "--version"], lambda i: (i + 1) ** 2),
}


def find_scene(path, extension):
    """The scene in the renderer's own format: beside the XML, or in $CAUSTICA_PEER_SCENES."""
    name = os.path.splitext(os.path.basename(path))[0] + extension
    directories = [os.path.dirname(path), os.environ.get("CAUSTICA_PEER_SCENES", "")]
    found = [os.path.join(d, name) for d in directories if os.path.isfile(os.path.join(d, name))]
    if not found:
        peer.skip(f"there is no {name} beside the scene or in $CAUSTICA_PEER_SCENES")
    return os.path.abspath(found[0])


def version(command):
    """The first number with a dot in what the renderer says of its version."""
    said = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True).stdout
    words = [word.strip(",()") for word in said.split()]
    return next((word for word in words if "." in word and word.lstrip("v")[:1].isdigit()), "unknown")


def main():
    arguments = peer.parse_arguments()
    if len(arguments.words) != 1 or arguments.words[0] not in RENDERERS:
        raise SystemExit(f"usage: native.py {'|'.join(RENDERERS)} SCENE OUTDIR --budgets ...")
    (name,) = arguments.words
    command, extension, version_command, samples_of = RENDERERS[name]
    if shutil.which(name) is None:
        peer.skip(f"{name} is not on the PATH")
    scene = find_scene(arguments.scene, extension)
    peer.say(renderer=f"{name} {version(version_command)}", method="native", backend="cpu")
    # These programs end with their picture. So each one is a run of its own, with more samples than the last.
    budgets = list(arguments.budgets)
    outdir = tempfile.mkdtemp(dir=os.path.abspath(arguments.outdir))
    step, seconds, samples = 0, 0.0, 0
    while budgets:
        # Steps whose picture would come long before the budget need not be tried.
        while samples and seconds * samples_of(step) / samples < 0.9 * budgets[0]:
            step += 1
        samples = samples_of(step)
        output = os.path.join(outdir, f"{samples}.exr")
        began, cpu_began = time.perf_counter(), peer.cpu_time()
        done = subprocess.run(
            command(arguments, scene, output, samples), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        seconds, cpu_seconds = time.perf_counter() - began, peer.cpu_time() - cpu_began
        if done.returncode != 0 or not glob.glob(output):
            raise SystemExit(f"{name}: {done.stderr.decode(errors='replace').strip()[-300:] or 'made no EXR'}")
        step += 1
        if seconds >= budgets[0]:
            budgets = [budget for budget in budgets if budget > seconds]
            peer.say(
                seconds=seconds, cpu_seconds=cpu_seconds, load_seconds=0.0, passes=samples, image=output
            )


if __name__ == "__main__":
    main()
