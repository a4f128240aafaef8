"""Times of several things side by side, so that whatever else the machine does slows all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager

import numpy as np

from softcal.checks import Floats


def interleaved(
    things: Mapping[str, Callable[[], object]], *, repeats: int, seconds: float = 60.0
) -> dict[str, Floats]:
    """Wall times [s] by name, one of each per round, for `repeats` rounds or until `seconds` are over (three at least).

    One round goes before, uncounted: it compiles and warms up.
    """
    for thing in things.values():
        thing()
    times: dict[str, list[float]] = {name: [] for name in things}
    end = time.perf_counter() + seconds
    for done in range(repeats):
        if done >= 3 and time.perf_counter() > end:
            break
        for name, thing in things.items():
            start = time.perf_counter()
            thing()
            times[name].append(time.perf_counter() - start)
    return {name: np.array(values) for name, values in times.items()}


@contextmanager
def mkl_threads(n: int) -> Generator[None]:
    """MKL with n threads."""
    from pypardiso import PyPardisoSolver

    mkl = PyPardisoSolver().libmkl
    before = int(mkl.mkl_get_max_threads())
    mkl.MKL_Set_Num_Threads(n)
    try:
        yield
    finally:
        mkl.MKL_Set_Num_Threads(before)


def milliseconds(seconds: float) -> str:
    """Three digits."""
    return f"{1e3 * seconds:.3g}"
