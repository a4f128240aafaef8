"""Bad input ends with exit code 2 and one clear message: no traceback, nothing written, every fault told."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import bench_csv, bench_values, write_project

from softcal.geometry.write import write_mesh
from softcal.workflows import output

Change = tuple[str, str]


def refused(capsys: pytest.CaptureFixture[str], project: Path, *pieces: str, command: str = "calibrate") -> str:
    """Run a command that must refuse the project, and return what it said."""
    out = project.parent / "out"
    before = sorted(project.parent.rglob("*"))
    code, printed, err = run(capsys, command, project, "--out", out)
    assert code == 2, err
    assert err.startswith("Error: ")
    assert "Traceback" not in err
    assert printed == ""
    assert sorted(project.parent.rglob("*")) == before, "something was written"
    for piece in pieces:
        assert piece in err, err
    return err


UNITS: dict[str, tuple[Change, tuple[str, ...]]] = {
    "a missing unit": (
        ("youngs_modulus: 2 MPa", "youngs_modulus: 2"),
        ("project.yaml:8: robot.bodies.bar.youngs_modulus", "unit is missing", "got 2", "converts to Pa"),
    ),
    "a wrong unit": (
        ("youngs_modulus: 2 MPa", "youngs_modulus: 2 mm"),
        ("project.yaml:8:", "unit does not fit", "'mm'", "converts to Pa"),
    ),
    "an unknown unit": (("modulus: 2 MPa", "modulus: 2 MPascal_"), ("project.yaml:8:", "'MPascal_'")),
    "not a quantity": (("modulus: 2 MPa", "modulus: soft"), ("project.yaml:8:", "not a quantity", "'soft'")),
    "a wrong unit in a list": (
        ("[30 mm, 0 mm, 0 mm]", "[30 mm, 0 N, 0 mm]"),
        ("project.yaml:20: robot.cables.front.via[1].at[1]", "'N'", "converts to m"),
    ),
    "a missing unit of the mesh": (
        ("unit: mm}\n      element", "}\n      element"),
        ("project.yaml:6:", "unit of the mesh"),
    ),
    "a wrong unit of the mesh": (("unit: mm}\n      element", "unit: kg}\n      element"), ("project.yaml:6:", "'kg'")),
    "a wrong unit of a column": (
        ("{name: Force, unit: N}", "{name: Force, unit: mm}"),
        ("project.yaml:26: experiments.pull.files[0]", "pull.csv", "column 'Force [N]'", "'mm'"),
    ),
    "a missing unit of a noise": (
        ("tension: 0.05 N", "tension: 0.05"),
        ("experiments.pull.noise.tension", "unit is missing"),
    ),
    "a missing unit of a bound": (
        ("[0 mm, 5 mm]", "[0 mm, 5]"),
        ("project.yaml:35: parameters.front.slack.bounds[1]", "unit is missing", "got 5"),
    ),
}

KEYS: dict[str, tuple[Change, tuple[str, ...]]] = {
    "a key by another word of the field": (
        ("youngs_modulus: 2 MPa", "E: 2 MPa"),
        ("robot.bodies.bar.E: unknown key", "Try: 'youngs_modulus'."),
    ),
    "an unknown key": (
        ("poissons_ratio", "poisson_ratio"),
        ("project.yaml:9:", "unknown key", "Try: 'poissons_ratio'"),
    ),
    "an unknown section": (
        ("parameters:", "paramters:"),
        ("project.yaml:33: paramters: unknown key", "Try: 'parameters'"),
    ),
    "a missing key": (("      youngs_modulus: 2 MPa\n", ""), ("robot.bodies.bar.youngs_modulus: a key is missing",)),
    "a key that stands twice": (
        ("      element: P1\n", "      element: P1\n      element: P2\n"),
        ("project.yaml:8: robot.bodies.bar.element", "appears twice", "line 7"),
    ),
    "an unknown choice": (("element: P1", "element: Q1"), ("project.yaml:7:", "'Q1'", "P1, P2, P2P1")),
    "an unknown method": (
        ("least-squares", "simplex"),
        ("calibration.method", "'simplex'", "grid, least-squares, tpe"),
    ),
    "not YAML": (("plates:", "plates: {"), ("project.yaml:", "not YAML")),
    "a format of the future": (("softcal: 1", "softcal: 2"), ("project.yaml:1: softcal", "not known", "got 2")),
}

MODEL: dict[str, tuple[Change, tuple[str, ...]]] = {
    "a ratio of one half": (
        ("poissons_ratio: 0.42", "poissons_ratio: 0.5"),
        ("project.yaml:9:", "out of range", "0.4999"),
    ),
    "a ratio at which the law gives way": (
        ("poissons_ratio: 0.42", "poissons_ratio: -0.6"),
        (
            "project.yaml:9: robot.bodies.bar.poissons_ratio",
            "got -0.6",
            "between -0.5 and 0.5",
            "law neo-hooke-isochoric",
        ),
    ),
    "a bound at which the law gives way": (
        ("  front.slack:", "  bar.poissons_ratio: {bounds: [-0.6, 0.4]}\n  front.slack:"),
        ("project.yaml:35: parameters.bar.poissons_ratio", "lower bound", "got -0.6", "law neo-hooke-isochoric"),
    ),
    "a bound of one half": (
        ("  front.slack:", "  bar.poissons_ratio: {bounds: [0.4, 0.5]}\n  front.slack:"),
        ("project.yaml:35: parameters.bar.poissons_ratio", "upper bound", "got 0.5", "0.4999"),
    ),
    "bounds reversed": (
        ("[0.1 MPa, 40 MPa]", "[40 MPa, 0.1 MPa]"),
        ("project.yaml:34: parameters.bar.youngs_modulus", "reversed", "40 MPa to 100 kPa", "lower < upper"),
    ),
    "a prior outside the bounds": (
        ("{bounds: [0.1 MPa, 40 MPa]", "{bounds: [3 MPa, 40 MPa], prior: {mean: 2 MPa, sd: 1 MPa}"),
        (
            "project.yaml:34: parameters.bar.youngs_modulus: the prior's mean is",
            "got 2 MPa; allowed: 3 to 40 MPa. Try:",
        ),
    ),
    "a log scale through zero": (
        ("front.slack: {bounds: [0 mm, 5 mm]", "front.slack: {bounds: [0 mm, 5 mm], scale: log"),
        ("project.yaml:35: parameters.front.slack", "log scale needs bounds above zero"),
    ),
    "an unknown parameter": (
        ("bar.youngs_modulus: {b", "bar.young_modulus: {b"),
        ("no such parameter", "bar.youngs_modulus"),
    ),
    "a region that selects nothing": (
        ("point: [0 mm, 0 mm, 0 mm]", "point: [0 mm, 0 mm, 7 m]"),
        ("project.yaml:11: robot.bodies.bar.regions.foot", "selects no nodes", "spans", "unit"),
    ),
    "an unknown group": (("{group: z1}", "{group: z2}"), ("regions.head", "'z2'", "z0, z1", "Try: 'z1'")),
    "an unknown region": (("fixed: foot", "fixed: fot"), ("robot.bodies.bar.fixed", "'fot'", "Try: 'foot'")),
    "a cable point outside its body": (
        ("{on: plate, at: [30 mm, 0 mm, 100 mm]}", "{on: bar, at: [30 mm, 0 mm, 100 mm]}"),
        ("project.yaml:19: robot.cables.front.via[0].at", "outside its body by 20 mm", "spans"),
    ),
    "a cable on one plate": (
        ("- {at: [30 mm, 0 mm, 0 mm]}", "- {on: plate, at: [30 mm, 0 mm, 0 mm]}"),
        ("project.yaml:17: robot.cables.front: nothing changes the length", "got every via point on plate"),
    ),
    "a cable in space": (
        ("{on: plate, at: [30 mm, 0 mm, 100 mm]}", "{at: [30 mm, 0 mm, 100 mm]}"),
        ("project.yaml:17: robot.cables.front: nothing changes the length", "got every via point fixed in space"),
    ),
    "a cable on nothing": (("on: plate", "on: plat"), ("via[0].on", "'plat'", "Try: 'plate'")),
    "a missing mesh": (
        ("file: bar.msh", "file: baz.msh"),
        ("project.yaml:6:", "no such mesh file", "'baz.msh'", "bar.msh"),
    ),
    "via points at one place": (
        ("- {at: [30 mm, 0 mm, 0 mm]}", "- {at: [30 mm, 0 mm, 0 mm]}\n        - {at: [30 mm, 0 mm, 0 mm]}"),
        ("project.yaml:17: robot.cables.front: via points 2 and 3 are at one place", "(30, 0, 0) mm"),
    ),
    "a cable without a length": (
        ("- {at: [30 mm, 0 mm, 0 mm]}", "- {at: [30 mm, 0 mm, 100 mm]}"),
        ("project.yaml:17: robot.cables.front: the cable has no length", "(30, 0, 100) mm"),
    ),
    "a cable shorter than the data pull it": (
        ("- {at: [30 mm, 0 mm, 0 mm]}", "- {at: [30 mm, 0 mm, 90 mm]}"),
        ("front.shortening", "got 20 mm; allowed: < 10 mm. Try: check the unit of the column 'Displacement' in mm"),
    ),
    "friction in per cent": (
        ("experiments:\n", "rig:\n  pulleys: {wrap: 90 deg, friction_coefficient: 5}\nexperiments:\n"),
        ("project.yaml:22: rig.pulleys.friction_coefficient", "got 5; allowed: 0 to 2. Try: 0.05 for 5 %"),
    ),
    "friction that leaves nothing of the tension": (
        ("experiments:\n", "rig:\n  pulleys: {count: 90, wrap: 9 rad, friction_coefficient: 0.1}\nexperiments:\n"),
        ("project.yaml:22: rig.pulleys", "the friction over all pulleys is out of range; got 81; allowed: 0 to 10"),
    ),
    "a wrap the other way round": (
        ("experiments:\n", "rig:\n  pulleys: {wrap: -90 deg, friction_coefficient: 0.1}\nexperiments:\n"),
        ("project.yaml:22: rig.pulleys.wrap: the wrap angle is out of range", "allowed: 0 to 100 rad"),
    ),
    "nothing but what drives": (
        (
            "          tension: {name: Force, unit: N}\n          pitch: {name: Pitch, unit: deg}\n    noise: "
            "{tension: 0.05 N, pitch: 0.2 deg}\n",
            "",
        ),
        ("project.yaml:22: experiments.pull: there is nothing to compare", "got shortening, which drives it", "--pull"),
    ),
    "a mesh in km": (
        ("unit: mm}\n      element", "unit: km}\n      element"),
        ("project.yaml:6: robot.bodies.bar.mesh", "got 100000 m; allowed: 1e-06 to 100 m. Try: another unit"),
    ),
    "a mesh in nm, which could not be solved": (
        ("unit: mm}\n      element", "unit: nm}\n      element"),
        ("project.yaml:6: robot.bodies.bar.mesh", "got 1e-07 m; allowed: 1e-06 to 100 m"),
    ),
    "gravity in mm/s^2": (
        ("  cables:\n", "  gravity: [0 m/s^2, 0 m/s^2, -9810 m/s^2]\n  cables:\n"),
        ("project.yaml:16: robot.gravity[2]: the acceleration is out of range", "Try: 9.81 m/s^2, or 9810 mm/s^2"),
    ),
    "no noise to speak of": (
        ("tension: 0.05 N", "tension: 1e-300 N"),
        ("project.yaml:32: experiments.pull.noise.tension", "got 1e-300 N; allowed: 1e-12 to 1e+06 N"),
    ),
    "everything held out": (
        ("starts: 1}", "starts: 1, hold_out: pull}"),
        ("project.yaml:36: calibration.hold_out: no experiment is left to fit",),
    ),
    "no number": (
        ("normal: [0, 0, 1]", "normal: [0, 0, .nan]"),
        ("Error: project.yaml:11: robot.bodies.bar.regions.foot.plane.normal[2]: this is not a quantity; got '.nan'",),
    ),
    "an unreadable kind of mesh": (
        ("file: bar.msh", "file: project.yaml"),
        ("project.yaml:6:", "'.yaml'", ".msh, .vtk"),
    ),
    "a missing data file": (("data/pull.csv", "data/push.csv"), ("project.yaml:26:", "no such data file", "pull.csv")),
    "a missing column": (
        ("name: Displacement", "name: Displacment"),
        ("project.yaml:26: experiments.pull.files[0]", "pull.csv, line 1", "no column 'Displacment'", "'Displacement"),
    ),
    "an unknown channel": (("          tension:", "          tensoin:"), ("'tensoin'", "Try: 'tension'")),
    "an unknown cable": (("    cable: front", "    cable: frnt"), ("experiments.pull.cable", "'frnt'", "Try: 'front'")),
    "an unknown step": (("    noise:", "    prepare: [zeero]\n    noise:"), ("prepare[0]", "'zeero'", "Try: 'zero'")),
}


@pytest.mark.parametrize("case", [*UNITS, *KEYS, *MODEL])
def test_a_project_with_one_fault(capsys: pytest.CaptureFixture[str], tmp_path: Path, case: str):
    change, pieces = {**UNITS, **KEYS, **MODEL}[case]
    err = refused(capsys, write_project(tmp_path, change), *pieces)
    assert "faults" not in err, f"one mistake, several faults: {err}"


def lines(change: Callable[[list[str]], None]) -> str:
    rows = bench_csv().splitlines()
    change(rows)
    return "\n".join(rows) + "\n"


def put(row: int, column: int, value: str) -> str:
    def change(rows: list[str]) -> None:
        cells = rows[row].split(",")
        cells[column] = value
        rows[row] = ",".join(cells)

    return lines(change)


DATA: dict[str, tuple[Callable[[], str], tuple[str, ...]]] = {
    "text in a number column": (lambda: put(4, 2, "overload"), ("column 'Force [N]', line 5", "'overload'", "numbers")),
    "NaN in a column of times": (lambda: put(4, 0, "NaN"), ("column 'Time [s]', line 5", "'NaN'")),
    "nothing in the column that drives the robot": (
        lambda: put(7, 1, ""),
        ("column 'Displacement [mm]', line 8", "got nothing"),
    ),
    "time that runs backwards": (
        lambda: put(9, 0, "0.05"),
        ("time runs backwards", "column 'Time [s]', line 10", "'0.05' after"),
    ),
    "an empty file": (lambda: "", ("pull.csv", "empty")),
    "only a header": (lambda: bench_csv().splitlines()[0] + "\n", ("pull.csv",)),
    "two columns of one name": (
        lambda: bench_csv().replace("Pitch [deg]", "Force [N]"),
        ("2 columns have the name 'Force'",),
    ),
}


@pytest.mark.parametrize("case", DATA)
def test_a_data_file_with_a_fault(capsys: pytest.CaptureFixture[str], tmp_path: Path, case: str):
    data, pieces = DATA[case]
    refused(capsys, write_project(tmp_path, data=data()), "project.yaml:26: experiments.pull.files[0]", *pieces)


def test_an_empty_cell_of_a_channel_is_not_compared_and_noted(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    out = tmp_path / "out"
    path = write_project(tmp_path, data=put(4, 2, ""))
    code, printed, err = run(capsys, "calibrate", path, "--out", out, "--verbose", "--no-report")
    assert code == 0, err
    assert "not measured, and so not compared: tension in state 4." in " ".join(printed.split())
    assert "does not rise" not in err
    assert json.loads((out / "result.json").read_text())["experiments"]["pull"]["missing"] == {"tension": 1}


def test_all_faults_of_the_sections_at_once_and_then_all_of_what_they_name(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    data = put(4, 2, "overload").replace("Pitch", "Tilt")
    path = write_project(tmp_path, ("element: P1", "element: Q1"), ("[0 mm, 5 mm]", "[5 mm, 0 mm]"), data=data)
    err = refused(capsys, path, "3 faults", "'Q1'", "reversed", "no column 'Pitch'")
    assert len(err.strip().splitlines()) == 4
    path = write_project(tmp_path, ("fixed: foot", "fixed: fot"), data=data)
    err = refused(capsys, path, "3 faults", "'overload'", "no column 'Pitch'", "'fot'")
    assert len(err.strip().splitlines()) == 4


@pytest.mark.parametrize("named", ["path: data/pull.csv", "file: bar.msh"])
@pytest.mark.parametrize("kind", ["a device", "a pipe", "a folder"])
def test_what_is_no_regular_file_is_not_read(capsys: pytest.CaptureFixture[str], tmp_path: Path, named: str, kind: str):
    other = tmp_path / "other"
    if kind == "a device":
        other.symlink_to("/dev/zero")
    elif kind == "a pipe":
        os.mkfifo(other)
    else:
        other.mkdir()
    path = write_project(tmp_path, (named, f"{named.split(maxsplit=1)[0]} {other}"))
    refused(capsys, path, "project.yaml:", f"file is {kind}", f"got '{other}'", "allowed: a regular file")
    refused(capsys, other, f"{other}: the project file cannot be read; got {kind}; allowed: a regular file")


@pytest.mark.parametrize(
    ("mesh", "piece"),
    [
        (b"", "empty"),
        (b"nonsense\n", "cannot be read"),
        (b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 0 0\n$EndNodes\n", "bar.msh"),
    ],
)
def test_a_mesh_that_cannot_be_read(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: bytes, piece: str):
    refused(capsys, write_project(tmp_path, mesh=mesh), "project.yaml:6: robot.bodies.bar.mesh", piece)


def test_a_mesh_without_tets(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    import meshio

    path = write_project(tmp_path)
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    meshio.write(tmp_path / "bar.msh", meshio.Mesh(points, [("triangle", np.array([[0, 1, 2]]))]), file_format="gmsh22")
    capsys.readouterr()
    refused(capsys, path, "project.yaml:6:", "no tetrahedra", "triangle")


def test_a_mesh_with_an_inverted_tet(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    from project_case import bar_mesh

    from softcal.geometry.mesh import TetMesh

    mesh = bar_mesh(in_millimetres=True)
    tets = mesh.tets.copy()
    tets[7] = tets[7][[0, 2, 1, 3]]
    path = write_project(tmp_path)
    write_mesh(TetMesh(mesh.points, tets, node_sets={"z1": mesh.node_sets["z1"]}), tmp_path / "bar.msh")
    refused(capsys, path, "project.yaml:6:", "1 of 192 tets are inverted", "7")


def test_no_free_parameter(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path = write_project(tmp_path)
    text = path.read_text()
    path.write_text(text[: text.index("parameters:")] + text[text.index("calibration:") :])
    refused(capsys, path, "no free parameter", "bounds:")


def test_force_in_kilonewtons_by_mistake_is_warned_of(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from softcal.report import check_figures
    from softcal.report.scene_render import Rendering

    monkeypatch.setattr(check_figures, "render_scenes", lambda *_: Rendering((), ""))
    data = bench_csv().replace("Force [N]", "Force").replace("Displacement [mm]", "Displacement")
    path = write_project(tmp_path, ("{name: Force, unit: N}", "{name: Force, unit: kN}"), data=data)
    code, _, err = run(capsys, "check", path, "--out", tmp_path / "look")
    assert code == 0
    assert "Warning: project.yaml:22: experiments.pull: the stiffness dT/dd is" in err
    assert "kN" in err
    assert "implausible compared with the twin's" in err


@pytest.mark.parametrize(("at", "said"), [("0.03", "near the origin"), ("30000", "far away"), ("30", ""), ("0", "")])
def test_a_point_in_metres_by_mistake_is_warned_of(tmp_path: Path, at: str, said: str):
    from softcal.project.project import load
    from softcal.workflows.checking import check

    project = load(write_project(tmp_path, ("[30 mm, 0 mm, 0 mm]", f"[{at} mm, 0 mm, 0 mm]")))
    found = [one for one in check(project, solve=False).warnings if "m written for mm" in one]
    assert len(found) == bool(said)
    assert all(one.startswith(f"front, via point 2: the point ({at}, 0, 0) mm is {said}") for one in found)


def test_a_value_outside_the_bounds_of_its_search_is_warned_of(tmp_path: Path):
    from softcal.project.project import load
    from softcal.workflows.checking import check

    path = write_project(tmp_path, ("youngs_modulus: 2 MPa", "youngs_modulus: 90 MPa"))
    beyond = [warning for warning in check(load(path)).warnings if "outside the bounds" in warning]
    assert len(beyond) == 1
    assert beyond[0].startswith(
        "bar.youngs_modulus: the project's value is outside the bounds of the search; got 90 MPa"
    )


def test_what_calibrate_would_refuse_is_warned_of(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    from softcal.project.project import load
    from softcal.workflows.checking import check

    path = write_project(tmp_path, ("starts: 1}", "starts: 1, loss: distance}\nrig: {length: 100 mm}"))
    refusal = refused(capsys, path, "the loss 'distance' needs positions only")
    told = [warning for warning in check(load(path), solve=False).warnings if "would refuse" in warning]
    assert told
    for warning in told:
        assert warning.removeprefix("calibrate would refuse this project: ") in refusal


def test_a_law_that_is_unstable_at_rest_is_warned_of(tmp_path: Path):
    from softcal.project.project import load
    from softcal.workflows.checking import check

    def warnings(C01: str) -> list[str]:
        own = f"law: mooney-rivlin\n      C10: 200 kPa\n      C01: {C01}\n      bulk_modulus: 5 MPa"
        free = ("bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa]", "bar.C10: {bounds: [0.1 MPa, 40 MPa]")
        path = write_project(tmp_path, ("youngs_modulus: 2 MPa", own), ("      poissons_ratio: 0.42\n", ""), free)
        return [warning for warning in check(load(path), solve=False).warnings if "unstable at rest" in warning]

    (told,) = warnings("-250 kPa")
    assert told.startswith("bar: with these constants mooney-rivlin is unstable at rest (shear modulus -100 kPa, ")
    assert warnings("-150 kPa") == []


def test_plausible_data_are_not_warned_of(tmp_path: Path):
    from softcal.project.project import load
    from softcal.workflows.checking import check

    assert check(load(write_project(tmp_path))).warnings == ()


@pytest.mark.parametrize("value", ["bar.youngs_modulus", "=2MPa", "bar.youngs_modulus="])
def test_a_set_that_sets_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path, value: str):
    path = write_project(tmp_path)
    code, _, err = run(capsys, "simulate", path, "--set", value, "--out", tmp_path / "out")
    assert code == 2
    assert "NAME=VALUE" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "piece"),
    [
        (("--set", "bar.young=1MPa"), "bar.youngs_modulus"),
        (("--set", "bar.youngs_modulus=1"), "unit is missing"),
        (("--set", "bar.poissons_ratio=0.5"), "0.4999"),
        (("--set", "bar.youngs_modulus=1e-30 Pa"), "bar.youngs_modulus: the modulus is out of range; got 1e-30 Pa"),
        (("--set", "front.slack=-9 m"), "front.slack: experiments.pull: front.shortening: the cable is pulled in by"),
        (("--set", "front.slack=9 m"), "front.slack: experiments.pull: the cable would be slack at every sample"),
        (("--experiment", "push"), "allowed: pull"),
        (("--pull", "left=4mm"), "--pull: the robot has no such cable; got 'left'; allowed: front"),
        (("--pull", "front=4"), "a cable and a length or force"),
        (("--pull", "front=-4 mm"), "must be positive"),
        (("--pull", "front=4mm", "--experiment", "pull"), "exclude each other"),
    ],
)
def test_simulate_with_bad_options(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: tuple[str, ...], piece: str
):
    code, _, err = run(capsys, "simulate", write_project(tmp_path), *arguments, "--out", tmp_path / "out")
    assert code == 2
    assert piece in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_a_value_that_is_set_is_blamed_and_none_beside_it(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path, out = write_project(tmp_path), tmp_path / "out"
    values = ("--set", "bar.poissons_ratio=0.3", "--set", "front.slack=-9 m", "--set", "bar.youngs_modulus=1MPa")
    _, _, err = run(capsys, "simulate", path, *values, "--out", out)
    assert err.startswith("Error: front.slack: experiments.pull: front.shortening")


def test_the_file_is_blamed_for_what_it_says_whatever_is_set(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path, out = write_project(tmp_path, ("    plate: plate\n", "    plate: plate\n    slack: -9 m\n")), tmp_path / "out"
    _, _, err = run(capsys, "simulate", path, "--set", "bar.poissons_ratio=0.3", "--out", out)
    assert err.startswith("Error: project.yaml:22: experiments.pull: front.shortening: the cable is pulled in by")
    code, *_ = run(capsys, "simulate", path, "--set", "front.slack=1 mm", "--out", out)
    assert code == 0


@pytest.mark.parametrize(
    "arguments", [("--method", "simplex"), ("--fit", "some"), ("--trials", "0"), ("--workers", "0")]
)
def test_calibrate_with_bad_options(capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: tuple[str, ...]):
    code, _, err = run(capsys, "calibrate", write_project(tmp_path), *arguments, "--out", tmp_path / "out")
    assert code == 2
    assert arguments[0].strip("-") in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_a_project_file_that_is_not_there(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    code, _, err = run(capsys, "check", tmp_path / "none.yaml")
    assert code == 2
    assert "none.yaml" in err
    assert "no such file" in err


def test_a_report_of_what_is_no_run(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    code, _, err = run(capsys, "report", tmp_path)
    assert code == 2
    assert "there is no run here" in err


def test_a_projects_folder_is_no_run(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path = write_project(tmp_path / "p")
    code, _, err = run(capsys, "export", "sofa", path.parent, "--out", tmp_path / "scene")
    assert code == 2
    assert "there is no run here" in err
    assert str(path) in err


@pytest.mark.parametrize("record", ["", "{", "[]", '{"format": 9}', json.dumps({"format": 1})])
def test_a_run_with_a_broken_record(capsys: pytest.CaptureFixture[str], tmp_path: Path, record: str):
    (tmp_path / "run.json").write_text(record)
    code, _, err = run(capsys, "report", tmp_path)
    assert code == 2
    assert "run.json" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("command", ["simulate", "calibrate"])
def test_a_folder_with_files_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str):
    out = tmp_path / "out"
    out.mkdir()
    (out / "precious.txt").write_text("mine")
    code, _, err = run(capsys, command, write_project(tmp_path / "p"), "--out", out)
    assert code == 2
    assert "nothing is overwritten" in err
    assert "precious.txt" in err
    assert [path.name for path in out.iterdir()] == ["precious.txt"]


@pytest.mark.parametrize("command", ["simulate", "calibrate"])
def test_a_file_in_the_place_of_the_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str):
    (tmp_path / "out").write_text("mine")
    code, _, err = run(capsys, command, write_project(tmp_path / "p"), "--out", tmp_path / "out")
    assert code == 2
    assert "is a file" in err


@pytest.mark.parametrize("command", ["check", "simulate", "calibrate"])
def test_a_folder_that_cannot_be_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch
):
    # Root may write anywhere, so the system's refusal is put in its place.
    def no(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(output.tempfile, "mkdtemp", no)
    monkeypatch.setattr(output.tempfile, "TemporaryFile", no)
    code, _, err = run(capsys, command, write_project(tmp_path / "p"), "--out", tmp_path / "out")
    assert code == 2
    assert "Permission denied" in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_a_disk_that_fills_up_leaves_nothing_half(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("softcal.workflows.run_folder.shutil.copyfile", full)
    code, _, err = run(capsys, "calibrate", write_project(tmp_path / "p"), "--out", tmp_path / "out")
    assert code == 2
    assert "No space left on device" in err
    assert [path.name for path in tmp_path.iterdir()] == ["p"]


def test_the_good_project_is_not_refused(tmp_path: Path):
    from softcal.project.project import load

    assert load(write_project(tmp_path)).warnings == ()
    assert len(bench_values()[0]) == 25


@pytest.mark.parametrize("option", ["--trials", "--seed"])
def test_a_count_on_the_command_line_is_told_its_limit(capsys: pytest.CaptureFixture[str], tmp_path: Path, option: str):
    most = {"--trials": "1 to 100000 trials", "--seed": "0 to 4294967295."}[option]
    code, _, err = run(capsys, "calibrate", write_project(tmp_path), option, 9999999999)
    assert code == 2
    what = {"--trials": "there are too many trials", "--seed": "this number is out of range"}[option]
    assert err.startswith(f"Error: {option}: {what}; got 9999999999;")
    assert f"allowed: {most}" in err


@pytest.mark.parametrize("words", [("--out", ""), ("--out=",), ("--set", "")])
def test_an_empty_word_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, words: tuple[str, ...]):
    code, _, err = run(capsys, "calibrate", write_project(tmp_path), *words)
    assert code == 2
    assert f"the value of {words[0].rstrip('=')} is empty" in err


def test_a_setting_given_by_its_own_option_too_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    project, run_folder = write_project(tmp_path), tmp_path / "run"
    twice = ("--method", "tpe", "--option", "method=grid", "--no-mesh-error", "--option", "mesh_error=true")
    code, _, err = run(capsys, "calibrate", project, "--out", run_folder, *twice)
    assert code == 2
    assert "the name is given twice; got '--method tpe' and '--option method=grid'; allowed: each name once" in err
    assert "'--no-mesh-error' and '--option mesh_error=true'" in err
    assert not run_folder.exists()


def test_files_and_columns_are_looked_for_beside_sections_with_slips(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    slips = (
        ("bar.msh", "bra.msh"),
        ("      via:\n", "      vai:\n"),
        ("name: Displacement, unit: mm", "name: Displacemnt, unit: mm"),
        ("name: Force, unit: N", "name: Force, unit: s"),
        ("starts: 1", "startz: 1"),
        ("noise: {tension: 0.05 N, pitch: 0.2 deg}", "label: State"),
    )
    refused(
        capsys,
        write_project(tmp_path, *slips),
        "project.yaml:6: robot.bodies.bar.mesh: there is no such mesh file; got 'bra.msh'",
        "project.yaml:18: robot.cables.front.vai: unknown key",
        "no columns 'Displacemnt', 'State'",
        "Try: 'Displacement'",
        "column 'Force [N]': the unit does not fit; got 's'",
        "calibration.startz: unknown key",
    )


@pytest.mark.parametrize(
    ("slip", "meant"),
    [
        (("  cables:", "  tendons:"), "robot.tendons: unknown key; got 'tendons'; .* Try: 'cables'"),
        (("  cables:", "  pressure_chambers: {}\n  cables:"), "'pressure_chambers'; .* Try: 'actuators'"),
        (("poissons_ratio:", "nu:"), "bodies.bar.nu: unknown key; .* Try: 'poissons_ratio'"),
        (("poissons_ratio:", "rho: 1 g/cm^3\n      poissons_ratio:"), "bodies.bar.rho: unknown key; .* Try: 'density'"),
        (("bar.youngs_modulus: {b", "bar.E: {b"), "bar.E: there is no such parameter; .* Try: 'bar.youngs_modulus'"),
    ],
)
def test_another_word_of_the_field_proposes_the_key(
    slip: Change, meant: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert re.search(meant, refused(capsys, write_project(tmp_path, slip)))


@pytest.mark.parametrize(("unit", "slack"), [("cm", ""), ("um", "    slack: 2 mm\n")])
def test_a_wrong_unit_in_a_header_is_told_by_its_column(
    unit: str, slack: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bench_csv().replace("Displacement [mm]", f"Displacement [{unit}]")
    change = [("name: Displacement, unit: mm", "name: Displacement"), ("    noise:", f"{slack}    noise:")]
    path = write_project(tmp_path, *change, data=data)
    refused(capsys, path, f"Try: check the unit of the column 'Displacement' in {unit}")
