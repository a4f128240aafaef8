"""The search space: scales, bounds, expansion, and every fault at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fake_twin import NU, E, fake_experiment, fake_robot
from hypothesis import given
from hypothesis import strategies as st

from softcal.calibration.problem.experiment import rig_parameters
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace, search_space
from softcal.errors import InputError, ParameterError
from softcal.twin.parameters import robot_parameters

MODULUS = FreeParameter(E, "Pa", 0.1e6, 40e6, "log")
RATIO = FreeParameter(NU, "1", 0.4, 0.4999)
SPACE = SearchSpace((MODULUS, RATIO))
KNOWN = {**robot_parameters(fake_robot()), **rig_parameters([fake_experiment()])}
unit = st.floats(0.0, 1.0)


@given(unit, unit)
def test_to_model_and_to_search_undo_each_other_within_the_bounds(a: float, b: float) -> None:
    theta = SPACE.to_model([a, b])
    assert 0.1e6 <= theta[E] <= 40e6
    assert 0.4 <= theta[NU] <= 0.4999
    np.testing.assert_allclose(SPACE.to_search(theta), [a, b], atol=1e-12)


@given(st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_the_jacobian_is_that_of_central_differences(a: float, b: float) -> None:
    z, h = np.array([a, b]), 1e-6
    above, below = (np.array(list(SPACE.to_model(z + s).values())) for s in (h, -h))
    np.testing.assert_allclose(SPACE.jacobian(z), (above - below) / (2 * h), rtol=1e-7)


def test_the_middle_of_a_log_scale_is_the_geometric_mean() -> None:
    assert SPACE.to_model([0.5, 0.5])[E] == pytest.approx(np.sqrt(0.1e6 * 40e6))


def test_a_nuisance_per_experiment_is_expanded_and_read_by_its_own_experiment() -> None:
    slack = FreeParameter("front.slack", "m", 0.0, 0.01, per_experiment=True)
    space = search_space([MODULUS, slack], ["20mm", "40mm"], KNOWN)
    assert space.labels == (E, "front.slack[20mm]", "front.slack[40mm]")
    theta = {E: 1e6, "front.slack[20mm]": 0.001, "front.slack[40mm]": 0.004}
    assert space.values_for("40mm", theta) == {E: 1e6, "front.slack": 0.004}
    assert space.restricted("20mm").labels == (E, "front.slack[20mm]")


def test_the_start_is_the_robots_own_value_where_that_lies_within() -> None:
    space = search_space([MODULUS, FreeParameter(NU, "1", 0.46, 0.49)], [], KNOWN)
    assert space.parameters[0].start == 1.0e6
    assert space.parameters[1].start is None


def test_every_fault_is_told_at_once() -> None:
    with pytest.raises(ParameterError) as caught:
        search_space(
            [
                FreeParameter("neck.youngs_modulos", "Pa", 1e5, 1e7),
                FreeParameter(NU, "1", 0.4, 0.5),
                FreeParameter("plate.mass", "g", 0.0, 1.0),
            ],
            [],
            KNOWN,
        )
    text = str(caught.value)
    assert len(caught.value.faults) == 3
    assert "Try: 'neck.youngs_modulus'" in text
    assert "0.4999 instead of 0.5" in text
    assert "plate.mass: the parameter has another unit; got g; allowed: kg" in text


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ((), "no free parameter"),
        ((MODULUS, MODULUS), "free twice"),
    ],
)
def test_a_space_that_makes_no_sense_is_refused(parameters: tuple[FreeParameter, ...], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        SearchSpace(parameters)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"upper": 0.0}, "the bounds are reversed or equal; got 1 MPa to 0 Pa"),
        ({"lower": 0.0, "scale": "log"}, "a log scale needs bounds above zero"),
        ({"start": 3e6}, "start is outside"),
        ({"prior_mean": 1e6}, "both a mean and an sd"),
        ({"prior_mean": 1e6, "prior_sd": 0.0}, "sd must be above zero"),
        (
            {"prior_mean": 3e6, "prior_sd": 1e6},
            r"the prior's mean is outside the bounds; got 3 MPa; allowed: 1 to 2 MPa. Try: wider bounds",
        ),
    ],
)
def test_a_parameter_that_makes_no_sense_is_refused_by_itself(values: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {"lower": 1e6, "upper": 2e6, **values}
    with pytest.raises(ParameterError, match=f"{E}: .*{message}"):
        FreeParameter(E, "Pa", **settings)


@pytest.mark.parametrize("bound", [float("nan"), float("inf")])
def test_a_bound_that_is_not_finite_is_refused_by_its_name(bound: float) -> None:
    with pytest.raises(InputError, match=r"youngs_modulus\.upper: this is not finite"):
        FreeParameter(E, "Pa", 1e6, bound)


def test_at_bound_is_judged_on_the_scale_of_the_search() -> None:
    near = SPACE.to_model([0.9995, 0.5])
    assert SPACE.at_bound(near) == {E: True, NU: False}
    assert SPACE.at_bound(SPACE.to_model([0.998, 0.5])) == {E: False, NU: False}


def test_a_step_that_ends_a_rounding_short_of_a_bound_is_at_it():
    space = SearchSpace((FreeParameter("front.slack", "m", 0.0, 3e-3), FreeParameter("E", "Pa", 1e5, 1e7, "log")))
    assert space.to_model([2.8e-17, 1 - 2e-16]) == {"front.slack": 0.0, "E": 1e7}
    near = space.to_model([1e-9, 1 - 1e-9])
    assert 0.0 < near["front.slack"] < 1e-11
    assert near["E"] < 1e7
