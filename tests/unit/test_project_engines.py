"""The `engines` section: what it may say, that it reaches SOFA wherever SOFA is run, and that a run keeps to it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from mechanics_cases import pulled, tensed
from project_case import write_project
from sofa_case import use_fake
from typer.testing import CliRunner

from softcal.cli import app
from softcal.errors import ProjectFileError, StorageError
from softcal.plugins.sofa import simulator as sofa_engine_module
from softcal.plugins.sofa.export import write_scene
from softcal.plugins.sofa.settings import Rest, SofaSettings
from softcal.project.project import load
from softcal.workflows.calibration import calibrate
from softcal.workflows.cases import Case

ALL = """\
engines:
  sofa:
    timeout: 10 min
    states: 6
    time_steps: [20 ms, 4 ms]
    rayleigh_mass: 3 1/s
    rayleigh_stiffness: 10 ms
    ramp: 20 ms
    settle: {speed: 2 um/s, hold: 50 ms, longest: 8 s}
"""
SETTINGS = SofaSettings(600.0, 6, (0.02, 0.004), 0.01, 3.0, 0.02, Rest(2e-6, 0.05, 8.0))
QUICK = "engines: {sofa: {ramp: 20 ms, settle: {longest: 6 s}}}\n"
ONE_FREE = ("  front.slack: {bounds: [0 mm, 5 mm], per: experiment}\n", "")
CLOSE = ("[0.1 MPa, 40 MPa], scale: log", "[1 MPa, 3 MPa]")


def project_with(folder: Path, text: str, *changes: tuple[str, str]) -> Path:
    return write_project(folder, ("parameters:\n", f"{text}parameters:\n"), *changes)


def test_every_setting_and_its_default(tmp_path: Path):
    assert load(project_with(tmp_path / "all", ALL)).engines == {"sofa": SETTINGS}
    assert load(write_project(tmp_path / "none")).engines == {}
    one = load(project_with(tmp_path / "one", "engines: {sofa: {time_steps: 1 ms}}\n")).engines["sofa"]
    assert one == SofaSettings(time_steps=(0.001,))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("softa: {}", r"engines\.softa: unknown key.*Try: 'sofa'"),
        ("sofa: {time_step: 1 ms}", r"engines\.sofa\.time_step: unknown key.*Try: 'time_steps'"),
        ("sofa: {time_steps: [2 ms, 5 ms]}", r"time_steps: time steps must decrease.*0\.005 s after 0\.002 s"),
        ("sofa: {time_steps: [10 ms, 0 ms]}", r"engines\.sofa\.time_steps\[1\]: the duration is out of range"),
        ("sofa: {time_steps: []}", r"engines\.sofa\.time_steps: the list has the wrong length"),
        ("sofa: {timeout: 30}", r"engines\.sofa\.timeout"),
        ("sofa: {states: 1}", r"engines\.sofa\.states: .*got 1"),
        ("sofa: {rayleigh_mass: 5 s}", r"engines\.sofa\.rayleigh_mass: the unit does not fit"),
        ("sofa: {rayleigh_stiffness: -1 s}", r"engines\.sofa\.rayleigh_stiffness"),
        ("sofa: {settle: {hold: 2 min}}", r"engines\.sofa\.settle: the time at rest must be shorter.*hold < longest"),
        ("sofa: {settle: {speed: 1 mm}}", r"engines\.sofa\.settle\.speed: the unit does not fit"),
        ("sofa: 3", r"engines\.sofa: this is of the wrong kind"),
    ],
)
def test_faults_are_told_by_key(tmp_path: Path, given: str, message: str):
    with pytest.raises(ProjectFileError, match=message):
        load(project_with(tmp_path, f"engines: {{{given}}}\n"))


def test_all_faults_at_once(tmp_path: Path):
    with pytest.raises(ProjectFileError) as error:
        load(project_with(tmp_path, "engines: {sofa: {ramp: 0 s, states: many, settle: {hold: 1 m}}}\n"))
    told = [str(fault) for fault in error.value.faults]
    assert [key for key in ("ramp", "states", "settle.hold") for line in told if f"engines.sofa.{key}:" in line] == [
        "ramp",
        "states",
        "settle.hold",
    ]


def invoke(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_check_accepts_it(tmp_path: Path):
    done = invoke("check", project_with(tmp_path, ALL))
    assert done.exit_code == 0, done.output


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[SofaSettings]:
    """SOFA's stand-in, and with what it was run."""
    use_fake(monkeypatch)
    seen: list[SofaSettings] = []
    real = sofa_engine_module.run_states

    def noted(sofa, linear, protocol, states, settings, *, shapes=False):
        seen.append(replace(settings, states=len(states)))
        return real(sofa, linear, protocol, states, settings, shapes=shapes)

    monkeypatch.setattr(sofa_engine_module, "run_states", noted)
    return seen


@pytest.mark.slow
def test_they_reach_a_simulation(tmp_path: Path, asked: list[SofaSettings]):
    path, out = project_with(tmp_path, ALL), tmp_path / "out"
    done = invoke("simulate", path, "--experiment", "pull", "--engine", "sofa", "--out", out)
    assert done.exit_code == 0, done.output
    assert asked == [SETTINGS]
    assert json.loads((out / "simulation.json").read_text())["engines"]["sofa"]["states"] == 6


def test_they_reach_an_exported_scene(tmp_path: Path):
    path, out = project_with(tmp_path, ALL + "dynamics: {time_step: 5 ms, rayleigh_mass: 0.3 1/s}\n"), tmp_path / "out"
    done = invoke("export", "sofa", path, "--pull", "front=10mm", "--out", out)
    assert done.exit_code == 0, done.output
    parameters = json.loads((out / "a_square_bar" / "parameters.json").read_text())
    rest = {"time_steps": [0.02, 0.004], "rayleigh_stiffness": 0.01, "rayleigh_mass": 3.0, "ramp": 0.02}
    assert parameters["rest"] == {**rest, "speed": 2e-6, "hold": 0.05, "longest": 8.0}
    assert parameters["time"] == {"dt": 0.005, "rayleigh_stiffness": 0.2, "rayleigh_mass": 0.3}


def test_an_exported_scene_names_the_experiment_of_its_schedule(tmp_path: Path):
    project = load(write_project(tmp_path / "project"))
    several = {
        name: Case(project.robot, protocol)
        for name, protocol in {"short": pulled(0.002), "far": pulled(0.008), "strong": tensed(3.0)}.items()
    }
    for name, cases in (("several", several), ("one", {"far": several["far"]})):
        (tmp_path / name).mkdir()
        write_scene(project, cases, tmp_path / name)
    readme = (tmp_path / "several" / "README.md").read_text()
    assert "pulls front by shortening, as in experiment `far` (the one with the largest pull), until" in readme
    last = (tmp_path / "several" / "a_square_bar" / "schedule.csv").read_text().splitlines()[-1]
    assert float(last.split(",")[1]) == pytest.approx(0.008)
    assert "experiment `" not in (tmp_path / "one" / "README.md").read_text()


@pytest.mark.slow
def test_a_run_goes_on_only_with_the_settings_it_began_with(tmp_path: Path, asked: list[SofaSettings]):
    run = tmp_path / "run"
    options = {"out": run, "method": "grid", "trials": 2, "engine": "sofa"}
    begun = calibrate(load(project_with(tmp_path / "a", QUICK, ONE_FREE, CLOSE)), **options)
    assert {(one.ramp, one.settle) for one in asked} == {(0.02, Rest(longest=6.0))}
    assert begun.headline.hashes["engine"] == "sofa"
    assert begun.headline.hashes["engines.sofa.time_steps"] == "0.05, 0.01, 0.005, 0.002"
    n = len(asked)

    slower = QUICK.replace("20 ms", "30 ms").replace("6 s", "7 s")
    with pytest.raises(StorageError) as error:
        calibrate(load(project_with(tmp_path / "b", slower, ONE_FREE, CLOSE)), resume=True, **options)
    told = [str(fault) for fault in error.value.faults]
    assert len(told) == 2
    assert "engines.sofa.ramp" in told[0]
    assert "got 0.03; allowed: 0.02" in told[0]
    assert "engines.sofa.settle.longest" in told[1]
    with pytest.raises(StorageError) as error:
        calibrate(
            load(project_with(tmp_path / "c", QUICK, ONE_FREE, CLOSE)), resume=True, **{**options, "engine": "softcal"}
        )
    (told,) = error.value.faults
    assert "another engine; got softcal; allowed: sofa. Try: --engine sofa." in str(told)
    assert len(asked) == n

    patient = QUICK.replace("ramp", "timeout: 2 h, ramp")
    again = calibrate(load(project_with(tmp_path / "d", patient, ONE_FREE, CLOSE)), resume=True, **options)
    assert again.headline.parameters == begun.headline.parameters


def test_settings_do_not_matter_where_softcal_computes(tmp_path: Path):
    run = tmp_path / "run"
    options = {"out": run, "method": "grid", "trials": 2}
    calibrate(load(project_with(tmp_path / "a", "", ONE_FREE, CLOSE)), **options)
    calibrate(load(project_with(tmp_path / "b", ALL, ONE_FREE, CLOSE)), resume=True, **options)
