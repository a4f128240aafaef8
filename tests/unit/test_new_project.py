"""A project by clicks: what a click on a surface means, the file that is written, files that are dropped."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import softcal
from softcal.checks import Floats
from softcal.cli import app
from softcal.errors import DatasetError, ProjectFileError
from softcal.geometry.bore import bore_at
from softcal.geometry.regions import plane_at
from softcal.geometry.surface import boundary_triangles
from softcal.plugins.watch import new_page
from softcal.plugins.watch.draft import (
    BenchTable,
    Draft,
    DraftCable,
    likely_columns,
    middle,
    on_plane,
    part_surface,
    project_text,
    pulled_behind,
    same_plane,
    table_columns,
    towards,
    via_points,
)
from softcal.plugins.watch.gate import Gate
from softcal.plugins.watch.new_page import NewProject, taken
from softcal.project.project import load

FINGER = Path(__file__).parents[2] / "examples" / "finger"
RIBS = [(0, 14), *((k, k + 5) for k in range(17, 70, 8)), (73, 84)]  # [mm], in which the channel is
PULL = {"shortening": ("displacement [mm]", ""), "tension": ("force [N]", "")}
IN_CHANNEL = 1e-3 * np.array([4.5, 1.49, 60.0])


@pytest.fixture(scope="module")
def finger() -> Floats:
    return part_surface(FINGER / "finger.stl", "mm", "4 mm")


def turned(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """A random rotation and translation."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q)), rng.normal(scale=0.1, size=3)


def test_the_face_at_a_click_is_its_plane(finger: Floats):
    foot = plane_at(finger, np.array([0.0, 0.003, 0.0]))
    assert foot is not None
    assert foot.normal == (0.0, 0.0, -1.0)
    assert foot.point[2] == 0.0
    assert middle(on_plane(finger, foot)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert plane_at(finger, IN_CHANNEL) is None


def test_a_click_in_the_channel_finds_it_in_every_rib(finger: Floats):
    bore = bore_at(finger, IN_CHANNEL)
    assert bore is not None
    assert np.abs(bore.axis) == pytest.approx([0, 0, 1], abs=1e-4)
    assert bore.diameter == pytest.approx(3e-3, rel=0.02)  # through chords of 3 mm
    assert bore.stretches[..., 2] == pytest.approx(1e-3 * np.array(RIBS, dtype=float), abs=2e-6)
    assert bore.is_blind.tolist() == [[False, False]] * len(RIBS)
    assert bore.stretches[..., :2] == pytest.approx(np.broadcast_to([4.5e-3, 0.0], (len(RIBS), 2, 2)), abs=1e-5)


def test_a_via_point_is_a_diameter_from_the_blind_end_of_a_bore():
    """A box with a void: a square bore of 2 mm from 10 to 40 mm, closed at both ends."""
    box = lambda lower, upper: softcal.box_mesh(np.subtract(upper, lower), (1, 1, 1), origin=lower)  # noqa: E731
    outer, inner = (mesh.points[boundary_triangles(mesh.tets)] for mesh in (
        box((-0.01, -0.01, 0.0), (0.01, 0.01, 0.05)), box((-0.001, -0.001, 0.01), (0.001, 0.001, 0.04))))  # fmt: skip
    bore = bore_at(np.concatenate([outer, inner[:, ::-1]]), np.array([0.001, 0.0002, 0.02]))
    assert bore is not None
    assert bore.is_blind.all()
    assert sorted(bore.stretches[0, :, 2]) == pytest.approx([0.01, 0.04], abs=1e-5)
    heights = sorted(at[2] for at in via_points(bore))
    assert heights == pytest.approx([0.01 + bore.diameter, 0.04 - bore.diameter], abs=1e-5)


@pytest.mark.slow  # Gmsh fills it
def test_a_click_in_the_bore_of_a_step_file_finds_it(tmp_path: Path):
    """The finger of the gallery; its unit is in the file."""
    step = next((FINGER.parents[1] / "gallery" / "finger").glob("*.step"))
    surface = part_surface(step, "in", "4 mm")
    top = surface.reshape(-1, 3)[:, 2].max()
    places = [(x, y) for x in np.arange(-0.01, 0.01, 1e-3) for y in np.arange(-0.01, 0.01, 1e-3)]
    bores = (bore for x, y in places if (bore := bore_at(surface, np.array([x, y, 0.5 * top]))) is not None)
    assert any(abs(bore.axis[2]) > 0.999 and bore.diameter < 5e-3 and not bore.is_blind.any() for bore in bores)
    with pytest.raises(softcal.InputError, match="unit is missing"):
        part_surface(step, "mm", "4")


def test_a_cable_runs_to_the_fixed_face(draft: Draft):
    own = draft.cables["cable"].via
    for via in (own, own[::-1]):
        assert [at[2] for at in towards(via, draft.fixed)] == [at[2] for at in own]
        assert [at[2] for at in towards(via, draft.top)] == [at[2] for at in own[::-1]]
        assert towards(via, None) == via
    assert own[0][2] == pytest.approx(0.0835, abs=1e-5)
    assert pulled_behind(own)[2] == pytest.approx(-0.0095, abs=1e-5)


@pytest.mark.parametrize("at", [[-0.008, 0.0, 0.04], [0.0, 0.0, 0.0], [0.0, 0.0, 0.084]])
def test_no_bore_is_at_an_outer_face(finger: Floats, at: list[float]):
    assert bore_at(finger, np.array(at)) is None


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_picked_turns_with_the_part(finger: Floats, seed: int):
    R, t = turned(np.random.default_rng(seed))
    bore, moved = bore_at(finger, IN_CHANNEL), bore_at(finger @ R.T + t, R @ IN_CHANNEL + t)
    assert bore is not None
    assert moved is not None
    ends = (bore.stretches if moved.axis @ R @ bore.axis > 0 else bore.stretches[::-1, ::-1]) @ R.T + t
    assert moved.stretches == pytest.approx(ends, abs=2e-5)
    plane = plane_at(finger @ R.T + t, R @ np.array([0.0, 0.003, 0.0]) + t)
    assert plane is not None
    assert plane.normal == pytest.approx(R @ [0, 0, -1], abs=1e-5)


def test_an_stl_that_is_inside_out_is_turned(tmp_path: Path, finger: Floats):
    data = bytearray((FINGER / "finger.stl").read_bytes())
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles = np.frombuffer(bytes(data[84:]), record).copy()
    triangles["corners"] = triangles["corners"][:, ::-1]
    data[84:] = triangles.tobytes()
    (tmp_path / "inside-out.stl").write_bytes(data)
    assert np.array_equal(part_surface(tmp_path / "inside-out.stl", "mm", "4 mm"), finger)


@pytest.fixture(scope="module")
def draft(finger: Floats) -> Draft:
    """The finger as it is set up by six clicks."""
    fixed, top = plane_at(finger, np.array([0.0, 0.003, 0.0])), plane_at(finger, np.array([0.0, 0.0, 0.084]))
    bore = bore_at(finger, IN_CHANNEL)
    assert bore is not None
    assert top is not None
    via = towards(via_points(bore), fixed)
    columns = likely_columns(table_columns(FINGER / "data" / "pull-7mm.csv"))
    tests = tuple(BenchTable(f"data/pull-{n}mm.csv", columns) for n in (7, 10))
    reference = middle(on_plane(finger, top))
    cables = {"cable": DraftCable(via, pulled_behind(via))}
    return Draft("finger.stl", "mm", "4 mm", fixed=fixed, top=top, reference=reference, cables=cables, tests=tests)


def loaded(draft: Draft, folder: Path) -> Any:
    for name in ("finger.stl", "data"):
        if not (folder / name).exists():
            (folder / name).symlink_to(FINGER / name)
    (folder / "project.yaml").write_text(project_text(draft), encoding="utf-8")
    return load(folder / "project.yaml")


@pytest.mark.slow  # both are meshed and built
def test_the_file_is_the_finger_that_a_person_wrote(draft: Draft, tmp_path: Path):
    project, ours = loaded(draft, tmp_path), load(FINGER / "project.yaml")
    assert not softcal.check(project, solve=False).warnings
    # The knot, and where the cable is pulled, are a person's choice.
    made, written = ([via.at for via in one.robot.cables[0].via_points] for one in (project, ours))
    stated = [at for at in written if 0.0 < at[2] < 0.074]
    assert all(np.linalg.norm(np.array(made) - at, axis=1).min() < 1e-8 for at in stated)
    assert project.robot.bodies[0].fixed.tolist() == ours.robot.bodies[0].fixed.tolist()
    assert project.robot.plates[0].reference == pytest.approx(ours.robot.plates[0].reference)
    assert [e.dataset.n_samples for e in project.experiments.values()] == [41, 41]
    names = [{p.name: (p.lower, p.upper) for p in one.space.parameters} for one in (project, ours) if one.space]
    assert len(names) == 2
    assert sorted(names[0].values()) == sorted(names[1].values())


@pytest.mark.slow  # it is meshed and built
def test_tests_of_several_cables_have_their_own_parameters(draft: Draft, tmp_path: Path):
    knot, foot, pulled_at = (np.array([-0.0045, 0.0, z]) for z in (0.0835, 0.0005, -0.0095))
    front, back = draft.cables["cable"], DraftCable((knot, foot), pulled_at)
    tests = tuple(replace(test, cable=name) for test, name in zip(draft.tests, ("front", "back"), strict=True))
    both = replace(draft, cables={"front": front, "back": back, "unused": DraftCable()}, tests=tests)
    project = loaded(both, tmp_path)
    assert [cable.name for cable in project.robot.cables] == ["front", "back"]
    assert [one.cable for one in project.experiments.values()] == ["front", "back"]
    assert project.space is not None
    assert set(project.space.labels) == {"finger.youngs_modulus", "front.slack[pull_7mm]", "back.slack[pull_10mm]"}
    assert {one.label for one in project.uncertain} == {
        f"{part}_drift[{test}]"
        for part, test in (("front.tension", "pull_7mm"), ("back.tension", "pull_10mm"),
                           ("tip.pitch", "pull_7mm"), ("tip.pitch", "pull_10mm"))
    }  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fixed": None}, "not fixed"),
        ({"youngs_modulus": "10"}, "youngs_modulus"),
        ({"youngs_modulus": "stiff"}, "youngs_modulus"),
        ({"poissons_ratio": "0.6"}, "poissons_ratio"),
        ({"size": "4"}, "size"),
        ({"drift": {"tension": "20"}}, "tension_drift"),
        ({"drift": {"pitch": "-1 deg"}}, "pitch_drift"),
        ({"tests": (BenchTable("data/pull-7mm.csv", PULL, {"tension": "0.05 mm"}),)}, "noise"),
        ({"tests": (BenchTable("data/pull-7mm.csv", PULL, {"tension": "0 N"}),)}, "noise"),
        ({"tests": (BenchTable("data/none.csv", {"tension": ("force [N]", "")}),)}, "none.csv"),
        ({"tests": (BenchTable("data/pull-7mm.csv", {"tension": ("force", "K")}),)}, "force"),
    ],
    ids=[
        "not fixed",
        "no unit",
        "no number",
        "ratio",
        "size",
        "drift without unit",
        "negative drift",
        "noise in mm",
        "noise of zero",
        "no table",
        "no column",
    ],
)
def test_what_is_missing_or_wrong_is_a_fault_of_the_file(
    draft: Draft, tmp_path: Path, changes: dict[str, Any], said: str
):
    with pytest.raises(ProjectFileError, match=said):
        loaded(replace(draft, **changes), tmp_path)


def test_noise_and_drift_are_written_as_a_person_writes_them(draft: Draft):
    guesses = "    # guesses (tension, pitch): state those of your instruments"
    text = project_text(draft)
    assert f"    noise: {{tension: 0.05 N, pitch: 0.3 deg}}{guesses}\n" in text
    assert f"uncertain:{guesses}\n" in text
    first, second = draft.tests
    stated = replace(first, noise={"tension": "2 mN", "pitch": "0.5 deg"})
    half = replace(second, noise={"pitch": "", "roll": "1 deg"})  # roll is not compared
    drift = {"tension": "0.01 N", "pitch": "0.05 deg"}
    text = project_text(replace(draft, tests=(stated, half), drift=drift))
    assert "    noise: {tension: 2 mN, pitch: 0.5 deg}\n" in text
    assert "    noise: {tension: 0.05 N}    # guesses (tension): state those of your instruments\n" in text
    assert "uncertain:\n  cable.tension_drift: {sd: 0.01 N, per: experiment}\n" in text
    assert "  tip.pitch_drift: {sd: 0.05 deg, per: experiment}\n" in text
    assert "roll" not in text
    text = project_text(replace(draft, drift={"tension": "", "pitch": ""}))
    assert "uncertain:" not in text
    assert "drift" not in text


def test_what_drives_a_test_has_neither_noise_nor_drift():
    columns = {"tension": ("F", "N"), "pitch": ("a", "deg"), "roll": ("b", "deg")}
    text = project_text(Draft("part.stl", tests=(BenchTable("a.csv", columns),)))
    assert "drive: tension\n" in text
    assert "noise: {pitch: 0.3 deg, roll: 0.3 deg}" in text
    assert "tip.roll_drift: {sd: 0.1 deg, per: experiment}\n" in text
    assert "tension_drift" not in text
    assert "noise" not in project_text(Draft("part.stl", tests=(BenchTable("a.csv", {"tension": ("F", "N")}),)))


@pytest.mark.slow  # it is meshed and built
def test_noise_and_drift_are_those_of_the_project(draft: Draft, tmp_path: Path):
    tests = tuple(replace(test, noise={"tension": "2 mN"}) for test in draft.tests)
    project = loaded(replace(draft, tests=tests, drift={"tension": "0.01 N"}), tmp_path)
    sigmas = [one.dataset.channels["tension"].sigma for one in project.experiments.values()]
    assert sigmas == [0.002, 0.002]
    assert {one.name: one.sd for one in project.uncertain} == {
        "cable.tension_drift": 0.01,
        "tip.pitch_drift": pytest.approx(np.radians(0.1)),
    }


@given(header=st.text(min_size=1, max_size=20), file=st.text(min_size=1, max_size=20))
def test_any_name_of_a_column_or_file_is_text_of_the_file(header: str, file: str):
    from ruamel.yaml import YAML

    header, file = (" ".join(one.split()) or "a" for one in (header, file))
    if not (header.isprintable() and file.isprintable()):
        return
    text = project_text(Draft("part.stl", tests=(BenchTable(f"{file}.csv", {"tension": (header, "N")}),)))
    data = YAML(typ="safe").load(text)
    (test,) = data["experiments"].values()
    assert test["files"][0]["path"] == f"{file}.csv"
    assert test["files"][0]["columns"]["tension"] == {"name": header, "unit": "N"}


@pytest.mark.parametrize(
    ("file", "name"),
    [("Finger v2.stl", "Finger_v2"), ("a/part 7,5 mm.stl", "part_7_5_mm"), ("3.stl", "body_3"), ("ü.stl", "body")],
)
def test_parts_and_tests_are_called_as_their_files(file: str, name: str):
    assert Draft(file).body == name


def test_tests_of_one_name_are_told_apart_by_their_folders():
    tests = tuple(BenchTable(f"{file}.csv", {"tension": ("F", "N")}) for file in ("a/pull", "b/pull", "b/7"))
    assert list(Draft("part.stl", tests=tests).experiments) == ["a_pull", "b_pull", "test_7"]


@pytest.mark.parametrize(
    ("file", "keys"),
    [
        ("part.step", "size: 4 mm, edges_around: 6"),
        ("part.STP", "size: 4 mm, edges_around: 6"),
        ("part.stl", "unit: mm, size: 4 mm"),
        ("part.msh", "unit: mm"),
    ],
)
def test_a_mesh_has_the_keys_of_its_kind(file: str, keys: str):
    assert f"      mesh: {{file: {file}, {keys}}}\n" in project_text(Draft(file))


def test_columns_are_guessed_by_their_headers(tmp_path: Path):
    (tmp_path / "a.csv").write_text("Zeit;Weg;Kraft;Winkel\ns;mm;N;deg\n0;1,5;2;3\n1;2;3;4\n")
    columns = table_columns(tmp_path / "a.csv")
    assert columns == {"Zeit": "s", "Weg": "mm", "Kraft": "N", "Winkel": "deg"}
    assert {channel: header for channel, (header, _) in likely_columns(columns).items()} == {
        "time": "Zeit", "shortening": "Weg", "tension": "Kraft", "pitch": "Winkel",
    }  # fmt: skip


class TestPage:
    """The addresses of the page, without a browser."""

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        (tmp_path / "robot").mkdir()
        return tmp_path / "robot"

    def dropped(self, folder: Path, name: str, *parts: bytes) -> tuple[str, int]:
        class Dropped:
            async def stream(self) -> AsyncGenerator[bytes]:
                for part in parts:
                    yield part

        return asyncio.run(taken(folder, name, cast("Any", Dropped())))

    def test_a_file_that_is_dropped_is_copied_once(self, folder: Path):
        assert self.dropped(folder, "part.stl", b"x" * 100, b"y")[1] == 201
        assert (folder / "part.stl").read_bytes() == b"x" * 100 + b"y"
        said, status = self.dropped(folder, "part.stl", b"other")
        assert status == 409
        assert "was not replaced" in said
        assert (folder / "part.stl").read_bytes() == b"x" * 100 + b"y"

    @pytest.mark.parametrize(
        "name", [".hidden.csv", "a.exe", "project.yaml", "../a.csv", "a/b.csv", "/tmp/a.csv", ".."]
    )
    def test_what_is_not_read_here_is_not_copied(self, folder: Path, name: str):
        assert self.dropped(folder, name, b"x")[1] == 415
        assert list(folder.iterdir()) == []

    def test_a_file_whose_sender_is_gone_is_not_left_half(self, folder: Path):
        class Broken:
            async def stream(self) -> AsyncGenerator[bytes]:
                yield b"x"
                raise asyncio.CancelledError

        with pytest.raises(asyncio.CancelledError):
            asyncio.run(taken(folder, "part.stl", cast("Any", Broken())))
        assert list(folder.iterdir()) == []

    def test_only_a_page_that_takes_files_lets_them_in(self):
        def answer(most_bytes: int, **changes: Any) -> int:
            sent: list[Any] = []

            async def served(scope: Any, receive: Any, send: Any) -> None:
                await send({"type": "http.response.start", "status": 201, "headers": []})

            async def send(message: Any) -> None:
                sent.append(message)

            headers = [(b"host", b"127.0.0.1:8085"), (b"content-length", str(changes.pop("length", 10)).encode())]
            headers += [(b"origin", changes.pop("origin").encode())] if "origin" in changes else []
            scope = {"type": "http", "method": "PUT", "path": "/files/a.stl", "headers": headers, **changes}
            asyncio.run(Gate(served, "", 8085, most_bytes)(scope, cast("Any", None), send))
            return sent[0]["status"]

        assert answer(0) == 403
        assert answer(3_000_000) == 201
        assert answer(3_000_000, length=2_000_000) == 201
        assert answer(3_000_000, length=4_000_000) == 403
        assert answer(3_000_000, path="/surface/a.stl") == 403
        assert answer(3_000_000, method="DELETE") == 403
        assert answer(3_000_000, origin="http://elsewhere.example") == 403

    @pytest.mark.slow  # it is meshed and built
    def test_findings_are_those_of_the_draft_and_nothing_is_written_beside_the_files(
        self, draft: Draft, folder: Path, tmp_path: Path
    ):
        for name in ("finger.stl", "data"):
            (shutil.copytree if (FINGER / name).is_dir() else shutil.copy)(FINGER / name, folder / name)
        (tmp_path / "scratch").mkdir()
        project = NewProject(folder, tmp_path / "scratch")
        assert project.files((".stl", ".csv")) == ["data/pull-10mm.csv", "data/pull-7mm.csv", "finger.stl"]
        found = project.findings(replace(draft, fixed=None))
        assert len(found.faults) == 1
        assert found.faults[0].startswith("project.yaml:")
        found = project.findings(draft)
        assert not found.faults
        assert dict(found.rows)["plate tip"].startswith("on 34 nodes of finger")
        assert sorted(one.name for one in folder.iterdir()) == ["data", "finger.stl"]


@pytest.mark.parametrize(("place", "said"), [("file", "this is no folder"), ("file/inside", "cannot be written")])
def test_the_command_needs_a_folder(tmp_path: Path, place: str, said: str):
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(app, ["new", str(tmp_path / place), "--no-browser"])
    assert done.exit_code == 2
    assert said in done.stderr


def test_a_folder_that_is_not_there_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    served: list[Path] = []
    monkeypatch.setattr(new_page, "serve_new", lambda folder, **_: served.append(folder))
    done = CliRunner().invoke(app, ["new", str(tmp_path / "my" / "robot"), "--no-browser"])
    assert done.exit_code == 0, done.output
    assert served == [tmp_path / "my" / "robot"]
    assert served[0].is_dir()


def test_a_letter_is_no_table(tmp_path: Path):
    (tmp_path / "letter.txt").write_text(
        "Dear colleague, here are\nthe data of which we spoke, as\nyou wished, yours\n"
    )
    with pytest.raises(DatasetError):
        table_columns(tmp_path / "letter.txt")


def test_a_plane_is_itself(finger: Floats):
    foot, again, top = (plane_at(finger, np.array(at)) for at in ([0, 0.003, 0], [0, -0.003, 0], [0, 0, 0.084]))
    assert foot is not None
    assert again is not None
    assert top is not None
    assert same_plane(foot, again)
    assert not same_plane(foot, top)
    assert not same_plane(None, foot)
