"""`softcal next-test`: the ranking of a run's candidates, the project's own, its files, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import bench_csv, write_project

import softcal
from softcal.calibration.problem.uncertain import MESH_ERROR
from softcal.calibration.statistics.intervals import box_intervals
from softcal.cli import main
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
    # Noise that is larger than the error of the bar's linear tets, which no test would change.
    chance = np.random.default_rng(0)
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
    assert "Not possible, beyond:" in told
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
        ("{cable: back}", "there is no such cable; got 'back'"),
        ("{shortening: 20 N}", "candidates.next.shortening"),
        ("{shortening: 20 mm, tension: 2 N}", "a cable is pulled by one of the two"),
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
