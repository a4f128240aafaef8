"""Project files changed at random: each loads or is refused in sentences, soon, and in little memory."""

from __future__ import annotations

import contextlib
import copy
import io
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from project_case import write_project
from robot_case import MANIPULATOR, ROBOT, write_robot
from ruamel.yaml import YAML

from softcal.errors import InputError
from softcal.project.project import load

LONGEST, MOST_MEMORY = 60.0, 2e9  # [s], [bytes]

SCALARS = [None, True, False, 0, 1, -1, 3, 2.5, 1e30, -1e30, 1e-30, float("nan"), float("inf"), 10**20, 10**400]
TEXTS = ["", " ", "x", "\x07", "\u202e", "a" * 300, "..", "../..", "/dev/zero", "~nobody/x", "[", "*", "joint", "frame"]
TEXTS += [
    "front",
    "bar",
    "plate",
    "start",
    "z0",
    "tension",
    "pitch",
    "time",
    "P1",
    "P2P1",
    "1 GPa:2 GPa:1 Pa",
    "one clock",
]
NUMBERS = ["0", "-1", "0.4999", "1e30", "1e-30", "1e999", "nan", "9" * 400]
UNITS = [
    "",
    "mm",
    "m",
    "px",
    "MPa",
    "Pa",
    "deg",
    "rad",
    "%",
    "s",
    "kg",
    "N",
    "kgf",
    "m/s^2",
    "kg/m^3",
    "Hz",
    "lbs",
    "furlong",
]
QUANTITIES = [f"{number} {unit}" for number in NUMBERS for unit in UNITS]
CONTAINERS: list[Any] = [[], {}, [[]], [None], ["x"], [0, 0, 0], ["0 mm"] * 3, ["1 m"] * 3, {"a": 1}, {"x": {"y": {}}}]
VALUES = st.sampled_from([*SCALARS, *TEXTS, *QUANTITIES, *CONTAINERS])
KEYS = st.sampled_from([*TEXTS, "name", "bounds", "unit", "at", "on", "file", "mesh", "a.b", "NUL"])

KeyPath = tuple[str | int, ...]


def keys_of(data: Any, before: KeyPath = ()) -> list[KeyPath]:
    """Every way to a value of a document."""
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [way for key, value in entries for way in ((*before, key), *keys_of(value, (*before, key)))]


def at(data: Any, way: KeyPath) -> Any:
    for key in way:
        data = data[key]
    return data


def changed(data: Any, draw: Callable[[st.SearchStrategy[Any]], Any]) -> Any:
    """The document after one to three changes: a value replaced, copied from elsewhere, deleted, renamed, doubled."""
    data = copy.deepcopy(data)
    for _ in range(draw(st.integers(1, 3))):
        ways = keys_of(data)
        if not ways:
            break
        way = draw(st.sampled_from(ways))
        parent, key = at(data, way[:-1]), way[-1]
        match draw(st.sampled_from(["replace"] * 4 + ["copy", "delete", "rename", "double"])):
            case "replace":
                parent[key] = copy.deepcopy(draw(VALUES))
            case "copy":
                parent[key] = copy.deepcopy(at(data, draw(st.sampled_from(ways))))
            case "delete":
                del parent[key]
            case "rename" if isinstance(parent, dict):
                parent[draw(KEYS)] = parent.pop(key)
            case _ if isinstance(parent, list):
                parent.append(copy.deepcopy(parent[key]))
            case _:
                parent[draw(KEYS)] = copy.deepcopy(parent[key])
    return data


def plain() -> YAML:
    return YAML(typ="safe", pure=True)


def check_load(path: Path, data: Any) -> None:
    text = io.StringIO()
    plain().dump(data, text)
    path.write_text(text.getvalue(), encoding="utf-8")
    begun = time.monotonic()
    with contextlib.suppress(InputError):
        load(path)
    assert time.monotonic() - begun < LONGEST


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, Any]]:
    folder = tmp_path_factory.mktemp("fuzz")
    paths = [write_project(folder / "bar"), write_robot(folder / "robot", text=ROBOT)]
    paths.append(write_robot(folder / "manipulator", text=MANIPULATOR))
    return [(path.with_name("changed.yaml"), plain().load(path.read_text(encoding="utf-8"))) for path in paths]


@pytest.mark.slow
@settings(max_examples=80, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_small_project_changed_at_random(small: list[tuple[Path, Any]], data: st.DataObject):
    path, document = data.draw(st.sampled_from(small))
    check_load(path, changed(document, data.draw))


@pytest.mark.long
@settings(max_examples=500, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_small_project_changed_at_random_many_times(small: list[tuple[Path, Any]], data: st.DataObject):
    path, document = data.draw(st.sampled_from(small))
    check_load(path, changed(document, data.draw))


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> list[tuple[Path, Any]]:
    folder = tmp_path_factory.mktemp("shipped")
    found: list[tuple[Path, Any]] = []
    for name in ("neck", "beam", "manipulator"):
        shutil.copytree(repository / "examples" / name, folder / name)
        text = (folder / name / "project.yaml").read_text(encoding="utf-8")
        found.append((folder / name / "changed.yaml", plain().load(text)))
    return found


@pytest.mark.slow
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_shipped_project_changed_at_random(shipped: list[tuple[Path, Any]], data: st.DataObject):
    path, document = data.draw(st.sampled_from(shipped))
    check_load(path, changed(document, data.draw))


# What each process is given, besides the project: it must refuse all of them, and say why, before it writes anything.
COMMANDS = {
    "a value without a unit": ["simulate", "--pull", "front=1mm", "--set", "bar.youngs_modulus=2"],
    "a value of another unit": ["simulate", "--pull", "front=1mm", "--set", "bar.poissons_ratio=0.4deg"],
    "a value out of range": ["simulate", "--pull", "front=1mm", "--set", "front.slack=1000m"],
    "a value of many digits": ["simulate", "--pull", "front=1mm", "--set", f"bar.density={'9' * 400} kg/m^3"],
    "a pull in pixels": ["simulate", "--pull", "front=5px"],
    "a pull beyond all": ["simulate", "--pull", "front=1000km"],
    "a seed beyond all": ["calibrate", "--seed", "4294967296"],
    "trials beyond all": ["calibrate", "--trials", "99999999999"],
    "workers beyond all": ["calibrate", "--trials", "1", "--workers", "99999999"],
    "an axis beyond all": ["sweep", "--over", "bar.youngs_modulus=1MPa:2MPa:1uPa"],
    "a step below all": ["sweep", "--over", "bar.youngs_modulus=1MPa:2MPa:1e-300Pa"],
    "a grid beyond all": [
        "sweep", "--over", "bar.youngs_modulus=1MPa:2MPa:1kPa", "--over", "bar.poissons_ratio=0.1:0.4:1e-4",
    ],
    "a reach in pixels": ["export reduced", "--reach", "5px"],
}  # fmt: skip
ALONE = {
    "markers beyond all": ["board", "--ids", "0-999999999"],
    "squares beyond all": ["board", "--squares", f"{'9' * 5000}x3"],
    "a square in pixels": ["board", "--square", "28px"],
    "a run of 300 letters": ["report", "a" * 300],
    "a study of 300 letters": ["mesh-study", "a" * 300],
    "images of 300 letters": ["camera", "a" * 300],
}

IN_ONE_PROCESS = """
import contextlib, io, json, sys
from softcal.cli import main
for arguments in json.loads(sys.stdin.read()):
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            main(arguments)
    except SystemExit as left:
        print(json.dumps([left.code, said.getvalue()]), flush=True)
"""


@pytest.mark.slow
def test_commands_refuse_what_cannot_be(tmp_path: Path):
    import json

    project = write_project(tmp_path / "bar")
    before = sorted(tmp_path.rglob("*"))
    given = [[*command.split(), str(project), *more] for command, *more in COMMANDS.values()] + [*ALONE.values()]
    wanted = [[*arguments, "--out", str(tmp_path / "out")] for arguments in given]
    wanted += [["simulate", str(project), "--pull", "front=1mm", "--out", str(tmp_path / ("a" * 300))]]
    wanted += [["init", "neck", str(tmp_path / ("a" * 300))]]
    done = subprocess.run(
        [sys.executable, "-c", IN_ONE_PROCESS],
        input=json.dumps(wanted),
        capture_output=True,
        text=True,
        timeout=LONGEST * 2,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (int(MOST_MEMORY), int(MOST_MEMORY))),
    )
    told = [json.loads(line) for line in done.stdout.splitlines()]
    for arguments, (code, said) in zip(wanted, told, strict=False):
        assert code == 2, (arguments, said)
        assert "Traceback" not in said
        assert said.strip()
        assert len(said) < 7000
    assert len(told) == len(wanted), (wanted[len(told)], done.stderr)
    assert sorted(tmp_path.rglob("*")) == before, "something was written"
