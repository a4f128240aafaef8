"""Whatever a project file says wrong is refused at its line in a sentence: by family."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest
from project_case import PROJECT, write_project
from robot_case import MANIPULATOR, ROBOT, write_robot

from softcal.errors import InputError
from softcal.project.project import load

# Values that no number of any kind may have, and units that fit nearly nothing.
NO_NUMBER = ("soft", "[1, 2, 3, 4, 5]", "{a: 1}", "true", "''", ".nan", ".inf", "'1e999'", "'1,5'", "9" * 5000)


def told(path: Path) -> list[str]:
    with pytest.raises(InputError) as error:
        load(path)
    return [str(fault) for fault in error.value.faults]


def line_of(text: str, piece: str) -> int:
    return text[: text.index(piece)].count("\n") + 1


# A value of the project, how it stands there, and what may not stand in its place besides `NO_NUMBER`.
LENGTHS = ("5 px", "5 kg", "5 %", "5 deg", "5", "1000 km", "1e300 m")
RATIOS = ("0.43 deg", "0.43 rad", "0.43 mm", "0.43 px", "1e30")
BAR: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "a modulus": ("youngs_modulus: ", "2 MPa", ("0 Pa", "-2 MPa", "2", "2 mm", "2 Mpa", "2 kg", "1e300 Pa")),
    "a ratio": ("poissons_ratio: ", "0.42", (*RATIOS, "0.5", "-1", "50 MPa", "60 %")),
    "a length": ("reference: [0 mm, 0 mm, ", "100 mm", LENGTHS),
    "a noise": ("noise: {tension: ", "0.05 N", ("0 N", "-1 N", "1 kg", "1 mm", "5 %", "0.05")),
    "a noise of an angle": ("pitch: ", "0.2 deg}", ("0 deg}", "-1 deg}", "20 %}", "1 mm}", "0.2}", "1 px}")),
    "a lower bound": ("bar.youngs_modulus: {bounds: [", "0.1 MPa", ("-1 MPa", "0 MPa", "1", "1 mm", "1e300 Pa")),
    "an upper bound": (", 40 MPa", "]", ("e20]", " mm]", "%]")),
    "a bound of a slack": ("front.slack: {bounds: [0 mm, ", "5 mm", ("1000 m", "5 px", "5 deg", "5")),
    "a modulus of the print": ("bulk_youngs_modulus: [", "8 MPa", ("0 MPa", "-8 MPa", "8 N", "8")),
    "an infill": ("infill: ", "0.3", ("0", "-0.3", "1.3", "130 %", "0.3 rad")),
    "an exponent": ("exponent: [", "1.2", ("-1", "1e9", "1.2 deg")),
}
NUMBERS = [
    (family, value)
    for family, (_, _, values) in BAR.items()
    for value in (*values, *(NO_NUMBER if family not in ("a noise of an angle", "an upper bound") else ()))
]


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_project(tmp_path_factory.mktemp("bar"))


def rewritten(path: Path, old: str, new: str, text: str) -> Path:
    assert text.count(old) >= 1, old
    changed = path.with_name("changed.yaml")
    changed.write_text(text.replace(old, new, 1), encoding="utf-8")
    return changed


@pytest.mark.parametrize(("family", "value"), NUMBERS, ids=[f"{f}: {v[:20]}" for f, v in NUMBERS])
def test_a_number_that_cannot_be(bar: Path, family: str, value: str):
    before, right, _ = BAR[family]
    faults = told(rewritten(bar, before + right, before + value, PROJECT))
    assert f"changed.yaml:{line_of(PROJECT, before + right)}: " in faults[0], faults
    assert "Traceback" not in "".join(faults)


COUNTS = {
    "starts": ("starts: 1", "calibration"),
    "trials": ("starts: 1", "calibration"),
    "seed": ("starts: 1", "calibration"),
}
WRONG_COUNTS = ("0", "-1", "1.5", "1e3", "'3'", "true", "null_", "[1]", "99999999999", "9" * 5000, ".inf", "3 mm")


@pytest.mark.parametrize(("key", "value"), list(itertools.product(COUNTS, WRONG_COUNTS)))
def test_a_count_that_cannot_be(bar: Path, key: str, value: str):
    if key == "seed" and value == "0":
        pytest.skip("a seed may be 0")
    faults = told(rewritten(bar, "starts: 1", f"{key}: {value}", PROJECT))
    assert faults[0].startswith(f"changed.yaml:{line_of(PROJECT, 'starts: 1')}: calibration.{key}: "), faults


TABLE = ("delimiter", "header_row", "units_row", "skip_rows", "skip_footer", "rest_samples", "decimal", "axes", "where")
WRONG_SETTINGS = {
    "delimiter": ("''", "a", "','' ", "5", "[',']", '"\\n"', "'\"'", "'.'", "ab"),
    "header_row": ("0", "-1", "1.5", "true", "99999999", "x"),
    "units_row": ("0", "-1", "1.5", "true", "99999999", "x"),
    "skip_rows": ("-1", "1.5", "true", "99999999999", "x"),
    "skip_footer": ("-1", "1.5", "true", "99999999999", "x"),
    "rest_samples": ("0", "-1", "1.5", "true", "99999999999", "x"),
    "decimal": ("';'", "5", "[]", "''"),
    "axes": ("x", "[x, y]", "[x, y, w]", "5", "{x: y}"),
    "where": ("5", "[a]", "{Time: []}", "{Time: {a: 1}}", "{Nowhere: 5}", "{Time: [true]}"),
}


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in WRONG_SETTINGS.items() for value in values])
def test_a_setting_of_a_file_that_cannot_be(bar: Path, key: str, value: str):
    old = "      - path: data/pull.csv\n"
    faults = told(rewritten(bar, old, f"{old}        {key}: {value}\n", PROJECT))
    assert re.match(r"changed\.yaml:\d+: ", faults[0]), faults


SCALES = ("0", "-0.0", "1e300", "1e-300", ".nan", "true", "x", "1 mm", "2 deg", "[1]")


@pytest.mark.parametrize("scale", SCALES)
def test_a_scale_that_cannot_be(bar: Path, scale: str):
    faults = told(rewritten(bar, "{name: Force, unit: N}", f"{{name: Force, unit: N, scale: {scale}}}", PROJECT))
    assert "columns.tension.scale: " in faults[0]


@pytest.mark.parametrize("slack", ["1000 m", "5 m", "25 mm", "5 px", "5 deg", "5", "50 %"])
def test_a_slack_that_cannot_be(bar: Path, slack: str):
    faults = told(rewritten(bar, "    noise:", f"    slack: {slack}\n    noise:", PROJECT))
    assert "experiments.pull.slack: " in faults[0], faults
    assert len(faults) == 1


STEPS = (
    "resample: {by: shortening, n: 100000000000}",
    "resample: {by: shortening, n: 1.5}",
    "resample: {by: shortening, n: -3}",
    "resample: {by: shortening, step: 1e-15 mm}",
    "resample: {by: shortening, step: -1 mm}",
    "resample: {by: shortening, step: 1 deg}",
    "smooth: {channel: tension, n_samples: 99999999999, order: 2}",
    "window: {channel: shortening, lower: 5 px}",
    "window: {channel: pitch, lower: 20 %}",
    "remove_slack: 1000 m",
    "remove_slack: -1000 m",
    "set_noise: {channel: tension, sigma: 0 N}",
    "correct_pulley_friction: {n_pulleys: 2, friction_coefficient: -0.1, wrap_angle: 180 deg}",
    "correct_pulley_friction: {n_pulleys: 2, friction_coefficient: 1e6, wrap_angle: 180 deg}",
    "correct_pulley_friction: {n_pulleys: 2, friction_coefficient: 0.1, wrap_angle: 50 %}",
    "find_cycles: {prominence: 3}",
    "find_cycles: {prominence: 0.1 deg}",
    "zero: {channel: [tension]}",
    "zero: [[]]",
    "5",
    "[zero]",
    "{}",
    "{zero: first, resample: 5}",
)


@pytest.mark.parametrize("step", STEPS)
def test_a_step_that_cannot_be(bar: Path, step: str):
    faults = told(rewritten(bar, "    noise:", f"    prepare:\n      - {step}\n    noise:", PROJECT))
    assert "experiments.pull.prepare" in faults[0], faults


NAMES = {
    "up a folder": '".."',
    "here": '"."',
    "the calibration of all": "joint",
    "the calibration of all in capitals": "JOINT",
    "a separator": "a/b",
    "the other separator": '"a\\\\b"',
    "a path": "../../etc/passwd",
    "nothing": '""',
    "a blank": '" "',
    "a blank at its end": '"a "',
    "a dot at its end": '"a."',
    "a hidden file": ".hidden",
    "300 letters": "a" * 300,
    "61 letters": "a" * 61,
    "a line feed": '"a\\nb"',
    "a control character": '"a\\x07b"',
    "a NUL": '"a\\0b"',
    "a mark that turns text": '"a\\u202eb"',
    "brackets": '"a[b]"',
    "a pattern": '"a*"',
    "a comma": '"a,b"',
    "an equals sign": '"a=b"',
    "a colon": '"a:b"',
    "quotes": '"a\'b"',
    "a tag of HTML": '"<b>"',
    "a device": "NUL",
    "a list": "[a, b]",
    "a mapping": "{a: b}",
    "null": "~",
}


@pytest.mark.parametrize("case", NAMES)
def test_a_name_of_an_experiment_that_cannot_be(bar: Path, case: str):
    faults = told(rewritten(bar, "  pull:\n", f"  ? {NAMES[case]}\n  :\n", PROJECT))
    assert f"changed.yaml:{line_of(PROJECT, '  pull:')}: experiments" in "\n".join(faults), faults


@pytest.mark.parametrize("case", [case for case in NAMES if case not in ("null", "nothing", "a list", "a mapping")])
def test_a_name_of_a_set_up_that_cannot_be(bar: Path, case: str):
    old = "    cable: front\n"
    faults = told(rewritten(bar, old, f"{old}    set_up: {NAMES[case]}\n", PROJECT))
    assert "experiments.pull.set_up: " in faults[0], faults


@pytest.mark.parametrize("case", [case for case in NAMES if case != "the calibration of all"])
def test_a_name_of_a_part_that_cannot_be(bar: Path, case: str):
    if NAMES[case] == "JOINT":
        pytest.skip("a part may be called so")
    faults = told(rewritten(bar, "  cables:\n    front:\n", f"  cables:\n    ? {NAMES[case]}\n    :\n", PROJECT))
    assert "changed.yaml:17: robot.cables" in "\n".join(faults), faults


@pytest.mark.parametrize("name", ["frame", "pulleys", "Frame", "BAR", "Plate"])
def test_a_part_named_like_another_or_like_the_rig(bar: Path, name: str):
    faults = told(rewritten(bar, "  cables:\n    front:\n", f"  cables:\n    {name}:\n", PROJECT))
    assert f"changed.yaml:17: robot.cables.{name}: " in faults[0]


def test_experiments_that_differ_in_capitals_alone(bar: Path):
    at = PROJECT.index("  pull:\n")
    end = PROJECT.index("parameters:")
    text = PROJECT[:end] + PROJECT[at:end].replace("  pull:", "  Pull:") + PROJECT[end:]
    path = bar.with_name("changed.yaml")
    path.write_text(text, encoding="utf-8")
    assert "experiments.Pull: two names differ only in capitals; got 'pull' and 'Pull'" in told(path)[0]


PATHS = {
    "300 letters": "a" * 300 + ".csv",
    "5000 letters": "a/" * 2500 + "b.csv",
    "a folder": "data",
    "a device": "/dev/zero",
    "a NUL": '"data/\\0.csv"',
    "nobody's home": "~nobody_at_all/a.csv",
    "nothing": "''",
    "a number": "5",
    "a list": "[a.csv]",
    "a folder that is a file": "project.yaml/pull.csv",
}


@pytest.mark.parametrize("case", PATHS)
def test_a_path_of_a_data_file_that_cannot_be(bar: Path, case: str):
    faults = told(rewritten(bar, "path: data/pull.csv", f"path: {PATHS[case]}", PROJECT))
    assert faults[0].startswith("changed.yaml:26: experiments.pull.files[0]"), faults
    assert max(map(len, faults)) < 400


@pytest.mark.parametrize("case", PATHS)
def test_a_path_of_a_mesh_that_cannot_be(bar: Path, case: str):
    written = PATHS[case].replace(".csv", ".msh")
    faults = told(rewritten(bar, "file: bar.msh", f"file: {written}", PROJECT))
    assert faults[0].startswith("changed.yaml:6: robot.bodies.bar.mesh"), faults
    assert max(map(len, faults)) < 400


MESHES = (
    "{primitive: [neck], tets: 1000}",
    "{primitive: {a: b}, tets: 1000}",
    "{primitive: 5, tets: 1000}",
    "{primitive: null, tets: 1000}",
    "{primitive: cube, tets: 1000}",
    "{primitive: neck, tets: 0}",
    "{primitive: neck, tets: 100000000000}",
    "{primitive: neck, tets: 1000, sectors: 1000000}",
    "{primitive: neck, tets: 1000, n_bells: 100000}",
    "{primitive: neck, size: 0 mm}",
    "{primitive: neck, size: -1 mm}",
    "{primitive: neck, size: 3 px}",
    "{primitive: neck, size: 1e-9 mm}",
    "{primitive: neck, outer_diameter: 1000 km, tets: 1000}",
    "{primitive: neck, tets: 1000, waist_refinement: 1e9}",
    "{primitive: disc, diameter: 30 mm, thickness: 4 mm, size: 1 nm}",
    "{primitive: disc, diameter: 30 mm, thickness: 4 mm, tets: 99999999}",
    "{primitive: disc, diameter: 30 mm, thickness: 4 mm, size: 5 mm, "
    "holes: {count: 100000, diameter: 1 mm, radius: 9 mm}}",
    "{primitive: rod, length: 100 m, diameter: 1 um}",
    "{primitive: rod, length: 100 mm, diameter: 5 mm, layers: 100000000}",
    "{primitive: rod, length: 100 mm, diameter: 5 mm, layers: 10000, rings: 20}",
    "{primitive: rod, length: 100 mm, diameter: 5 mm, rings: 10000}",
    "{primitive: spring, wire_diameter: 1 mm, coil_diameter: 10 mm, turns: 1e9, pitch: 2 mm}",
    "{primitive: spring, wire_diameter: 1 mm, coil_diameter: 10 mm, turns: 1000, pitch: 2 mm, layers_per_turn: 1000, "
    "rings: 20}",
    "{primitive: spring, wire_diameter: 1 um, coil_diameter: 10 m, turns: 1000, pitch: 2 mm}",
)


@pytest.mark.parametrize("mesh", MESHES)
def test_a_mesh_that_cannot_be(bar: Path, mesh: str):
    faults = told(rewritten(bar, "{file: bar.msh, unit: mm}", mesh, PROJECT))
    assert faults[0].startswith("changed.yaml:6: robot.bodies.bar.mesh"), faults


ROBOTS: dict[str, tuple[str, str]] = {
    "a negative mass": ("mass: 10 g", "mass: -10 g"),
    "a mass in pounds of force": ("mass: 10 g", "mass: 10 lbf"),
    "a mass beyond all": ("mass: 10 g", "mass: 1e9 kg"),
    "a negative density": ("density: 900 kg/m^3", "density: -900 kg/m^3"),
    "a density beyond all": ("density: 900 kg/m^3", "density: 900 kg/cm^3"),
    "a negative friction": ("pulled_end: first", "pulled_end: first\n      friction_coefficient: -0.1"),
    "a friction beyond all": ("pulled_end: first", "pulled_end: first\n      friction_coefficient: 100"),
    "a friction as an angle": ("pulled_end: first", "pulled_end: first\n      friction_coefficient: 5 deg"),
    "an angle as a share": ("angle: 15 deg", "angle: 270 %"),
    "an angle without a unit": ("angle: 15 deg", "angle: 15"),
    "an angle beyond all": ("angle: 15 deg", "angle: 1e9 deg"),
    "a direction of no length": ("normal: [0, 0, 1]", "normal: [0, 0, 0]"),
    "a direction in mm": ("normal: [0, 0, 1]", "normal: [0, 0, 1 mm]"),
    "a direction of two": ("normal: [0, 0, 1]", "normal: [0, 1]"),
    "a direction beyond all": ("normal: [0, 0, 1]", "normal: [0, 0, 1e300]"),
    "a disc without a thickness": ("thickness: 4 mm", "thickness: 0 mm"),
    "a disc in pixels": ("thickness: 4 mm", "thickness: 4 px"),
    "a hole of a negative diameter": ("hole_diameter: 2 mm", "hole_diameter: -2 mm"),
    "holes beyond all": ("count: 3", "count: 1000000000"),
    "no holes": ("count: 3", "count: 0"),
    "holes and a half": ("count: 3", "count: 2.5"),
    "a section of no size": ("section: {diameter: 4 mm}", "section: {diameter: 0 mm}"),
    "elements beyond all": ("section: {diameter: 4 mm}", "elements: 1000000000\n      section: {diameter: 4 mm}"),
    "a mass that hangs up": ("at: [0 mm, 0 mm, 200 mm], mass: 5 g", "at: [0 mm, 0 mm, 200 mm], mass: -5 g"),
    "a force of a mass": ("force: 0.02 N", "force: 20 g"),
    "a force beyond all": ("force: 0.02 N", "force: 1e30 N"),
    "gravity as a length": ("-9.81 m/s^2", "-9.81 m"),
    "gravity beyond all": ("-9.81 m/s^2", "-9.81 km/ms^2"),
    "gravity of two": ("gravity: [0 m/s^2, ", "gravity: ["),
    "a name with a dot": ("    seam: {body", "    se.am: {body"),
    "a name of 300 letters": ("    seam: {body", f"    {'a' * 300}: {{body"),
}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("robot"))


@pytest.mark.parametrize("case", ROBOTS)
def test_a_robot_that_cannot_be(robot: Path, case: str):
    old, new = ROBOTS[case]
    faults = told(rewritten(robot, old, new, ROBOT))
    # A key that is added stands on the line after the one it is added to.
    lines = {line_of(ROBOT, old), line_of(ROBOT, old) + 1}
    assert any(fault.startswith(f"changed.yaml:{line}: robot.") for fault in faults for line in lines), faults


MANIPULATORS: dict[str, tuple[str, str]] = {
    "sections beyond all": ("    total_length: 425 mm", "    total_length: 425 mm\n    sections: 1000000000"),
    "no sections": ("    total_length: 425 mm", "    total_length: 425 mm\n    sections: 0"),
    "no length": ("total_length: 425 mm", "total_length: 0 mm"),
    "a length in pixels": ("total_length: 425 mm", "total_length: 425 px"),
    "turns beyond all": ("turns: 3", "turns: 1e9"),
    "turns as an angle": ("turns: 3", "turns: 1080 deg"),
    "no turns": ("turns: 3", "turns: 0"),
    "elements beyond all": ("turns: 3", "turns: 3\n      elements_per_turn: 1000000000"),
    "rings beyond all": ("turns: 3", "turns: 3\n      model: solid\n      rings: 1000000000"),
    "cables beyond all": ("ends: {S2", "per_end: 1000000000, ends: {S2"),
    "an end of 150 digits": ("ends: {S2", f"ends: {{S{'9' * 150}"),
    "a negative mass": ("mass: 20 g", "mass: -20 g"),
    "an azimuth as a share": ("S4: 60 deg", "S4: 60 %"),
    "a modulus by nothing": ("youngs_modulus: 1.6 GPa", "youngs_modulus: {}"),
}


@pytest.mark.parametrize("case", MANIPULATORS)
def test_a_manipulator_that_cannot_be(robot: Path, case: str):
    faults = told(rewritten(robot, *MANIPULATORS[case], MANIPULATOR))
    assert re.match(r"changed\.yaml:\d+: robot\.manipulator", faults[0]), faults
    assert max(map(len, faults)) < 600


IN_TIME = {
    "a time step of nothing": "dynamics: {time_step: 0 s}",
    "a time step below nothing": "dynamics: {time_step: -1 ms}",
    "a time step as a length": "dynamics: {time_step: 1 mm}",
    "steps beyond all": "dynamics: {time_step: 1 ns, ramp: 1 h}",
    "a hold beyond all": "dynamics: {time_step: 1 ms, hold: 1e6 s}",
    "a settling beyond all": "dynamics: {time_step: 1 us, settle: {longest: 1e6 s}}",
    "damping below nothing": "dynamics: {rayleigh_mass: -1 Hz}",
    "damping in degrees": "dynamics: {rayleigh_mass: 1 deg/s}",
    "states beyond all": "engines: {sofa: {states: 1000000000}}",
    "one state": "engines: {sofa: {states: 1}}",
    "time steps beyond all": "engines: {sofa: {time_steps: [" + ", ".join(f"{100 - k} ms" for k in range(50)) + "]}}",
    "a timeout of nothing": "engines: {sofa: {timeout: 0 s}}",
    "a grid beyond all": "sweep: {over: {bar.youngs_modulus: '1 MPa:2 MPa:1 mPa'}}",
    "a grid of grids beyond all": "sweep: {over: {bar.youngs_modulus: '1 MPa:2 MPa:100 Pa', "
    "bar.poissons_ratio: '0.1:0.4:0.001', bar.density: '0 kg/m^3:900 kg/m^3:1 kg/m^3'}}",
    "a grid of no steps": "sweep: {over: {bar.youngs_modulus: '1 MPa:2 MPa:0 MPa'}}",
    "a grid of nothing": "sweep: {over: {}}",
    "a grid of text": "sweep: {over: {bar.youngs_modulus: [[a]]}}",
    "a length of nothing": "rig: {length: 0 mm}",
    "pulleys beyond all": "rig: {pulleys: {count: 1000000, wrap: 180 deg}}",
    "a wrap as a share": "rig: {pulleys: {wrap: 50 %}}",
    "a friction below nothing": "rig: {pulleys: {wrap: 180 deg, friction_coefficient: -0.1}}",
}


@pytest.mark.parametrize("case", IN_TIME)
def test_a_section_that_cannot_be(bar: Path, case: str):
    section = IN_TIME[case]
    faults = told(rewritten(bar, "print: {", f"{section}\nprint: {{", PROJECT))
    assert re.match(rf"changed\.yaml:37: {section.partition(':')[0]}", faults[0]), faults
