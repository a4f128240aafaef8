"""The wall time of `softcal --help`."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from benchmarks.section import Goal, Section, run_alone
from benchmarks.timing import interleaved

LIMIT = 0.5
REPEATS = 5


def measure(quick: bool) -> Section:
    command = shutil.which("softcal", path=str(Path(sys.executable).parent))
    if command is None:
        raise RuntimeError("the command softcal is not installed beside this Python")
    commands = {
        "`softcal --help`": [command, "--help"],
        "`import softcal`": [sys.executable, "-c", "import softcal"],
        "Python alone": [sys.executable, "-c", "pass"],
    }
    times = interleaved(
        {
            name: lambda words=words: subprocess.run(words, check=True, capture_output=True)
            for name, words in commands.items()
        },
        repeats=REPEATS,
    )
    rows = [[name, f"{np.median(t):.3f}", f"{t.min():.3f}", f"{t.max():.3f}"] for name, t in times.items()]
    goal = Goal("softcal --help", float(np.median(times["`softcal --help`"])), LIMIT, "s")
    notes = [f"Seconds, {REPEATS} runs each in turn after one that warms the file cache."]
    return Section("Start-up", ["command", "median", "fastest", "slowest"], rows, [goal], notes)


if __name__ == "__main__":
    run_alone(measure)
