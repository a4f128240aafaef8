"""Camera files, base files, images and motion capture that are wrong: refused in a sentence, with file and key."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from test_motion_capture import MARKERS, positions, written

from softcal.cli import main
from softcal.errors import DatasetError, InputError, StorageError
from softcal.experiments.motion_capture import read_c3d
from softcal.plugins.markers.camera_file import read_camera
from softcal.plugins.markers.shots import read_image
from softcal.project.base_file import read_base

CAMERA = """\
camera: 1
resolution: [640 px, 480 px]
matrix: {fx: 600 px, fy: 601 px, cx: 321 px, cy: 239 px}
distortion: {k1: 0.1, k2: -0.05, p1: 0.001, p2: 0, k3: 0}
reprojection_error: 0.2 px
"""
BASE = """\
base: 1
markers:
  0: {at: [0 mm, 0 mm, 0 mm], size: 30 mm}
  5: {at: [60 mm, 0 mm, 0 mm], rotation_vector: [0 deg, 0 deg, 90 deg]}
"""

CAMERAS: dict[str, tuple[str, str, str]] = {
    "a length in the place of pixels": ("fx: 600 px", "fx: 5 mm", "matrix.fx"),
    "a resolution in millimetres": ("640 px", "640 mm", r"resolution\[0\]"),
    "a number without unit": ("fx: 600 px", "fx: 600", "matrix.fx"),
    "a focal length of zero": ("fx: 600 px", "fx: 0 px", "matrix.fx"),
    "a focal length below zero": ("fy: 601 px", "fy: -601 px", "matrix.fy"),
    "a focal length that is none": ("fx: 600 px", "fx: .nan px", "matrix.fx"),
    "an infinite focal length": ("fx: 600 px", "fx: .inf", "matrix.fx"),
    "a focal length beyond all": ("fx: 600 px", "fx: 1e30 px", "matrix.fx"),
    "a resolution of zero": ("640 px", "0 px", r"resolution\[0\]"),
    "a resolution below zero": ("480 px", "-480 px", r"resolution\[1\]"),
    "a resolution beyond all": ("640 px", "1e12 px", r"resolution\[0\]"),
    "half a pixel": ("640 px", "640.5 px", "whole pixels"),
    "a resolution of one number": ("[640 px, 480 px]", "[640 px]", "resolution"),
    "a resolution that is none": ("[640 px, 480 px]", "640 px", "resolution"),
    "a principal point far off": ("cx: 321 px", "cx: 32100 px", "matrix.cx"),
    "a principal point that is none": ("cy: 239 px", "cy: soft", "matrix.cy"),
    "a distortion beyond all": ("k1: 0.1", "k1: 1e30", "distortion"),
    "a distortion that folds": ("k1: 0.1", "k1: -3", "distortion: the distortion is not invertible"),
    "a distortion that folds far out": ("k3: 0}", "k3: -400}", "distortion: the distortion is not invertible"),
    "a tangential distortion that folds": ("p1: 0.001", "p1: 4", "distortion"),
    "a distortion that is none": ("k2: -0.05", "k2: .nan", "distortion.k2"),
    "a distortion with a unit": ("k1: 0.1", "k1: 0.1 px", "distortion.k1"),
    "an unknown coefficient": ("k3: 0}", "k4: 0}", "distortion.k4: unknown key"),
    "a reprojection error below zero": ("0.2 px", "-0.2 px", "reprojection_error"),
    "a reprojection error that is none": ("0.2 px", ".nan", "reprojection_error"),
    "a reprojection error in millimetres": ("0.2 px", "0.2 mm", "reprojection_error"),
    "a format of the future": ("camera: 1", "camera: 2", "the format is not known"),
    "a format of text": ("camera: 1", "camera: one", "camera"),
    "no format": ("camera: 1\n", "", "camera"),
    "no matrix": ("matrix: {fx: 600 px, fy: 601 px, cx: 321 px, cy: 239 px}\n", "", "matrix"),
    "a matrix of numbers": ("{fx: 600 px, fy: 601 px, cx: 321 px, cy: 239 px}", "[600, 0, 321]", "matrix"),
    "an unknown key": ("camera: 1", "camera: 1\nlens: 8 mm", "lens: unknown key"),
    "not YAML": ("camera: 1", "camera: {", "not YAML"),
}


def test_the_files_that_are_changed_below_are_right(tmp_path: Path) -> None:
    camera, base = tmp_path / "camera.yaml", tmp_path / "base.yaml"
    camera.write_text(CAMERA)
    base.write_text(BASE)
    assert read_camera(camera).is_reversible
    assert sorted(read_base(str(base)).placed) == [0, 5]


@pytest.mark.parametrize("case", CAMERAS)
def test_a_camera_that_cannot_be_is_refused(case: str, tmp_path: Path) -> None:
    old, new, message = CAMERAS[case]
    assert old in CAMERA
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        read_camera(path)
    assert "camera.yaml" in str(caught.value)


@pytest.mark.parametrize("k1", [-0.45, -0.2, 0.0, 0.3, 1.0])
def test_a_camera_that_can_be_is_not(k1: float, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA.replace("k1: 0.1", f"k1: {k1}"))
    camera = read_camera(path)
    inside = np.array([[160.0, 120.0], [480.0, 360.0]])
    np.testing.assert_allclose(camera.pixels(camera.directions(inside)), inside, atol=1e-6)


BASES: dict[str, tuple[str, str, str]] = {
    "a place in pixels": ("[60 mm, 0 mm, 0 mm]", "[60 px, 0 mm, 0 mm]", r"markers.5.at\[0\]"),
    "a place without unit": ("[60 mm, 0 mm, 0 mm]", "[60, 0 mm, 0 mm]", r"markers.5.at\[0\]"),
    "a place of two numbers": ("[60 mm, 0 mm, 0 mm]", "[60 mm, 0 mm]", "markers.5.at"),
    "a place that is none": ("[60 mm, 0 mm, 0 mm]", "[.nan mm, 0 mm, 0 mm]", r"markers.5.at\[0\]"),
    "a place beyond all": ("[60 mm, 0 mm, 0 mm]", "[1e30 m, 0 mm, 0 mm]", r"markers.5.at\[0\]"),
    "a turn in millimetres": ("90 deg", "90 mm", r"markers.5.rotation_vector\[2\]"),
    "a turn without unit": ("90 deg", "90", r"markers.5.rotation_vector\[2\]"),
    "a turn in per cent": ("90 deg", "270 %", r"markers.5.rotation_vector\[2\]"),
    "a size of zero": ("size: 30 mm", "size: 0 mm", "markers.0.size"),
    "a size below zero": ("size: 30 mm", "size: -30 mm", "markers.0.size"),
    "a size in newtons": ("size: 30 mm", "size: 30 N", "markers.0.size"),
    "a marker by name": ("  5:", "  tip:", "not the number of a marker"),
    "a marker below zero": ("  5:", "  -5:", "not the number of a marker"),
    "an unknown key": ("size: 30 mm", "scale: 30 mm", "markers.0.scale: unknown key"),
    "a marker that is a number": ("{at: [0 mm, 0 mm, 0 mm], size: 30 mm}", "7", "markers.0"),
    "no markers": (BASE.partition("\n")[2], "", "there are no markers"),
    "a format of the future": ("base: 1", "base: 2", "the format is not known"),
    "not YAML": ("base: 1", "base: [", "not YAML"),
}


@pytest.mark.parametrize("case", BASES)
def test_a_base_that_cannot_be_is_refused(case: str, tmp_path: Path) -> None:
    old, new, message = BASES[case]
    assert old in BASE
    path = tmp_path / "base.yaml"
    path.write_text(BASE.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        read_base(str(path))
    assert "base.yaml" in str(caught.value)


def encoded(suffix: str, shape: tuple[int, int] = (40, 60)) -> bytes:
    image = np.random.default_rng(3).integers(0, 255, shape).astype(np.uint8)
    return cv2.imencode(suffix, image)[1].tobytes()


def huge_bitmap() -> bytes:
    raw = bytearray(encoded(".bmp"))
    raw[18:26] = (2**31 - 1).to_bytes(4, "little") * 2
    return bytes(raw)


def huge_png() -> bytes:
    """A header of 60,000 x 60,000 pixels before the data of a small image."""
    import struct
    import zlib

    raw = bytearray(encoded(".png"))
    raw[16:24] = struct.pack(">II", 60_000, 60_000)
    raw[29:33] = struct.pack(">I", zlib.crc32(raw[12:29]))
    return bytes(raw)


def noisy_jpeg() -> bytes:
    ok, raw = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (64, 96), dtype=np.uint8))
    assert ok
    return bytes(raw)


IMAGES: dict[str, tuple[str, bytes]] = {
    "nothing": (".png", b""),
    "text": (".png", b"no picture"),
    "half a PNG": (".png", encoded(".png")[:900]),
    "a PNG with a changed byte": (".png", encoded(".png")[:900] + b"\0" + encoded(".png")[901:]),
    "half a JPEG": (".jpg", encoded(".jpg")[:900]),
    "a JPEG without its end": (".jpg", encoded(".jpg")[:-2]),
    "half a JPEG with an end": (".jpg", noisy_jpeg()[:2500] + b"\xff\xd9"),
    "a JPEG with zeros": (".jpg", noisy_jpeg()[:2500] + bytes(200) + noisy_jpeg()[2700:]),
    "half a WebP": (".webp", encoded(".webp")[:200]),
    "a bitmap of 4e18 pixels": (".bmp", huge_bitmap()),
    "a PNG of 3.6e9 pixels": (".png", huge_png()),
    "a PGM of no size": (".pgm", b"P5\n-4 0\n255\n"),
}


@pytest.mark.parametrize("case", IMAGES)
def test_an_image_that_is_damaged_is_refused(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    suffix, raw = IMAGES[case]
    path = tmp_path / f"image{suffix}"
    path.write_bytes(raw)
    with pytest.raises(StorageError, match=r"no image that can be read|the image is cut off"):
        read_image(path)
    assert not capfd.readouterr().err


def test_an_image_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "image.png")
    with pytest.raises(StorageError, match="the image cannot be read; got a pipe"):
        read_image(tmp_path / "image.png")


def test_an_image_is_read_without_an_error_output(tmp_path: Path) -> None:
    (tmp_path / "image.png").write_bytes(encoded(".png"))
    code = (
        "import os, sys; from pathlib import Path; from softcal.plugins.markers.shots import read_image; os.close(2); "
    )
    code += "print(read_image(Path(sys.argv[1])).ndim)"
    run = [sys.executable, "-c", code, str(tmp_path / "image.png")]
    assert subprocess.run(run, capture_output=True, text=True, check=False).stdout == "2\n"


def test_a_jpeg_with_padding_before_its_end_is_read(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "image.jpg").write_bytes(noisy_jpeg()[:-2] + bytes(40) + b"\xff\xd9")
    assert read_image(tmp_path / "image.jpg").shape == (64, 96)
    assert not capfd.readouterr().err


def test_images_that_are_damaged_end_the_command_with_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.jpg").write_bytes(encoded(".jpg")[:900])
    with pytest.raises(SystemExit) as left:
        main(["camera", str(tmp_path), "--out", str(tmp_path / "camera.yaml")])
    assert left.value.code == 2
    assert "a.jpg: the image is cut off" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:No analog data found")
def test_motion_capture_that_is_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    whole = written(tmp_path).read_bytes()
    path = tmp_path / "cut.c3d"
    for length in range(0, len(whole) - 512, 97):
        path.write_bytes(whole[:length])
        with pytest.raises(DatasetError, match=r"cut\.c3d"):
            read_c3d(path, MARKERS)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:No analog data found")
def test_motion_capture_with_changed_bytes_is_read_or_refused(tmp_path: Path) -> None:
    """Every byte of the header and of the parameters in turn, as 0 and as 255."""
    whole = written(tmp_path).read_bytes()
    path = tmp_path / "changed.c3d"
    refused = 0
    for place in range(0, 1536, 3):
        for byte in (0, 255):
            path.write_bytes(whole[:place] + bytes([byte]) + whole[place + 1 :])
            try:
                found = read_c3d(path, MARKERS)
            except InputError as error:
                refused += "changed.c3d" in str(error)
                continue
            assert all(
                np.abs(channel.values[~np.isnan(channel.values)]).max() < 1e9 for channel in found.channels.values()
            )
    assert refused > 20


@pytest.mark.filterwarnings("ignore:No analog data found")
def test_a_marker_beyond_all_reach_is_refused(tmp_path: Path) -> None:
    xyz = positions()
    xyz[7, 1, 2] = 1e20
    with pytest.raises(DatasetError, match=r"a marker is out of reach; got 1e\+17 m; allowed: at most 1000 m"):
        read_c3d(written(tmp_path, xyz), MARKERS)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_an_image_of_a_camera_of_more_bits_keeps_its_shades(bits: int, tmp_path: Path) -> None:
    shades = np.tile(np.linspace(0, 2**bits - 1, 256).round().astype(np.uint16), (8, 1))
    cv2.imwrite(str(tmp_path / "a.png"), shades)
    np.testing.assert_allclose(read_image(tmp_path / "a.png")[0], np.arange(256), atol=1)


def test_an_image_of_several_is_refused(tmp_path: Path) -> None:
    pages = [Image.new("L", (40, 30), shade) for shade in (255, 0)]
    for name in ("a.tif", "a.png", "a.webp"):
        pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:])
        with pytest.raises(StorageError, match="the file holds several images; got 2; allowed: one image a file"):
            read_image(tmp_path / name)


@pytest.mark.parametrize("orientation", [3, 6])
def test_a_tiff_that_is_to_be_shown_turned_is_refused(orientation: int, tmp_path: Path) -> None:
    """Of the other formats, the pixels are read as the sensor has them."""
    image = Image.fromarray(np.arange(48 * 64, dtype=np.uint8).reshape(48, 64))
    image.save(tmp_path / "a.tif", tiffinfo={274: orientation})
    with pytest.raises(StorageError, match=r"a\.tif: the image states that it is turned\. Try: save it without"):
        read_image(tmp_path / "a.tif")
    turned = Image.Exif()
    turned[274] = orientation
    image.save(tmp_path / "a.png", exif=turned)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), np.asarray(image))
