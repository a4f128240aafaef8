"""load: sections to robot, experiments and search space; every fault at once, each with its place."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from project_case import MODULUS, bar_robot, bench_csv, bench_values, write_project

from softcal.calibration.problem.rig import Pulleys
from softcal.errors import ParameterError, ProjectFileError
from softcal.project.project import Project, load


def faults_of(path: Path, **options: object) -> list[str]:
    with pytest.raises(ProjectFileError) as error:
        load(path, **options)
    return [str(fault) for fault in error.value.faults]


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return load(write_project(tmp_path))


def test_the_robot_is_the_one_described(project: Project):
    robot, expected = project.robot, bar_robot(2e6)
    assert robot.bodies[0].parameters == {"youngs_modulus": 2e6, "poissons_ratio": 0.42}
    assert robot.bodies[0].element == "P1"
    np.testing.assert_allclose(robot.bodies[0].mesh.points, expected.bodies[0].mesh.points, atol=1e-15)
    np.testing.assert_array_equal(robot.bodies[0].fixed, expected.bodies[0].fixed)
    np.testing.assert_array_equal(robot.plates[0].nodes["bar"], expected.plates[0].nodes["bar"])
    np.testing.assert_allclose(robot.cables[0].via_points[0].at, [0.03, 0, 0.1])
    assert robot.cables[0].via_points[0].on == "plate"


def test_the_data_are_in_si_with_their_noise(project: Project):
    data = project.experiments["pull"].dataset
    _, shortening, tension, pitch = bench_values()
    np.testing.assert_allclose(data.values("shortening"), np.array(shortening) / 1e3, atol=1e-9)
    np.testing.assert_allclose(data.values("tension"), tension, atol=1e-6)
    np.testing.assert_allclose(data.values("pitch"), np.deg2rad(pitch), atol=1e-7)
    assert data.channels["tension"].sigma == 0.05
    assert data.channels["pitch"].sigma == pytest.approx(math.radians(0.2))
    assert project.experiments["pull"].compared == ("tension", "pitch")


def test_a_test_that_is_read_twice_is_warned_of(tmp_path: Path, project: Project):
    assert not any("a copy counts" in str(warning) for warning in project.warnings)
    path = write_project(tmp_path)
    text = path.read_text()
    pull = text[text.index("  pull:\n") : text.index("parameters:\n")]
    path.write_text(text.replace(pull, pull + pull.replace("  pull:", "  again:")))
    (warning,) = [str(one) for one in load(path).warnings if "a copy counts" in str(one)]
    assert "experiments.again: every measured value is that of pull" in warning


def test_the_search_space(project: Project):
    space = project.space
    assert space is not None
    assert space.labels == ("bar.youngs_modulus", "front.slack[pull]")
    assert (space.parameters[0].lower, space.parameters[0].upper, space.parameters[0].scale) == (1e5, 4e7, "log")
    assert (space.parameters[1].lower, space.parameters[1].upper) == (0.0, 0.005)


def test_hashes_of_all_that_was_read(project: Project):
    assert set(project.hashes) == {"project.yaml", "bar.msh", "data/pull.csv"}
    assert all(len(value) == 64 for value in project.hashes.values())


def test_held_values_are_no_longer_free(tmp_path: Path):
    path = write_project(tmp_path)
    project = load(path, values={"bar.youngs_modulus": "1.5MPa", "front.slack": 0.001})
    assert project.robot.bodies[0].parameters["youngs_modulus"] == 1.5e6
    assert project.experiments["pull"].rig_values()["front.slack"] == 0.001
    assert project.space is None
    assert project.held == {"bar.youngs_modulus": 1.5e6, "front.slack": 0.001}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"bar.youngs_modulu": "1 MPa"}, "no such parameter.*bar.youngs_modulus"),
        ({"bar.youngs_modulus": "1"}, "unit is missing"),
        ({"bar.youngs_modulus": "1 mm"}, "unit does not fit"),
        ({"bar.poissons_ratio": "0.5"}, "out of range; got 0.5"),
    ],
)
def test_held_values_that_do_not_fit(tmp_path: Path, values: dict[str, str], message: str):
    with pytest.raises(ParameterError, match=message):
        load(write_project(tmp_path), values=values)


def test_pulleys_bring_the_tension_to_the_neck(tmp_path: Path):
    rig = "rig:\n  pulleys: {count: 2, wrap: 180 deg, friction_coefficient: 0.1}\nexperiments:"
    project = load(write_project(tmp_path, ("experiments:", rig)))
    experiment = project.experiments["pull"]
    assert experiment.rig.pulleys == Pulleys(wrap=math.pi, friction_coefficient=0.1)
    factor = math.exp(-2 * 0.1 * math.pi)
    np.testing.assert_allclose(experiment.dataset.values("tension"), factor * np.array(bench_values()[2]), atol=1e-6)
    np.testing.assert_allclose(project.records["pull"].values("tension"), bench_values()[2], atol=1e-6)
    assert "pulleys.friction_coefficient" in project.parameters


def test_held_friction_prepares_the_data_too(tmp_path: Path):
    rig = "rig:\n  pulleys: {count: 2, wrap: 180 deg, friction_coefficient: 0.1}\nexperiments:"
    path = write_project(tmp_path, ("experiments:", rig))
    data = load(path, values={"pulleys.friction_coefficient": "0"}).experiments["pull"].dataset
    np.testing.assert_allclose(data.values("tension"), bench_values()[2], atol=1e-6)


def test_friction_is_not_taken_off_twice(tmp_path: Path):
    rig = "rig:\n  pulleys: {wrap: 180 deg, friction_coefficient: 0.1}\nexperiments:"
    step = (
        "    prepare: [correct_pulley_friction: {n_pulleys: 2, friction_coefficient: 0.1}]\n"
        "    noise: {tension: 0.05 N, pitch: 0.2 deg}"
    )
    path = write_project(tmp_path, ("experiments:", rig), ("    noise: {tension: 0.05 N, pitch: 0.2 deg}", step))
    assert "corrected twice" in faults_of(path)[0]


def test_preparation_steps_are_applied_in_order(tmp_path: Path):
    steps = (
        "    prepare:\n      - window: {channel: shortening, lower: 4 mm}\n      - resample: {by: shortening, n: 5}\n"
    )
    data = load(write_project(tmp_path, ("    noise:", steps + "    noise:"))).experiments["pull"].dataset
    assert data.n_samples == 5
    assert data.values("shortening")[0] >= 0.004
    assert [step.name for step in data.provenance][:3] == ["read_table", "window", "resample"]


def test_a_fault_of_a_step_is_placed_at_its_setting(tmp_path: Path):
    steps = "    prepare:\n      - window: {channel: shortening, lower: 4 N}\n      - resampel: {n: 5}\n"
    told = faults_of(write_project(tmp_path, ("    noise:", steps + "    noise:")))
    assert told[0].startswith(
        "project.yaml:33: experiments.pull.prepare[0].window.lower: the unit does not fit; got 'N'"
    )
    assert told[1].startswith("project.yaml:34: experiments.pull.prepare[1]: there is no such preparation step")
    assert "'resample'" in told[1]


TWO_FILES = (
    "          tension: {name: Force, unit: N}\n          pitch: {name: Pitch, unit: deg}\n",
    "          tension: {name: Force, unit: N}\n"
    "      - path: data/pull.csv\n"
    "        columns: {time: {name: Time}, pitch: {name: Pitch, unit: deg}}\n",
)


def test_two_files_need_a_word_on_their_clocks(tmp_path: Path):
    (told,) = faults_of(write_project(tmp_path, TWO_FILES))
    assert "relation of the files' clocks is not specified" in told
    assert "one clock" in told


def test_two_files_on_one_clock(tmp_path: Path):
    path = write_project(tmp_path, TWO_FILES, ("    noise:", "    synchronise: one clock\n    noise:"))
    data = load(path).experiments["pull"].dataset
    np.testing.assert_allclose(data.values("pitch"), np.deg2rad(bench_values()[3]), atol=1e-7)
    assert "merge_on_one_clock" in [step.name for step in data.provenance]


def test_faults_of_all_sections_come_at_once_in_the_order_of_the_lines(tmp_path: Path):
    path = write_project(
        tmp_path,
        ("youngs_modulus: 2 MPa", "youngs_modulus: 2"),
        ("poissons_ratio: 0.42", "poisson_ratio: 0.42\n      poissons_ratio: 0.5"),
        ("    cable: front", "    cable: frnt"),
        ("path: data/pull.csv", "path: data/pul.csv"),
        ("bounds: [0.1 MPa, 40 MPa]", "bounds: [40 MPa, 0.1 MPa]"),
        ("infill: 0.3", "infill: 1.3"),
        ("calibration: {method", "calibrate: {}\ncalibration: {methd"),
    )
    told = "\n".join(faults_of(path))
    for piece in (
        "project.yaml:8: robot.bodies.bar.youngs_modulus: the unit is missing; got 2",
        "project.yaml:9: robot.bodies.bar.poisson_ratio: unknown key",
        "Try: 'poissons_ratio'",
        "project.yaml:10: robot.bodies.bar.poissons_ratio: Poisson's ratio is out of range",
        "there is no such data file",
        "bar.youngs_modulus: the bounds are reversed or equal; got 40 MPa to 100 kPa",
        "calibrate: unknown key",
        "calibration.methd: unknown key",
        "print.infill: the infill is out of range",
    ):
        assert piece in told
    lines = [int(line.split(":")[1]) for line in told.splitlines()]
    assert lines == sorted(lines)


@pytest.mark.parametrize(
    ("right", "wrong"), [("  bodies:", "  boides:"), ("  cables:", "  tendons:"), ("robot:", "robots:")]
)
def test_what_an_unknown_section_defines_is_no_further_fault(tmp_path: Path, right: str, wrong: str):
    """Neither its parts, which others name, nor that it is missing."""
    (told,) = faults_of(write_project(tmp_path, (f"{right}\n", f"{wrong}\n")))
    assert "unknown key" in told
    assert f"Try: '{right.strip(' :')}'" in told


def test_names_are_resolved_with_the_nearest_known(tmp_path: Path):
    path = write_project(
        tmp_path,
        ("region: head", "region: haed"),
        ("fixed: foot", "fixed: fot"),
        ("on: plate", "on: plat"),
    )
    told = "\n".join(faults_of(path))
    for name in ("'head'", "'foot'", "'plate'"):
        assert f"Try: {name}" in told


def test_an_unknown_parameter_and_what_is_known(tmp_path: Path):
    (told,) = faults_of(write_project(tmp_path, ("  front.slack:", "  front.slak:")))
    assert told.startswith("project.yaml:35: parameters.front.slak: there is no such parameter")
    assert "front.slack" in told


def test_keys_of_existing_parts_and_the_axes_of_a_sweep_are_judged_beside_other_faults(tmp_path: Path):
    others = (
        ("  front.slack:", "  front.slak:"),
        (
            "calibration: {",
            "sweep: {over: {bar.youngs_modulos: [1 MPa], baar.density: [1 g/cm^3]}, experiments: [pul]}\n"
            "calibration: {",
        ),
    )
    told = faults_of(write_project(tmp_path, ("youngs_modulus: 2 MPa", "youngs_modulus: 2"), *others))
    assert {line.split(": ")[1] for line in told} == {
        "robot.bodies.bar.youngs_modulus",
        "parameters.front.slak",
        "sweep.over.bar.youngs_modulos",
        "sweep.over.baar.density",
        "sweep.experiments[0]",
    }
    for nearest in ("'slack'", "'youngs_modulus'", "'bar'", "'pull'"):
        assert f"Try: {nearest}" in "\n".join(told)


def test_a_project_without_experiments_can_be_simulated(tmp_path: Path):
    path = write_project(tmp_path)
    text = path.read_text()
    path.write_text(text[: text.index("experiments:")])
    project = load(path)
    assert project.space is None
    assert not project.experiments


def test_nothing_may_be_both_fixed_and_on_the_plate(tmp_path: Path):
    told = faults_of(write_project(tmp_path, ("region: head", "region: foot")))
    assert "both fixed and tied to the plate" in told[0]


def test_something_must_be_fixed(tmp_path: Path):
    told = "\n".join(faults_of(write_project(tmp_path, ("      fixed: foot\n", ""))))
    assert "the robot is not fixed" in told


def test_a_point_load_and_a_surface_load(tmp_path: Path):
    loads = (
        "  loads:\n"
        "    weight: {on: plate, at: [0 mm, 0 mm, 100 mm], force: [0 N, 0 N, -5 N]}\n"
        "    wind: {on: bar, region: x1, traction: [1 kPa, 0 Pa, 0 Pa]}\n"
        "  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]\n"
        "experiments:"
    )
    robot = load(write_project(tmp_path, ("experiments:", loads))).robot
    np.testing.assert_allclose(robot.loads[0].force, [0, 0, -5])
    np.testing.assert_allclose(robot.loads[1].traction, [1000, 0, 0])
    np.testing.assert_allclose(robot.bodies[0].mesh.points[robot.loads[1].faces][..., 0], 0.01)
    np.testing.assert_allclose(robot.gravity, [0, 0, -9.81])


def test_a_load_that_is_neither(tmp_path: Path):
    loads = "  loads: {odd: {on: bar, at: [0 mm, 0 mm, 5 mm]}}\nexperiments:"
    (told,) = faults_of(write_project(tmp_path, ("experiments:", loads)))
    assert "a load is a force, a moment or a mass at a point, or a traction on a region" in told


def test_copies_stand_in_for_the_files(tmp_path: Path):
    path = write_project(tmp_path / "original")
    moved = tmp_path / "moved"
    moved.mkdir()
    (moved / "project.yaml").write_text(path.read_text())
    (moved / "mesh.msh").write_bytes((path.parent / "bar.msh").read_bytes())
    (moved / "table.csv").write_text(bench_csv())
    project = load(moved / "project.yaml", copies={"bar.msh": "mesh.msh", "data/pull.csv": "table.csv"})
    assert project.hashes == load(path).hashes
    assert project.robot.bodies[0].parameters["youngs_modulus"] != MODULUS


@pytest.mark.parametrize("step", ["set_noise: {channel: tension, sigma: 1 N}", "estimate_noise: tension"])
def test_a_noise_that_is_stated_twice_is_refused(tmp_path: Path, step: str):
    path = write_project(tmp_path, ("    noise: {tension", f"    prepare:\n      - {step}\n    noise: {{tension"))
    (fault,) = faults_of(path)
    assert "experiments.pull.noise.tension: the noise of a channel is stated twice; got tension" in fault


def test_axes_without_a_quaternion_are_refused(tmp_path: Path):
    (fault,) = faults_of(
        write_project(tmp_path, ("        columns:\n", "        axes: [y, -x, z]\n        columns:\n"))
    )
    assert "files[0].axes: axes turn quaternions alone, and no column is of one; got y, -x, z" in fault


def test_a_noise_that_is_not_used_is_warned_of(tmp_path: Path):
    changes = ("    noise: {tension", "    compare: [tension, pitch]\n    noise: {shortening: 0.1 mm, tension")
    project = load(write_project(tmp_path, changes))
    (warning,) = map(str, project.warnings)
    assert "experiments.pull.noise.shortening: this channel is not compared: its noise is not used" in warning
