"""Public calls with arguments that make no sense: each is refused in a sentence that names the argument, by an
InputError, before anything is computed or written; never one of Python's own errors, never a number without a word.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project_case import bar_robot, write_project

import softcal
from softcal.calibration.run import calibrate as calibrate_problem
from softcal.checks import ReadOnly
from softcal.declare import Checked, _argument_hints, checked_arguments
from softcal.errors import InputError

NAN = math.nan
MASKED = np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False])
BEYOND_ALL = {"nan": NAN, "a text": "3", "True": True, "a complex number": 1 + 1j, "None": None, "an object": object()}

# What is absurd for an argument, by its kind.
ABSURD: dict[str, dict[str, Any]] = {
    "number": {**BEYOND_ALL, "an array": np.ones(3), "a list": [1.0], "infinity": math.inf},
    "count": {**BEYOND_ALL, "two and a half": 2.5, "minus one": -1, "a million million": 10**12, "array": np.ones(2)},
    "text": {"None": None, "five": 5, "a list": ["a"], "bytes": b"a", "an object": object(), "an array": np.ones(2)},
    "name": {"a dict": {}, "five": 5, "a list": ["a"], "None": None, "a name of nothing": "no such name"},
    "path": {"None": None, "five": 5, "a list": ["a"], "bytes": b"a", "an object": object(), "a zero byte": "a\0b"},
    "flag": {"None": None, "one": 1, "yes": "yes", "an array": np.ones(2)},
    "function": {"five": 5, "a text": "print"},
    "part": {"None": None, "five": 5, "a text": "no/such.yaml", "an object": object(), "a list": [1]},
    "names": {"a number": 5, "numbers": [5], "letters": [b"a"], "an object": object(), "an array": np.ones(2)},
    "mapping": {"a number": 5, "a text": "a", "a list": [1], "an object": object(), "an array": np.ones(2)},
    "array": {
        "masked values": MASKED,
        "a list with a masked value": [1.0, np.ma.masked, 3.0],
        "complex numbers": [1.0, 2.0 + 1e-3j, 3.0],
        "texts": ["1", "2", "3"],
        "objects": np.array([1.0, None, 3.0], dtype=object),
        "flags": [True, False, True],
        "dates": np.array(["2026-01-01"] * 3, dtype="datetime64[D]"),
        "infinity": [1.0, math.inf, 3.0],
        "rows of two lengths": [[1.0], [2.0, 3.0]],
        "four axes": np.ones((1, 1, 1, 1)),
        "a mapping": {},
        "a number": 5.0,
        "a text": "123",
    },
    "numbers": {
        "floats": [0.0, 1.0],
        "halves": [0.5, 1.5],
        "complex numbers": [0j],
        "masked values": np.ma.array([0, 1], mask=[False, True]),
        "flags": [True, False],
        "below zero": [-1],
        "more than there are": [10**9],
        "more than an integer": [2**70],
        "texts": ["0"],
        "a text": "0",
        "a number": 0,
        "three axes": np.zeros((1, 1, 1), dtype=int),
    },
}  # fmt: skip
ABSURD |= {f"{kind}?": {n: v for n, v in of.items() if v is not None} for kind, of in ABSURD.items()}  # None is allowed
ABSURD["points"] = {**ABSURD["array"], "two columns": np.zeros((3, 2)), "NaN": np.full((8, 3), NAN)}

MESH = softcal.box_mesh((0.01, 0.01, 0.02), (1, 1, 1))
ELASTIC = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
PULLED = {"tension": (0.0, 5.0)}
LINE = softcal.straight((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 2)
CHANNEL = softcal.Channel([1.0, 2.0, 3.0], "m")
DATASET = softcal.Dataset("pull", {"shortening": CHANNEL, "tension": softcal.Channel([1.0, 2.0, 3.0], "N")})
PULL = softcal.Command("tension", [0.0, 0.5, 1.0])
SCHEDULE = softcal.ramp({"front": ("tension", 1.0)}, 0.1)
EXPERIMENT = softcal.Experiment("pull", DATASET, cable="front", compared=("tension",))
MODULUS = softcal.FreeParameter("bar.youngs_modulus", "Pa", 1e5, 1e7)
PROBLEM = softcal.make_problem(bar_robot(), [EXPERIMENT], [MODULUS])
COUPON = softcal.Coupon("a", "uniaxial", [[1.0], [1.1], [1.2]], [[0.0], [1e5], [2e5]])
VIA = (softcal.ViaPoint((0.0, 0.0, 0.1)), softcal.ViaPoint((0.0, 0.0, 0.0)))
ROBOT = bar_robot()
WORKERS = {"none": 0, "less than none": -2, "two and a half": 2.5, "a text": "two", "True": True, "None": None}
OF_PROBLEM = {"resume": "flag", "workers": "workers", "progress": "function"}
SEARCH = {"out": "path?", **OF_PROBLEM}
ABSURD["workers"] = {**WORKERS, "a million million": 10**12}
ABSURD["control"] = {"five": 5, "a list": ["a"], "a name of nothing": "pull", "None": None}
ABSURD["own storage"] = {"five": 5, "a list": ["journal:a"], "an object": object()}

# A call, the arguments that it has where nothing is said, and the kinds of those that are tried.
Call = tuple[Callable[..., Any], Mapping[str, Any], Mapping[str, str]]
CALLS: list[Call] = [
    # What a robot is made of
    (softcal.box_mesh, {"lengths": (1.0, 1.0, 1.0), "divisions": (1, 1, 1)}, {"lengths": "array", "order": "count"}),
    (softcal.box_mesh, {"lengths": (1.0, 1.0, 1.0)}, {"divisions": "numbers"}),
    (softcal.box_mesh, {"lengths": (1.0, 1.0, 1.0), "divisions": (1, 1, 1)}, {"origin": "array"}),
    (softcal.TetMesh, {"tets": MESH.tets}, {"points": "points"}),
    (softcal.TetMesh, {"points": MESH.points}, {"tets": "numbers"}),
    (softcal.TetMesh, {"points": MESH.points, "tets": MESH.tets}, {"node_sets": "mapping", "element_sets": "mapping"}),
    (lambda node_sets: softcal.TetMesh(MESH.points, MESH.tets, {"a": node_sets}), {}, {"node_sets": "numbers"}),
    (
        lambda element_sets: softcal.TetMesh(MESH.points, MESH.tets, {}, {}, {"a": element_sets}),
        {},
        {"element_sets": "numbers"},
    ),
    (softcal.straight, {"start": (0, 0, 0), "end": (0, 0, 1), "at": 2}, {"start": "array", "end": "array"}),
    (softcal.straight, {"start": (0, 0, 0), "end": (0, 0, 1)}, {"at": "array"}),
    (
        softcal.helix,
        {"base": (0, 0, 0), "axis": (0, 0, 1), "diameter": 0.03, "pitch": 0.01, "turns": 3, "at": 10},
        {"base": "array", "axis": "array", "diameter": "number", "pitch": "number", "turns": "number", "at": "array"},
    ),
    (
        softcal.Body,
        {"name": "bar", "mesh": MESH, "fixed": [0], "parameters": ELASTIC},
        {"name": "text", "mesh": "part", "fixed": "numbers", "parameters": "mapping", "density": "number"},
    ),
    (softcal.Material, {"name": "core", "elements": [0], "parameters": {}}, {"density": "number"}),
    (
        softcal.Rod,
        {"name": "rod", "centreline": LINE, "section": softcal.RoundBar(0.01), "parameters": ELASTIC},
        {"fixed": "numbers", "centreline": "part", "section": "part"},
    ),
    (softcal.Plate, {"name": "top", "nodes": {}, "reference": (0, 0, 0)}, {"reference": "array", "mass": "number"}),
    (softcal.Marker, {"name": "eye", "on": "top", "at": (0, 0, 0)}, {"at": "array", "offset": "array"}),
    (softcal.PointLoad, {"name": "w", "on": "top", "at": (0, 0, 0), "force": (0, 0, 1)}, {"force": "array"}),
    (softcal.Moment, {"name": "w", "on": "top", "moment": (0, 0, 1)}, {"moment": "array"}),
    (softcal.SurfaceLoad, {"name": "w", "on": "bar", "faces": [[0, 1, 2]]}, {"traction": "array"}),
    (softcal.ViaPoint, {"at": (0, 0, 0)}, {"at": "array", "radius": "number?", "offset": "array"}),
    (softcal.Cable, {"name": "front", "via_points": VIA}, {"via_points": "part", "friction_coefficient": "number"}),
    (softcal.RoundBar, {"diameter": 0.01}, {"diameter": "number"}),
    (softcal.Robot, {}, {"bodies": "part", "gravity": "array"}),
    # What drives and measures it
    (softcal.Command, {"control": "tension", "values": [0.0]}, {"control": "name", "values": "array", "by": "mapping"}),
    (softcal.Protocol, {"commands": {"front": PULL}}, {"commands": "mapping", "times": "array"}),
    (softcal.Schedule, {"times": [0.0, 1.0, 2.0], "commands": {"front": PULL}}, {"times": "array"}),
    (softcal.Schedule, {"times": [0.0, 1.0, 2.0], "commands": {"front": PULL}}, {"commands": "mapping"}),
    (softcal.ramp, {"targets": {"front": ("tension", 1.0)}, "duration": 1.0}, {"duration": "number"}),
    (softcal.ramp, {"duration": 1.0}, {"targets": "mapping"}),
    (softcal.Channel, {"values": [0.0], "unit": "m"}, {"values": "array", "unit": "text", "sigma": "number"}),
    (softcal.Dataset, {"name": "pull", "channels": {"tension": CHANNEL}}, {"name": "text", "channels": "mapping"}),
    (softcal.Dataset, {"name": "pull", "channels": {"tension": CHANNEL}}, {"cycle": "array"}),
    (softcal.Experiment, {"name": "pull", "dataset": DATASET, "cable": "front"}, {"dataset": "part", "drive": "name"}),
    (softcal.Experiment, {"name": "pull", "dataset": DATASET, "cable": "front"}, {"settings": "mapping"}),
    (softcal.Coupon, {"name": "a", "test": "uniaxial", "strain": [[1.0]], "stress": [[0.0]]}, {"stress": "array"}),
    (softcal.Coupon, {"name": "a", "test": "uniaxial", "strain": [[1.0]], "stress": [[0.0]]}, {"strain": "array"}),
    (softcal.Coupon, {"name": "a", "test": "uniaxial", "strain": [[1.0]], "stress": [[0.0]]}, {"test": "name"}),
    # What is computed
    (
        softcal.pull,
        {"robot": ROBOT, "actuator": "front", "control": "tension", "end": 1.0},
        {"robot": "part", "actuator": "name", "control": "name", "end": "number", "samples": "count"},
    ),
    (softcal.simulate, {"twin": ROBOT}, {"protocol": "mapping", "theta": "mapping", "experiment": "text"}),
    (softcal.simulate, {}, {"twin": "part"}),
    (softcal.simulate, {"twin": ROBOT}, {"sensitivities": "names", "snapshots": "name", "engine": "function"}),
    (softcal.simulate_in_time, {"schedule": SCHEDULE}, {"robot": "part"}),
    (softcal.simulate_in_time, {"robot": ROBOT}, {"schedule": "part"}),
    (softcal.simulate_in_time, {"robot": ROBOT, "schedule": SCHEDULE}, {"settings": "part", "snapshots": "count"}),
    (softcal.LiveTwin, {}, {"twin": "part"}),
    (softcal.LiveTwin, {"twin": ROBOT}, {"controls": "control", "theta": "mapping", "sensitivities": "names"}),
    (softcal.robot_parameters, {}, {"robot": "part"}),
    (softcal.with_parameters, {"robot": ROBOT}, {"values": "mapping"}),
    (lambda value: softcal.with_parameters(ROBOT, {"bar.youngs_modulus": value}), {}, {"value": "number"}),
    # What is fitted
    (
        softcal.FreeParameter,
        {"name": "bar.youngs_modulus", "unit": "Pa", "lower": 1e5, "upper": 1e7},
        {"name": "text", "unit": "text", "scale": "name", "start": "number?", "prior_mean": "number?"},
    ),
    (softcal.UncertainParameter, {"name": "a.mass", "unit": "kg", "sd": 0.1}, {"sd": "number", "per_set_up": "flag"}),
    (softcal.Candidate, {"name": "a", "like": "pull"}, {"reach": "number?", "samples": "count", "repeats": "count"}),
    (softcal.SearchSettings, {}, {"method": "text", "trials": "count?", "seed": "count", "batch": "count?"}),
    (softcal.make_problem, {"robot": ROBOT, "experiments": [EXPERIMENT]}, {"parameters": "part"}),
    (softcal.make_problem, {"robot": ROBOT, "parameters": [MODULUS]}, {"experiments": "part"}),
    (softcal.make_problem, {"experiments": [EXPERIMENT], "parameters": [MODULUS]}, {"robot": "part"}),
    (softcal.compare_laws, {"coupons": [COUPON]}, {"laws": "names", "poissons_ratio": "number", "reach": "number?"}),
    (softcal.compare_laws, {}, {"coupons": "part"}),
    (calibrate_problem, {"problem": PROBLEM, "store": "OUT"}, {**OF_PROBLEM, "store": "path?", "settings": "part?"}),
    # Of files and folders
    (softcal.load, {}, {"path": "path"}),
    (softcal.load, {"path": "PROJECT"}, {"values": "mapping", "copies": "mapping", "changes": "mapping"}),
    (softcal.load_run, {}, {"folder": "path"}),
    (softcal.read_mesh, {}, {"path": "path"}),
    (softcal.read_mesh, {"path": "bar.msh"}, {"unit": "name"}),
    (softcal.read_coupons, {"test": "uniaxial"}, {"path": "path"}),
    (softcal.read_coupons, {"path": "a.csv", "test": "uniaxial"}, {"test": "name", "needs_stress": "flag"}),
    (softcal.quantity, {}, {"kind": "name"}),
    (softcal.calibrate, {}, {"project": "part"}),
    (softcal.calibrate, {"project": "PROJECT", "out": "OUT"}, {**SEARCH, "engine": "name", "storage": "own storage"}),
    (softcal.calibrate, {"project": "PROJECT", "out": "OUT"}, {"trials": "count?", "seed": "count?"}),
    (softcal.check, {"project": "PROJECT"}, {"out_dir": "path?", "solve": "flag", "progress": "function"}),
    (softcal.check, {}, {"project": "part"}),
    (softcal.sweep, {"project": "PROJECT", "out": "OUT"}, {**SEARCH, "over": "mapping", "experiments": "names"}),
    (softcal.fleet, {"source": "fleet.csv", "out": "OUT"}, {**SEARCH, "out": "path", "by": "names"}),
    (softcal.fleet, {"out": "OUT"}, {"source": "path"}),
    (softcal.importance, {"path": "PROJECT", "out": "OUT"}, {"seed": "count", "simulations": "count"}),
    (softcal.intervals, {"path": "run", "out": "OUT"}, {"by": "name", "samples": "count?", "workers": "workers"}),
    (softcal.mesh_study, {"path": "PROJECT", "out": "OUT"}, {"halvings": "count", "element": "name"}),
    (softcal.next_test, {"run": "run", "out": "OUT"}, {"candidates": "part", "workers": "workers"}),
    (softcal.reach, {"twin": "PROJECT", "out": "OUT"}, {"targets": "mapping"}),
    (softcal.reach, {"targets": {"plate.x": 0.001}, "out": "OUT"}, {"twin": "part"}),
    (softcal.workspace, {"twin": "PROJECT", "limits": PULLED, "out": "OUT"}, {"channels": "names", "states": "count?"}),
    (softcal.workspace, {"channels": ["plate.x"], "limits": PULLED, "out": "OUT"}, {"twin": "part"}),
    (softcal.linearise, {"twin": "PROJECT", "out": "OUT"}, {"commands": "mapping", "modes": "count"}),
    (softcal.linearise, {"out": "OUT"}, {"twin": "part"}),
    (softcal.validate, {"projects": "PROJECT"}, {"hold_out": "names", "split": "names", "workers": "workers"}),
    (softcal.compare_records, {"project": "PROJECT"}, {"result": "part"}),
    (softcal.watch_run, {}, {"folder": "path"}),
    (softcal.watch_run, {"folder": "run"}, {"port": "count?"}),
    (softcal.write_report, {}, {"run": "path"}),
    (softcal.write_report, {"run": "run"}, {"out": "path?", "figures": "names", "solved": "mapping"}),
    (softcal.shape_grid, {"robot": ROBOT}, {"shape": "part"}),
    (softcal.ExportRequest, {}, {"project": "part"}),
    (softcal.write_export, {"request": "REQUEST", "folder": "OUT"}, {"name": "name"}),
]  # fmt: skip

CASES = [
    (call, given, argument, kind, what)
    for call, given, tried in CALLS
    for argument, kind in tried.items()
    for what in ABSURD[kind]
]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> softcal.Project:
    return softcal.load(write_project(tmp_path_factory.mktemp("project")))


@pytest.mark.parametrize(
    ("call", "given", "argument", "kind", "what"),
    CASES,
    ids=[f"{getattr(c, '__name__', c)}-{a}-{w}-{i}" for i, (c, _, a, _, w) in enumerate(CASES)],
)
def test_an_absurd_argument_is_refused_by_its_name(
    call: Callable[..., Any], given: Mapping[str, Any], argument: str, kind: str, what: str,
    project: softcal.Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    place = {"PROJECT": project, "OUT": tmp_path / "run", "REQUEST": softcal.ExportRequest(project)}
    usual = {name: place.get(value, value) if isinstance(value, str) else value for name, value in given.items()}
    with pytest.raises(InputError) as error:
        call(**{**usual, argument: ABSURD[kind][what]})
    told = str(error.value)
    # By its own name, or by the option's where the command line has it too.
    assert argument in told or argument.replace("_", "-") in told or _is_told_by_what_it_was(told, ABSURD[kind][what])
    assert told.rstrip()[-1] in ".?"
    assert len(told.split()) > 4
    assert not list(tmp_path.iterdir())


def _is_told_by_what_it_was(told: str, value: object) -> bool:
    """Whether a message on a name or a path that does not exist has it."""
    return isinstance(value, str | int | float) and str(value) in told


def test_there_are_many_of_them() -> None:
    assert len(CASES) > 700


@pytest.mark.parametrize("name", [name for name in dir(softcal) if inspect.isfunction(getattr(softcal, name))])
def test_every_public_function_checks_its_arguments(name: str) -> None:
    function = getattr(softcal, name)
    if name.startswith("register_"):  # the catalogue checks what is registered
        return
    assert function.__code__ is checked_arguments(function).__code__
    assert _argument_hints(function.__wrapped__)


@pytest.mark.parametrize("name", [name for name in dir(softcal) if is_dataclass(getattr(softcal, name))])
def test_every_public_part_with_arrays_checks_them_or_locks_them(name: str) -> None:
    part = getattr(softcal, name)
    arrays = re.compile(r"\b(Floats|Ints|Series|Measured|Numbers|Triangles|Position|Traction|\w+Vector|Gravity)\b")
    if name != "Project" and any(arrays.search(str(one.type)) for one in fields(part)):  # whose arrays are its meshes'
        assert issubclass(part, (Checked, ReadOnly))


# What softcal makes itself, and what the catalogue looks at as it is registered.
MADE = (
    "CalibrationResult Calibrations Drawing DrawnShape Fault Fleet Jacobian LawComparison LinearSystem LiveState "
    "PrimitiveShape Project Proposal RecordFit ReportContent Response SweepResult Swept"
)
LOOKED_AT = "ChannelKind ExportRequest Limit NamedSensor Quantity ReportTable"
DERIVED = ("ActuatorTerm",)  # abstract: its fields are those of a class of its author


@pytest.mark.parametrize("name", [name for name in dir(softcal) if is_dataclass(getattr(softcal, name))])
def test_every_part_that_a_user_makes_checks_its_fields(name: str) -> None:
    part = getattr(softcal, name)
    assert issubclass(part, Checked) or name in (*MADE.split(), *LOOKED_AT.split(), *DERIVED)


@pytest.mark.parametrize(
    ("channel", "unit", "own"), [("tension", "kN", "N"), ("tension", "m", "N"), ("a.x", "mm", "m")]
)
def test_a_channel_of_a_dataset_is_in_its_own_unit(channel: str, unit: str, own: str) -> None:
    """Its numbers would be taken for SI."""
    with pytest.raises(
        InputError, match=f"pull, {channel}: the channel is in another unit; got '{unit}'; allowed: {own}"
    ):
        softcal.Dataset("pull", {channel: softcal.Channel([1.0, 2.0], unit)})


def test_no_coupons_are_refused() -> None:
    with pytest.raises(InputError, match="coupons: there are none; allowed: one test or more"):
        softcal.compare_laws([])
