"""The twin of a run: its shape as a file for the page, simulated seldom, in a process of its own."""

from __future__ import annotations

import json
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_trials import undigested
from project_case import bar_robot, write_project
from watch_case import add_trials

from softcal.plugins.watch import twin
from softcal.plugins.watch.run_reader import RunReader
from softcal.plugins.watch.twin import SHORTEST, TwinKeeper, TwinShape
from softcal.plugins.watch.twin_panel import caption
from softcal.plugins.watch.watched import WatchedSearch
from softcal.project.files import sha256
from softcal.project.project import load
from softcal.report.scene import Ball, FlatDisc, Surface, Tube
from softcal.report.scene_glb import scene_glb
from softcal.workflows.calibration import plan
from softcal.workflows.run_folder import begin_run

UP, RIGHT = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def document(glb: bytes) -> tuple[dict[str, Any], bytes]:
    """The two chunks of a GLB file, which is checked to be whole."""
    magic, version, whole = struct.unpack_from("<4sII", glb)
    assert (magic, version, whole) == (b"glTF", 2, len(glb))
    length, kind = struct.unpack_from("<I4s", glb, 12)
    assert (kind, length % 4) == (b"JSON", 0)
    size, binary = struct.unpack_from("<I4s", glb, 20 + length)
    assert binary == b"BIN\0"
    assert 28 + length + size == len(glb)
    return json.loads(glb[20 : 20 + length]), glb[28 + length :]


def floats(about: dict[str, Any], data: bytes, number: int) -> np.ndarray:
    accessor = about["accessors"][number]
    view = about["bufferViews"][accessor["bufferView"]]
    kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
    width = {"VEC3": 3, "SCALAR": 1}[accessor["type"]]
    found = np.frombuffer(data, kind, accessor["count"] * width, view["byteOffset"])
    return found.reshape(-1, width)


def test_a_triangle_with_its_colours():
    points = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, 0.4]])
    shades = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]])
    surface = Surface(points, np.array([[0, 1, 2]]), colour=shades)
    about, data = document(scene_glb([surface], [], UP, RIGHT))
    held = about["meshes"][0]["primitives"][0]["attributes"]
    # The middle is the origin, and the diagonal of 0.5 m has the length 10.
    placed = floats(about, data, held["POSITION"])
    np.testing.assert_allclose(placed, [[-3, 0, -4], [3, 0, -4], [-3, 0, 4]], atol=1e-6)
    assert about["accessors"][held["POSITION"]]["max"] == [3.0, 0.0, 4.0]
    # 0.5 as a colour is named is the intensity 0.214 (sRGB).
    np.testing.assert_allclose(floats(about, data, held["COLOR_0"])[2], [0.0, 0.0, 0.214], atol=2e-3)
    np.testing.assert_allclose(floats(about, data, held["NORMAL"]), [[0, -1, 0]] * 3, atol=1e-6)


def test_up_is_up_and_the_bending_goes_to_the_right():
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [1.0, 0.0, 0.0]])
    surface = Surface(points, np.array([[0, 1, 2]]), colour="red")
    about, data = document(scene_glb([surface], [], np.array([2.0, 0.0, 0.0]), np.array([3.0, 1.0, 0.0])))
    placed = floats(about, data, about["meshes"][0]["primitives"][0]["attributes"]["POSITION"])
    assert placed[2, 2] - placed[0, 2] > 0  # x is up
    assert placed[1, 0] - placed[0, 0] > 0  # y is to the right


def test_every_kind_of_part_and_the_edges_at_rest():
    path = np.array([[0.0, 0, 0], [0, 0, 0.1], [0, 0.05, 0.2]])
    box = Surface(*_tetrahedron(), colour="red")
    parts = [
        box, Tube(path, 0.01, colour="blue"), Tube(path, np.array([0.01, 0.02, 0.01]), colour=np.eye(3)),
        Ball(path[0], 0.01, colour="green"), FlatDisc(path[2], UP, 0.05, 0.01, colour="grey", opacity=0.3),
    ]  # fmt: skip
    about, data = document(scene_glb(parts, [box], UP, RIGHT))
    primitives = about["meshes"][0]["primitives"]
    assert [one["mode"] for one in primitives] == [4, 4, 4, 4, 4, 1]
    see_through = [about["materials"][one["material"]].get("alphaMode") for one in primitives]
    assert see_through == [None, None, None, None, "BLEND", None]
    for one in primitives:
        count = about["accessors"][one["attributes"]["POSITION"]]["count"]
        assert floats(about, data, one["indices"]).max() < count
        assert np.isfinite(floats(about, data, one["attributes"]["POSITION"])).all()


def _tetrahedron() -> tuple[np.ndarray, np.ndarray]:
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    return points, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def started_run(folder: Path, losses: list[float | None]) -> Path:
    """A run of the bar whose search has these trials."""
    project = load(write_project(folder / "project"))
    settings, problems = plan(project)
    run = folder / "run"
    begin_run(project, settings, list(problems), run)
    place = run / "calibrations" / next(iter(problems))
    place.mkdir(parents=True)
    if losses:
        add_trials(place, losses)
    return run


@pytest.mark.slow
def test_the_twin_at_the_best_trial(tmp_path: Path):
    run = started_run(tmp_path, [3.0, 2.0])
    (search,) = RunReader(run).read().searches
    before = sorted(run.rglob("*"))
    answer, glb = twin.simulated_twin(run, search)
    assert answer["trouble"] == ""
    assert answer["units"]["bar.youngs_modulus"] == "Pa"
    assert answer["bounds"]["front.slack[pull]"] == [0.0, 0.005]
    assert answer["title"].startswith("front: ")
    assert 0.01 < answer["largest"] < 0.05
    (fit,) = answer["fits"]
    assert fit.caption == "pull: measured and simulated; the residual is simulated minus measured."
    assert fit.png.startswith(b"\x89PNG")
    about, _ = document(glb)
    assert len(about["meshes"][0]["primitives"]) >= 4
    assert sorted(run.rglob("*")) == before


def test_before_the_first_trial_units_alone(tmp_path: Path):
    run = started_run(tmp_path, [])
    (search,) = RunReader(run).read().searches
    answer, glb = twin.simulated_twin(run, search)
    assert (answer["trouble"], glb) == ("", b"")
    assert answer["units"]["bar.youngs_modulus"] == "Pa"


def test_a_twin_that_cannot_be_had_is_a_sentence(tmp_path: Path):
    run = started_run(tmp_path, [3.0])
    (run / "inputs" / "bar.msh").write_text("changed")
    (search,) = RunReader(run).read().searches
    answer, glb = twin.simulated_twin(run, search)
    assert "the file was changed after the calibration" in answer["trouble"]
    assert glb == b""
    late, glb = twin.simulated_twin(run, search, patience=0.01)
    assert (late["trouble"], glb) == ("The simulation for the picture took longer than 0.01 s.", b"")


def test_the_twin_is_simulated_again_when_the_best_changed_and_after_a_rest(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    made: list[int | None] = []
    clock, done, cpu = [100.0], threading.Event(), [None]

    def answer(folder: Path, search: WatchedSearch) -> tuple[dict[str, Any], bytes]:
        made.append(None if search.best is None else search.best.number)
        clock[0] += 2.0
        done.set()
        return {
            "units": {"bar.youngs_modulus": "Pa"},
            "bounds": {},
            "title": "front",
            "largest": 0.01,
            "trouble": "",
            "cpu": cpu[0],
        }, b"glb"

    def want(search: WatchedSearch, *, ended: bool = False) -> None:
        done.clear()
        keeper.want(search, ended=ended)
        while keeper.is_busy:
            time.sleep(0.001)

    def searched(*losses: float) -> WatchedSearch:
        place = tmp_path / f"{len(losses)}"
        place.mkdir(exist_ok=True)
        add_trials(place, losses)
        from softcal.plugins.watch.trials import TrialReader

        return WatchedSearch("joint", "calibrations/joint", trials=TrialReader(place).read())

    monkeypatch.setattr(twin, "simulated_twin", answer)
    keeper = TwinKeeper(tmp_path, now=lambda: clock[0])
    one, two, three = searched(3.0), searched(3.0, 2.0), searched(3.0, 2.0, 2.5)
    want(one)
    want(one)
    assert made == [0]
    want(two)  # it took 2 s, so that none is begun before 20 s are over
    clock[0] += 17.0
    want(two)
    assert made == [0]
    clock[0] += 1.5
    want(two)
    want(three)  # the same best
    assert made == [0, 1]
    want(searched(3.0, 2.0, 2.5, 1.0), ended=True)  # of an ended search at once
    assert made == [0, 1, 3]
    shape = keeper.shape(one)
    assert shape is not None
    assert (shape.trial, shape.glb, shape.largest) == (3, b"glb", 0.01)
    assert SHORTEST >= 5.0
    # One that took 0.3 s of a processor in 2 s of time is followed by the shortest rest.
    clock[0], cpu[0] = 1000.0, 0.3
    want(one)
    clock[0] += 4.9
    want(two)
    assert made == [0, 1, 3, 0]
    clock[0] += 0.2
    want(two)
    assert made == [0, 1, 3, 0, 1]
    clock[0] += 100.0
    keeper.close()
    want(one)
    assert made == [0, 1, 3, 0, 1]


def test_a_shape_of_an_earlier_best_says_so(tmp_path: Path):
    run = started_run(tmp_path, [3.0, 2.0])
    (search,) = RunReader(run).read().searches
    assert caption(search, TwinShape(1, "front: 9.9 N", 0.01, b"x", "")) == "Trial 1: front: 9.9 N."
    expected = "Trial 0: pull: no equilibrium was found. Trial 1 is better, and is drawn next."
    assert caption(search, TwinShape(0, "", 0.0, b"", "pull: no equilibrium was found.")) == expected
    assert bar_robot().bodies[0].name == "bar"


def made_up(run: Path, change: Callable[[dict[str, Any]], None]) -> str:
    """What the page says of the twin of a run whose record was changed by hand."""
    record = undigested(json.loads((run / "run.json").read_text()))
    change(record)
    record["hashes"]["project.yaml"] = sha256(run / "project.yaml")
    (run / "run.json").write_text(json.dumps(record))
    (search,) = RunReader(run).read().searches
    answer, glb = twin.simulated_twin(run, search)
    assert glb == b""
    return answer["trouble"]


@pytest.mark.slow
def test_the_twin_reads_no_file_outside_the_run(tmp_path: Path):
    secret = tmp_path / "secret.txt"
    secret.write_text("Time,secret word\n0,1\n")
    run = started_run(tmp_path, [3.0])
    text = (run / "project.yaml").read_text()

    def left_out(record: dict[str, Any]) -> None:
        for kind in ("hashes", "copies"):
            record[kind].pop("data/pull.csv")

    (run / "project.yaml").write_text(text.replace("data/pull.csv", str(secret)))
    told = made_up(run, left_out)
    assert "the run has no copy of the data file" in told
    assert "word" not in told

    def linked(record: dict[str, Any]) -> None:
        record["copies"]["data/pull.csv"] = "inputs/link.csv"
        record["hashes"]["data/pull.csv"] = sha256(secret)

    (run / "project.yaml").write_text(text)
    (run / "inputs" / "link.csv").symlink_to(secret)
    told = made_up(run, linked)
    assert "link.csv: this lies outside the folder" in told
    assert "word" not in told
    (run / "inputs" / "link.csv").unlink()
    (run / "inputs" / "link.csv").symlink_to(run / "inputs" / "link.csv")  # a loop
    assert "link.csv" in made_up(run, lambda record: None)


def test_the_project_file_of_a_twin_is_the_run_s_own(tmp_path: Path):
    run = started_run(tmp_path, [3.0])
    (tmp_path / "secret.txt").write_text("a secret word")
    (run / "project.yaml").unlink()
    (run / "project.yaml").symlink_to(tmp_path / "secret.txt")
    told = made_up(run, lambda record: None)
    assert "project.yaml: this lies outside the folder" in told
    assert "word" not in told


def test_the_twin_of_a_run_outside_the_folder_is_not_simulated(tmp_path: Path):
    started_run(tmp_path, [3.0])
    fleet = tmp_path / "fleet"
    (fleet / "specimens").mkdir(parents=True)
    (fleet / "specimens" / "x").symlink_to(tmp_path / "run")
    search = WatchedSearch("x", "specimens/x/calibrations/pull")
    answer, glb = twin.simulated_twin(fleet, search)
    assert answer == {"trouble": "The run lies outside the folder that is shown; there is no picture of it."}
    assert glb == b""
