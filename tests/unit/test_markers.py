"""From rendered images to the table of markers: perspective, blur, noise, lens distortion, uneven light."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run
from marker_bench import (
    BOARD,
    DICTIONARY,
    ROUGH,
    WEBCAM,
    Bench,
    board_poses,
    looking,
    manipulator,
    marker_panel,
    photograph,
    photograph_board,
    save,
    viewpoints,
)

from examples.manipulator.render import Optics, Panel, render
from softcal.errors import DatasetError, InputError, ProjectFileError, StorageError
from softcal.geometry.pose import Pose
from softcal.plugins.markers.aruco import detect_markers
from softcal.plugins.markers.camera import Camera
from softcal.plugins.markers.camera_file import camera_text
from softcal.plugins.markers.charuco import Calibration, find_board
from softcal.plugins.markers.edges import refine_corners
from softcal.plugins.markers.fiducials import find_dictionary, marker_texture
from softcal.plugins.markers.pattern_sheet import board_sheet, marker_sheet
from softcal.plugins.markers.shots import find_shots
from softcal.plugins.markers.workflow import make_camera_file, measure_markers
from softcal.project.base_file import read_base

NAMES = "0=base,1=S1,2=S2,3=S3,4=S4"


def table(path: Path) -> dict[str, dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return {row["group"]: row for row in csv.DictReader(stream)}


def position(row: dict[str, str], name: str, suffix: str = "") -> np.ndarray:
    return np.array([float(row[f"{name}.{axis}{suffix} [m]"]) for axis in "xyz"])


# Corners


def true_corners(bench: Bench, viewpoint: Pose, number: int) -> np.ndarray:
    half = bench.sizes[number] / 2
    corners = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    pose = viewpoint.after(bench.poses[number])
    pixels, _ = cv2.projectPoints(corners, pose.rotation_vector, pose.position, WEBCAM.matrix, WEBCAM.distortion)
    return pixels[:, 0]


def test_corners_are_sharper_than_opencv_finds_them():
    bench, view = manipulator(), viewpoints(1)[0]
    image = photograph(bench, view)
    found = detect_markers(image, DICTIONARY, WEBCAM)
    assert sorted(found.corners) == [0, 1, 2, 3, 4]
    assert not found.unclear
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    squares, ids, _ = cv2.aruco.ArucoDetector(find_dictionary(DICTIONARY), settings).detectMarkers(image)
    ours = [found.corners[n] - true_corners(bench, view, n) for n in range(5)]
    theirs = [s[0] - true_corners(bench, view, int(n)) for s, n in zip(squares, ids.ravel(), strict=True)]
    assert np.sqrt(np.mean(np.square(ours))) < 0.03
    assert np.sqrt(np.mean(np.square(theirs))) > 0.1


@pytest.mark.parametrize(
    "optics", [Optics(blur=2.0, noise=2.0), Optics(blur=0.6, noise=6.0), Optics(white=120.0, light=(0.4, 0.3))]
)
def test_corners_in_bad_light_and_out_of_focus(optics: Optics):
    bench, view = manipulator(), viewpoints(1)[0]
    image = photograph(bench, view, optics=optics)
    rough = np.random.default_rng(0)
    errors = []
    for number in range(5):
        true = true_corners(bench, view, number)
        corners = refine_corners(image, true + rough.uniform(-0.7, 0.7, (4, 2)), 6, WEBCAM)
        if corners is not None:
            errors.append(corners - true)
    assert len(errors) >= 4
    assert np.sqrt(np.mean(np.square(errors))) < 0.1


def test_edges_that_the_lens_bends():
    lens = Camera(1920, 1080, WEBCAM.matrix, np.array([-0.35, 0.12, 0.002, -0.001, 0.0]))
    bench = Bench({0: Pose.of((0.2, -0.3, 0.1), (0.11, -0.19, 0.0))}, {0: 0.06})
    view = viewpoints(1)[0]
    half = 0.03 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    true = lens.project(view.after(bench.poses[0]).apply(half))
    image = photograph(bench, view, camera=lens)
    found = refine_corners(image, true, 6, lens)
    straight = refine_corners(image, true, 6, Camera(1920, 1080, WEBCAM.matrix, np.zeros(5)))
    assert found is not None
    assert np.abs(found - true).max() < 0.05
    assert straight is None or np.abs(straight - true).max() > 0.2


@pytest.mark.parametrize("shade", [30, 110, 210])
@pytest.mark.parametrize("width", [3, 14])
def test_an_edge_that_is_hidden_is_not_guessed(width: int, shade: int):
    bench, view = manipulator(), viewpoints(1)[0]
    clear = photograph(bench, view)
    for number, (start, end) in ((1, (0.0, 0.5)), (2, (0.3, 0.7)), (4, (0.1, 0.8))):
        image, corners = clear.copy(), true_corners(bench, view, number)
        a, b, inward = corners[0], corners[1], (corners[3] - corners[0]) / np.linalg.norm(corners[3] - corners[0])
        first, last = a + start * (b - a), a + end * (b - a)
        hand = [first - width * inward, last - width * inward, last + width * inward, first + width * inward]
        cv2.fillPoly(image, [np.rint(hand).astype(np.int32)], shade)
        assert refine_corners(clear, corners, 6, WEBCAM) is not None
        found = refine_corners(image, corners, 6, WEBCAM)
        assert found is None or np.abs(found - corners).max() < 0.15


# The accuracy that is asked for


@pytest.mark.parametrize(("n_views", "limit"), [(1, 0.8e-3), (3, 0.3e-3)])
def test_markers_are_placed_to_a_third_of_a_millimetre(tmp_path: Path, n_views: int, limit: float):
    bench = manipulator(1)
    for i, view in enumerate(viewpoints(n_views)):
        save(tmp_path / f"rest_{i}.png", photograph(bench, view, seed=i))
    run = measure(tmp_path)
    errors = [
        np.linalg.norm(run.table.cells["rest", f"m{n}"].pose.position - bench.in_base(n).position) for n in range(1, 5)
    ]
    assert np.mean(errors) < 0.3e-3
    assert max(errors) < limit
    turns = [run.table.cells["rest", f"m{n}"].pose.angle_to(bench.in_base(n)) for n in range(1, 5)]
    assert max(turns) < np.radians(1.0)


def write_camera(folder: Path) -> Path:
    path = folder / "camera.yaml"
    if not path.exists():
        known = Calibration(WEBCAM, 0.05, {}, np.ones(2), np.ones(2), 1.0, ())
        path.write_text(camera_text(known, str(BOARD)), encoding="utf-8")
    return path


def measure(folder: Path, **options: str):
    given = {"camera": write_camera(folder), "dictionary": DICTIONARY, "size": "20 mm", "base": "0", **options}
    return measure_markers([folder], out=folder / "markers.csv", **given)


@pytest.mark.long
def test_from_calibration_images_to_positions(tmp_path: Path):
    """The whole way, with a camera that was calibrated and not given: states pulled further and further."""
    for i, pose in enumerate(board_poses(14)):
        save(
            tmp_path / "board" / f"{i:02}.png",
            photograph_board(pose, camera=WEBCAM, optics=replace(ROUGH, rays=21), seed=i),
        )
    calibration = make_camera_file([tmp_path / "board"], BOARD, tmp_path / "camera.yaml").calibration
    assert calibration.camera.focal == pytest.approx(WEBCAM.focal, rel=5e-4)
    errors: list[float] = []
    scores: list[np.ndarray] = []
    benches = {f"cable{i}": manipulator(seed=i) for i in range(4)}
    for seed, (group, bench) in enumerate(benches.items()):
        for i, view in enumerate(viewpoints(3)):
            save(tmp_path / "run" / f"{group}_{i}.png", photograph(bench, view, seed=10 * seed + i))
    run = measure_markers(
        [tmp_path / "run"],
        camera=tmp_path / "camera.yaml",
        dictionary=DICTIONARY,
        size="20mm",
        base="0",
        out=tmp_path / "markers.csv",
    )
    for (group, name), one in run.table.cells.items():
        off = one.pose.position - benches[group].in_base(int(name[1:])).position
        errors.append(float(np.linalg.norm(off)))
        scores.append(off / np.sqrt(np.diag(one.covariance)[3:]))
    assert len(errors) == 16
    assert np.mean(errors) < 0.15e-3
    assert max(errors) < 0.3e-3
    assert np.sqrt(np.mean(np.square(scores))) < 3.0


# The command


@pytest.fixture(scope="module")
def photographs() -> dict[str, np.ndarray]:
    rest, pulled = manipulator(0), manipulator(1)
    hidden = replace(pulled, poses={k: p for k, p in pulled.poses.items() if k != 3})
    views = viewpoints(3)
    return {
        "rest_01.png": photograph(rest, views[0], seed=1),
        "rest_02.png": photograph(rest, views[2], seed=2),
        "cable6_2kgf_01.png": photograph(hidden, views[0], seed=3),
    }


@pytest.fixture
def folder(tmp_path: Path, photographs: dict[str, np.ndarray]) -> Path:
    write_camera(tmp_path)
    for name, image in photographs.items():
        save(tmp_path / "run" / name, image)
    return tmp_path


def arguments(folder: Path, *more: object, images: Sequence[object] = ()) -> list[object]:
    given = ["--camera", folder / "camera.yaml", "--size", "20mm", "--base", "0", "--out", folder / "markers.csv"]
    return ["markers", *(images or [folder / "run"]), *given, *more]


def test_markers_writes_a_table_and_names_what_is_missing(capsys: pytest.CaptureFixture[str], folder: Path):
    code, said, warned = run(capsys, *arguments(folder, "--names", NAMES))
    assert code == 0, warned
    assert "rest: 2 images, S1, S2, S3, S4, sd up to 0." in said
    assert warned.splitlines() == ["Warning: cable6_2kgf: S3 (marker 3) is missing."]
    rows = table(folder / "markers.csv")
    assert list(rows) == ["cable6_2kgf", "rest"]
    bench = manipulator(0)
    for i in range(1, 5):
        off = position(rows["rest"], f"S{i}") - bench.in_base(i).position
        assert np.linalg.norm(off) < 0.3e-3
        assert np.abs(off / position(rows["rest"], f"S{i}", "_sd")).max() < 5
        turn = np.array([float(rows["rest"][f"S{i}.r{axis} [rad]"]) for axis in "xyz"])
        assert Pose.of(turn).angle_to(bench.in_base(i)) < np.radians(1.0)
        assert rows["rest"][f"S{i}.images [1]"] == "2"
    assert rows["cable6_2kgf"]["S3.x [m]"] == ""
    assert rows["cable6_2kgf"]["notes"] == "S3 (marker 3) is missing"
    assert "base.x [m]" not in rows["rest"]

    before = (folder / "markers.csv").read_bytes()
    code, _, warned = run(capsys, *arguments(folder))
    assert code == 2
    assert "the file exists, and nothing is overwritten" in warned
    assert (folder / "markers.csv").read_bytes() == before


def test_a_base_file_and_other_sizes(folder: Path):
    layout = folder / "base.yaml"
    layout.write_text("base: 1\nmarkers:\n  0: {at: [10 mm, 0 mm, 5 mm], rotation_vector: [0 deg, 0 deg, 90 deg]}\n")
    options = {"camera": folder / "camera.yaml", "dictionary": DICTIONARY, "base": str(layout)}
    for name, text in (("a", "20 mm"), ("b", "40 mm")):
        sizes = "0=20mm,1=20mm,2=20mm,3=20mm,4=20mm" if name == "b" else ""
        out = folder / f"{name}.csv"
        measure_markers([folder / "run" / "rest_0*.png"], size=text, sizes=sizes, out=out, **options)
    assert (folder / "a.csv").read_text() == (folder / "b.csv").read_text()
    expected = Pose.of((0, 0, np.pi / 2), (0.01, 0.0, 0.005)).apply(manipulator(0).in_base(2).position[None])[0]
    assert position(table(folder / "a.csv")["rest"], "m2") == pytest.approx(expected, abs=0.3e-3)


def test_all_that_is_wrong_with_the_images_is_told_at_once(capsys: pytest.CaptureFixture[str], folder: Path):
    bench, view = manipulator(), viewpoints(1)[0]
    again = marker_panel(2, 0.02, Pose.of((0.0, 0.0, 0.0), (0.09, 0.05, 0.0)))
    save(folder / "run" / "twice.png", render(WEBCAM, view, [*bench.panels(), again], ROUGH))
    save(folder / "run" / "wall.png", np.full((1080, 1920), 120, dtype=np.uint8))
    save(folder / "run" / "small.png", np.full((480, 640), 120, dtype=np.uint8))
    (folder / "run" / "torn.png").write_bytes(b"\x89PNG\r\n")
    code, _, said = run(capsys, *arguments(folder))
    assert code == 2
    assert said.startswith("Error: 4 faults:")
    assert re.search(r"twice.png: marker 2 is in the image 2 times; got centres at \(\d+, \d+\) px, ", said)
    assert "wall.png: there is no marker of DICT_4X4_50 in the image" in said
    assert (
        "small.png: the image has another resolution than the camera file; got 640 x 480 px; allowed: 1920 x 1080"
        in said
    )
    assert "torn.png: the file holds no image that can be read; got 6 bytes" in said
    assert not (folder / "markers.csv").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--dictionary", "DICT_4X4"], "there is no such dictionary of markers; got 'DICT_4X4'"),
        (["--size", "20"], "--size: the unit is missing"),
        (["--size", "-1mm"], "--size: the size is out of range; got -1mm; allowed: above 0"),
        (["--base", "7"], "--base: the base is in none of the images"),
        (["--base", "0,0"], "marker 0 is named twice"),
        (["--base", "first"], "--base: this is not a base; got 'first'"),
        (["--base", "60"], "DICT_4X4_50 has no marker 60; allowed: 0 to 49"),
        (["--names", "1=S1,1=S2"], "marker 1 is named twice"),
        (["--names", "S1"], "--names: this is not a marker assignment; got 'S1'; allowed: 1=S1,2=S2"),
        (["--names", "1=S 1"], "the name is no valid column header"),
        (["--names", "9=S9"], "--names: none of the named markers is in the images; got S9 (marker 9)"),
        (["--sizes", "1=3kg"], "--sizes, marker 1: the unit does not fit"),
        (["--group-by", "moon"], "unknown grouping of the images; got 'moon'"),
        (["--viewpoints", "two"], "unknown choice of viewpoints"),
        (["--camera", "nowhere.yaml"], "nowhere.yaml: the camera file cannot be read"),
    ],
)
def test_what_is_wrong_is_said(capsys: pytest.CaptureFixture[str], folder: Path, more: list[str], said: str):
    images = [folder / "run" / "cable6_2kgf_01.png"]
    code, _, told = run(capsys, *arguments(folder, *more, images=images))
    assert code == 2
    assert said in told
    assert "Traceback" not in told
    assert not (folder / "markers.csv").exists()


# Files


def touch(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def test_images_are_grouped_by_name_folder_or_not(tmp_path: Path):
    touch(tmp_path, "a/cable6_2kgf_01.png", "a/cable6_2kgf_02.JPG", "a/rest.png", "a/notes.txt", "b/rest-3.png")
    by_name = [(shot.group, shot.number) for shot in find_shots([tmp_path])]
    assert by_name == [("cable6_2kgf", "01"), ("cable6_2kgf", "02"), ("rest", ""), ("rest", "3")]
    assert [shot.group for shot in find_shots([tmp_path], "folder")] == ["a", "a", "a", "b"]
    alone = [shot.group for shot in find_shots([tmp_path / "a/cable*", tmp_path / "a/rest.png"], "image")]
    assert alone == ["cable6_2kgf_01", "cable6_2kgf_02", "rest"]


def test_images_that_cannot_be_told_apart(tmp_path: Path):
    touch(tmp_path, "a/rest_1.png", "b/rest_1.png")
    with pytest.raises(DatasetError, match=r"two images have the same name and number in the state 'rest'"):
        find_shots([tmp_path / "a", tmp_path / "b"])
    with pytest.raises(StorageError, match=r"nothing\*: there is no image"):
        find_shots([tmp_path / "nothing*", tmp_path / "a"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("base: 1\nmarkers: {}\n", "there are no markers"),
        ("base: 1\nmarkers:\n  a: {at: [0 mm, 0 mm, 0 mm]}\n", r"base.yaml:3: markers.a: not the number of a marker"),
        ("base: 1\nmarkers:\n  0: {at: [0 mm, 0 mm]}\n", "the list is too short"),
        ("base: 1\nmarkers:\n  0: {at: [0 mm, 0 mm, 0]}\n  1: {size: -3 mm}\n", "a key is missing"),
        ("markers:\n  0: {at: [0 mm, 0 mm, 0 mm]}\nsides: 3\n", "unknown key; got 'sides'"),
    ],
)
def test_a_wrong_base_file(tmp_path: Path, text: str, said: str):
    path = tmp_path / "base.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ProjectFileError, match=said):
        read_base(str(path))


# Sheets to print


def drawn(svg: str, per_mm: float) -> np.ndarray:
    """The black paths of a sheet as an image."""
    width, height = (float(n) for n in re.search(r'viewBox="0 0 (\S+) (\S+)"', svg).groups())
    image = np.full((round(height * per_mm), round(width * per_mm)), 255, dtype=np.uint8)
    for x, y, w, h in re.findall(r"M(\S+) (\S+)h([\d.]+)v([\d.]+)h-", svg):
        left, top, across, down = (float(n) * per_mm for n in (x, y, w, h))
        image[round(top) : round(top + down), round(left) : round(left + across)] = 0
    return image


def test_printed_markers_are_found_at_their_size():
    svg = marker_sheet(DICTIONARY, [0, 7, 12, 13, 14, 15, 16], 0.03)
    assert 'width="210mm"' in svg
    squares, ids, _ = cv2.aruco.ArucoDetector(find_dictionary(DICTIONARY)).detectMarkers(drawn(svg, 10))
    assert sorted(ids.ravel()) == [0, 7, 12, 13, 14, 15, 16]
    for square in squares:
        assert np.linalg.norm(square[0][1] - square[0][0]) == pytest.approx(300, abs=2)
    with pytest.raises(InputError, match="cannot be laid out; got 200 mm"):
        marker_sheet(DICTIONARY, [0], 0.2)


def test_a_printed_board_is_found_at_its_size(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    view = find_board(drawn(board_sheet(BOARD), 5), BOARD, "sheet")
    assert view is not None
    assert len(view.points) == 40
    scale = (view.pixels.max(axis=0) - view.pixels.min(axis=0)) / np.ptp(view.points[:, :2], axis=0)
    assert scale == pytest.approx([5000, 5000], rel=1e-3)
    out = tmp_path / "board.svg"
    code, said, _ = run(capsys, "board", "--out", out)
    assert (code, out.read_text(encoding="utf-8")) == (0, board_sheet(BOARD))
    assert "Print it at 100 %" in said
    code, _, said = run(capsys, "board", "--ids", "0-x", "--out", tmp_path / "markers.svg")
    assert code == 2
    assert "--ids: these are not markers" in said


# Rendering


def test_a_near_panel_hides_a_far_one_and_a_back_is_not_seen():
    view, optics = looking((0, 0, 0.5), (0, 0, 0)), Optics(blur=0.0, noise=0.0, black=0.0, white=200.0, background=0.5)
    grey = np.array([[0.25]])
    near = Panel(grey, 0.02, 0.02, Pose.of((0, 0, 0), (0, 0, 0.1)))
    far = Panel(np.array([[1.0]]), 0.1, 0.1, Pose.of())
    behind = Panel(np.array([[0.0]]), 0.02, 0.02, Pose.of((np.pi, 0, 0), (0, 0, 0.2)))
    hole = Panel(np.array([[np.nan]]), 0.02, 0.02, Pose.of((0, 0, 0), (0, 0, 0.3)))
    for order in ([near, far, behind, hole], [hole, behind, far, near]):
        image = render(WEBCAM, view, order, optics)
        middle = (round(WEBCAM.centre[1]), round(WEBCAM.centre[0]))
        assert image[middle] == 50
        assert image[middle[0], middle[1] + 60] == 200
        assert image[5, 5] == 100


def test_a_marker_has_a_border_of_its_own():
    texture = marker_texture(DICTIONARY, 3)
    assert texture.shape == (8, 8)
    assert np.all(texture[0] == 1)
    assert np.all(texture[1, 1:-1] == 0)
    with pytest.raises(InputError, match="DICT_4X4_50 has no such marker; got 50"):
        marker_texture(DICTIONARY, 50)
