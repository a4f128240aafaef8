"""Maxwell branches at large strains: closed forms, equal stretches, directions."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.checks import Floats
from softcal.materials.components import TWICE, doubled, full
from softcal.materials.inelastic import Stressed
from softcal.materials.maxwell import Maxwell
from softcal.materials.strain_measure import MeasuredStrain

MU, TAU = np.array([3e5, 1e5]), np.array([0.5, 8.0])


def constants(m: float) -> dict[str, float]:
    values = {f"branch_{kind}{i + 1}": float(of[i]) for kind, of in (("modulus", MU), ("time", TAU)) for i in range(2)}
    return {**values, "branch_exponent": m}


def green(F: Floats) -> Floats:
    return doubled(0.5 * (np.swapaxes(F, 1, 2) @ F - np.eye(3)))


def stresses(F: Floats, times: Floats, m: float) -> Floats:
    """S (n, 6) of the branches alone along a way from rest at time 0."""
    part, memory, out = Maxwell(2), np.zeros((1, 18)), list[Floats]()
    for E, dt in zip(green(F), np.diff(times, prepend=0.0), strict=True):
        alone = Stressed(E[None], np.zeros(1), np.zeros((1, 6)), np.zeros((0, 6, 6)))
        at, memory = part.respond(alone, memory, float(dt), constants(m))
        out.append(at.S[0])
    return np.array(out)


def sheared(gamma: Floats) -> Floats:
    F = np.tile(np.eye(3), (len(gamma), 1, 1))
    F[:, 0, 1] = gamma
    return F


def planar(strain: Floats) -> Floats:
    return np.exp(strain)[:, None, None] ** np.array([1.0, -1.0, 0.0])[:, None] * np.eye(3)


@pytest.mark.parametrize("m", [0.0, 0.6, 1.0, 2.0])
def test_a_large_shear_that_is_held_relaxes_as_the_branches_say(m: float) -> None:
    """Nominal stress at once: that of the energy 2 mu sinh(m x)^2 / m^2 with sinh x = gamma / 2."""
    gamma, t = 10.0, np.concatenate([[0.0], np.geomspace(1e-3, 50.0, 12)])
    S = stresses(sheared(np.full(len(t), gamma)), t, m)
    x = np.arcsinh(0.5 * gamma)
    once = (np.sinh(2.0 * m * x) / m if m else 2.0 * x) / np.sqrt(1.0 + 0.25 * gamma**2)
    expected = once * (MU * np.exp(-t[:, None] / TAU)).sum(axis=1)
    np.testing.assert_allclose(S[:, 3] + gamma * S[:, 1], expected, rtol=1e-10)


@pytest.mark.parametrize("n", [3, 30])
def test_a_constant_rate_of_the_logarithmic_strain_is_the_closed_form(n: int) -> None:
    """Planar tension to a stretch of 20, by few samples and by many: the difference of the true stresses."""
    t = np.linspace(0.0, 3.0, n + 1)[1:]
    F = planar(t)
    S = stresses(F, t, 0.0)
    got = F[:, 0, 0] ** 2 * S[:, 0] - F[:, 1, 1] ** 2 * S[:, 1]
    np.testing.assert_allclose(got, 4.0 * (MU * TAU * (1.0 - np.exp(-t[:, None] / TAU))).sum(axis=1), rtol=1e-10)


@pytest.mark.parametrize("omega", [0.02, 0.2, 2.0, 20.0])
def test_storage_and_loss_modulus(omega: float) -> None:
    """Over three decades, at the end of a small oscillation; a row has the mean rate since the row before, so that it
    lags by half of that time.
    """
    n, periods = 1600 if omega < 1.0 else 64, max(3, int(np.ceil(60.0 * omega / (2.0 * np.pi))))
    t = np.linspace(0.0, periods * 2.0 * np.pi / omega, periods * n + 1)[1:]
    S = stresses(sheared(1e-4 * np.sin(omega * t)), t, 1.0)[-n:, 3] / 1e-4
    last, w = omega * t[-n:], (omega * TAU) ** 2
    storage, loss = float((MU * w / (1.0 + w)).sum()), float((MU * omega * TAU / (1.0 + w)).sum())
    lag = (np.pi / n) * np.hypot(storage, loss)
    assert 2.0 * np.mean(S * np.sin(last)) == pytest.approx(storage, abs=lag)
    assert 2.0 * np.mean(S * np.cos(last)) == pytest.approx(loss, abs=lag)


def test_a_body_that_is_turned_before_it_is_strained_has_the_same_stresses_turned() -> None:
    rng = np.random.default_rng(1)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    F = np.eye(3) + 0.4 * rng.uniform(-1.0, 1.0, (6, 3, 3))
    t = np.arange(1.0, 7.0)
    S, turned = full(stresses(F, t, 0.7)), full(stresses(F @ R, t, 0.7))
    np.testing.assert_allclose(turned, R.T @ S @ R, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("m", [0.0, 0.4, 1.7])
@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-6, 3e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("third", [1.0, 0.7])
def test_derivatives_are_exact_where_stretches_are_equal_or_nearly(m: float, apart: float, third: float) -> None:
    rng = np.random.default_rng(2)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    F = (np.diag([1.3, 1.3 * (1.0 + apart), 1.3 * third * (1.0 - apart)]) @ R)[None]
    T, E = rng.normal(size=(1, 6)), green(F)
    slopes, bend = MeasuredStrain(E, m).derivatives(T, second=True)
    by_exponent = MeasuredStrain(E, m).by_exponent(T)
    h = 1e-5

    def shifted(k: int, s: float) -> MeasuredStrain:
        return MeasuredStrain(E + s * h * np.eye(6)[k], m)

    for k in range(6):
        up, down = shifted(k, 1.0), shifted(k, -1.0)
        np.testing.assert_allclose(slopes[0, :, k], (up.A - down.A)[0] / (2 * h), rtol=0, atol=1e-8)
        pulled = [T @ one.derivatives(T, second=False)[0][0] for one in (up, down)]
        np.testing.assert_allclose(bend[0, :, k], (pulled[0] - pulled[1])[0] / (2 * h), rtol=0, atol=1e-7)
    if m:
        up, down = MeasuredStrain(E, m + h), MeasuredStrain(E, m - h)
        np.testing.assert_allclose(by_exponent[0], (up.A - down.A) / (2 * h), rtol=0, atol=1e-8)
        pulled = [T @ one.derivatives(T, second=False)[0][0] for one in (up, down)]
        np.testing.assert_allclose(by_exponent[1], (pulled[0] - pulled[1]) / (2 * h), rtol=0, atol=1e-8)


def test_exponents_are_the_strains_they_are_named_after() -> None:
    F = np.eye(3) + 0.3 * np.random.default_rng(3).uniform(-1.0, 1.0, (1, 3, 3))
    F /= np.cbrt(np.linalg.det(F))[:, None, None]
    C = np.swapaxes(F, 1, 2) @ F
    two = full(MeasuredStrain(green(F), 2.0).A / TWICE)
    np.testing.assert_allclose(two, 0.25 * (C - np.linalg.inv(C)), atol=1e-14)
    from scipy.linalg import logm

    np.testing.assert_allclose(full(MeasuredStrain(green(F), 0.0).A / TWICE)[0], 0.5 * logm(C[0]).real, atol=1e-12)
