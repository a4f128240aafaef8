"""Moduli of soft robots from any start in the bounds, whatever the bounds of the rig's parameters are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from soft_robots import (
    FINGER_E,
    LENGTH,
    TENTACLE_E,
    begun_at,
    finger_problem,
    tentacle_problem,
)

from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.problem import Problem
from softcal.calibration.run import calibrate

LIMIT = 12  # trajectories, of all loads together


def starts(size: int, *, seed: int, randoms: int) -> list[tuple[float, ...]]:
    """The first and the last corner of the unit box, and random points."""
    chance = np.random.default_rng(seed)
    return [(0.0,) * size, (1.0,) * size, *(tuple(chance.random(size)) for _ in range(randoms))]


def found(problem: Problem, name: str, start: Sequence[float], true: float) -> None:
    result = calibrate(begun_at(problem, start), starts=1)
    where = f"from {np.round(start, 3).tolist()}: {result.status}"
    assert result.parameters[name].value == pytest.approx(true, rel=0.05), where
    assert len(result.trials) <= LIMIT, where
    assert "Converged" in result.status, where


@pytest.mark.long  # ten seconds each
@pytest.mark.parametrize(
    "loss", [pytest.param(LikelihoodLoss(), marks=pytest.mark.long), DistanceLoss(LENGTH)], ids=lambda loss: loss.name
)
def test_a_tentacle_400_mm_before_a_camera(loss: Loss) -> None:
    problem = tentacle_problem(loss)
    for start in starts(problem.space.size, seed=1, randoms=0):
        found(problem, "tentacle.youngs_modulus", start, TENTACLE_E)


@pytest.mark.long
@pytest.mark.parametrize(
    "loss", [LikelihoodLoss(), pytest.param(PapersLoss(), marks=pytest.mark.long)], ids=lambda loss: loss.name
)
def test_a_finger_on_instruments_whose_offsets_have_one_sign(loss: Loss) -> None:
    problem = finger_problem(loss)
    for start in starts(problem.space.size, seed=2, randoms=1):
        found(problem, "finger.youngs_modulus", start, FINGER_E)


@pytest.mark.slow
def test_a_force_in_the_wrong_unit_leaves_no_search_at_its_start() -> None:
    """mN read as N: nothing fits, and the misfit of the force must not make every start look like the minimum."""
    problem = finger_problem(LikelihoodLoss(), nu=(0.3, 0.499))
    (test,) = problem.experiments
    channels = dict(test.dataset.channels)
    channels["tension"] = replace(channels["tension"], values=1e3 * channels["tension"].values)
    wrong = replace(problem, experiments=(replace(test, dataset=replace(test.dataset, channels=channels)),))
    results = [calibrate(begun_at(wrong, (z, 0.5, 0.5, 0.9)), starts=1) for z in (0.02, 0.5)]
    assert results[0].loss == pytest.approx(results[1].loss, rel=1e-6), [result.status for result in results]
    assert all(result.parameters["finger.youngs_modulus"].at_bound for result in results)


@pytest.mark.long
def test_a_tentacle_from_any_start() -> None:
    """Six random starts in the bounds, under each loss, each with noise of its own."""
    for k, start in enumerate(starts(7, seed=3, randoms=6)[2:]):
        for loss in (LikelihoodLoss(), DistanceLoss(LENGTH)):
            found(tentacle_problem(loss, seed=k), "tentacle.youngs_modulus", start, TENTACLE_E)


@pytest.mark.long
def test_a_finger_from_any_start() -> None:
    """Six random starts in the bounds, under each loss, each with noise of its own."""
    for k, start in enumerate(starts(3, seed=4, randoms=6)[2:]):
        for loss in (LikelihoodLoss(), PapersLoss()):
            found(finger_problem(loss, seed=k), "finger.youngs_modulus", start, FINGER_E)
