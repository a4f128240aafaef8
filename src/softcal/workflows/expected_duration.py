"""Expected duration of a calibration by another engine, estimated from one timed simulation."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

from softcal.calibration.problem.problem import Problem
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.search.settings import SearchSettings
from softcal.errors import SimulationError

# Typical fewest and most points at which an experiment's own rig values are fitted.
_POINTS_HELD_OUT = (2, 6)


@dataclass(frozen=True)
class Expected:
    """Expected cost of a calibration.

    Attributes
    ----------
    seconds
        Duration of one simulation [s].
    simulations
        Fewest and most simulations of the search.
    held_out
        Fewest and most simulations for predictions of held-out experiments.
    workers
        Number of processes of the search.
    """

    seconds: float
    simulations: tuple[int, int]
    held_out: tuple[int, int] = (0, 0)
    workers: int = 1

    @property
    def duration(self) -> tuple[float, float]:
        """Shortest and longest [s]; predictions run in one process."""
        low, high = (
            self.seconds * (search / self.workers + predictions)
            for search, predictions in zip(self.simulations, self.held_out, strict=True)
        )
        return low, high


def expected_duration(problems: Mapping[str, Problem], settings: SearchSettings, workers: int = 1) -> Expected:
    """Time one simulation at the start values, and estimate the number of simulations of the calibrations.

    Parameters
    ----------
    problems
        Label -> problem, with the engine that simulates; see `softcal.workflows.calibration.plan`.
    settings
        Settings of the calibration.
    workers
        Number of processes.

    Raises
    ------
    SimulationError
        Where the engine cannot simulate the twin at the start values.
    """
    first = next(iter(problems.values()))
    if first.simulate is None:
        raise ValueError("softcal's own twin takes no time worth telling")
    protocol, theta = first.first_trajectory()
    began = time.perf_counter()
    response = first.simulate(first.robot, protocol, theta)
    seconds = time.perf_counter() - began
    if not response.succeeded:
        raise SimulationError(f"The twin at the start values: {response.status}")
    optimiser = OPTIMISERS.named(settings.method)
    budget = optimiser.settled(settings).trials or 0
    points = optimiser.expected or (budget, budget)
    search, held_out = [0, 0], [0, 0]
    for problem in problems.values():
        names = [e.name for e in problem.experiments]
        fitted = problem.only([name for name in names if name not in settings.hold_out])
        for end in (0, 1):
            search[end] += points[end] * fitted.n_simulations(jacobian=optimiser.needs_jacobian)
        for name in (name for name in names if name in settings.hold_out):
            alone = problem.alone(name)
            own = any(p.label not in fitted.space.labels for p in alone.space.parameters)
            for end in (0, 1):
                held_out[end] += (_POINTS_HELD_OUT[end] if own else 1) * alone.n_simulations()
    shared = workers if optimiser.in_parallel else 1
    return Expected(seconds, (search[0], search[1]), (held_out[0], held_out[1]), shared)
