"""Contact is left out for other programs, on both sides of a comparison, and a sentence says so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from mechanics_cases import column_robot, elastic, pulled
from project_case import write_project
from sofa_case import use_fake
from typer.testing import CliRunner

from softcal.cli import app
from softcal.errors import ParameterError
from softcal.export.engine import ENGINES, Engine, EngineState, state_of
from softcal.plugins.calculix.crosscheck import crosscheck
from softcal.plugins.calculix.deck import deck_faults, in_its_law
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.barrier import Contact
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

CONTACT = ["true", "{friction_coefficient: 0.5}"]
QUICK = "engines: {sofa: {ramp: 20 ms, settle: {longest: 6 s}}}\n"
INSTEAD = "parts may pass through each other. Compare small bending only, or set contact: false."
EXPORTED = {
    "sofa": (f"Contact is not exported: in the scene {INSTEAD}", ("README.md", "a_square_bar/parameters.json")),
    "calculix": (f"Contact is not exported: in the deck {INSTEAD}", ("README.txt", "robot.inp")),
}
LEFT_OUT = f"Contact is left out by {{}}: {INSTEAD}"


def project_with(contact: str, folder: Path) -> Path:
    return write_project(
        folder,
        ("robot:\n", f"{QUICK}robot:\n  contact: {contact}\n"),
        ("[0.1 MPa, 40 MPa], scale: log", "[1 MPa, 3 MPa]"),
        ("  front.slack: {bounds: [0 mm, 5 mm], per: experiment}\n", ""),
    )


def invoke(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


@pytest.mark.parametrize("contact", [*CONTACT, "false"])
@pytest.mark.parametrize("name", EXPORTED)
def test_an_export_prints_and_writes_it(name: str, contact: str, tmp_path: Path) -> None:
    sentence, files = EXPORTED[name]
    out = tmp_path / "out"
    printed = invoke("export", name, project_with(contact, tmp_path / "p"), "--pull", "front=3mm", "--out", out)
    n = int(contact != "false")
    assert printed.count(f"Warning: {sentence}") == n
    assert [(out / file).read_text(encoding="utf-8").count(sentence) for file in files] == [n, n]


@pytest.mark.parametrize("name", EXPORTED)
def test_the_rest_of_an_export_is_that_without_contact(name: str, tmp_path: Path) -> None:
    texts: dict[str, dict[Path, str]] = {}
    for contact in ("true", "false"):
        out = tmp_path / contact
        invoke("export", name, project_with(contact, tmp_path / "p"), "--pull", "front=3mm", "--out", out)
        texts[contact] = {path.relative_to(out): path.read_text(encoding="utf-8") for path in out.rglob("*.*")}
    assert texts["true"].keys() == texts["false"].keys()
    for path, text in texts["true"].items():
        other = texts["false"][path]
        if path.suffix == ".json":
            assert {**json.loads(text), "notes": []} == json.loads(other)
        else:
            assert [line for line in text.splitlines() if EXPORTED[name][0] not in line] == other.splitlines()


@pytest.mark.slow
def test_linear_tets_are_identified_by_the_twin_without_contact(tmp_path: Path) -> None:
    """With friction of contact the twin has no statics."""
    robot = column_robot("P2P1", parameters=elastic(2e6, 0.4), divisions=(1, 1, 3))
    found = []
    for folder, contact in ((tmp_path / "with", Contact(friction_coefficient=0.5)), (tmp_path / "without", None)):
        folder.mkdir()
        write_sofa(replace(robot, contact=contact), pulled(0.0, 0.005), folder, "robot")
        parameters = json.loads((folder / "robot" / "parameters.json").read_text(encoding="utf-8"))
        found.append({key: value for key, value in parameters.items() if key != "notes"})
    assert found[0] == found[1]


def test_a_body_that_only_contact_would_carry_is_refused() -> None:
    robot = column_robot()
    free = replace(robot.bodies[0], name="loose", fixed=())
    both = replace(robot, bodies=(*robot.bodies, free), contact=Contact())
    said = "loose: contact is not exported to {}, and the body is not attached otherwise"
    with pytest.raises(ParameterError, match=said.format("SOFA")):
        linear_robot(both)
    (fault,) = deck_faults(both)
    assert str(fault).startswith(said.format("CalculiX"))


@pytest.mark.parametrize("contact", [*CONTACT, "false"])
def test_a_simulation_by_sofa_says_it(contact: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_fake(monkeypatch)
    project, out = project_with(contact, tmp_path / "p"), tmp_path / "out"
    printed = invoke("simulate", project, "--pull", "front=10mm", "--engine", "sofa", "--out", out)
    assert printed.count(LEFT_OUT.format("SOFA")) == int(contact != "false")
    status = json.loads((out / "simulation.json").read_text(encoding="utf-8"))["responses"]["pull"]["status"]
    assert (LEFT_OUT.format("SOFA") in status) == (contact != "false")


@pytest.mark.parametrize("contact", [*CONTACT, "false"])
def test_a_calibration_by_sofa_says_it(contact: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the search, and with its result; its shapes are those without contact."""
    use_fake(monkeypatch)
    project, run = project_with(contact, tmp_path / "p"), tmp_path / "run"
    how = ["--method", "grid", "--trials", 2, "--no-report"]
    printed = invoke("calibrate", project, "--engine", "sofa", "--out", run, *how)
    sentence, said = LEFT_OUT.format("sofa"), contact != "false"
    assert (f"Warning: {sentence}" in printed) == said
    assert (f"Warning: pull: {sentence}" in printed) == said
    result = json.loads((run / "calibrations" / "pull" / "result.json").read_text(encoding="utf-8"))
    assert (sentence in result["notes"]) == said
    if "friction" not in contact:  # softcal's own twin has no statics with it
        assert "Contact" not in invoke("calibrate", project, "--out", tmp_path / "own", *how)


@pytest.mark.parametrize("contact", [Contact(), Contact(friction_coefficient=0.5), None])
def test_a_crosscheck_leaves_it_out_in_both(contact: Contact | None, monkeypatch: pytest.MonkeyPatch) -> None:
    def solve(robot: Robot, protocol, shape, running) -> EngineState:
        assert robot.contact is None
        return state_of(simulate(robot, protocol, snapshots=True, curve_tolerance=0.0))

    monkeypatch.setitem(ENGINES._members, "bare", Engine("bare", in_its_law, lambda: "", solve))
    robot = replace(column_robot("P2", law="neo-hooke-isochoric", divisions=(1, 1, 3)), contact=contact)
    (one,) = crosscheck(robot, pulled(0.005), ["bare"]).comparisons
    assert one.agrees
    assert one.changed == (("no contact, so that parts may pass through each other",) if contact else ())


def test_an_engine_that_has_contact_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def solve(robot: Robot, protocol, shape, running) -> EngineState:
        assert robot.contact is not None
        return state_of(simulate(robot, protocol, snapshots=True, curve_tolerance=0.0))

    monkeypatch.setitem(ENGINES._members, "full", Engine("full", lambda robot: robot, lambda: "", solve))
    robot = replace(column_robot(divisions=(1, 1, 3)), contact=Contact())
    (one,) = crosscheck(robot, pulled(0.005), ["full"]).comparisons
    assert one.agrees
    assert one.changed == ()
    assert not ENGINES["full"].leaves_out_contact(robot)
    assert ENGINES["sofa"].leaves_out_contact(robot)
