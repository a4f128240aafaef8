"""A factorisation kept along a path as preconditioner: the same equilibria, derivatives and losses of stability."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled

from softcal.errors import SimulationError
from softcal.mechanics import bordered, linear_solve
from softcal.mechanics.bordered import BorderedTangent
from softcal.mechanics.krylov import gmres
from softcal.mechanics.linear_solve import Pardiso, SuperLU
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import Controls
from softcal.twin.build import build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.simulate import simulate

SLACK, TAUT = (Controls(np.array([is_held]), np.zeros(1), np.zeros(1)) for is_held in (True, False))
PARAMETERS = {"neck.youngs_modulus": 1e6, "neck.poissons_ratio": 0.45}


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Factors are kept, and in single precision, for robots of any size."""
    keep(monkeypatch)


def keep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bordered, "LARGE", 0)
    monkeypatch.setattr(linear_solve, "SOLVES", 1.0)  # a factorisation costs as much as in a large robot


@pytest.fixture
def column(kept: None) -> Generator[Statics]:
    """The solver of a column of P2P1 elements, whose factors are kept."""
    robot = column_robot("P2P1", divisions=(2, 2, 8), parameters=elastic(1e6, 0.45))
    statics = Statics(build_twin(robot).system, parameter_values(robot))
    yield statics
    statics.release()


def response(element: str, d: float = 0.03):
    robot = column_robot(element, divisions=(2, 2, 8), parameters=elastic(*PARAMETERS.values()))
    return simulate(robot, pulled(*np.linspace(0.0, d, 7)), sensitivities=tuple(PARAMETERS))


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_curves_and_derivatives_are_those_of_fresh_factors(element, monkeypatch):
    fresh = response(element)
    keep(monkeypatch)
    found = response(element)
    assert fresh.succeeded
    assert found.succeeded
    assert found.n_factorisations < fresh.n_factorisations
    units = fresh.units
    for name, values in fresh.channels.items():
        scale = max(np.abs(fresh.channels[other]).max() for other, unit in units.items() if unit == units[name])
        # Both end with residuals below 1e-9 of the reactions.
        np.testing.assert_allclose(found.channels[name], values, atol=2e-9 * scale, rtol=0)
        for parameter, value in PARAMETERS.items():
            own = fresh.sensitivities[name][parameter]
            theirs = found.sensitivities[name][parameter]
            np.testing.assert_allclose(theirs, own, atol=1e-8 * (np.abs(own).max() + scale / value), rtol=0)


def test_a_slack_sample_takes_no_factorisation_of_its_own(monkeypatch: pytest.MonkeyPatch, kept: None):
    monkeypatch.setattr(linear_solve, "SOLVES", 0.05)  # factors of the path's end do not serve at rest
    robot = column_robot("P2P1", divisions=(2, 2, 8), parameters=elastic(*PARAMETERS.values()))
    taut, slack = (simulate(replace(robot), pulled(*first, 0.015, 0.03)) for first in ((), (0.0,)))
    assert slack.n_factorisations == taut.n_factorisations


def test_solutions_are_exact_with_factors_of_another_state(column: Statics):
    """The response by the tangent's own factors is that by factors of the state at rest."""
    layout = column.system.layout
    at = column.tangent_at(rest_state(layout), TAUT)
    column.n_unstable()
    column.tangent.take(replace(at, data=1.3 * at.data))
    b = np.random.default_rng(1).standard_normal((layout.n_unknowns, 2))
    x = column.solve(b)
    assert column.n_factorisations == 1
    column.factorise(replace(at, data=1.3 * at.data))
    exact = column.solve(b)
    for part in (slice(layout.first_pressure_unknown), slice(layout.first_effort_unknown, None)):
        assert np.abs(x - exact)[part].max() < 1e-9 * np.abs(exact[part]).max()


def test_a_loss_of_stability_is_seen_by_kept_factors(column: Statics):
    """A tangent of which one mode is reversed has one unstable direction, also with factors that have none."""
    at = column.tangent_at(rest_state(column.system.layout), SLACK)
    assert column.n_unstable() == 0
    assert at.data is not None
    lower = at.data.copy()
    lower[column.system.pattern.indptr[:1]] *= -0.5
    column.tangent.take(replace(at, data=lower))
    assert column.n_unstable() == 1


def test_a_step_by_earlier_factors_that_leads_nowhere_is_solved_anew(column: Statics, monkeypatch: pytest.MonkeyPatch):
    """Earlier factors may be far too stiff, where surfaces have separated: their estimate of the error is too small."""
    solve, wrong = BorderedTangent.solve, list[bool]()

    def uphill(tangent: BorderedTangent, *args: Any) -> np.ndarray:
        wrong.append(not tangent.has_own_factors and not any(wrong))
        return -solve(tangent, *args) if wrong[-1] else solve(tangent, *args)

    monkeypatch.setattr(BorderedTangent, "solve", uphill)
    shortened = Controls(np.array([False]), np.zeros(1), np.array([0.02]))
    solved = column.equilibrium(rest_state(column.system.layout), shortened)
    assert solved.converged
    assert any(wrong)


@pytest.mark.parametrize("columns", [1, 3])
def test_gmres_is_as_accurate_as_requested(columns):
    random = np.random.default_rng(0)
    n = 60
    near = np.eye(n) + 0.2 * random.standard_normal((n, n)) / np.sqrt(n)
    b = random.standard_normal((n, columns))
    exact = np.linalg.solve(near, b)
    for accuracy in (1e-2, 1e-4, 1e-11):
        found = gmres(lambda x: near @ x, lambda r: r, b, accuracy, 100)
        assert found.converged
        errors = np.linalg.norm(found.x - exact, axis=0) / np.linalg.norm(exact, axis=0)
        assert errors.max() < 2.0 * accuracy
    assert not gmres(lambda x: near @ x, lambda r: r, b, 1e-11, 4).converged


def test_ritz_values_show_a_negative_eigenvalue():
    values = np.append(np.linspace(0.5, 2.0, 99), -0.1)
    b = np.random.default_rng(4).standard_normal((100, 1))
    found = gmres(lambda x: values[:, None] * x, lambda r: r, b, 1e-5, 100)
    assert found.converged
    assert found.ritz.min() == pytest.approx(-0.1, abs=1e-3)


def test_single_precision_has_the_same_inertia_in_half_the_digits():
    import scipy.sparse as sp

    dense = np.random.default_rng(5).standard_normal((40, 40))
    upper = sp.csr_matrix(np.triu(dense + dense.T))
    upper.sort_indices()
    arguments = upper.indptr.astype(np.int64), upper.indices.astype(np.int64)
    matrix, b = dense + dense.T, np.ones(40)
    for factors, limit in (
        (Pardiso(*arguments, single=True), 1e-2),
        (Pardiso(*arguments), 1e-9),
        (SuperLU(*arguments), 1e-9),
    ):
        factors.factorise(upper.data)
        x = factors.solve(b)
        assert np.abs(matrix @ x - b).max() < limit
        assert factors.n_negative == np.count_nonzero(np.linalg.eigvalsh(matrix) < 0.0)
        assert factors.solves_per_factorisation > 0.0
        factors.release()


def test_a_missing_tangent_is_a_sentence(column: Statics):
    at = column.system.linearise(rest_state(column.system.layout), SLACK, column.theta, tangent=False)
    with pytest.raises(SimulationError, match="no tangent"):
        column.take(at)
