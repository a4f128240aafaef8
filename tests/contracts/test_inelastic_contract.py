"""What every part of a material beyond its elastic law must keep: exact tangents and rates, one result at a sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.materials.components import PAIRS
from softcal.materials.flow import Flow
from softcal.materials.inelastic import History, PointRates, Stressed
from softcal.materials.isochoric import YEOH
from softcal.materials.law import compile_law
from softcal.materials.maxwell import Maxwell
from softcal.materials.relaxation import Relaxation
from softcal.materials.softening import Softening
from softcal.materials.stress_at import Deformation, points

HISTORIES = {
    "relaxation": History((Relaxation(2),)),
    "softening": History((Softening(),)),
    "maxwell": History((Maxwell(2),)),
    "flow": History((Flow(),)),
    "flow at once": History((Flow(at_once=True),)),
    "all": History((Softening(), Relaxation(1), Maxwell(1), Flow())),
}
every_history = pytest.mark.parametrize("history", HISTORIES.values(), ids=HISTORIES)
LAW = compile_law(YEOH)
VALUES = {
    "relaxing_share1": 0.3, "relaxation_time1": 1.5, "relaxing_share2": 0.1, "relaxation_time2": 20.0,
    "softening_amount": 1.8, "softening_energy": 0.02, "softening_range": 0.2,
    "branch_modulus1": 0.4, "branch_time1": 1.1, "branch_modulus2": 0.2, "branch_time2": 15.0, "branch_exponent": 1.3,
    "flow_modulus": 0.3, "flow_threshold": 0.05, "flow_time": 2.0,
}  # fmt: skip
C = (0.2, 0.05, 0.01, 5.0)  # of the law


def stressed(F: np.ndarray, law: tuple[float, ...] = C) -> Stressed:
    """The elastic law at F (3, 3)."""
    of = Deformation(LAW, points(F[None]))
    S, D = of.stress(law)
    E = 0.5 * (F.T @ F - np.eye(3))
    strain = np.array([[E[i, j] * (1.0 if i == j else 2.0) for i, j in PAIRS]])
    return Stressed(strain, of.energy(law), S, D)


def strained(F: np.ndarray, k: int, h: float) -> np.ndarray:
    i, j = PAIRS[k]
    dE = np.zeros((3, 3))
    dE[i, j] += 0.5 * h
    dE[j, i] += 0.5 * h
    return F + np.linalg.inv(F).T @ dE


def way(seed: int, n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [np.eye(3) + 0.35 * rng.uniform(-1.0, 1.0, (3, 3)) for _ in range(n)]


seeds = st.integers(0, 10_000)
steps = st.sampled_from([0.0, 0.01, 0.7, 30.0, np.inf])


@every_history
@settings(max_examples=25, deadline=None)
@given(seeds, steps)
def test_stress_and_tangent_are_those_of_a_potential(history: History, seed: int, dt: float) -> None:
    before, here = way(seed, 2)
    memory = history.respond(stressed(before), np.zeros((1, history.size)), 0.4, VALUES).memory
    at = history.respond(stressed(here), memory, dt, VALUES).at
    h = 1e-6
    for k in range(6):
        up, down = (history.respond(stressed(strained(here, k, s * h)), memory, dt, VALUES).at for s in (1, -1))
        assert at.S[0, k] == pytest.approx((up.W[0] - down.W[0]) / (2 * h), rel=1e-5, abs=1e-6)
        np.testing.assert_allclose(at.D[0, :, k], (up.S[0] - down.S[0]) / (2 * h), rtol=1e-4, atol=2e-5)
    np.testing.assert_allclose(at.D[0], at.D[0].T, rtol=1e-9, atol=1e-12)


@every_history
@settings(max_examples=25, deadline=None)
@given(seeds, steps)
def test_the_new_memory_leaves_the_stress_as_it_was(history: History, seed: int, dt: float) -> None:
    before, here = way(seed, 2)
    memory = history.respond(stressed(before), np.zeros((1, history.size)), 0.4, VALUES).memory
    at, left = history.respond(stressed(here), memory, dt, VALUES)
    again, same = history.respond(stressed(here), left, 0.0, VALUES)
    np.testing.assert_allclose(again.S, at.S, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(same, left, rtol=1e-12, atol=1e-14)


@every_history
@settings(max_examples=25, deadline=None)
@given(seeds, st.sampled_from([0.3, 5.0, np.inf]))
def test_rates_are_exact(history: History, seed: int, dt: float) -> None:
    """By the strain, the memory, the constants and the law's own, all at once."""
    rng = np.random.default_rng(seed)
    before, here = way(seed, 2)
    memory = history.respond(stressed(before), np.zeros((1, history.size)), 0.4, VALUES).memory
    names = [one.name for part in history.parts for one in part.parameters]
    changes = {name: VALUES[name] * rng.uniform(-1.0, 1.0) for name in names}
    H, m = rng.uniform(-0.5, 0.5, (3, 3)), rng.uniform(-0.05, 0.05, memory.shape)

    def at(s: float):
        law = (C[0] * (1.0 + s), *C[1:])
        values = {name: VALUES[name] + s * changes.get(name, 0.0) for name in VALUES}
        return history.respond(stressed(here + s * H, law), memory + s * m, dt, values)

    elastic, h = stressed(here), 1e-6
    up, down = stressed(here + h * H, (C[0] * (1 + h), *C[1:])), stressed(here - h * H, (C[0] * (1 - h), *C[1:]))
    by = PointRates(*((getattr(up, name) - getattr(down, name)) / (2 * h) for name in ("E", "W", "S")))
    rates, kept = history.rates(elastic, by, (memory, m), dt, (VALUES, changes))
    plus, minus = at(h), at(-h)
    np.testing.assert_allclose(rates.S, (plus.at.S - minus.at.S) / (2 * h), rtol=2e-5, atol=2e-6)
    np.testing.assert_allclose(kept, (plus.memory - minus.memory) / (2 * h), rtol=2e-5, atol=2e-6)


@every_history
def test_rates_by_several_constants_at_once_are_those_by_each(history: History) -> None:
    """A rate of a constant may be another one at each point."""
    before, here = way(3, 2)
    memory = history.respond(stressed(before), np.zeros((1, history.size)), 0.4, VALUES).memory
    names = [one.name for part in history.parts for one in part.parameters]
    n, at = len(names), stressed(here)
    repeated = Stressed(*(np.repeat(one, n, axis=0) for one in at))
    still = PointRates(*(np.zeros_like(one) for one in repeated[:3]))
    own = np.repeat(memory, n, axis=0)
    unit = {name: np.eye(n)[k] for k, name in enumerate(names)}
    together = history.rates(repeated, still, (own, np.zeros_like(own)), 0.7, (VALUES, unit))
    alone = PointRates(*(one[:1] for one in still))
    for k, name in enumerate(names):
        rates, kept = history.rates(at, alone, (memory, np.zeros_like(memory)), 0.7, (VALUES, {name: 1.0}))
        np.testing.assert_allclose(together[0].S[k], rates.S[0], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(together[1][k], kept[0], rtol=1e-12, atol=1e-14)


@every_history
def test_at_rest_there_is_no_stress_and_no_memory(history: History) -> None:
    at, left = history.respond(stressed(np.eye(3)), np.zeros((1, history.size)), 1.0, VALUES)
    np.testing.assert_allclose(at.S, 0.0, atol=1e-15)
    np.testing.assert_allclose(left, 0.0, atol=1e-15)


@every_history
@settings(max_examples=20, deadline=None)
@given(seeds)
def test_no_energy_is_made_in_a_closed_cycle(history: History, seed: int) -> None:
    """From rest along a way and back again: the work of the stress, by the trapezoidal rule, is not below zero."""
    rng = np.random.default_rng(seed)
    H = rng.uniform(-0.4, 0.4, (3, 3))
    memory, work, last = np.zeros((1, history.size)), 0.0, stressed(np.eye(3))
    last_S = np.zeros((1, 6))
    for s in [*np.linspace(0, 1, 60)[1:], *np.linspace(1, 0, 60)[1:]]:
        now = stressed(np.eye(3) + s * H)
        at, memory = history.respond(now, memory, 0.1, VALUES)
        work += float(0.5 * ((at.S + last_S) * (now.E - last.E)).sum())
        last, last_S = now, at.S
    assert work > -1e-5
