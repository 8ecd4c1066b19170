#!/usr/bin/env python3
"""Times renders with and without the skipping of stages that a scene does not need, and prints a table.

    python3 bench/skipping/measure.py [--program PATH] [--runs N]

Runs alternate, so that whatever else the machine does meets both alike; the table shows medians of the seconds that
rendering took, and of those of the stages.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", default=ROOT / "target/release/caustica", type=pathlib.Path)
    parser.add_argument("--runs", default=9, type=int)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        subprocess.run([sys.executable, HERE / "untextured.py", folder], check=True)
        cases = [
            ("cornell-diffuse", ROOT / "scenes/cornell-diffuse.xml", "photonmap", 16),
            ("mirrors only", HERE / "mirrors.xml", "photonmap", 16),
            ("untextured", folder / "untextured.xml", "photonmap", 8),
            ("untextured, `path`", folder / "untextured.xml", "path", 16),
        ]
        print("| scene | passes | everything: s (photons, maps, eye) | skipped: s (photons, maps, eye) | ratio |")
        print("|---|---|---|---|---|")
        for name, scene, integrator, passes in cases:
            times = {"false": [], "true": []}
            for _ in range(args.runs):
                for skip, runs in times.items():
                    stats = folder / "stats.json"
                    command = [args.program, "render", scene, "--integrator", integrator]
                    command += ["--passes", str(passes), "--set", f"skip={skip}"]
                    command += ["-o", folder / "image.exr", "--stats", stats, "-q"]
                    subprocess.run(command, check=True)
                    seconds = json.loads(stats.read_text())["seconds"]
                    stages = [seconds[stage] for stage in ("photons", "maps", "eye")]
                    runs.append([sum(stages), *stages])
            medians = {skip: [statistics.median(column) for column in zip(*runs)] for skip, runs in times.items()}
            cells = ["{:.3f} ({:.3f}, {:.3f}, {:.3f})".format(*medians[skip]) for skip in ("false", "true")]
            ratio = medians["false"][0] / medians["true"][0]
            print(f"| {name} | {passes} | {cells[0]} | {cells[1]} | {ratio:.2f} |", flush=True)


main()
