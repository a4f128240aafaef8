"""Jackknife and bootstrap: against closed forms, against fits, and silent where the tests are alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from fake_twin import E
from interval_cases import curved, linear_problem, values
from manipulator_case import CABLES, LENGTH, manipulator
from scipy.optimize import lsq_linear, minimize

from softcal.calibration.interval_studies.bootstrap import bootstrap
from softcal.calibration.interval_studies.checked_interval import CheckedInterval, IntervalStudy
from softcal.calibration.interval_studies.resampling import jackknife, resampled
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.loss import Block, Loss, total
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.rig import Rig
from softcal.calibration.statistics.between_markers import with_markers
from softcal.calibration.statistics.estimator import estimator
from softcal.calibration.statistics.groups import KINDS, groups_of
from softcal.calibration.statistics.jackknife import delete_one
from softcal.calibration.statistics.random_effects import RandomEffects
from softcal.calibration.statistics.reweighted import NONE, Reweighted, reweighted
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.errors import InputError, ParameterError
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Marker, Robot

ALIKE = "No interval by {} differs from the quick one by more than chance explains."
SIX = tuple("abcdef")
STIFF, SOFT = "spring1.youngs_modulus", "spring2.youngs_modulus"
FORCES = np.array([5.0, 10.0, 15.0])
MARKERS = tuple(f"m{k}" for k in range(1, 9))
ROBOT = replace(manipulator(), markers=tuple(Marker(m, "S4", np.array([0.02, 0.0, -LENGTH])) for m in MARKERS))


def test_large_differences_are_named_though_chance_explains_them() -> None:
    def study(far: float, chance: float) -> tuple[str, ...]:
        near = CheckedInterval(2.0, "Pa", 0.1, 10.0, "linear", (1.9, 2.1), (1.89, 2.12), "", 0.4)
        other = CheckedInterval(2.0, "m", 0.1, 10.0, "linear", (1.9, 2.1), (1.9 - far, 2.1 + far), "", chance)
        return IntervalStudy("jackknife", {"a": near, "frame.y": other}, (), {}, 0.0).sentences

    assert study(0.05, 0.3) == (ALIKE.format("jackknife"),)
    (text,) = study(0.29, 0.08)
    assert "chance explains, but of so few groups chance explains much: frame.y (p = 0.08) differs by more" in text
    (text,) = study(0.29, 0.01)
    assert text.startswith("frame.y: the interval by jackknife is")


def blocks_of(seed: int, n: int = 30, k: int = 6, size: int = 2, channel: str = "tension") -> list[Block]:
    """Records at the minimum of least squares: `size` shared parameters, and an offset for each."""
    chance = np.random.default_rng(seed)
    jacobians = [
        np.column_stack([chance.uniform(0.5, 1.5, (n, size)), np.tile(np.eye(k)[i], (n, 1))]) for i in range(k)
    ]
    noise = [
        (1 + i) * 1e-3 * chance.standard_normal(n) + 2e-3 * chance.standard_normal() * jacobians[i][:, 0]
        for i in range(k)
    ]
    step = np.linalg.lstsq(np.concatenate(jacobians), -np.concatenate(noise), rcond=None)[0]
    return [
        Block(f"t{i}", channel, np.full(n, 5.0), noise[i] + jacobians[i] @ step, 1e-3, jacobians[i]) for i in range(k)
    ]


def minimum(problem: Problem) -> dict[str, float]:
    """The minimum of a sum of squares within the bounds, by Gauss-Newton steps."""
    space = problem.space
    z = space.to_search(space.start)
    for _ in range(6):
        blocks = problem.evaluate(space.to_model(z), jacobian=True).blocks
        roots = [np.sqrt(problem.loss.square_weights(b, b.residual)) for b in blocks]
        rows = np.concatenate([w[:, None] * b.jacobian * space.jacobian(z) for w, b in zip(roots, blocks, strict=True)])
        right = np.concatenate([w * b.residual for w, b in zip(roots, blocks, strict=True)])
        z = np.clip(z + lsq_linear(rows, -right, (-z - 1e-12, 1.0 - z + 1e-12)).x, 0.0, 1.0)
    return space.to_model(z)


def grouped(loss: Loss, blocks: list[Block], groups: list[np.ndarray] | None = None) -> Reweighted:
    size = blocks[0].jacobian.shape[1]
    z, ones = np.full(size, 0.5), np.ones(size)
    held = groups or [np.full(len(b.residual), b.experiment or NONE, dtype=object) for b in blocks]
    return reweighted(loss, z, ones, blocks, held, estimator(loss, z, ones, blocks))


def test_the_jackknife_of_a_mean_is_its_standard_error_with_n_less_one_degrees_of_freedom():
    chance = np.random.default_rng(1)
    values = chance.standard_normal(7)
    blocks = [Block(f"t{i}", "tension", np.ones(1), v - np.full(1, values.mean()), 1e-3, -np.ones((1, 1)))
              for i, v in enumerate(values)]  # fmt: skip
    found = delete_one(grouped(LikelihoodLoss(), blocks))
    assert found.budget.root[0, 0] ** 2 == pytest.approx(values.var(ddof=1) / 7, rel=1e-9)
    assert found.dof[0] == pytest.approx(6.0)
    assert found.excess[0] == pytest.approx(1.0)


def test_each_value_without_an_experiment_is_that_of_a_fit_without_it():
    blocks = blocks_of(2)
    found = delete_one(grouped(LikelihoodLoss(), blocks))
    for i in range(len(blocks)):
        rest = [b for j, b in enumerate(blocks) if j != i]
        rows, right = (np.concatenate([getattr(b, k) for b in rest]) for k in ("jacobian", "residual"))
        step = np.linalg.lstsq(rows, -right, rcond=None)[0]
        assert found.steps[i, :2] == pytest.approx(step[:2], rel=1e-5, abs=1e-12)
    assert found.determined.tolist() == [True, True, *[False] * 6]  # an offset is one experiment's own
    assert np.all((found.dof[:2] > 2) & (found.dof[:2] < 6))


def test_with_weights_the_minimum_is_that_of_the_weighted_papers_loss():
    loss = PapersLoss()
    blocks = blocks_of(3, k=4, size=1)
    found = grouped(loss, blocks)
    for weights in (np.array([2.0, 0.3, 0.7, 1.0]), np.array([0.0, 1.0, 1.0, 1.0])):

        def value(step: np.ndarray, weights: np.ndarray = weights) -> float:
            return sum(
                w * loss.block_value(b, b.residual + b.jacobian @ step) for w, b in zip(weights, blocks, strict=True)
            )

        expected = minimize(value, np.zeros(5), method="BFGS", options={"gtol": 1e-12}).x
        assert found.minima(weights[None])[0][0] - 0.5 == pytest.approx(expected[0], abs=2e-6)
    assert total(loss, blocks) > 0


def test_the_draws_of_a_linear_model_scatter_as_its_sandwich_says():
    problem = linear_problem(LikelihoodLoss(), n=400)
    theta = minimum(problem)
    found = bootstrap(problem, theta, over="records", samples=4000)
    space = problem.space
    draws = np.array([space.to_search(dict(zip(space.labels, row, strict=True)))
                      for row in zip(*found.points.values(), strict=True)])  # fmt: skip
    evaluation = problem.evaluate(theta, jacobian=True)
    slopes = space.jacobian(space.to_search(theta))
    groups = groups_of(problem, evaluation.blocks, "records")
    hessian, scores = np.zeros((2, 2)), {}
    for block, held in zip(evaluation.blocks, groups, strict=True):
        J = block.jacobian * slopes / block.sigma[:, None]
        hessian += J.T @ J
        for name in set(held):
            scores[name] = scores.get(name, 0.0) + J[held == name].T @ (block.residual / block.sigma)[held == name]
    k = len(scores)
    bread = np.linalg.inv(hessian)
    sandwich = bread @ sum(np.outer(s, s) for s in scores.values()) @ bread * k / (k - 1)
    t = 2.093 / 1.96  # with twenty pieces
    assert k == 20
    assert draws.std(axis=0) / np.sqrt(np.diag(sandwich)) == pytest.approx(t * np.ones(2), rel=0.12)
    assert np.corrcoef(draws.T)[0, 1] == pytest.approx(sandwich[0, 1] / np.sqrt(np.prod(np.diag(sandwich))), abs=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("loss", [LikelihoodLoss(), PapersLoss()])
def test_of_alike_experiments_both_say_that_nothing_differs(loss: Loss):
    problem = linear_problem(loss, names=SIX, noise=0.9)
    theta = values(problem) if loss.straight_along(blocks_of(1)[0], np.ones(30)) is not None else minimum(problem)
    for found in (jackknife(problem, theta), bootstrap(problem, theta)):
        assert found.facts["experiments"] == 6
        assert found.sentences == (ALIKE.format(found.by),)
        for one in found.intervals.values():
            assert 0.4 < (one.found[1] - one.found[0]) / (one.quick[1] - one.quick[0]) < 2.5


def test_a_bootstrap_is_confirmed_by_refits_and_repeated_by_its_seed():
    problem = curved()
    theta = values(problem)
    first, again = (bootstrap(problem, theta, samples=500, seed=3) for _ in range(2))
    assert first.intervals == again.intervals
    assert first.facts["refits"] == 6
    assert first.facts["evaluations"] > 6
    other = bootstrap(problem, theta, samples=500, seed=4)
    assert other.intervals != first.intervals


LONGER = "the intervals are those found with one marker left out at a time, where these are longer."


def straight(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    """Markers that move in proportion to the force over the moduli, each in its own proportion."""
    now = parameter_values(robot, theta)
    ((cable, command),) = protocol.commands.items()
    chance = np.random.default_rng(CABLES.index(cable))
    channels, by = {}, {}
    for name in (f"{marker}.{axis}" for marker in MARKERS for axis in "xyz"):
        parts = {
            p: 1e6 * share * command.values for p, share in zip((STIFF, SOFT), chance.uniform(1, 3, 2), strict=True)
        }
        channels[name] = sum(part / now[p] for p, part in parts.items())
        by[name] = {p: -parts[p] / now[p] ** 2 for p in sensitivities if p in parts}
    units = dict.fromkeys(channels, "m")
    return Response(channels, units, "Straight.", succeeded=True, n_factorisations=0, sensitivities=by)


def markers(seed: int, offset: float = 0.0, *more: FreeParameter, n: int = 8) -> Problem:
    """Six cables, three weights, n of eight markers, with errors of the markers' places [m]; more: free parameters."""
    chance = np.random.default_rng(seed)
    off = {f"{m}.{axis}": offset * chance.standard_normal() for m in MARKERS for axis in "xyz"}
    tests = []
    for cable in CABLES:
        seen = straight(ROBOT, Protocol({cable: Command("tension", FORCES)}), {STIFF: 0.7e9, SOFT: 0.9e9})
        noisy = {n: Channel(v + off[n] + 5e-4 * chance.standard_normal(3), "m", 5e-4) for n, v in seen.channels.items()}
        seen_there = {name: one for name, one in noisy.items() if name.partition(".")[0] in MARKERS[:n]}
        channels = {f"{cable}.tension": Channel(FORCES, "N"), **seen_there}
        tests.append(Experiment(cable, Dataset(cable, channels), drive=(f"{cable}.tension",), rig=Rig(length=LENGTH)))
    free = [FreeParameter(name, "Pa", 0.1e9, 10e9, "log", start=0.8e9) for name in (STIFF, SOFT)]
    return make_problem(ROBOT, tests, [*free, *more], DistanceLoss(LENGTH), straight)


@pytest.mark.parametrize("seed", [0, 1])
def test_markers_that_are_off_are_said_to_differ_and_the_same_markers_in_place_are_not(seed: int):
    right, wrong = markers(seed, n=5), markers(seed, 3e-3, n=5)
    assert jackknife(right, minimum(right), over="markers").sentences == (ALIKE.format("jackknife"),)
    found = jackknife(wrong, minimum(wrong), over="markers")
    assert any("the markers differ by more than the noise" in one for one in found.sentences)
    low, high = found.intervals[SOFT].found
    assert low < 0.9e9 < high


@pytest.mark.slow
def test_the_intervals_are_those_by_the_markers_where_six_or_more_differ() -> None:
    for offset in (0.0, 3e-3):
        problem = markers(1, offset)
        theta = minimum(problem)
        blocks = problem.evaluate(theta, jacobian=True).blocks
        few = [block for block in blocks if block.point in MARKERS[:5]]
        for seen, widens in ((blocks, offset > 0), (few, False)):
            known = local_statistics(problem.space, problem.loss, theta, seen)
            notes = [str(note) for note in known.notes if "markers differ" in str(note)]
            assert notes == ["The 8 markers differ by more than the noise explains: " + LONGER] * widens
            assert any("markers" in shares for shares in known.shares.values()) == widens
    study = jackknife(problem, theta, over="markers")
    assert study.sentences == (ALIKE.format("jackknife"),)  # the quick intervals include the markers already
    by_markers, quick = study.intervals[SOFT].found, known.intervals[SOFT]
    stated = local_statistics(problem.space, problem.loss, theta, blocks).intervals[SOFT]
    assert stated == pytest.approx(by_markers, rel=0.01)
    assert np.ptp(stated) > 1.5 * np.ptp(quick)


def test_an_interval_by_the_markers_is_never_shorter_than_the_quick_one() -> None:
    problem = markers(1, 3e-3)
    z = problem.space.to_search(theta := minimum(problem))
    blocks = problem.evaluate(theta, jacobian=True).blocks
    slopes = problem.space.jacobian(z)
    found = estimator(problem.loss, z, slopes, blocks)
    wide = with_markers(problem.loss, z, slopes, blocks, found)
    assert np.all(np.linalg.norm(wide.root, axis=0) >= np.linalg.norm(found.root, axis=0))
    total = np.sum(list(wide.variances.values()), axis=0)
    np.testing.assert_allclose(total, np.sum(wide.root**2, axis=0), rtol=1e-3)


def test_the_covariance_of_fewer_groups_than_parameters_is_not_singular():
    frame = [FreeParameter(name, "m" if len(name) == 7 else "rad", -0.5, 0.5) for name in FRAME]
    problem = markers(2, 1e-3, *frame)
    found = resampled(problem, minimum(problem), "weights")
    assert len(found.parts.names) == 3
    errors = np.linalg.norm(found.root, axis=0)
    assert errors == pytest.approx(np.linalg.norm(found.without.budget.root, axis=0))
    assert np.linalg.cond(found.root / errors) < 1e3


def test_pieces_of_records_are_said_not_to_show_that_experiments_differ() -> None:
    said = "The tests differ, which records cannot show: the quick intervals include it."
    problem = markers(3, n=5)
    by_records = resampled(problem, minimum(problem), "records")
    assert said not in by_records._notes()
    first = replace(by_records.held.found.between[0], effects=RandomEffects(9.0, 1e-4, 0.1, 0.0, 0.05, 5))
    found = replace(by_records.held.found, between=(first,))
    differing = replace(by_records, held=replace(by_records.held, found=found))
    assert said in differing._notes()
    assert said not in replace(differing, kind="experiments")._notes()


def test_what_is_a_group():
    problem = markers(1)
    blocks = problem.evaluate(problem.space.start, jacobian=True).blocks
    found = {kind: groups_of(problem, blocks, kind) for kind in ("experiments", "actuators", "weights", "markers")}
    names = {kind: {name for held in groups for name in held} for kind, groups in found.items()}
    assert names["experiments"] == names["actuators"] == set(CABLES)
    assert names["markers"] == set(MARKERS)
    assert names["weights"] == {"5 N", "10 N", "15 N"}
    assert set(KINDS) == {"experiments", "actuators", "weights", "markers", "cycles", "records"}


def test_cycles_are_groups_where_a_record_has_them():
    problem = linear_problem(LikelihoodLoss(), n=60)
    (experiment,) = problem.experiments

    def with_cycles(cycle: np.ndarray) -> Problem:
        data = replace(experiment.dataset, cycle=cycle)
        return replace(problem, experiments=(replace(experiment, dataset=data),))

    theta = minimum(problem)
    found = jackknife(with_cycles(np.repeat([2.0, 3.0, 4.0, 5.0], 15)), theta, over="cycles")
    assert found.facts["cycles"] == 4
    for averaged in (np.tile([2.0, 3.0, 4.0, 5.0], 15), None):
        with pytest.raises(InputError, match="too few cycles"):
            jackknife(with_cycles(averaged), theta, over="cycles")


@pytest.mark.parametrize("by", [jackknife, bootstrap])
def test_what_cannot_be_resampled_is_refused(by):
    problem = linear_problem(LikelihoodLoss(), n=60)
    theta = minimum(problem)
    with pytest.raises(InputError, match="too few experiments") as error:
        by(problem, theta, over="experiments")
    assert "3 or more" in str(error.value)
    with pytest.raises(InputError, match="no kind of group"):
        by(problem, theta, over="bolts")
    with pytest.raises(InputError, match="too few markers"):
        by(problem, theta, over="markers")
    with pytest.raises(ParameterError, match="samples"):
        bootstrap(problem, {**theta, E: theta[E]}, samples=10)
