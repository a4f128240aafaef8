"""The pinhole with Brown's distortion, its file, and what calibrating from a rendered board gives back."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run
from hypothesis import given
from hypothesis import strategies as st
from marker_bench import BOARD, SMALL, WEBCAM, board_poses, photograph_board, save

from softcal.errors import DatasetError, InputError, ProjectFileError, StorageError
from softcal.plugins.markers.camera import Camera, Image
from softcal.plugins.markers.camera_file import camera_text, read_camera
from softcal.plugins.markers.charuco import BoardView, Calibration, calibrate_camera, find_board
from softcal.plugins.markers.fiducials import CharucoBoard

directions = st.tuples(st.floats(-0.7, 0.7), st.floats(-0.4, 0.4)).map(lambda xy: np.array([xy]))


@given(directions)
def test_pixels_and_directions_undo_each_other(direction: np.ndarray):
    assert WEBCAM.directions(WEBCAM.pixels(direction)) == pytest.approx(direction, abs=1e-11)


def test_a_point_is_seen_where_opencv_sees_it():
    points = np.random.default_rng(1).uniform((-0.3, -0.2, 0.4), (0.3, 0.2, 1.5), (50, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), WEBCAM.matrix, WEBCAM.distortion)
    assert WEBCAM.project(points) == pytest.approx(expected[:, 0], abs=1e-9)


def test_the_slope_is_that_of_the_projection():
    point, step = np.array([[0.15, -0.1, 0.6]]), 1e-6
    _, slope = WEBCAM.project_with_slope(point)
    moved = [(WEBCAM.project(point + d) - WEBCAM.project(point - d))[0] / (2 * step) for d in step * np.eye(3)]
    assert slope[0] == pytest.approx(np.transpose(moved), rel=1e-6, abs=1e-4)


def test_a_camera_needs_positive_numbers():
    with pytest.raises(InputError, match="this is not a camera"):
        Camera(0, 1080, WEBCAM.matrix, WEBCAM.distortion)


# The camera file


def calibration(camera: Camera = WEBCAM) -> Calibration:
    return Calibration(camera, 0.1, {"a b.png": 0.1}, np.ones(2), np.ones(2), 0.9, ())


def test_a_camera_file_gives_its_camera_back(tmp_path: Path):
    path = tmp_path / "camera.yaml"
    path.write_text(camera_text(calibration(), str(BOARD), ["c.png"]), encoding="utf-8")
    camera = read_camera(path)
    assert (camera.width, camera.height) == (1920, 1080)
    assert camera.matrix == pytest.approx(WEBCAM.matrix, rel=1e-8)
    assert camera.distortion == pytest.approx(WEBCAM.distortion, rel=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("fx: 1400 px", "fx: 1400", r"camera.yaml:4: matrix.fx: the unit is missing"),
        ("fx: 1400 px", "fx: -1400 px", r"matrix.fx: the focal length is out of range"),
        ("fx: 1400 px, ", "", r"a key is missing; allowed: 'fx' must be given"),
        ("1920 px", "1920.5 px", r"resolution\[0\]: the resolution must be in whole pixels"),
        ("matrix:", "matirx:", r"unknown key; got 'matirx'.*Try: 'matrix'"),
        ("camera: 1", "camera: 7", r"the format is not known; got 7"),
    ],
)
def test_a_wrong_camera_file_is_told_by_line_and_key(tmp_path: Path, old: str, new: str, said: str):
    path = tmp_path / "camera.yaml"
    text = camera_text(calibration(), str(BOARD))
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProjectFileError, match=said):
        read_camera(path)


def test_a_camera_file_that_is_not_there(tmp_path: Path):
    with pytest.raises(StorageError, match="the camera file cannot be read"):
        read_camera(tmp_path / "camera.yaml")


# Calibrating


@pytest.fixture(scope="module")
def photographs() -> list[Image]:
    return [photograph_board(pose, seed=i) for i, pose in enumerate(board_poses(9))]


@pytest.fixture(scope="module")
def views(photographs: list[Image]) -> list[BoardView]:
    found = [find_board(image, BOARD, f"{i}.png") for i, image in enumerate(photographs)]
    return [view for view in found if view is not None]


@pytest.mark.slow
def test_the_camera_of_rendered_images_is_found_again(views: list[BoardView]):
    assert len(views) == 9
    found = calibrate_camera(views, SMALL.width, SMALL.height)
    off = found.camera.focal - SMALL.focal
    assert np.abs(off / SMALL.focal).max() < 2e-3
    assert np.abs(off / found.focal_sd).max() < 4
    assert np.abs(found.camera.centre - SMALL.centre).max() < 2.0
    assert 0.01 < found.rms < 0.12
    assert found.coverage > 0.9
    assert not found.warnings
    assert set(found.rms_by_image) == {f"{i}.png" for i in range(9)}


def test_little_tilt_and_coverage_are_warned_about():
    rng = np.random.default_rng(3)
    points = np.array(BOARD.opencv().getChessboardCorners(), dtype=float)
    views = []
    for i in range(5):
        middle = points - points.mean(axis=0) + rng.uniform(-0.004, 0.004, 3) + [0.05, 0.02, 0.6 + 0.01 * i]
        views.append(BoardView(f"{i}.png", points, SMALL.project(middle) + rng.normal(0, 0.1, (len(points), 2))))
    said = " ".join(calibrate_camera(views, SMALL.width, SMALL.height).warnings)
    assert "only 5 images" in said
    assert "the board covers only" in said
    assert "focal length is in doubt" in said


def test_too_few_views_are_refused(views: list[BoardView]):
    with pytest.raises(DatasetError, match=r"too few images show the board.*got 3; allowed: 4 or more"):
        calibrate_camera(views[:3], SMALL.width, SMALL.height)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"marker": 0.03}, "the marker does not fit"),
        ({"columns": 2}, "does not make a board"),
        ({"columns": 20, "rows": 20}, "too few markers"),
        ({"dictionary": "DICT_4X4_51"}, "no such dictionary.*Try: 'DICT_4X4_50'"),
    ],
)
def test_a_board_that_cannot_be(changes: dict[str, object], said: str):
    given: dict[str, object] = {"columns": 9, "rows": 6, "square": 0.028, "marker": 0.021, "dictionary": "DICT_4X4_50"}
    with pytest.raises(InputError, match=said):
        CharucoBoard(**{**given, **changes})  # type: ignore[arg-type]


# The command


@pytest.fixture
def folder(tmp_path: Path, photographs: list[Image]) -> Path:
    for i, image in enumerate(photographs[:5]):
        save(tmp_path / f"board_{i:02}.png", image)
    save(tmp_path / "wall.png", np.full_like(photographs[0], 128))
    return tmp_path


def test_camera_writes_a_file_and_names_what_it_skipped(capsys: pytest.CaptureFixture[str], folder: Path):
    out = folder / "camera.yaml"
    code, said, warned = run(capsys, "camera", folder, "--out", out)
    assert code == 0
    assert "board_03.png: 0.0" in said
    assert "Reprojection error: 0.0" in said
    assert "wall.png: the board was not found; skipped" in warned
    assert "only 5 images were used" in warned
    assert read_camera(out).focal == pytest.approx(SMALL.focal, rel=5e-3)

    before = out.read_text(encoding="utf-8")
    code, _, warned = run(capsys, "camera", folder, "--out", out)
    assert code == 2
    assert "the file exists, and nothing is overwritten" in warned
    assert out.read_text(encoding="utf-8") == before


def test_a_board_that_is_in_too_few_images(capsys: pytest.CaptureFixture[str], folder: Path):
    out = folder / "camera.yaml"
    code, _, said = run(capsys, "camera", folder, "--out", out, "--squares", "5x7", "--dictionary", "DICT_6X6_50")
    assert code == 2
    assert "the board was found in 0 of 6 images; got not in board_00.png" in said
    assert "5x7 squares of 28 mm" in said
    assert not out.exists()


def test_images_of_different_cameras(capsys: pytest.CaptureFixture[str], folder: Path):
    save(folder / "other.png", np.zeros((480, 640), dtype=np.uint8))
    code, _, said = run(capsys, "camera", folder, "--out", folder / "camera.yaml")
    assert code == 2
    assert (
        "other.png: the image has another resolution than the others; got 640 x 480 px; allowed: 960 x 540 px" in said
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere: there is no image"),
        (["text.png"], "text.png: the file holds no image that can be read"),
        (["wall.png", "--squares", "9"], "--squares: this is not a number of squares"),
        (["wall.png", "--square", "28"], "--square: the unit is missing"),
    ],
)
def test_what_is_wrong_is_said(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
):
    monkeypatch.chdir(folder)
    Path("text.png").write_text("no picture", encoding="utf-8")
    code, _, told = run(capsys, "camera", *arguments)
    assert code == 2
    assert said in told
