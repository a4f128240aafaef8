"""The bench record of examples/neck-bench: is what it was made from found again, and is it what its generator writes?

The record comes from a finer twin, so the calibrated E differs from the true one for two known reasons: the loading
branch stands above the elastic curve by the overstress, and a coarser mesh is stiffer. Both are known here, and E is
asked for with them counted within 1 %; without the mesh counted, within the 4 % by which the coarse one is too stiff.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.problem.pulley_gain import reversals
from softcal.calibration.results.result import CalibrationResult, ExperimentFit
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.estimate import Estimate
from softcal.experiments.dataset import Dataset
from softcal.project.project import Project, load
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.units import parse_quantity
from softcal.workflows.calibration import make_problem

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "neck-bench"
E, NU = "neck.youngs_modulus", "neck.poissons_ratio"
MESH_AT_MOST = 0.04  # share by which the project's mesh is stiffer than the finer one


@pytest.fixture(scope="module")
def true_values(truth: dict[str, Any]) -> dict[str, float]:
    neck = truth["neck"]
    return {E: parse_quantity(neck["youngs_modulus"], "Pa"), NU: float(neck["poissons_ratio"])}


@pytest.fixture(scope="module")
def joint(project: Project) -> CalibrationResult:
    return calibrate(make_problem(project), method="least-squares", starts=1)


@pytest.fixture(scope="module")
def loading_modulus(truth: dict[str, Any], true_values: dict[str, float]) -> float:
    """E as the loading branches show it [Pa]: the elastic one with the mean overstress."""
    return true_values[E] * (1.0 + np.mean([test["overstress"] for test in truth["experiments"].values()]))


def step(data: Dataset, name: str, number: int = 0) -> dict[str, Any]:
    return dict([one for one in data.provenance if one.name == name][number].settings)


# --- the preparation --------------------------------------------------------------------------------------------


def test_the_two_clocks_are_brought_together(project: Project, truth: dict[str, Any]) -> None:
    for name, test in truth["experiments"].items():
        found = step(project.experiments[name].dataset, "synchronise")
        middle = 0.5 * project.records[name].values("time")[-1]
        lag = parse_quantity(test["lag"], "s") + float(test["clock_rate"]) * middle
        assert found["lag"] == pytest.approx(lag, abs=5e-3)
        assert found["rate"] == pytest.approx(float(test["clock_rate"]), abs=25e-6)


def test_eight_cycles_are_found_and_the_first_two_are_told_apart(project: Project) -> None:
    for name, experiment in project.experiments.items():
        cycles = project.corrected[name]
        assert cycles is not None
        assert cycles.cycle is not None
        assert sorted(set(cycles.cycle[cycles.cycle >= 0])) == list(range(8))
        classes = step(experiment.dataset, "classify_cycles")["classes"]
        assert list(classes.values()) == ["first", "preconditioning", *["stable"] * 6]


def test_the_force_is_brought_to_the_neck(generator: ModuleType, project: Project, truth: dict[str, Any]) -> None:
    curve = generator.read_elastic()
    for name, test in truth["experiments"].items():
        data = project.experiments[name].dataset
        assert project.records[name].values("tension").max() > 1.8 * data.values("tension")[-1]
        peak = parse_quantity(test["target"], "m") - slack_of(test)
        # Within the residual softening and the half bin that the branch's last point lies below the peak.
        expected = (1.0 + test["overstress"]) * np.interp(peak, curve.shortening, curve.tension)
        assert data.values("tension")[-1] == pytest.approx(expected, rel=0.01)


# --- the calibration --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_all_tests_jointly_give_the_modulus_within_what_the_mesh_adds(
    joint: CalibrationResult, loading_modulus: float
) -> None:
    ratio = joint.parameters[E].value / loading_modulus
    assert 1.0 - MESH_AT_MOST < ratio < 1.0


@pytest.mark.slow
def test_with_the_mesh_counted_the_modulus_is_the_true_one(
    generator: ModuleType, project: Project, true_values: dict[str, float], loading_modulus: float
) -> None:
    mesh = mesh_factor(generator, project, true_values)
    assert 1.0 < mesh < 1.0 + MESH_AT_MOST + 0.02
    found = calibrate(at_ratio(make_problem(project), true_values[NU]), method="least-squares", starts=1)
    assert found.parameters[E].value == pytest.approx(loading_modulus / mesh, rel=0.01)
    assert "Converged" in found.status


@pytest.mark.slow
def test_poissons_ratio_hardly_matters(project: Project, joint: CalibrationResult) -> None:
    """Paper A's Table I: E decides. The loss at any other ratio is the same but for some per cent, at another E."""
    assert joint.importance[E] == max(joint.importance.values())
    assert joint.importance[NU] < 0.01
    there = calibrate(at_ratio(make_problem(project), 0.48), method="least-squares", starts=1)
    assert there.loss < 1.05 * joint.loss
    assert there.parameters[E].value == pytest.approx(joint.parameters[E].value, rel=0.05)


@pytest.mark.slow
def test_slack_and_the_lean_of_the_neck_at_rest_are_found(joint: CalibrationResult, truth: dict[str, Any]) -> None:
    for name, test in truth["experiments"].items():
        # Slack and offset make up for the coarser mesh.
        slack = joint.parameters[f"front.slack[{name}]"]
        assert slack.value == pytest.approx(slack_of(test), abs=0.2e-3)
        assert contains(slack, slack_of(test))
        lean = parse_quantity(truth["material"]["set_tilt"], "rad/m") * (
            slack_of(test) - parse_quantity(test["slack"], "m")
        )
        offset = joint.parameters[f"plate.pitch_offset[{name}]"]
        # The detrending takes some of the set's growth for drift of the IMU.
        assert offset.value == pytest.approx(lean, abs=math.radians(0.25))
        assert contains(offset, lean)


@pytest.mark.slow
def test_every_test_is_met_to_the_noise(joint: CalibrationResult) -> None:
    for fit in joint.experiments.values():
        assert fit.rmse["tension"] < 0.02
        assert fit.rmse["pitch"] < math.radians(0.02)


@pytest.mark.long
def test_by_tension_the_modulus_is_the_same(
    project: Project, true_values: dict[str, float], joint: CalibrationResult
) -> None:
    """Paper A's wording: the twin is pulled by the measured force; shortening and pitch are compared."""
    problem = at_ratio(make_problem(project).alone("20mm_5mms"), true_values[NU])
    found = calibrate(by_force(problem), method="least-squares", starts=1)
    assert set(found.experiments["20mm_5mms"].rmse) == {"shortening", "pitch"}
    assert found.parameters[E].value == pytest.approx(joint.parameters[E].value, rel=0.03)


def with_noise(
    experiment: Experiment, fit: ExperimentFit, sigmas: Mapping[str, float], chance: np.random.Generator
) -> Experiment:
    """The experiment with what the twin answers, and white noise, in the place of what was measured."""
    channels = dict(experiment.dataset.channels)
    for name, sigma in sigmas.items():
        noise = sigma * chance.standard_normal(experiment.dataset.n_samples)
        channels[name] = replace(channels[name], values=fit.simulated[name] + noise)
    return replace(experiment, dataset=replace(experiment.dataset, channels=channels))


@pytest.mark.long
def test_the_interval_of_a_ratio_ends_where_fits_with_it_held_are_excluded(project: Project) -> None:
    """By tension, with white noise of half the size that a first fit leaves: ν held at an end of its interval costs
    1.96^2.

    The residuals of the record itself are mostly the misfit of the mesh, they are correlated, and its tests differ:
    their interval is longer than that. Without contact, whose curves are not smooth enough for a quadratic model.
    """
    problem = replace(by_force(make_problem(project)), uncertain=())  # the loss knows of noise alone
    fits = calibrate(problem, method="least-squares", starts=1).experiments
    first = next(iter(fits.values()))
    left = {channel: [fit.rmse[channel] ** 2 for fit in fits.values()] for channel in first.rmse}
    sigmas = {channel: 0.5 * math.sqrt(np.mean(squares)) for channel, squares in left.items()}
    problem = replace(problem, robot=replace(problem.robot, contact=None))
    fits = calibrate(problem, method="least-squares", starts=1).experiments
    chance = np.random.default_rng(1)
    problem = replace(
        problem, experiments=tuple(with_noise(e, fits[e.name], sigmas, chance) for e in problem.experiments)
    )
    wider = [replace(p, lower=0.25) if p.label == NU else p for p in problem.space.parameters]
    problem = replace(problem, loss=LikelihoodLoss(sigmas), space=SearchSpace(tuple(wider)))
    best = calibrate(problem, method="least-squares", starts=1)
    low, high = best.parameters[NU].interval
    assert 0.25 < low < 0.45
    for end in (low, high):
        found = calibrate(at_ratio(problem, end), method="least-squares", starts=1)
        excess = (found.loss - best.loss) / 1.96**2
        # The quadratic model; the exact profile ends a little sooner, as docs/uncertainty.md says.
        assert excess < 1.3
        assert excess > 0.7 or end == 0.4999


# --- pulleys that reverse ---------------------------------------------------------------------------------------------

# Here the friction of the pulleys, in the record that of loading throughout, is made to reverse with the cable.
EXPONENT, PRESLIDING, OFFSET = 0.2 * math.pi, 2e-4, 0.03
TEST = "20mm_2mms"
FRICTION = "pulleys.friction_coefficient"
CHANGES = (
    ("friction_coefficient: 0.1}", "friction_coefficient: 0.07, friction_memory: true, presliding: 0.1 mm}"),
    ("      - take_branch: loading\n", ""),
    ("      - resample: {by: shortening, n: 60}\n", "      - resample: {by: time, n: 1500}\n"),
    ("  front.slack: {bounds", f"  {FRICTION}: {{bounds: [0, 0.3]}}\n  front.slack: {{bounds"),
    ("  pulleys.friction_coefficient: {sd: 0.01}\n", ""),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    to = tmp_path_factory.mktemp("reversing")
    shutil.copytree(EXAMPLE / "data", to / "data")
    shutil.copy(EXAMPLE / "neck.msh", to)
    path = to / "data" / "utm-20mm-2mms.csv"
    head, rows = [], []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            rows.append([float(value.replace(",", ".")) for value in line.split(";")])
        except ValueError:
            head.append(line)
    table = np.array(rows)
    share, _ = reversals(1e-3 * table[:, 1], PRESLIDING)
    table[:, 2] = OFFSET + (table[:, 2] - OFFSET) * np.exp(EXPONENT * (share - 1.0))
    path.write_text(
        "\n".join([*head, *(";".join(f"{v:.6f}".replace(".", ",") for v in row) for row in table), ""]),
        encoding="utf-8",
    )
    text = (EXAMPLE / "project.yaml").read_text(encoding="utf-8")
    for old, new in CHANGES:
        assert old in text, old
        text = text.replace(old, new)
    first = text.index("  20mm_5mms:")
    text = text[:first] + text[text.index("\nparameters:") + 1 :]
    (to / "project.yaml").write_text(text, encoding="utf-8")
    return to


@pytest.mark.slow
def test_both_branches_give_the_modulus_and_the_pulleys_friction(folder, generator, truth):
    """From a nominal friction that is wrong by a third. The overstress of both branches cancels, but for 3 %."""
    project = load(folder / "project.yaml")
    values = {E: 2.07e6, NU: truth["neck"]["poissons_ratio"]}
    mesh = mesh_factor(generator, project, values)
    found = calibrate(at_ratio(make_problem(project), values[NU]), method="least-squares", starts=1)
    assert "Converged" in found.status
    low, high = found.parameters[E].interval
    assert low < values[E] / mesh < high
    assert found.parameters[E].value == pytest.approx(values[E] / mesh, rel=0.03)
    assert found.parameters[FRICTION].value == pytest.approx(0.1, abs=0.005)


# --- the record -------------------------------------------------------------------------------------------------


def test_the_project_does_not_know_the_truth(true_values: dict[str, float]) -> None:
    text = (EXAMPLE / "project.yaml").read_text(encoding="utf-8")
    assert f"{1e-6 * true_values[E]:g} MPa" not in text
    assert f"{true_values[NU]:g}" not in text


@pytest.mark.slow
def test_the_generator_writes_the_record_that_is_kept(
    generator: ModuleType, truth: dict[str, Any], tmp_path: Path
) -> None:
    written = generator.write_record(tmp_path, truth, generator.read_elastic())
    assert sorted(path.name for path in written) == sorted(path.name for path in (EXAMPLE / "data").iterdir())
    for path in written:
        head, numbers = table(path)
        kept_head, kept = table(EXAMPLE / "data" / path.name)
        assert head == kept_head
        assert numbers.shape == kept.shape
        # To the last digit written: another library may round an exponential the other way.
        np.testing.assert_allclose(numbers, kept, rtol=0.0, atol=1.01e-3)


@pytest.mark.long
def test_the_finer_twin_answers_as_it_did(generator: ModuleType, truth: dict[str, Any]) -> None:
    pytest.importorskip("gmsh")
    kept, curve = generator.read_elastic(), generator.solve_elastic(truth)
    # Another version of Gmsh places its tets elsewhere; what the mesh adds to the stiffness moves with them.
    np.testing.assert_allclose(curve.tension, kept.tension, rtol=5e-3, atol=1e-6)
    np.testing.assert_allclose(curve.pitch, kept.pitch, rtol=1e-3, atol=1e-6)


def by_force(problem: Problem) -> Problem:
    """The problem with the twin pulled by the measured force."""
    tests = tuple(replace(experiment, drive="tension", compared=()) for experiment in problem.experiments)
    return replace(problem, experiments=tests)


def at_ratio(problem: Problem, ratio: float) -> Problem:
    """The problem with Poisson's ratio held."""
    free = SearchSpace(tuple(parameter for parameter in problem.space.parameters if parameter.name != NU))
    return replace(problem, robot=with_parameters(problem.robot, {NU: ratio}), space=free)


def contains(estimate: Estimate, value: float) -> bool:
    """Whether the 95 % interval of an estimate contains a value."""
    assert estimate.interval is not None
    low, high = estimate.interval
    return low < value < high


def slack_of(test: dict[str, Any]) -> float:
    """Slack with the permanent set [m] on the loading branches of the stable cycles, the third to the eighth."""
    grown = np.mean([1.0 - math.exp(-(k + 0.5) / 1.2) for k in range(2, 8)])
    return parse_quantity(test["slack"], "m") + grown * parse_quantity(test["set"], "m")


def mesh_factor(generator: ModuleType, project: Project, values: dict[str, float]) -> float:
    """How much stiffer than the finer twin the project's mesh is, over the range that was measured."""
    curve = generator.read_elastic()
    pulled = curve.shortening[(curve.shortening > 3e-3) & (curve.shortening < 28e-3)]
    response = simulate(project.robot, Protocol({"front": Command("shortening", pulled)}), values)
    coarse = response.channels["front.tension"]
    fine = np.interp(pulled, curve.shortening, curve.tension)
    return float(coarse @ coarse / (coarse @ fine))


def table(path: Path) -> tuple[str, np.ndarray]:
    lines = path.read_text(encoding="utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if re.match(r"^-?\d", line))
    rows = [
        [float(cell) for cell in row.replace(",", "." if ";" in row else " ").replace(";", " ").split()]
        for row in lines[first:]
    ]
    return "\n".join(lines[:first]), np.array(rows)
