"""What is expected of one more test, against the calibration with that test among its data: on a linear model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.statistics.added_test import AddedChannel, AddedTest, ExpectedEstimates, with_added_test
from softcal.calibration.statistics.estimator import Estimator, estimator

N = 50
PLACES = np.linspace(0.02, 1.0, N)
# Two shared parameters, and an offset of each test's own; tension feels both, pitch the second one.
TENSION = np.column_stack([PLACES, PLACES**2])
PITCH = np.column_stack([np.zeros(N), 0.2 * np.sin(2 * PLACES)])
ROWS = {"tension": TENSION, "pitch": PITCH}
SIGMA = {"tension": 0.02, "pitch": 0.004}
LIKELIHOOD, PAPERS = LikelihoodLoss(), PapersLoss({"tension": 0.3, "pitch": 1.0})


def serves(k: int) -> dict[str, np.ndarray]:
    return {f"pull{i}": np.array([True, True, *(j == i for j in range(k))]) for i in range(k)}


def study(
    k: int,
    noise: list[dict[str, np.ndarray]],
    stated: dict[str, float],
    own: np.ndarray | None = None,
    loss: Loss = LIKELIHOOD,
    drift: np.ndarray | None = None,
) -> tuple[list[Block], Estimator]:
    """The blocks at the joint minimum of k tests, and the estimator there; own: each test's first parameter."""
    step = np.zeros(2 + k)
    for _ in range(100):
        blocks = []
        for i in range(k):
            for channel, rows in ROWS.items():
                offset = np.zeros((N, k))
                offset[:, i] = channel == "tension"
                J = np.column_stack([rows, offset])
                e = noise[i][channel] - (0.0 if own is None else own[i] * rows[:, 0])
                sigma, left = stated.get(channel, 0.0), e + J @ step
                blocks.append(Block(f"pull{i}", channel, 5.0 - left, left, sigma, J, drift=drift))
        weights = [loss.square_weights(one, one.residual) for one in blocks]
        A = sum(b.jacobian.T @ (w[:, None] * b.jacobian) for b, w in zip(blocks, weights, strict=True))
        change = np.linalg.solve(A, sum(b.jacobian.T @ (w * b.residual) for b, w in zip(blocks, weights, strict=True)))
        step -= change
        if np.abs(change).max() < 1e-9:
            break
    found = estimator(loss, np.full(2 + k, 0.5), np.ones(2 + k), blocks, serves(k) if k > 1 else None)
    return blocks, found


def drawn(k: int, seed: int, sigma: dict[str, float] = SIGMA) -> list[dict[str, np.ndarray]]:
    chance = np.random.default_rng(seed)
    return [{c: s * chance.standard_normal(N) for c, s in sigma.items()} for _ in range(k)]


def exact(k: int) -> list[dict[str, np.ndarray]]:
    """Residuals below the stated noise, which is then the one that counts."""
    return [{c: 0.9 * s * (-1.0) ** np.arange(N) for c, s in SIGMA.items()} for _ in range(k)]


def one_more(k: int, *, repeats: int = 1, drift: np.ndarray | None = None, **sigma: float) -> AddedTest:
    """The same test once more, after k of them."""
    channels = tuple(
        AddedChannel(
            c,
            np.column_stack([rows, np.zeros((N, k))]),
            np.full((N, 1), float(c == "tension")),
            (f"pull{k - 1}", c),
            sigma.get(c),
            drift=drift,
        )
        for c, rows in ROWS.items()
    )
    return AddedTest("next", channels, np.array([True, True, *([False] * k)]), np.zeros((0, 1)), repeats)


def expected(loss: Loss, k: int, blocks: list[Block], found: Estimator, added: AddedTest) -> ExpectedEstimates:
    return with_added_test(loss, blocks, np.ones(2 + k), serves(k) if k > 1 else {}, found, added)


def errors(one: ExpectedEstimates | Estimator) -> np.ndarray:
    return np.linalg.norm(one.root, axis=0)[:2]


@pytest.mark.parametrize("drift", [None, PLACES], ids=["steady", "a drift that the noise conceals"])
@pytest.mark.parametrize("repeats", [1, 3])
def test_it_is_the_calibration_with_the_test_among_its_data(repeats: int, drift: np.ndarray | None) -> None:
    blocks, found = study(2, exact(2), SIGMA, drift=drift)
    assert ("drift" in found.variances) == (drift is not None)
    told = expected(LIKELIHOOD, 2, blocks, found, one_more(2, repeats=repeats, drift=drift))
    _, after = study(2 + repeats, exact(2 + repeats), SIGMA, drift=drift)
    np.testing.assert_allclose(errors(told), errors(after), rtol=1e-6)
    assert np.all(errors(told) < errors(found))
    assert np.all(np.isinf(told.dof))


def test_closed_form_of_a_better_sensor() -> None:
    blocks, found = study(1, exact(1), SIGMA)
    told = expected(LIKELIHOOD, 1, blocks, found, one_more(1, pitch=SIGMA["pitch"] / 5))
    centred = TENSION - TENSION.mean(axis=0)  # the offsets of their own eliminated
    A = 2 * centred.T @ centred / SIGMA["tension"] ** 2 + (1 + 25) * PITCH.T @ PITCH / SIGMA["pitch"] ** 2
    np.testing.assert_allclose(errors(told), np.sqrt(np.diag(np.linalg.inv(A))), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("loss", [LIKELIHOOD, PAPERS], ids=["likelihood", "papers"])
def test_it_is_what_studies_find(loss: Loss) -> None:
    """The expected errors against the mean of those that the calibrations with another test state."""
    stated = SIGMA if loss is LIKELIHOOD else {}
    before, after = [], []
    for seed in range(40):
        blocks, found = study(2, drawn(2, seed), stated, loss=loss)
        before.append(errors(expected(loss, 2, blocks, found, one_more(2))))
        after.append(errors(study(3, drawn(3, seed), stated, loss=loss)[1]))
    np.testing.assert_allclose(np.mean(before, axis=0), np.mean(after, axis=0), rtol=0.05)


def test_where_the_tests_differ_more_samples_of_the_same_ones_bring_little() -> None:
    own = np.array([-0.2, 0.05, 0.1, 0.3])
    blocks, found = study(4, drawn(4, 0), SIGMA, own)
    assert found.between[0].effects.differs
    told = expected(LIKELIHOOD, 4, blocks, found, one_more(4))
    precise = expected(LIKELIHOOD, 4, blocks, found, one_more(4, tension=SIGMA["tension"] / 100))
    spread = found.between[0].effects.spread
    assert errors(found)[0] == pytest.approx(spread / 2, rel=0.05)
    assert errors(told)[0] == pytest.approx(spread / np.sqrt(5), rel=0.05)
    assert errors(precise)[0] == pytest.approx(spread / np.sqrt(5), rel=0.05)
    assert found.dof[0] == pytest.approx(3, rel=0.05)
    assert told.dof[0] == pytest.approx(4, rel=0.05)
    assert errors(expected(LIKELIHOOD, 4, blocks, found, one_more(4, repeats=5)))[0] == pytest.approx(
        spread / 3, rel=0.05
    )


def correlated(k: int, seed: int, rho: float = 0.95) -> list[dict[str, np.ndarray]]:
    chance = np.random.default_rng(seed)
    out = []
    for _ in range(k):
        held = {}
        for channel, s in SIGMA.items():
            e = chance.standard_normal(N)
            for i in range(1, N):
                e[i] = rho * e[i - 1] + np.sqrt(1 - rho**2) * e[i]
            held[channel] = s * e
        out.append(held)
    return out


def test_more_samples_of_a_correlated_record_bring_nothing() -> None:
    _, found = study(3, correlated(3, 1), SIGMA)
    assert any(one.process is not None for one in found.sources)
    once = one_more(3)
    dense = replace(
        once,
        channels=tuple(
            replace(c, answer=np.repeat(c.answer, 10, axis=0), own=np.repeat(c.own, 10, axis=0)) for c in once.channels
        ),
    )
    first, second = (expected(PAPERS, 3, *study(3, correlated(3, 1), {}, loss=PAPERS), one) for one in (once, dense))
    assert np.all(errors(second) > 0.9 * errors(first))
    white = study(3, drawn(3, 1), {}, loss=PAPERS)
    first, second = (expected(PAPERS, 3, *white, one) for one in (once, dense))
    assert np.all(errors(second) < 0.9 * errors(first))


def test_a_channel_that_the_loss_does_not_count_weighs_as_much_as_the_others() -> None:
    blocks, found = study(2, drawn(2, 3), {}, loss=PAPERS)
    added = one_more(2)
    roll = AddedChannel(
        "roll", np.column_stack([TENSION, np.zeros((N, 2))]), np.zeros((N, 1)), None, 0.02, counted=False
    )
    told = expected(PAPERS, 2, blocks, found, replace(added, channels=(*added.channels, roll)))
    assert np.all(errors(told) < errors(expected(PAPERS, 2, blocks, found, added)))


def test_a_prior_of_the_tests_own_parameter_counts() -> None:
    blocks, found = study(1, exact(1), SIGMA)
    added = one_more(1)
    known = expected(LIKELIHOOD, 1, blocks, found, replace(added, priors=np.array([[1e5]])))
    centred = TENSION - TENSION.mean(axis=0)
    A = (centred.T @ centred + TENSION.T @ TENSION) / SIGMA["tension"] ** 2 + 2 * PITCH.T @ PITCH / SIGMA["pitch"] ** 2
    np.testing.assert_allclose(errors(known), np.sqrt(np.diag(np.linalg.inv(A))), rtol=1e-4)
