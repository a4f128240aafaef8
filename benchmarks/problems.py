"""Inverse problems of the neck whose answer is known: what the twin itself would have been measured to do."""

from __future__ import annotations

import numpy as np

from benchmarks.neck_case import PITCH, PULL, TENSION, pull
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

E, NU = "neck.youngs_modulus", "neck.poissons_ratio"
N_SAMPLES = 100
SIGMA_TENSION, SIGMA_PITCH = 0.05, 3e-3  # [N], [rad]
BOUNDS = ((0.1e6, 40e6), (0.4, 0.4999))  # paper A's


def known_problem(robot: Robot, *, noise: bool, start: tuple[float, float] | None = None, log: bool = True) -> Problem:
    """Tension and pitch over a pull of 40 mm by `robot` as it is; E and nu free within paper A's bounds.

    log: whether E is searched on a log scale. start: where a local search begins.
    """
    shortening = np.linspace(0.0, PULL, N_SAMPLES)
    seen = simulate(robot, pull(shortening))
    if not seen.succeeded:
        raise RuntimeError(seen.status)
    chance = np.random.default_rng(0)
    sigmas = (SIGMA_TENSION, SIGMA_PITCH) if noise else (0.0, 0.0)
    tension, pitch = (
        seen.channels[name] + sigma * chance.standard_normal(N_SAMPLES)
        for name, sigma in zip((TENSION, PITCH), sigmas, strict=True)
    )
    channels = {
        "shortening": Channel(shortening, "m"),
        "tension": Channel(tension, "N", SIGMA_TENSION),
        "pitch": Channel(pitch, "rad", SIGMA_PITCH),
    }
    experiment = Experiment("pull", Dataset("pull", channels), cable="front", plate="plate")
    (E_low, E_high), (nu_low, nu_high) = BOUNDS
    E_start, nu_start = start or (None, None)
    parameters = [
        FreeParameter(E, "Pa", E_low, E_high, scale="log" if log else "linear", start=E_start),
        FreeParameter(NU, "1", nu_low, nu_high, start=nu_start),
    ]
    return make_problem(robot, [experiment], parameters)
