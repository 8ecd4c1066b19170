"""What every peer does alike: the command line, the clock, and the lines that `caustica bench` reads."""

import argparse
import json
import os
import sys
import time


def parse_arguments():
    """The arguments that `caustica bench` appends to a peer's command; words before them are the peer's own."""
    parser = argparse.ArgumentParser()
    parser.add_argument("words", nargs="*", help="the peer's own words, then SCENE and OUTDIR")
    parser.add_argument("--budgets", required=True, type=lambda text: sorted(map(float, text.split(","))))
    parser.add_argument("--size", required=True, type=lambda text: tuple(map(int, text.split("x"))))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("-D", dest="defines", action="append", default=[], metavar="NAME=VALUE")
    arguments = parser.parse_args()
    if len(arguments.words) < 2:
        parser.error("SCENE and OUTDIR are missing")
    *arguments.words, arguments.scene, arguments.outdir = arguments.words
    arguments.defines = dict(define.split("=", 1) for define in arguments.defines)
    os.makedirs(arguments.outdir, exist_ok=True)
    return arguments


def say(**line):
    """Print one line of JSON at once: the reader may stop us when it has seen enough."""
    print(json.dumps(line), flush=True)


def skip(reason):
    """Say why this peer cannot do the job, which is no error, and end."""
    say(skipped=reason)
    sys.exit(0)


class Clock:
    """The wall time since loading began, less the time spent on writing pictures, and what is due by it."""

    def __init__(self, arguments):
        self.budgets = list(arguments.budgets)
        self.outdir = arguments.outdir
        self.pictures = 0
        self.load_seconds = 0.0
        self.start = time.perf_counter()

    def seconds(self):
        return time.perf_counter() - self.start

    def loaded(self):
        """Note that the scene is ready to be rendered."""
        self.load_seconds = self.seconds()

    def running(self):
        """Whether a budget is still ahead."""
        return bool(self.budgets)

    def remaining(self):
        """Seconds to the next budget; negative when it has passed."""
        return self.budgets[0] - self.seconds()

    def picture(self, passes, write, seconds=None):
        """If a budget has passed, call `write(path)` off the clock and report the picture.

        `seconds` is when the picture was there, if that was before now.
        """
        seconds = self.seconds() if seconds is None else seconds
        if not self.running() or seconds < self.budgets[0]:
            return
        while self.running() and self.budgets[0] <= seconds:
            self.budgets.pop(0)
        self.pictures += 1
        path = os.path.join(self.outdir, f"{self.pictures}.exr")
        pause = time.perf_counter()
        write(path)
        say(seconds=seconds, load_seconds=self.load_seconds, passes=passes, image=path)
        self.start += time.perf_counter() - pause
