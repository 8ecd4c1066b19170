"""What every peer does alike: the command line, the clock, and the lines that `caustica bench` reads."""

import argparse
import json
import os
import resource
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


def cpu_time():
    """Seconds that processors have worked for this process and for its children that have ended."""
    usages = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


class Clock:
    """Wall and CPU time since loading began, less what single pictures took, and what is due by it."""

    def __init__(self, arguments):
        self.budgets = list(arguments.budgets)
        self.outdir = arguments.outdir
        self.pictures = 0
        self.load_seconds = 0.0
        self.start = time.perf_counter()
        self.cpu_start = cpu_time()

    def seconds(self):
        return time.perf_counter() - self.start

    def cpu_seconds(self):
        return cpu_time() - self.cpu_start

    def loaded(self):
        """Note that the scene is ready to be rendered."""
        self.load_seconds = self.seconds()

    def running(self):
        """Whether a budget is still ahead."""
        return bool(self.budgets)

    def remaining(self):
        """Seconds to the next budget; negative when it has passed."""
        return self.budgets[0] - self.seconds()

    def picture(self, passes, write, make=lambda: None):
        """If a budget has passed, report a picture: what `make()` returns, which `write(path, made)` puts into a file.

        Making it counts for this picture and for no other, writing it for none.
        """
        if not self.running() or self.remaining() > 0:
            return
        pause, cpu_pause = time.perf_counter(), cpu_time()
        made = make()
        seconds, cpu_seconds = self.seconds(), self.cpu_seconds()
        # Making it may have outlasted further budgets.
        self.budgets = [budget for budget in self.budgets if budget > seconds]
        self.pictures += 1
        path = os.path.join(self.outdir, f"{self.pictures}.exr")
        write(path, made)
        say(
            seconds=seconds,
            cpu_seconds=cpu_seconds,
            load_seconds=self.load_seconds,
            passes=passes,
            image=path,
        )
        self.start += time.perf_counter() - pause
        self.cpu_start += cpu_time() - cpu_pause
