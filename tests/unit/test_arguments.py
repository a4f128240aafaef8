"""Arguments in Python that make no sense are refused and not ignored."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project_case import bar_robot, write_project

import softcal
from softcal.errors import InputError, ParameterError
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.plausibility import check_plausible, copies
from softcal.geometry.neck import Neck
from softcal.geometry.wire import SolidRod
from softcal.twin.channels import sensors_of
from softcal.twin.protocol import Command, Protocol
from softcal.workflows.export import EXPORTS

PULL = Protocol({"front": Command("shortening", np.array([0.0, 0.002]))})


def test_an_experiment_goes_with_a_project_and_without_a_protocol(tmp_path: Path) -> None:
    project = softcal.load(write_project(tmp_path))
    with pytest.raises(ParameterError, match="an experiment has a protocol of its own; got 'pull'"):
        softcal.simulate(project, PULL, experiment="pull")
    with pytest.raises(ParameterError, match="a robot without a project has no experiments; got 'pull'"):
        softcal.simulate(bar_robot(), experiment="pull")


def test_snapshots_are_none_all_or_those_of_samples() -> None:
    with pytest.raises(InputError, match=r"snapshots: .* kind; got 'sample'; allowed: True or False or 'samples'"):
        softcal.simulate(bar_robot(), PULL, snapshots="sample")  # type: ignore[arg-type]
    assert len(softcal.simulate(bar_robot(), PULL, snapshots="samples").snapshots) == 2


def test_one_sensitivity_may_be_named_alone() -> None:
    response = softcal.simulate(bar_robot(), PULL, sensitivities="bar.youngs_modulus")
    assert set(response.sensitivities["front.tension"]) == {"bar.youngs_modulus"}


@pytest.mark.parametrize(
    ("part", "given", "told"),
    [
        (Neck, {"tets": "1700"}, "tets: this is of the wrong kind; got '1700'; allowed: a whole number or None"),
        (Neck, {"tets": 1700, "n_bells": 2.5}, "n_bells: .*; got 2.5; allowed: a whole number"),
        (Neck, {"tets": 1700, "outer_diameter": [0.038]}, r"outer_diameter: .*; got \[0.038\]; allowed: a number"),
        (Neck, {"tets": 1700, "order": 3}, "order: .*; got 3; allowed: 1, 2"),
        (SolidRod, {"length": 0.02, "diameter": None}, "diameter: .*; got None; allowed: a number in SI"),
        (softcal.Contact, {"gap": "1 mm"}, "gap: .*; got '1 mm'; allowed: a number in SI or None"),
        (softcal.Springs, {"youngs_modulus": {"spring1": "1 GPa"}, "poissons_ratio": 0.4}, "spring1: .*'1 GPa'"),
        (softcal.Springs, {"youngs_modulus": "1 GPa", "poissons_ratio": 0.4}, "allowed: a number in SI or a mapping"),
        (softcal.Springs, {"youngs_modulus": 1e9, "poissons_ratio": 0.4, "model": "rood"}, "allowed: 'rod', 'solid'"),
        (softcal.Manipulator, {"springs": "steel"}, "springs: .*; got 'steel'; allowed: a Springs"),
        (softcal.TimeSettings, {"time_step": True}, "time_step: .*; got True; allowed: a number in SI"),
    ],
)  # fmt: skip
def test_values_of_another_kind_are_refused_with_their_names(part: type, given: dict[str, object], told: str) -> None:
    with pytest.raises(InputError, match=told):
        part(**given)


def test_a_command_drives_what_a_cable_has() -> None:
    with pytest.raises(
        InputError,
        match=r"control: no actuator is commanded by this quantity; got 'force'; "
        r"allowed: shortening, tension, volume, pressure",
    ):
        Command("force", np.array([1.0]))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="tension: the command has no sample"):
        Command("tension", np.array([]))


@pytest.mark.parametrize("samples", [1, 0, 2.5, 10**12])
def test_a_pull_has_two_samples_or_more(samples: float) -> None:
    with pytest.raises(InputError, match=r"samples: .*; allowed: (2 to 1000000 samples|a whole number)"):
        softcal.pull(bar_robot(), "front", "tension", 1.0, samples)  # type: ignore[arg-type]


def test_a_robot_has_the_nodes_and_the_moving_ends_that_its_parts_name() -> None:
    robot = bar_robot()
    (bar,), (plate,), (front,) = robot.bodies, robot.plates, robot.cables
    with pytest.raises(InputError, match=r"plate\.nodes\.bar: these indices do not exist; got 999"):
        replace(robot, plates=(replace(plate, nodes={"bar": [0, 999]}),))
    with pytest.raises(InputError, match=r"wind\.faces: these indices do not exist; got 999"):
        replace(robot, loads=(softcal.SurfaceLoad("wind", "bar", [[0, 1, 999]], (0.0, 0.0, 1.0)),))
    with pytest.raises(InputError, match=r"bar\.fixed: these indices do not exist; got 999; allowed"):
        replace(bar, fixed=[0, 999])
    on_plate = replace(front, via_points=tuple(replace(via, on="plate") for via in front.via_points))
    with pytest.raises(InputError, match=r"front: nothing changes the length .* on plate"):
        replace(robot, cables=(on_plate,))


def test_arrays_are_what_they_say_or_refused() -> None:
    times = np.ma.array([0.0, 1.0, 2.0], mask=[False, True, False])
    with pytest.raises(InputError, match=r"values: masked values are .* got 1 masked; .* NaN for a missing one"):
        Channel(times, "s")
    np.testing.assert_array_equal(Channel(np.ma.array([1.0, 2.0]), "s").values, [1.0, 2.0])  # none is masked
    np.testing.assert_array_equal(Channel(np.array([1, 2], dtype=np.uint8), "s").values, [1.0, 2.0])
    with pytest.raises(InputError, match=r"values: these are not real numbers; got complex numbers\. Try: \.real"):
        Command("tension", [1.0 + 0j])  # type: ignore[arg-type]
    mesh = softcal.box_mesh((1.0, 1.0, 1.0), (1, 1, 1))
    with pytest.raises(InputError, match=r"tets: these are not whole numbers; got floats\. Try: \.astype\(int\)"):
        softcal.TetMesh(mesh.points, mesh.tets.astype(float))


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.longdouble, Fraction])
def test_numbers_of_other_kinds_are_computed_with_as_floats(kind: Any) -> None:
    body = bar_robot().bodies[0]
    ratio, density = kind(0.25), kind(100)
    robot = replace(bar_robot(), bodies=(replace(body, density=density),), gravity=[0.0, 0.0, -9.81])
    as_floats = replace(robot, bodies=(replace(body, density=100.0),))
    name = "bar.poissons_ratio"
    channels = softcal.simulate(robot, PULL, {name: ratio}).channels
    same = softcal.simulate(as_floats, PULL, {name: 0.25}).channels
    assert channels["front.tension"].tolist() == same["front.tension"].tolist()
    assert type(softcal.FreeParameter(name, "1", kind(0), ratio).upper) is float


def test_what_a_part_is_made_of_does_not_change_under_it() -> None:
    robot = bar_robot()
    for mapping in (robot.bodies[0].parameters, robot.plates[0].nodes, PULL.commands):
        values: Any = mapping
        for change in (lambda v: v.update(a=1), lambda v: v.pop(next(iter(v))), lambda v: v.__setitem__("a", 1)):
            with pytest.raises(TypeError, match=r"dataclasses\.replace"):
                change(values)
        assert pickle.loads(pickle.dumps(values)).keys() == copy.deepcopy(values).keys() == values.keys()


def test_a_run_is_not_begun_with_files_that_are_no_longer_those_of_the_project(tmp_path: Path) -> None:
    project = softcal.load(write_project(tmp_path))
    data = tmp_path / "data" / "pull.csv"
    data.write_text(data.read_text() + "9.9,22.0,9.0,3.0\n")
    (tmp_path / "bar.msh").unlink()
    with pytest.raises(InputError, match=r"(?s)bar\.msh: .*pull\.csv: the file has changed or gone since .* loaded"):
        softcal.calibrate(project, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_test_that_is_read_twice_is_found() -> None:
    d = np.linspace(0.0, 0.04, 5)
    first = Dataset("a", {"shortening": Channel(d, "m"), "tension": Channel(100.0 * d, "N")})
    other = Dataset("c", {"shortening": Channel(d, "m"), "tension": Channel(101.0 * d, "N")})
    tension = {name: ["tension"] for name in "abc"}
    assert copies({"a": first, "b": first, "c": other}, tension) == {"b": "a"}
    assert copies({"a": first, "b": first}, {"a": ["tension"], "b": ["shortening"]}) == {}  # one file, read in halves
    still = Dataset("still", {"tension": Channel(np.zeros(5), "N")})
    assert copies({"a": still, "b": still}, tension) == {}


def test_rows_that_are_written_several_times_are_warned_of() -> None:
    d = np.linspace(0.0, 0.04, 50)
    rows = {"time": 0.1 * np.arange(50), "shortening": d, "tension": 100.0 * d, "pitch": 5.0 * d}
    units = {"time": "s", "shortening": "m", "tension": "N", "pitch": "rad"}

    def warned(repeats: int) -> str:
        channels = {name: Channel(np.repeat(values, repeats), units[name]) for name, values in rows.items()}
        return " ".join(check_plausible(Dataset("pull", channels)))

    assert warned(1) == ""
    assert "pull: 50 of 100 rows repeat the one before in every channel" in warned(2)
    assert "standard errors are too small" in warned(3)


def bar_of(mesh: Any, **changes: Any) -> softcal.Robot:
    """The bar with another mesh, held at its foot."""
    robot = bar_robot()
    fixed = np.flatnonzero(mesh.points[:, 2] < 1e-9)
    return replace(robot, bodies=(replace(robot.bodies[0], **{"mesh": mesh, "fixed": fixed, **changes}),))


@pytest.mark.parametrize("order", [1, 2])
def test_a_tet_twice_is_refused(order: Any) -> None:
    mesh = softcal.box_mesh([0.02] * 3, [1, 1, 1], order=order)
    turned = mesh.tets[2, [1, 2, 0, 3]] if order == 1 else mesh.tets[2]
    with pytest.raises(softcal.MeshError, match=r"tets: a tet appears twice, .*; got tets 2 and 6"):
        softcal.TetMesh(mesh.points, np.vstack([mesh.tets, turned]))


def test_bytes_are_no_numbers_and_a_box_has_a_size() -> None:
    for raw in (bytearray(b"01"), memoryview(b"01")):
        with pytest.raises(InputError, match=r"values: .*bytes"):
            softcal.Command("tension", raw)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"divisions: .*x01"):
        softcal.box_mesh([0.02] * 3, b"\x01\x01\x01")
    with pytest.raises(InputError, match=r"lengths\[0\]: the extent of a mesh is out of range"):
        softcal.box_mesh([1e-30] * 3, [1, 1, 1])


def test_a_piece_of_a_mesh_that_floats_is_refused() -> None:
    mesh = bar_robot().bodies[0].mesh
    upper = mesh.points[mesh.tets][:, :, 2].mean(axis=1) > 0.05
    points = np.vstack([mesh.points, mesh.points])  # a slit across
    slit = softcal.TetMesh(points, np.where(upper[:, None], mesh.tets + mesh.n_points, mesh.tets))
    robot = bar_of(slit)
    nodes = mesh.n_points + np.flatnonzero(mesh.points[:, 2] > 0.1 - 1e-9)
    robot = replace(robot, plates=(replace(robot.plates[0], nodes={"bar": nodes}),))
    with pytest.raises(InputError, match=r"bar: a piece of the body is not attached.*1 of 2 pieces"):
        softcal.simulate(robot, PULL)


def test_a_robot_with_contact_that_floats_is_refused() -> None:
    robot = replace(bar_of(bar_robot().bodies[0].mesh, fixed=[]), contact=softcal.Contact())
    with pytest.raises(InputError, match="bar: the body is not attached"):
        softcal.simulate(robot, PULL)


def test_a_live_state_is_not_changed_by_its_reader() -> None:
    state: Any = softcal.LiveTwin(bar_robot()).at({"front": 0.002})
    for mapping in (state.channels, state.commands):
        with pytest.raises(TypeError, match="this mapping is read-only"):
            mapping.clear()


def test_an_axis_of_a_sweep_has_values_with_units(tmp_path: Path) -> None:
    project = softcal.load(write_project(tmp_path))
    with pytest.raises(InputError, match=r"bar\.youngs_modulus: the axis has no values"):
        softcal.sweep(project, over={"bar.youngs_modulus": []})


def test_an_option_that_an_export_needs_is_asked_for(tmp_path: Path) -> None:
    @softcal.register_export("*.txt", digits=softcal.ExportOption(int, "Digits.", "N"))
    def needing(request: softcal.ExportRequest, folder: Path, digits: int) -> list[Path]:
        """Needs a number."""
        return []

    try:
        request = softcal.ExportRequest(softcal.load(write_project(tmp_path)))
        with pytest.raises(InputError, match="digits: the export needs this option"):
            softcal.write_export("needing", request, tmp_path / "out")
    finally:
        EXPORTS.remove("needing")
    assert not (tmp_path / "out").exists()


def test_a_project_is_used_from_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    project = softcal.load("project.yaml")
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    softcal.sweep(project, over={"front.slack": "0 mm, 1 mm"}, out="run")
    assert (gone / "run" / "sweep.csv").is_file()


def test_a_present_folder_that_is_gone_is_no_place_for_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = softcal.load(write_project(tmp_path))
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(softcal.StorageError, match="run: this cannot be written"):
        softcal.calibrate(project, out="run")


@pytest.mark.parametrize("name", [5, "", "a b", "<b>", "rig"])
def test_a_sensor_of_its_own_has_the_name_of_a_part(name: Any) -> None:
    sensor = sensors_of(bar_robot())[0].sensor
    assert softcal.NamedSensor("pot", sensor).name == "pot"
    with pytest.raises(InputError, match="name"):
        softcal.NamedSensor(name, sensor)
