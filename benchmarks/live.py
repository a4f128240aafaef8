"""Steps of a live twin per second: the neck driven in a loop by one cable, on one thread."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from benchmarks.neck_case import PULL, standard_robot
from benchmarks.section import Goal, Section, run_alone
from benchmarks.timing import mkl_threads
from softcal.checks import Floats
from softcal.twin.live import LiveState, LiveTwin

GOALS = {"P1": 400.0, "P2P1": 60.0}  # [1/s]
PERIOD, SAMPLING = 4.0, 400.0  # [s] of the sine, [1/s]: at most 0.08 mm a step, 31 mm/s
WALK = 1e-4  # [m], standard deviation of a random step
SEED = 0


def measure(quick: bool) -> Section:
    n = 60 if quick else 800
    sine = 0.5 * PULL * (1.0 + 0.975 * np.sin(2.0 * np.pi * np.arange(n) / (PERIOD * SAMPLING)))
    walk = np.cumsum(np.random.default_rng(SEED).normal(0.0, WALK, n)) + 0.5 * PULL
    walk = PULL - np.abs(PULL - np.abs(walk))  # reflected at both ends
    header = ["element", "commands", "derivatives", "p50 [1/s]", "p99 [1/s]", "iterations a step",
              "factorisations a step", "by the load path"]  # fmt: skip
    rows: list[list[str]] = []
    goals: list[Goal] = []
    with mkl_threads(1):
        for element, goal in GOALS.items():
            live = LiveTwin(standard_robot(element))
            for name, commands in (("sine", sine), ("random walk", walk)):
                for derivatives in (False, True):
                    seconds, states, factorisations = _driven(live, commands, derivatives=derivatives)
                    told = "by the command" if derivatives else ""
                    rows.append([element, name, told, *_row(seconds, states, factorisations)])
                    what = (
                        f"Live twin, {element}, {name}{', with derivatives' * derivatives}: median step on one thread"
                    )
                    goals.append(Goal(what, 1e3 * float(np.median(seconds)), 1e3 / goal, "ms"))
    notes = [
        "Steps per second of processor time, channels included; p99: of the slowest step but one in a hundred, which "
        f"factorises. The cable's shortening goes through {1e3 * PULL:g} mm as a sine of {PERIOD:g} s at "
        f"{SAMPLING:g} Hz, and as a random walk of {1e3 * WALK:g} mm a step. The derivatives are predicted from those "
        "of the last states, and corrected by the kept factorisation to 1e-7. Goals: 400 steps a second with P1, 60 "
        "with P2P1, derivatives included."
    ]
    return Section("A twin in a loop", header, rows, goals, notes)


def _driven(live: LiveTwin, commands: Floats, *, derivatives: bool) -> tuple[Floats, list[LiveState], int]:
    """Processor times [s] of the steps to shortenings (n,) [m], their states, and the number of factorisations."""
    statics = live._steps.statics  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] (those of derivatives too)
    live.reset()
    for value in commands[0] + np.linspace(-1e-4, 0.0, 5):
        live.at({"front": value}).by_commands()
    seconds, before = list[float](), statics.n_factorisations
    states: list[LiveState] = []
    for value in commands.tolist():
        start = time.process_time()
        states.append(live.at({"front": value}))
        if derivatives:
            states[-1].by_commands()
        seconds.append(time.process_time() - start)
        if not states[-1].succeeded:
            raise RuntimeError(states[-1].status)
    return np.array(seconds), states, statics.n_factorisations - before


def _row(seconds: Floats, states: Sequence[LiveState], factorisations: int) -> list[str]:
    return [
        f"{1.0 / np.median(seconds):.0f}",
        f"{1.0 / np.quantile(seconds, 0.99):.0f}",
        f"{np.mean([state.n_iterations for state in states]):.1f}",
        f"{factorisations / len(states):.2f}",
        str(sum(state.n_iterations == 0 for state in states)),
    ]


if __name__ == "__main__":
    run_alone(measure)
