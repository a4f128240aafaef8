"""Camera calibration from images of a ChArUco board, with its quality.

References
----------
Zhang, A flexible new technique for camera calibration, IEEE Transactions on Pattern Analysis and Machine Intelligence
22 (2000).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.geometry.pose import Pose
from softcal.plugins.markers.camera import Camera, Image
from softcal.plugins.markers.fiducials import CharucoBoard

FEWEST_IMAGES = 4
_ENOUGH_IMAGES = 8
_FEWEST_CORNERS = 8
_CELLS = (6, 4)  # cells of the image for the coverage by the board
_ENOUGH_COVERAGE = 0.7
_LARGEST_FOCAL_SD = 2e-3  # relative
_LARGEST_RMS = 1.0  # [px]
_SMALLEST_TILT = np.radians(15.0)  # of the most tilted view
_FIELD = (np.radians(10.0), np.radians(130.0))  # horizontal fields of view of cameras without fisheye


@dataclass(frozen=True)
class BoardView:
    """The board in an image: its inner corners on the board (n, 3) [m] and in the image (n, 2) [px]."""

    image: str
    points: Floats
    pixels: Floats


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera, and the quality of the calibration.

    Attributes
    ----------
    camera
        The camera.
    rms, rms_by_image
        RMS reprojection error of the corners, over all images and in each [px].
    focal_sd, centre_sd
        Standard deviations of focal lengths and principal point (2,) [px].
    coverage
        Share of the image in which corners of the board were observed.
    warnings
        Sentences on weaknesses of the calibration.
    """

    camera: Camera
    rms: float
    rms_by_image: Mapping[str, float]
    focal_sd: Floats
    centre_sd: Floats
    coverage: float
    warnings: tuple[str, ...]


def find_board(image: Image, board: CharucoBoard, name: str) -> BoardView | None:
    """The board in a grey image; None if it is not found, or too few of its corners.

    Parameters
    ----------
    image
        Grey image (height, width).
    board
        The board to look for.
    name
        Name of the image.
    """
    import cv2

    pattern = board.opencv()
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.CharucoDetector(pattern, cv2.aruco.CharucoParameters(), settings)
    corners, ids, _, _ = detector.detectBoard(image)
    # OpenCV returns None if it finds nothing, contrary to its annotations.
    if corners is None or ids is None or len(ids) < _FEWEST_CORNERS:  # pyright: ignore[reportUnnecessaryComparison]
        return None
    points = np.asarray(pattern.getChessboardCorners(), dtype=np.float64)[np.ravel(ids).astype(np.int64)]
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-9:
        return None  # all in one row
    return BoardView(name, points, np.asarray(corners, dtype=np.float64).reshape(-1, 2))


def calibrate_camera(views: Sequence[BoardView], width: int, height: int) -> Calibration:
    """The camera with the least reprojection error over all views of the board.

    Parameters
    ----------
    views
        The board's corners in each image.
    width, height
        Of the images [px].

    Raises
    ------
    DatasetError
        If there are too few views, or no camera fits them.
    """
    import cv2

    if len(views) < FEWEST_IMAGES:
        raise DatasetError(
            Fault(
                "too few images show the board to calibrate a camera",
                got=f"{len(views)}",
                allowed=f"{FEWEST_IMAGES} or more, better {2 * _ENOUGH_IMAGES}, with the board tilted",
                attempt="check the board's squares, sizes and dictionary against what was printed (and --legacy)",
            )
        )
    points = [view.points.astype(np.float32)[:, None] for view in views]
    pixels = [view.pixels.astype(np.float32)[:, None] for view in views]
    try:
        rms, matrix, distortion, turns, _, sd, _, each = cv2.calibrateCameraExtended(
            points, pixels, (width, height), np.eye(3), np.zeros(5)
        )
    except cv2.error as error:
        raise DatasetError(
            Fault("no camera fits these views of the board", got=str(error.err), attempt="more tilted views")
        ) from error
    camera = Camera(width, height, np.asarray(matrix, dtype=np.float64), np.ravel(distortion)[:5].astype(np.float64))
    spread = np.ravel(sd).astype(np.float64)
    rms_by_image = {view.image: float(one) for view, one in zip(views, np.ravel(each), strict=True)}
    focal_sd, centre_sd = spread[:2], spread[2:4]
    seen = np.concatenate([view.pixels for view in views])
    cells = np.floor((seen + 0.5) / (width, height) * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    coverage = len({(int(x), int(y)) for x, y in cells}) / (_CELLS[0] * _CELLS[1])
    normals = [Pose.of(np.ravel(turn)).rotation[:, 2] for turn in turns]
    tilt = float(np.arccos(np.clip(min(abs(normal[2]) for normal in normals), 0.0, 1.0)))  # the largest
    rms = float(rms)
    found: list[str] = []
    if len(rms_by_image) < _ENOUGH_IMAGES:
        found.append(f"only {len(rms_by_image)} images were used; {2 * _ENOUGH_IMAGES} make the camera more certain")
    if coverage < _ENOUGH_COVERAGE:
        found.append(
            f"the board covers only {coverage:.0%} of the image: elsewhere the lens's distortion is extrapolated. Add "
            "images with the board near the edges and in the corners"
        )
    relative = float(np.max(focal_sd / camera.focal))
    field = 2 * np.arctan(camera.width / 2 / camera.focal[0])
    doubts = [
        text
        for doubtful, text in (
            (relative > _LARGEST_FOCAL_SD, f"it is known to {relative:.1%} only"),
            (tilt < _SMALLEST_TILT, f"the board was tilted by {np.degrees(tilt):.0f}° at most"),
            (not _FIELD[0] < field < _FIELD[1], f"a field of view of {np.degrees(field):.0f}° is unlike a camera's"),
        )
        if doubtful
    ]
    if doubts:
        found.append(
            f"the focal length is in doubt ({', '.join(doubts)}): add images with the board tilted by 30° to 45° in "
            "different directions"
        )
    if rms > _LARGEST_RMS:
        found.append(
            f"the reprojection error of corners is {rms:.2g} px (rms): is the board flat, are the images sharp, "
            "and is the focus fixed?"
        )
    typical = float(np.median(list(rms_by_image.values())))
    worst = [f"{image} ({one:.2g} px)" for image, one in rms_by_image.items() if one > max(3 * typical, 0.3)]
    if worst:
        found.append(f"far worse than the other images, so better left out: {', '.join(worst)}")
    warnings = tuple(found)
    return Calibration(camera, float(rms), rms_by_image, focal_sd, centre_sd, coverage, warnings)
