"""The command line, in this process: what it prints, writes and leaves with."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import MODULUS, RATIO, SLACK, bar_robot, bench_values, write_project

from softcal.cli import main
from softcal.project.project import load
from softcal.report.write import ReportPaths
from softcal.twin.response import Response
from softcal.twin.simulate import simulate as simulate_robot
from softcal.workflows import calibrated_shapes, reporting
from softcal.workflows import calibration as calibrating
from softcal.workflows.run_folder import load_run
from softcal.workflows.simulation import pull, simulate


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as stream:
        header, *rows = list(csv.reader(stream))
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]):
    code, out, _ = run(capsys, "--help")
    assert code == 0
    for command in ("init", "check", "simulate", "calibrate", "report"):
        assert f"\n  {command} " in out


def test_an_unknown_option_is_bad_input(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    code, _, err = run(capsys, "calibrate", tmp_path, "--nonsense")
    assert code == 2
    assert "nonsense" in err


def test_init_writes_a_project_that_loads(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    code, out, _ = run(capsys, "init", "neck", tmp_path / "mine")
    assert code == 0
    assert "softcal check" in out
    project = load(tmp_path / "mine" / "project.yaml")
    assert list(project.experiments) == ["pull_20mm", "pull_40mm", "pull_60mm"]
    assert not project.warnings


def test_init_overwrites_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    (tmp_path / "mine.txt").write_text("mine")
    code, _, err = run(capsys, "init", "neck", tmp_path)
    assert code == 2
    assert "not empty" in err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize("template_name", ["neck", "finger", "pneunet", "bellows"])
def test_the_template_is_the_example(repository: Path, template_name: str):
    example, template = repository / "examples" / template_name, repository / "src/softcal/templates" / template_name
    names = sorted(path.relative_to(template) for path in template.rglob("*") if path.is_file())
    assert names
    for name in names:
        assert (example / name).read_bytes() == (template / name).read_bytes(), name


def test_check_prints_a_table_and_draws(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from softcal.report import check_figures
    from softcal.report.scene_render import Rendering

    monkeypatch.setattr(check_figures, "render_scenes", lambda *_: Rendering((), ""))
    code, out, err = run(capsys, "check", write_project(tmp_path / "p"), "--out", tmp_path / "look")
    assert code == 0
    assert "192 linear tets" in out
    assert "free bar.youngs_modulus" in out
    assert "in order" in out
    assert "Warning" not in err
    assert {path.name for path in (tmp_path / "look").iterdir()} == {
        "robot.png", "states.png", "data-pull.png"
    }  # fmt: skip


def test_simulate_writes_channels_with_units(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("softcal.workflows.simulation_folder._draw", lambda *_: None)
    path, out = write_project(tmp_path / "p"), tmp_path / "out"
    held = ["--set", f"bar.youngs_modulus={MODULUS / 1e6}MPa", "--set", f"front.slack={SLACK * 1e3} mm"]
    code, printed, _ = run(capsys, "simulate", path, *held, "--out", out)
    assert code == 0
    assert "pull: Solved" in printed
    tension = bench_values()[2]
    row = next(line for line in printed.splitlines() if "front.tension" in line)
    low, high = re.findall(r"-?[\d.]+", row.partition("tension")[2])
    assert [float(low), float(high)] == pytest.approx([tension.min(), tension.max()], abs=2e-4)
    found = table(out / "response-pull.csv")
    np.testing.assert_allclose(found["front.tension [N]"], bench_values()[2], atol=2e-5)
    np.testing.assert_allclose(found["plate.pitch [rad]"], np.deg2rad(bench_values()[3]), atol=1e-6)
    assert {"front.shortening [m]", "plate.roll [rad]", "plate.x [m]"} <= set(found)
    record = json.loads((out / "simulation.json").read_text())
    assert record["parameters"]["bar.youngs_modulus"] == {"value": MODULUS, "unit": "Pa"}


def test_simulate_a_pull(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("softcal.workflows.simulation_folder._draw", lambda *_: None)
    path = write_project(tmp_path / "p")
    assert run(capsys, "simulate", path, "--pull", "front=5mm", "--out", tmp_path / "d")[0] == 0
    assert run(capsys, "simulate", path, "--pull", "front=0.5 N", "--out", tmp_path / "t")[0] == 0
    assert table(tmp_path / "d" / "response-pull.csv")["front.shortening [m]"][-1] == pytest.approx(0.005)
    assert table(tmp_path / "t" / "response-pull.csv")["front.tension [N]"][-1] == pytest.approx(0.5)


def test_a_simulation_that_fails_says_why_and_writes_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    sentence = "No equilibrium at 12.0 mm of shortening: a tet would turn inside out."
    failed = Response({}, {}, sentence, succeeded=False, n_factorisations=3)
    monkeypatch.setattr("softcal.workflows.simulation.simulate_robot", lambda *_, **__: failed)
    code, _, err = run(capsys, "simulate", write_project(tmp_path / "p"), "--out", tmp_path / "out")
    assert code == 1
    assert err == f"Error: pull: {sentence}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["p"]


def test_the_states_that_exist_are_written_where_others_do_not(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    sentence = "Sample 2 of 3 was not reached (front 5 mm): no equilibrium. The other 2 are solved."
    channels = {"front.tension": np.array([1.0, 2.0])}
    partly = Response(channels, {"front.tension": "N"}, sentence, succeeded=False, n_factorisations=3, samples=(0, 2))
    monkeypatch.setattr("softcal.workflows.simulation.simulate_robot", lambda *_, **__: partly)
    code, printed, err = run(capsys, "simulate", write_project(tmp_path / "p"), "--out", tmp_path / "out")
    assert code == 1
    assert err == f"Error: pull: {sentence}\n"
    assert "Solved" not in printed
    assert table(tmp_path / "out" / "response-pull.csv")["front.tension [N]"].tolist() == [1.0, 2.0]
    record = json.loads((tmp_path / "out" / "simulation.json").read_text())["responses"]["pull"]
    assert record["status"] == sentence
    assert record["succeeded"] is False


def test_a_calibration_that_fails_everywhere_keeps_its_trials(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    failed = Response({}, {}, "No equilibrium.", succeeded=False, n_factorisations=3)
    monkeypatch.setattr("softcal.twin.simulate.simulate", lambda *_, **__: failed)
    code, _, err = run(capsys, "calibrate", write_project(tmp_path / "p"), "--out", tmp_path / "run")
    assert code == 1
    assert "could not be simulated" in err
    assert "Traceback" not in err
    assert (tmp_path / "run" / "calibrations" / "pull" / "optuna.journal").is_file()
    assert not (tmp_path / "run" / "result.json").exists()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of the small project."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.raises(SystemExit) as left:
        main(["calibrate", str(write_project(folder / "p")), "--out", str(folder / "run"), "--no-report"])
    assert not left.value.code
    return folder


def test_calibrate_finds_what_made_the_data(finished: Path):
    held = json.loads((finished / "run" / "result.json").read_text())
    assert held["parameters"]["bar.youngs_modulus"]["value"] == pytest.approx(MODULUS, rel=1e-5)
    assert held["parameters"]["front.slack[pull]"]["value"] == pytest.approx(SLACK, abs=1e-7)
    assert held["parameters"]["bar.youngs_modulus"]["unit"] == "Pa"
    assert not held["parameters"]["bar.youngs_modulus"]["at_bound"]
    wanted = {"loss", "loss_name", "method", "seed", "n_solves", "n_factorisations", "wall_s", "status",
              "experiments", "importance", "n_failed_trials", "versions", "hashes"}  # fmt: skip
    assert wanted <= set(held)
    assert set(held["experiments"]["pull"]) >= {
        "tension_rmse", "tension_rmse_detrended", "pitch_rmse", "pitch_rmse_detrended"
    }  # fmt: skip
    assert {"project.yaml", "bar.msh", "data/pull.csv"} <= set(held["hashes"])


def test_shapes_are_solved_once_for_the_warnings_and_the_report(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, finished: Path, tmp_path: Path
):
    home = shutil.copytree(finished, tmp_path / "home")
    solved: list[Response] = []

    def counted(*args: object, **options: object) -> Response:
        solved.append(simulate_robot(*args, **options))
        return solved[-1]

    monkeypatch.setattr(calibrated_shapes, "simulate_robot", counted)
    monkeypatch.setattr(reporting, "write_content", lambda content, out, **_: ReportPaths(out, (), ()))
    code, _, err = run(capsys, "calibrate", home / "p" / "project.yaml", "--out", home / "run", "--resume")
    assert code == 0, err
    assert [response.channels["front.tension"].size for response in solved] == [len(bench_values()[0])]


@pytest.mark.parametrize("changed", ["project.yaml", "inputs/data/pull.csv", "inputs/bar.msh"])
@pytest.mark.parametrize("missing", [False, True])
def test_a_run_whose_inputs_were_changed_is_not_told_of(
    capsys: pytest.CaptureFixture[str], finished: Path, tmp_path: Path, changed: str, missing: bool
):
    home = shutil.copytree(finished, tmp_path / "home")
    folder, path = home / "run", home / "run" / changed
    text = path.read_text() + "\n"
    path.unlink()
    if not missing:
        path.write_text(text)
    before = sorted(home.rglob("*"))
    again = ("calibrate", home / "p" / "project.yaml", "--out", folder, "--resume")
    for command in (("report", folder), ("export", "vtk", folder, "--out", tmp_path / "vtk"), again):
        code, _, err = run(capsys, *command)
        assert code == 2
        sentence = "a file of the run is missing" if missing else "the file was changed after the calibration"
        assert f"Error: {path}: {sentence}. Try: restore it" in err
    assert sorted(home.rglob("*")) == before


def test_a_run_is_not_gone_on_with_by_other_data(capsys: pytest.CaptureFixture[str], finished: Path, tmp_path: Path):
    home = shutil.copytree(finished, tmp_path / "home")
    path = home / "p" / "data" / "pull.csv"
    path.write_text(path.read_text() + "\n")
    code, _, err = run(capsys, "calibrate", home / "p" / "project.yaml", "--out", home / "run", "--resume")
    assert code == 2
    assert f"{path}: the file was changed after the run began" in err


@pytest.mark.slow
def test_check_shows_a_ratio_that_is_nearly_a_half_as_it_is_written(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path = write_project(tmp_path / "p")
    text = path.read_text()
    assert "poissons_ratio: 0.4" in text
    path.write_text(re.sub(r"(poissons_ratio: )0\.4\d*", r"\g<1>0.49999", text, count=1))
    code, out, err = run(capsys, "check", path)
    assert code == 0, err
    assert "ν 0.49999" in out


def test_the_run_folder_holds_its_tables(finished: Path):
    response = table(finished / "run" / "response-pull.csv")
    assert {"front.shortening [m]", "front.tension [N]", "plate.pitch [rad]", "plate.x [m]"} <= set(response)
    with (finished / "run" / "trials.csv").open(newline="") as stream:
        trials = list(csv.DictReader(stream))
    assert trials
    assert all(row["calibration"] == "pull" and row["state"] == "COMPLETE" for row in trials)
    assert float(trials[-1]["bar.youngs_modulus [Pa]"]) == pytest.approx(MODULUS, rel=1e-3)
    original, copy = finished / "p" / "project.yaml", finished / "run" / "project.yaml"
    assert original.read_bytes() == copy.read_bytes()


def test_a_run_can_be_read_wherever_it_went(finished: Path, tmp_path: Path):
    import shutil

    shutil.copytree(finished / "run", tmp_path / "elsewhere")
    read = load_run(tmp_path / "elsewhere")
    assert set(read.results) == {"pull"}
    assert read.project.inputs["bar.msh"].is_relative_to(tmp_path)
    assert read.project.hashes == read.hashes
    at_values = calibrating.calibrated(read.project, read.results["pull"])
    tension = simulate(at_values).channels["front.tension"]
    np.testing.assert_allclose(tension, bench_values()[2], atol=1e-4)


def test_a_finished_run_is_not_overwritten(capsys: pytest.CaptureFixture[str], finished: Path):
    before = (finished / "run" / "result.json").read_bytes()
    code, _, err = run(capsys, "calibrate", finished / "p" / "project.yaml", "--out", finished / "run")
    assert code == 2
    assert "nothing is overwritten" in err
    assert "--resume" in err
    assert (finished / "run" / "result.json").read_bytes() == before


def test_a_finished_run_resumes_to_the_same(capsys: pytest.CaptureFixture[str], finished: Path):
    before = json.loads((finished / "run" / "result.json").read_text())
    path = finished / "p" / "project.yaml"
    code, _, err = run(capsys, "calibrate", path, "--out", finished / "run", "--resume", "--no-report")
    assert code == 0, err
    after = json.loads((finished / "run" / "result.json").read_text())
    assert after["parameters"] == before["parameters"]
    assert after["n_solves"] == before["n_solves"]


def test_version(capsys: pytest.CaptureFixture[str]):
    code, out, _ = run(capsys, "--version")
    assert (code, out) == (0, f"softcal {version('softcal')}\n")


def test_resume_without_a_run(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    code, _, err = run(capsys, "calibrate", write_project(tmp_path / "p"), "--out", tmp_path / "run", "--resume")
    assert code == 2
    assert "there is no run here" in err
    assert not (tmp_path / "run").exists()


def test_a_run_is_not_resumed_with_other_values(capsys: pytest.CaptureFixture[str], finished: Path):
    arguments = ("--out", finished / "run", "--resume", "--set", "bar.poissons_ratio=0.3")
    code, _, err = run(capsys, "calibrate", finished / "p" / "project.yaml", *arguments)
    assert code == 2
    assert "other fixed parameters" in err


def test_a_held_parameter_is_not_searched(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    out = tmp_path / "run"
    arguments = ("--out", out, "--set", "front.slack=1.5mm", "--no-report", "--seed", 7)
    code, _, err = run(capsys, "calibrate", write_project(tmp_path / "p"), *arguments)
    assert code == 0, err
    held = json.loads((out / "result.json").read_text())
    assert list(held["parameters"]) == ["bar.youngs_modulus"]
    assert held["parameters"]["bar.youngs_modulus"]["value"] == pytest.approx(MODULUS, rel=1e-5)
    assert held["values"] == {"front.slack": 0.0015}
    assert held["seed"] == 7


SECOND = (
    "parameters:",
    "  again:\n"
    "    {cable: front, plate: plate, files: [{path: data/pull.csv, columns: "
    "{shortening: {name: Displacement}, tension: {name: Force}}}]}\n"
    "parameters:",
)


@pytest.mark.slow
def test_each_and_joint(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path, out = write_project(tmp_path / "p", SECOND), tmp_path / "run"
    code, printed, err = run(capsys, "calibrate", path, "--fit", "both", "--out", out, "--no-report")
    assert code == 0, err
    assert "joint" in printed
    held = json.loads((out / "result.json").read_text())
    assert held["headline"] == "joint"
    assert set(held["calibrations"]) == {"pull", "again", "joint"}
    assert set(held["parameters"]) == {"bar.youngs_modulus", "front.slack[pull]", "front.slack[again]"}
    assert set(load_run(out).results) == {"pull", "again", "joint"}


def test_each_alone_is_put_side_by_side(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path, out = write_project(tmp_path / "p", SECOND), tmp_path / "run"
    assert run(capsys, "calibrate", path, "--fit", "each", "--out", out, "--no-report")[0] == 0
    held = json.loads((out / "result.json").read_text())
    names = {"bar.youngs_modulus[pull]", "bar.youngs_modulus[again]", "front.slack[pull]", "front.slack[again]"}
    assert set(held["parameters"]) == names
    assert {path.name for path in out.glob("response-*.csv")} == {"response-pull.csv", "response-again.csv"}


def test_report_from_a_moved_run(capsys: pytest.CaptureFixture[str], finished: Path, monkeypatch: pytest.MonkeyPatch):
    from softcal.report.content import ReportContent
    from softcal.report.write import ReportPaths
    from softcal.workflows import reporting

    seen: list[ReportContent] = []

    def written(content: ReportContent, folder: Path, **_: object) -> ReportPaths:
        seen.append(content)
        return ReportPaths(folder / "report.html", (), ())

    monkeypatch.setattr(reporting, "write_content", written)
    code, out, err = run(capsys, "report", finished / "run")
    assert code == 0
    assert err.startswith("Report: ")  # what it is doing: into a pipe a line at the start, and one a minute
    assert len(err.splitlines()) == 1
    assert str(finished / "run" / "report.html") in out
    (content,) = seen
    assert content.project_name == "a square bar"
    assert content.print_infill is not None
    assert content.twin is not None
    assert content.twin.bent.plates["plate"][1][0, 2] > 0.1
    assert content.experiments["pull"].raw.n_samples == 25


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code", "by"),
    [
        (signal.SIGINT, 130, "the user"),
        (signal.SIGTERM, 143, "SIGTERM"),
        (signal.SIGHUP, 129, "SIGHUP"),
    ],
    ids=["Ctrl-C", "SIGTERM", "SIGHUP"],
)
def test_a_stop_keeps_everything_and_resumes(tmp_path: Path, number: signal.Signals, code: int, by: str):
    """A real process, a real signal: an exit code of its own, what to type next, and a run that goes on."""
    path, out = write_project(tmp_path / "p"), tmp_path / "run"
    command = [sys.executable, "-m", "softcal", "calibrate", str(path), "--out", str(out), "--no-report"]
    command += ["--method", "tpe", "--trials", "4000"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    store = out / "calibrations" / "pull" / "optuna.journal"
    deadline = time.monotonic() + 60
    while not (store.is_file() and store.stat().st_size > 1500) and time.monotonic() < deadline:
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    os.kill(process.pid, number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert "Traceback" not in err
    assert f"--out {out} --method tpe --trials 4000 --resume" in err
    held = json.loads((out / "result.json").read_text())
    assert f"Stopped by {by} after" in held["status"]
    n_before = len((out / "trials.csv").read_text().splitlines()) - 1
    assert n_before >= 1
    found = calibrating.calibrate(load(path), out=out, resume=True, method="tpe", trials=n_before + 2)
    assert not found.interrupted
    assert len(found.headline.trials) == n_before + 2


@pytest.mark.slow
def test_a_terminal_that_is_closed_stops_a_calibration_whole(tmp_path: Path):
    """What is written to it from then on is an error, which must not come before the results are kept."""
    fcntl, pty, termios = (pytest.importorskip(name) for name in ("fcntl", "pty", "termios"))
    path, out = write_project(tmp_path / "p"), tmp_path / "run"
    command = [sys.executable, "-m", "softcal", "calibrate", str(path), "--out", str(out), "--no-report"]
    command += ["--method", "tpe", "--trials", "4000"]
    terminal, end = pty.openpty()
    process = subprocess.Popen(
        command,
        stdin=end,
        stdout=end,
        stderr=end,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509 (nothing but a system call)
    )
    os.close(end)
    os.set_blocking(terminal, False)
    store = out / "calibrations" / "pull" / "optuna.journal"
    deadline = time.monotonic() + 60
    while not (store.is_file() and store.stat().st_size > 1500) and time.monotonic() < deadline:
        assert process.poll() is None
        with contextlib.suppress(BlockingIOError):
            os.read(terminal, 65536)
        time.sleep(0.05)
    os.close(terminal)
    assert process.wait(timeout=60) == 129
    assert "Stopped by SIGHUP after" in json.loads((out / "result.json").read_text())["status"]


def test_python_pull_and_robot_alone():
    response = simulate(bar_robot(), pull(bar_robot(), "front", "shortening", 0.01, samples=3))
    assert response.succeeded
    assert response.channels["plate.pitch"][-1] > 0.1
    assert RATIO == 0.42
