"""Calibrations whose intervals are known: of a twin that is linear in its parameters, and of a curved one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from fake_twin import NU, STEADY, E, fake_experiment, fake_robot, fake_simulate

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.run import calibrate
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot

TRUE = {E: 2.3e6, NU: 0.40}
SIGMA = {"tension": 0.5, "pitch": 0.01}
REACH = 0.04
STATED = {"tension": 10.0, "pitch": 0.2}  # more than the noise: it is not estimated


def linear_simulate(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    """tension = 1e-5 E x + 20 nu x^2, pitch = 0.5 nu x, with x the shortening over its reach."""
    values = parameter_values(robot, theta)
    d = protocol.commands["front"].values
    x = d / REACH
    channels = {
        "front.shortening": d,
        "front.tension": 1e-5 * values[E] * x + 20 * values[NU] * x**2,
        "plate.pitch": 0.5 * values[NU] * x,
    }
    by = {"front.tension": {E: 1e-5 * x, NU: 20 * x**2}, "plate.pitch": {E: np.zeros_like(x), NU: 0.5 * x}}
    return Response(
        channels,
        {"front.shortening": "m", "front.tension": "N", "plate.pitch": "rad"},
        "All samples were reached.",
        succeeded=True,
        n_factorisations=1,
        sensitivities={channel: {name: held[name] for name in sensitivities} for channel, held in by.items()},
        slopes={name: np.ones_like(x) for name in channels},
    )


def linear_problem(
    loss: Loss,
    *,
    names: Sequence[str] = ("pull",),
    n: int = 40,
    seed: int = 0,
    noise: float = 1.0,
    ratios: tuple[float, float] = (0.1, 0.49),
    correlation: float = 0.0,
    spread: float = 0.0,
    prior: tuple[float, float] | None = None,
    settings: Mapping[str, float] = STEADY,
    drift: float = 0.0,
) -> Problem:
    """Experiments with noise of `noise` times its stated size; spread [Pa]: of E between them; prior [Pa]: of E.

    drift: of all channels, from the first sample to the last, in stated sizes of the noise.
    """
    chance = np.random.default_rng(seed)
    experiments = []
    for name in names:
        shortening = np.linspace(0.0, REACH, n)
        true = {**TRUE, E: TRUE[E] + spread * chance.standard_normal()}
        seen = linear_simulate(fake_robot(), Protocol({"front": Command("shortening", shortening)}), true)
        channels = {"shortening": Channel(shortening, "m", 0.0)}
        for kind, unit, channel in (("tension", "N", "front.tension"), ("pitch", "rad", "plate.pitch")):
            values = chance.standard_normal(n)
            for i in range(1, n):
                values[i] = correlation * values[i - 1] + np.sqrt(1 - correlation**2) * values[i]
            error = noise * values + drift * np.linspace(0.0, 1.0, n)
            measured = seen.channels[channel] + SIGMA[kind] * error
            channels[kind] = Channel(measured, unit, SIGMA[kind])
        experiments.append(Experiment(name, Dataset(name, channels), "front", "plate", settings=settings))
    mean, sd = prior or (None, None)
    free = [
        FreeParameter(E, "Pa", 1.0e6, 4.0e6, prior_mean=mean, prior_sd=sd),
        FreeParameter(NU, "1", *ratios),
    ]
    return make_problem(fake_robot(), experiments, free, loss, linear_simulate)


def curved(loss: Loss | None = None) -> Problem:
    """Few samples with much noise: the fake twin is far from linear over its intervals."""
    experiment = fake_experiment(noise=0.08, sigma=0.08, n_samples=12, slack=2e-3, seed=3, settings=STEADY)
    free = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log"),
        FreeParameter(NU, "1", 0.05, 0.4999),
        FreeParameter("front.slack", "m", 0.0, 6e-3),
    ]
    return make_problem(fake_robot(), [experiment], free, loss or LikelihoodLoss(STATED), fake_simulate)


def values(problem: Problem) -> dict[str, float]:
    result = calibrate(problem)
    assert result.converged
    return {label: e.value for label, e in result.parameters.items()}
