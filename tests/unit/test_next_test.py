"""`softcal next-test`: the ranking of a run's candidates, the project's own, its files, and what it refuses."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import bench_csv, write_project

import softcal
from softcal.analysis.candidate import as_experiment
from softcal.analysis.default_candidates import default_candidates, like_by_default
from softcal.analysis.next_test import next_tests
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.uncertain import MESH_ERROR
from softcal.calibration.statistics.intervals import box_intervals
from softcal.cli import main
from softcal.errors import InputError
from softcal.experiments.dataset import Channel, Dataset
from softcal.workflows.run_folder import load_run
from softcal.workflows.study_source import study_source

CANDIDATES = """
candidates:
  too far: {shortening: 99 mm, noise: {tension: 0.01 N}}
  weighed: {tension: 2 N, measure: plate, noise: {plate.x: 0.1 mm}, samples: 20, repeats: 2}
  beyond: {like: pull, shortening: 120 mm}
"""


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bar")
    # Noise that is larger than the error of the bar's linear tets, which no test would change. No usual cause is
    # suspected in it, whose part in the interval would depend on how closely the curve is interpolated.
    chance = np.random.default_rng(1)
    head, *lines = bench_csv().splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    noisy = [f"{t},{d},{f + 3 * chance.standard_normal()},{p + 5 * chance.standard_normal()}" for t, d, f, p in rows]
    stated = ("tension: 0.05 N, pitch: 0.2 deg", "tension: 3 N, pitch: 5 deg")
    changes = ("starts: 1}", "starts: 1, loss: likelihood}"), stated
    path = write_project(folder, *changes, data="\n".join([head, *noisy]) + "\n")
    path.write_text(path.read_text(encoding="utf-8") + CANDIDATES, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path), "--out", str(folder / "run"), "--no-report"])
    assert not ended.value.code
    return folder / "run"


def test_the_candidates_are_ranked_and_what_cannot_be_done_is_a_sentence(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    code, told, _ = run(capsys, "next-test", calibrated, "--out", tmp_path / "next")
    assert code == 0
    for name in ("pull again", "pull 1.5 times as far", "pull by tension", "pull with a 5 times better", "weighed"):
        assert name in told, name
    assert "Not possible: beyond, " in told
    assert "the cable is pulled in by more than its length" in told
    assert "There is one experiment: by how much tests of this robot differ is not known" in told
    assert "The 95 % interval of bar.youngs_modulus is" in told
    record = json.loads((tmp_path / "next" / "next-test.json").read_text(encoding="utf-8"))
    assert record["calibration"] == "pull"
    with (tmp_path / "next" / "candidates.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    shares = [float(row["of present length [1]"]) for row in rows if row["upper"]]
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert [row["candidate"] for row in rows if row["not possible because"]]
    before = (tmp_path / "next" / "next-test.json").read_bytes()
    code, _, told = run(capsys, "next-test", calibrated, "--out", tmp_path / "next")
    assert code == 2
    assert "nothing is overwritten" in told
    assert (tmp_path / "next" / "next-test.json").read_bytes() == before


def test_the_present_interval_is_that_of_the_run(calibrated: Path):
    found = softcal.next_test(calibrated)
    assert found.interval == pytest.approx(
        load_run(calibrated).headline.parameters["bar.youngs_modulus"].interval, rel=1e-3
    )
    shares = {one.candidate.name: one.share for one in found.outlooks if not one.failure}
    assert shares["pull again"] is not None
    assert 0.5 < shares["pull again"] < 1.0
    assert shares["pull 1.5 times as far"] < shares["pull again"] < shares["pull 0.5 times as far"]
    twice = softcal.next_test(calibrated, candidates=[softcal.Candidate(name="three", like="pull", repeats=3)])
    (three,) = [one for one in twice.outlooks if one.candidate.name == "three"]
    assert three.share is not None
    assert three.share < shares["pull again"]
    assert found.n_solves < 12


def test_another_parameter(calibrated: Path, capsys: pytest.CaptureFixture[str]):
    code, told, _ = run(capsys, "next-test", calibrated, "--for", "front.slack[pull]")
    assert code == 0
    assert "The 95 % interval of front.slack[pull] is" in told


def test_bad_input_is_refused(calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for arguments, message in (
        ((calibrated, "--for", "bar.youngs"), "there is no such free parameter; got 'bar.youngs'"),
        ((calibrated, "--calibration", "joint"), "the run has no such calibration"),
        ((tmp_path,), "there is no run here"),
        ((tmp_path / "none",), "there is no run here"),
        (("a" * 300,), "this cannot be a path"),
    ):
        code, out, told = run(capsys, "next-test", *arguments)
        assert code == 2, arguments
        assert message in told
        assert "Traceback" not in told + out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{like: push}", "there is no such experiment; got 'push'"),
        ("{actuator: back}", "there is no such cable; got 'back'"),
        ("{pressure: 20 kPa}", "candidates.next.pressure: there is no such control; got 'pressure'"),
        ("{shortening: 20 N}", "candidates.next.shortening"),
        ("{shortening: 20 mm, tension: 2 N}", "a candidate is driven in two ways"),
        ("{measure: [tip]}", "there is no such channel, marker or plate"),
        ("{noise: {pitch: 1 N}}", "candidates.next.noise.pitch"),
        ("{settings: {bar.density: 3 mm}}", "candidates.next.settings.bar.density"),
        ("{repeats: 0}", "there are too few repeats"),
        ("{reach: 20 mm}", "unknown key"),
    ],
)
def test_a_slip_in_a_candidate_is_told_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
):
    path = write_project(tmp_path)
    path.write_text(path.read_text(encoding="utf-8") + f"candidates:\n  next: {text}\n", encoding="utf-8")
    code, _, told = run(capsys, "check", path)
    assert code == 2
    assert message in told


def test_a_candidate_must_not_have_the_name_of_an_experiment(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_project(tmp_path)
    path.write_text(path.read_text(encoding="utf-8") + "candidates: {pull: {samples: 3}}\n", encoding="utf-8")
    code, _, told = run(capsys, "check", path)
    assert code == 2
    assert "an experiment has the name of the candidate" in told


def turn_of_a_drive() -> tuple[Problem, float]:
    """A rod with two drives, of which one was turned; and the largest torque of that test."""
    centre, names = softcal.straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 6), ("left", "right", "front", "back")
    moduli = {"youngs_modulus": 1e9, "poissons_ratio": 0.35}
    spine = softcal.Rod(
        "spine", centre, softcal.RoundBar(0.003), moduli, clamped={"tip": np.array([6])}, fixed=np.array([0])
    )
    sides = [(0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)]
    ways = [
        tuple(softcal.ViaPoint(np.array([x, y, z]), on) for z, on in ((0.0, ""), (0.05, "spine"), (0.1, "tip")))
        for x, y in sides
    ]
    cables = [softcal.Cable(name, way, pulled_end="first") for name, way in zip(names, ways, strict=True)]
    drives = [
        softcal.NamedActuator(name, softcal.Drive({a: 1.0, b: -1.0}, 8e-3, spring_rate=2e3, pretension=1.5))
        for name, a, b in (("servo", "left", "right"), ("other", "front", "back"))
    ]
    tip = softcal.Plate("tip", {}, np.array([0.0, 0.0, 0.1]))
    robot = softcal.Robot(rods=(spine,), plates=(tip,), cables=tuple(cables), actuators=tuple(drives))
    angles = np.linspace(0.1, 0.8, 6)
    seen = softcal.simulate(robot, softcal.Protocol({"servo": softcal.Command("angle", angles)})).channels
    channels = {
        "servo.angle": Channel(angles, "rad"),
        "servo.torque": Channel(seen["servo.torque"], "N*m", 1e-4),
        "tip.pitch": Channel(seen["tip.pitch"], "rad", 1e-3),
    }
    turn = Experiment("turn", Dataset("turn", channels), drive=("servo.angle",))
    problem = make_problem(robot, [turn], [FreeParameter(SPINE_E, "Pa", 1e8, 1e10, "log")], LikelihoodLoss())
    return problem, float(seen["servo.torque"][-1])


SPINE_E = "spine.youngs_modulus"


def test_drives_are_candidates_as_cables_are() -> None:
    problem, torque = turn_of_a_drive()
    candidates = {one.name: one for one in default_candidates(problem)}
    assert {"turn again", "turn 1.5 times as far", "turn by torque", "other as turn"} <= candidates.keys()
    assert candidates["other as turn"].actuator == "other"
    harder = softcal.Candidate(name="harder", like="turn", control="torque", reach=2.0 * torque)
    outlooks = {
        one.candidate.name: one for one in next_tests(problem, {SPINE_E: 1e9}, [*candidates.values(), harder]).outlooks
    }
    assert not [one.failure for one in outlooks.values() if one.failure]
    shares = {name: one.share or np.inf for name, one in outlooks.items()}
    assert shares["turn again"] == pytest.approx(np.sqrt(0.5), rel=1e-3)
    assert shares["harder"] < shares["turn again"]
    assert shares["turn again"] < shares["other as turn"] < 1.0  # which leaves the pitch as it is
    wrong = softcal.Candidate(name="wrong", like="turn", control="pressure")
    with pytest.raises(InputError, match="servo of turn has no such control; got 'pressure'; allowed: angle, torque"):
        as_experiment(wrong, problem.experiments[0])


def test_a_candidate_is_by_default_like_a_test_of_its_own_kind_of_actuator() -> None:
    problem, _ = turn_of_a_drive()
    way = (softcal.ViaPoint(np.zeros(3)), softcal.ViaPoint(np.array([0.0, 0.0, 0.1]), "tip"))
    robot = replace(problem.robot, cables=(*problem.robot.cables, softcal.Cable("tug", way), softcal.Cable("tow", way)))
    pulled = {"tug.tension": Channel(np.array([0.0, 50.0]), "N"), "tip.pitch": Channel(np.zeros(2), "rad", 1e-3)}
    turn, pull = *problem.experiments, Experiment("pull", Dataset("pull", pulled), drive=("tug.tension",))

    stated = [(), (["angle", "torque"],), ((), ["angle"]), (["shortening", "tension"], [""]), (["pressure"],)]
    found = [like_by_default([turn, pull], *controls).name for controls in stated]
    assert found == ["pull", "turn", "turn", "pull", "pull"]
    names = {one.name for one in default_candidates(replace(problem, robot=robot, experiments=(turn, pull)))}
    assert {"other as turn", "tow as pull"} <= names
    assert not {"other as pull", "tow as turn"} & names


def test_candidates_beyond_the_limits_of_an_actuator_are_not_possible() -> None:
    problem, torque = turn_of_a_drive()
    further = softcal.Candidate(name="further", like="turn", reach=1.2)
    harder = softcal.Candidate(name="harder", like="turn", control="torque", reach=1.2 * torque)
    again = softcal.Candidate(name="again", like="turn")

    def failures(limits: dict[str, tuple[float, float]]) -> dict[str, str]:
        limited = replace(problem, robot=replace(problem.robot, actuator_limits=limits))
        outlooks = next_tests(limited, {SPINE_E: 1e9}, [again, further, harder]).outlooks
        return {one.candidate.name: one.failure for one in outlooks if one.failure}

    assert failures({}) == {}
    beyond = failures({"servo.angle": (-1.0, 1.1)})
    assert beyond.keys() == {"further"}
    assert re.search(r"beyond the limits of servo\.angle; got 68\.\d+ deg; allowed: -57\.\d+ to 63", beyond["further"])
    assert failures({"torque": (-1.0, 1.1 * torque)}).keys() == {"further", "harder"}
    # The bench has gone further already.
    assert failures({"servo.angle": (-1.0, 0.5)}) == {}


@pytest.mark.slow
def test_two_workers_rank_as_one_process(calibrated: Path):
    assert softcal.next_test(calibrated, workers=2) == softcal.next_test(calibrated)


def test_the_minimum_of_a_study_has_the_errors_of_the_calibration(calibrated: Path):
    source = study_source(calibrated)
    found, slopes = source.estimator()
    assert source.includes_mesh
    assert source.result is not None
    _, errors = box_intervals(source.problem.space.to_search(source.theta), found.minimum, found.root, found.dof)
    stated = [one.standard_error for one in source.result.parameters.values()]
    assert (np.array(errors) * np.abs(slopes)).tolist() == pytest.approx(stated, rel=1e-6)
    assert MESH_ERROR.source in found.variances
