"""The mesh study: what finer discretisations change, what that shifts, and what is said about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanics_cases import column_robot, elastic

from softcal.analysis import mesh_changes
from softcal.analysis import mesh_study as studying
from softcal.analysis.mesh_changes import Change, pooled
from softcal.analysis.mesh_study import LIMIT, Finer, MeshStudy, mesh_study
from softcal.analysis.mesh_verdict import mesh_verdicts, shift_text, times_text
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.estimate import Estimate
from softcal.errors import SimulationError
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.finer import Size
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

E = "neck.youngs_modulus"


def column(element: str = "P1") -> Robot:
    return column_robot(element, parameters=elastic(2.0e6, 0.4), divisions=(1, 1, 4))


def column_problem(robot: Robot, modulus: float = 2.0e6) -> Problem:
    """The modulus of a column from the tension of another column of that modulus with quadratic elements."""
    d = np.linspace(0.001, 0.006, 6)
    truth = column_robot("P2P1", parameters=elastic(modulus, 0.4), divisions=(2, 2, 6))
    seen = simulate(truth, Protocol({"front": Command("shortening", d)}))
    noise = 0.02 * np.array([1, -1, 1, 1, -1, -1])
    tension = Channel(seen.channels["front.tension"] + noise, "N", 0.02)
    data = Dataset("pull", {"shortening": Channel(d, "m"), "tension": tension})
    test = Experiment("pull", data, "front", "plate", "shortening")
    return make_problem(robot, (test,), [FreeParameter(E, "Pa", 0.1e6, 40e6, scale="log")], LikelihoodLoss())


@pytest.fixture(scope="module")
def problem() -> Problem:
    return column_problem(column())


@pytest.fixture(scope="module")
def optimum(problem: Problem) -> dict[str, float]:
    result = calibrate(problem, method="least-squares", starts=1)
    return {name: e.value for name, e in result.parameters.items()}


@pytest.fixture(scope="module")
def study(problem: Problem, optimum: dict[str, float]) -> MeshStudy:
    return mesh_study(problem, optimum)


def named(study: MeshStudy, name: str) -> Finer:
    return next(one for one in study.finer if one.name == name)


def test_every_discretisation_is_there_and_its_size(study: MeshStudy):
    assert [one.name for one in study.finer] == ["P2P1", "h/2", "h/4", "P2P1 h/2", LIMIT]
    assert [one.size.tets for one in study.finer if one.size] == [24, 192, 1536, 192]
    assert study.size.tets == 24
    assert study.elements == ("P1",)
    assert study.reference == "P2P1 h/2"
    assert study.of_robot == (E,)


def test_the_change_is_that_of_the_twin_itself(problem: Problem, optimum: dict[str, float], study: MeshStudy):
    from softcal.twin.finer import halved

    d = problem.experiments[0].dataset.values("shortening")
    coarse, fine = (
        simulate(r, Protocol({"front": Command("shortening", d)}), optimum).channels["front.tension"]
        for r in (problem.robot, halved(problem.robot))
    )
    (change,) = named(study, "h/2").changes
    assert change.rms == pytest.approx(np.sqrt(np.mean((fine - coarse) ** 2)), rel=1e-3)
    assert change.share == pytest.approx((fine - coarse) @ coarse / (coarse @ coarse), rel=1e-3)
    assert change.noise == pytest.approx(0.02)
    residual = coarse - problem.experiments[0].dataset.values("tension")
    assert change.residual == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-3)
    assert (change.experiment, change.name, change.unit, change.n) == ("pull", "tension", "N", 6)


def test_a_modulus_makes_up_for_a_tension(study: MeshStudy, optimum: dict[str, float]):
    # Tension is proportional to E, so what one loses the other must gain.
    for one in study.finer:
        share = one.changes[0].share
        assert share is not None
        assert share < -0.1
        assert one.values[E] == pytest.approx(optimum[E] / (1 + share), rel=0.01)
        assert one.loss is not None
        assert one.reachable is not None
        assert one.reachable < 0.1 * one.loss


def test_the_limit_goes_on_at_the_order_that_is_seen(study: MeshStudy):
    once, twice, limit = (named(study, name).changes[0] for name in ("h/2", "h/4", LIMIT))
    assert limit.order is not None
    assert 0.5 < limit.order < 2.5
    assert None not in (once.share, twice.share, limit.share)
    left = 2.0**-limit.order
    assert limit.share == pytest.approx(twice.share + left / (1 - left) * (twice.share - once.share), rel=0.01)


def test_without_lower_elements_the_limit_or_the_finest_is_judged_by():
    problem = column_problem(column("P2P1"))
    found = mesh_study(problem, {E: 2.0e6}, max_unknowns=12_000)
    assert [one.name for one in found.finer][:2] == ["h/2", "h/4"]
    assert found.reference == LIMIT
    order = named(found, LIMIT).changes[0].order
    assert order is not None
    assert 1.5 < order < 4.5
    only_once = mesh_study(problem, {E: 2.0e6}, max_unknowns=3_000)
    assert only_once.reference == "h/2"
    assert any("further halving" in note for note in only_once.notes)


def test_what_is_too_large_is_left_out_and_says_so(problem: Problem, optimum: dict[str, float]):
    found = mesh_study(problem, optimum, max_unknowns=500)
    too_large = named(found, "P2P1 h/2")
    assert too_large.failure == (
        f"It would have {too_large.size.unknowns:,} unknowns, more than the limit of 500."  # type: ignore[union-attr]
    )
    assert (too_large.values, too_large.changes) == ({}, ())
    assert found.reference == "P2P1"
    assert any("do not include the error of" in note for note in found.notes)
    nothing = mesh_study(problem, optimum, max_unknowns=10)
    (verdict,) = mesh_verdicts(nothing)
    assert nothing.reference == ""
    assert "influence of the mesh is unknown" in verdict.text
    assert "more than the limit of 10" in verdict.text


def test_a_finer_twin_that_cannot_be_simulated_says_why(problem: Problem, optimum: dict[str, float]):
    def linear_alone(robot, protocol, theta=None, *, sensitivities=(), snapshots=False) -> Response:
        if robot.bodies[0].element != "P1":
            return Response({}, {}, "No equilibrium beyond 1.0 mm.", succeeded=False, n_factorisations=3)
        return simulate(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots)

    found = mesh_study(replace(problem, simulate=linear_alone), optimum, halvings=1)
    assert "No equilibrium beyond 1.0 mm" in named(found, "P2P1").failure
    assert found.reference == "h/2"


def test_a_twin_that_cannot_be_simulated_as_it_is_cannot_be_studied(problem: Problem, optimum: dict[str, float]):
    def never(robot, protocol, theta=None, **options) -> Response:
        return Response({}, {}, "No equilibrium at all.", succeeded=False, n_factorisations=3)

    with pytest.raises(SimulationError, match="No equilibrium at all"):
        mesh_study(replace(problem, simulate=never), optimum)


def test_values_off_the_optimum_are_noted_and_shift_by_the_mesh_alone(
    problem: Problem, optimum: dict[str, float], study: MeshStudy
):
    away = mesh_study(problem, {E: 1.2 * optimum[E]}, halvings=1)
    assert any("do not minimise the loss" in note and E in note for note in away.notes)
    assert not study.notes or "do not minimise the loss" not in " ".join(study.notes)
    by_optimum = named(study, "h/2").values[E] / optimum[E]
    assert named(away, "h/2").values[E] / (1.2 * optimum[E]) == pytest.approx(by_optimum, rel=0.02)


def test_progress_is_told_from_the_beginning(problem: Problem, optimum: dict[str, float]):
    told: list[tuple[str, int, int | None]] = []
    mesh_study(problem, optimum, halvings=1, max_unknowns=500, progress=lambda *state: told.append(state))
    assert told == [
        ("original", 0, None), ("original", 1, None), ("P2P1", 0, 1), ("P2P1", 1, 1), ("h/2", 0, 1), ("h/2", 1, 1),
    ]  # fmt: skip


@given(order=st.floats(0.6, 5.5), size=st.floats(1e-2, 1.0), at=st.floats(-3.0, 3.0))
def test_an_order_is_found_where_there_is_one(order: float, size: float, at: float):
    error = size * np.array([1.0, 0.5, -0.3])
    sequence = [at + error * 2.0 ** (-order * k) for k in range(3)]
    left = studying._convergence(*sequence)
    tiny = np.sqrt(np.mean((sequence[2] - sequence[1]) ** 2)) <= 3 * studying.TOLERANCE * np.abs(sequence[2]).max()
    if not tiny:
        assert left == pytest.approx(2.0**-order, rel=1e-6)


@pytest.mark.parametrize(
    "sequence",
    [
        ([1.0, 2.0], [1.1, 2.1], [1.3, 2.3]),  # goes away
        ([1.0, 2.0], [1.1, 2.1], [1.05, 2.05]),  # goes back
        ([1.0, 2.0], [1.1, 2.1], [1.19, 2.08]),  # goes elsewhere
        ([1.0, 2.0], [1.1, 2.1], [1.1, 2.1]),  # is there
    ],
    ids=["away", "back", "elsewhere", "there"],
)
def test_no_order_is_made_up(sequence: tuple[list[float], ...]):
    assert studying._convergence(*(np.array(values) for values in sequence)) is None


def test_changes_are_pooled_over_experiments():
    one = Change("a", "tension", "N", 0.3, -0.1, 0.05, 0.2, 3.0, 10, 2.0)
    other = Change("b", "tension", "N", 0.4, -0.2, 0.05, 0.4, 2.0, 30, 1.0)
    place = Change("a", "m1", "m", 1e-3, None, None, 2e-3, 0.1, 4)
    found = pooled([one, other, place])
    both = found["tension"]
    assert both.rms == pytest.approx(np.sqrt((10 * 0.3**2 + 30 * 0.4**2) / 40))
    assert both.share == pytest.approx((10 * 9 * -0.1 + 30 * 4 * -0.2) / (10 * 9 + 30 * 4))
    assert both.residual == pytest.approx(np.sqrt((10 * 0.2**2 + 30 * 0.4**2) / 40))
    assert both.order == pytest.approx(1.5)
    assert (both.experiment, both.n, both.noise) == ("", 40, pytest.approx(0.05))
    assert found["m1"] == place


def made_up(
    there: float, *, found: float = 2.0e6, error: float | None = 0.05e6, at_bound: bool = False, unit: str = "Pa",
    elements: tuple[str, ...] = ("P1",), bounds: tuple[float, float] = (0.1e6, 40e6),
) -> MeshStudy:  # fmt: skip
    estimate = Estimate(found, unit, at_bound, *bounds, error)
    values: Mapping[str, float] = {"x": there}
    at = ("x",) if there in bounds else ()
    finer = Finer("h/2", "every element halved", Size(8, 0, 100), loss=1.0, reachable=0.5, values=values, at_bound=at)
    return MeshStudy({"x": estimate}, ("x",), 0.5, "papers", elements, "P2P1", Size(1, 0, 12), (finer,), "h/2")


def said(study: MeshStudy) -> list[str]:
    return [one.text for one in mesh_verdicts(study)]


def test_the_verdict_says_how_much_and_what_to_do():
    assert said(made_up(2.5e6)) == [
        "The mesh makes x too low by 20 %: 2.000 MPa, where 2.500 MPa is expected with every element halved. "
        "That is 10 times its standard error by noise.",
        "This error exceeds the noise: use P2P1 elements or a finer mesh, and calibrate again.",
    ]
    high, advice = said(made_up(1.6e6, elements=("P2P1",)))
    assert "too high by 25 %" in high
    assert advice.endswith("use a finer mesh, and calibrate again.")


def test_noise_may_hide_the_mesh():
    (verdict,) = mesh_verdicts(made_up(2.02e6))
    assert verdict.tone == "good"
    assert verdict.text == "The mesh makes x too low by 0.99 %, 0.4 times its standard error by noise."
    (between,) = mesh_verdicts(made_up(2.1e6))
    assert between.tone == "note"


def test_a_ratio_is_told_by_its_difference_and_far_ones_as_a_direction():
    near, *_ = said(made_up(0.43, found=0.4, error=0.02, unit="1", bounds=(0.2, 0.4999)))
    assert "too low by 0.03: 0.400, where 0.430 is expected" in near
    assert "direction" not in near
    far, *_ = said(made_up(0.48, found=0.3, error=0.02, unit="1", bounds=(0.2, 0.4999)))
    assert "only the direction is reliable" in far


def test_bounds_are_told():
    (stays,) = mesh_verdicts(made_up(40e6, found=40e6, error=None, at_bound=True))
    assert "is at a bound, 40 MPa, and is expected there on a finer mesh" in stays.text
    (reached,) = said(made_up(40e6, error=None))
    assert "too low by 95 % or more" in reached
    assert "That value is a bound. It has no standard error" in reached


def test_what_is_nothing_is_told_as_nothing():
    assert said(made_up(2.0e6)) == ["The mesh does not shift x."]
    to_zero, *_ = said(made_up(0.0, found=0.1, unit="N", error=0.01, bounds=(-1.0, 1.0)))
    assert "too high by 0.1 N: 0.100 N, where 0 N is expected" in to_zero


def test_shifts_in_words():
    assert shift_text(Estimate(2.0e6, "Pa", False, 1e5, 4e7, 0.1e6), 2.5e6) == "+0.5 MPa (5 s.e.)"
    assert shift_text(Estimate(2e-3, "m", False, 0.0, 1e-2), 1.9e-3) == "-0.1 mm"
    assert [times_text(x) for x in (0.04, -12.3, 543.2)] == ["0.04", "12", "543"]


def test_a_place_moves_as_far_as_its_coordinates_together():
    """3 and 4 are 5, whatever is done to average over the samples."""
    assert mesh_changes._distance(np.array([[3.0, 3.0], [4.0, 4.0]])) == pytest.approx(5.0)


@pytest.mark.slow
def test_two_workers_find_what_one_process_finds(problem: Problem, optimum: dict[str, float], study: MeshStudy):
    seen: list[tuple[str, int, int | None]] = []
    there = mesh_study(problem, optimum, workers=2, progress=lambda *told: seen.append(told))
    assert [replace(one, seconds=0.0) for one in there.finer] == [replace(one, seconds=0.0) for one in study.finer]
    assert there.notes == study.notes
    assert [name for name, done, of in seen if done and of] == [one.name for one in study.finer if one.name != LIMIT]
