"""Set-ups that differ, each with several experiments: they are what is compared, on a linear model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.statistics.estimator import Estimator, estimator
from softcal.calibration.statistics.intervals import box_intervals
from softcal.calibration.statistics.left_out import left_out

N, SET_UPS, EACH = 20, 4, 5
PLACES = np.linspace(0.1, 1.0, N)
SIGMA = 0.01
LOSS = LikelihoodLoss()
Z = np.array([0.5])
NAMES = [f"specimen{k}_weight{i}" for k in range(SET_UPS) for i in range(EACH)]
SERVES = {name: np.array([True]) for name in NAMES}


def blocks_with(own: np.ndarray, chance: np.random.Generator) -> tuple[list[Block], float]:
    """The blocks at the joint minimum, and that minimum less zero; own (SET_UPS, EACH): each experiment's parameter."""
    J = PLACES[:, None]
    noise = [SIGMA * chance.standard_normal(N) - PLACES * one for one in own.ravel()]
    step = float(np.linalg.lstsq(np.tile(J, (len(NAMES), 1)), -np.concatenate(noise), rcond=None)[0][0])
    blocks = [
        Block(name, "tension", np.full(N, 5.0), e + PLACES * step, SIGMA, J, set_up=name.partition("_")[0])
        for name, e in zip(NAMES, noise, strict=True)
    ]
    return blocks, step


def specimens(spread: float, seed: int) -> tuple[list[Block], float]:
    chance = np.random.default_rng([seed, 31])
    return blocks_with(np.repeat(spread * chance.standard_normal((SET_UPS, 1)), EACH, axis=1), chance)


def found_at(blocks: list[Block]) -> Estimator:
    return estimator(LOSS, Z, np.ones(1), blocks, SERVES)


def holds_zero(found: Estimator, step: float) -> bool:
    low, high = box_intervals(Z, found.minimum, found.root, found.dof)[0][0]
    return low <= Z[0] - step <= high


def test_experiments_of_one_set_up_are_one_of_those_that_differ() -> None:
    blocks, _ = specimens(0.08, seed=0)
    found = found_at(blocks)
    assert list(found.between[0].steps) == [f"specimen{k}" for k in range(SET_UPS)]
    assert found.between[0].effects.dof == SET_UPS - 1
    assert found.set_ups[NAMES[0]] == "specimen0"


@pytest.mark.long  # half a minute: many synthetic studies
def test_the_interval_holds_the_mean_of_specimens() -> None:
    """100 studies of four specimens with five weights each; without set-ups, the weights pass for 20 specimens."""
    held = {True: 0, False: 0}
    for seed in range(100):
        blocks, step = specimens(0.08, seed)
        for stated in held:
            given = blocks if stated else [replace(block, set_up="") for block in blocks]
            held[stated] += holds_zero(found_at(given), step)
    assert held[True] >= 90
    assert held[False] < 80


def test_alike_set_ups_leave_the_experiments_as_they_are() -> None:
    blocks, _ = specimens(0.0, seed=1)
    found = found_at(blocks)
    assert found.set_ups == {}
    assert list(found.between[0].steps) == NAMES


@pytest.mark.parametrize("set_up", ["", "all"])
def test_one_set_up_or_none_is_not_compared(set_up: str) -> None:
    chance = np.random.default_rng(3)
    blocks, _ = blocks_with(0.08 * chance.standard_normal((SET_UPS, EACH)), chance)
    found = found_at([replace(block, set_up=set_up) for block in blocks])
    assert list(found.between[0].steps) == NAMES


def test_an_experiment_is_predicted_without_its_whole_set_up() -> None:
    """The last specimen is the only soft one: no other specimen foretells it, though its own other weights do."""
    chance = np.random.default_rng(4)
    own = np.zeros((SET_UPS, EACH))
    own[-1] = -0.5
    own[:-1] += 0.05 * chance.standard_normal((SET_UPS - 1, 1))
    blocks, _ = blocks_with(own, chance)
    predicted = left_out(LOSS, Z, np.ones(1), blocks, SERVES, found_at(blocks))
    off = predicted[NAMES[-1]].rmse["tension"]
    assert off == pytest.approx(0.5 * np.sqrt(np.mean(PLACES**2)), rel=0.15)
