"""Camera calibration and marker measurement from image files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from softcal.checks import is_number
from softcal.errors import DatasetError, Fault, InputError
from softcal.plugins.markers.aruco import detect_markers
from softcal.plugins.markers.camera_file import camera_text, read_camera
from softcal.plugins.markers.charuco import FEWEST_IMAGES, BoardView, Calibration, calibrate_camera, find_board
from softcal.plugins.markers.fiducials import CharucoBoard, dictionary_size
from softcal.plugins.markers.marker_pose import MarkerPoses, estimate_poses
from softcal.plugins.markers.marker_scene import Glimpse, MarkerSet
from softcal.plugins.markers.marker_table import MarkerTable, marker_table
from softcal.plugins.markers.shots import Grouping, find_shots, read_image
from softcal.project.base_file import read_base
from softcal.quantities import QUANTITIES
from softcal.workflows.output import require_free_file, write_new_file

Viewpoints = Literal["each", "numbered", "one"]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CameraRun:
    """A camera calibration, and the images in which the board was not found."""

    calibration: Calibration
    skipped: tuple[str, ...]


@dataclass(frozen=True)
class MarkerRun:
    """The table of markers, and the poses it was computed from."""

    table: MarkerTable
    poses: MarkerPoses


def make_camera_file(
    images: Sequence[str | Path], board: CharucoBoard, out: str | Path, *, progress: Progress | None = None
) -> CameraRun:
    """Calibrate a camera from images of a ChArUco board and write its camera file.

    Parameters
    ----------
    images
        Files, folders or patterns of images.
    board
        The board in them.
    out
        The camera file, new.
    progress
        Called with the number of images that are done, and of all.

    Raises
    ------
    DatasetError
        Where images differ in resolution, or too few of them show the board.
    StorageError
        Where an image cannot be read, or `out` exists or cannot be written.
    """
    out = Path(out)
    shots = find_shots(images, "image")
    require_free_file(out)
    views: list[BoardView] = []
    skipped: list[str] = []
    sizes: dict[tuple[int, int], list[str]] = {}
    faults: list[Fault] = []
    for i, shot in enumerate(shots):
        try:
            image = read_image(shot.path)
        except InputError as error:
            faults.extend(error.faults)
            continue
        sizes.setdefault((image.shape[1], image.shape[0]), []).append(str(shot.path))
        view = find_board(image, board, shot.path.name)
        if view is None:
            skipped.append(shot.path.name)
        else:
            views.append(view)
        if progress is not None:
            progress(i + 1, len(shots))
    if len(sizes) > 1:
        usual = max(sizes, key=lambda size: len(sizes[size]))
        faults += [
            Fault("the image has another resolution than the others", path, _pixels(size), _pixels(usual))
            for size, paths in sizes.items()
            if size != usual
            for path in paths
        ]
    if len(views) < FEWEST_IMAGES:
        faults.append(
            Fault(
                f"the board was found in {len(views)} of {len(shots)} images",
                got=f"not in {', '.join(skipped[:8])}{', …' * (len(skipped) > 8)}" if skipped else "",
                allowed=f"{FEWEST_IMAGES} or more, better 16, with the board tilted in different directions",
                attempt=f"check that the board is {board}, as it was printed (--legacy for boards made with OpenCV "
                "before 4.6), whole, flat and sharp",
            )
        )
    if faults:
        raise DatasetError(faults)
    calibration = calibrate_camera(views, *next(iter(sizes)))
    write_new_file(out, camera_text(calibration, str(board), skipped))
    return CameraRun(calibration, tuple(skipped))


def measure_markers(  # noqa: PLR0913 (one keyword for each option)
    images: Sequence[str | Path],
    *,
    camera: str | Path,
    dictionary: str,
    size: str,
    base: str,
    out: str | Path,
    names: str = "",
    sizes: str = "",
    group_by: Grouping = "name",
    viewpoints: Viewpoints = "each",
    progress: Progress | None = None,
) -> MarkerRun:
    """Measure markers in images and write their table.

    Parameters
    ----------
    images
        Files, folders or patterns.
    camera
        The camera file.
    dictionary
        OpenCV's name, such as DICT_4X4_50.
    size
        Side of the black square of every marker that is not in `sizes`, with its unit.
    base
        Reference frame of the positions: `0`, `0,5,6` or a base file.
    out
        The table, which must not exist.
    names
        `1=S1,2=S2`; empty: every marker in the images.
    sizes
        `0=40mm,3=15mm`.
    group_by
        Grouping of images into states: by `name` without a final number, by `folder`, or each `image` alone.
    viewpoints
        Camera poses: one for `each` image, one for all images `numbered` alike, or `one` for all.
    progress
        Called with the number of processed images, and of all.

    Raises
    ------
    DatasetError
        With all faults of the images: no marker, a marker twice, another resolution than the camera's.
    InputError
        With all faults of the other arguments.
    StorageError
        Where a file cannot be read, or `out` exists or cannot be written.
    """
    out = Path(out)
    require_free_file(out)
    lens = read_camera(Path(camera))
    standing = read_base(base)
    given_sizes = {
        number: QUANTITIES["size"].read(text, where=f"--sizes, marker {number}")
        for number, text in _by_number(sizes, "--sizes", "0=40mm,3=15mm").items()
    }
    given_names = _by_number(names, "--names", "1=S1,2=S2")
    faults = [
        Fault("the name is no valid column header", f"--names, marker {number}", f"'{name}'", "letters, digits, _ - .")
        for number, name in given_names.items()
        if not re.fullmatch(r"[\w.-]+", name)
    ]
    known = dictionary_size(dictionary)
    named = {*standing.placed, *standing.companions, *given_sizes, *given_names}
    faults += [
        Fault(f"{dictionary} has no marker {number}", allowed=f"0 to {known - 1}")
        for number in sorted(named)
        if number >= known
    ]
    if faults:
        raise InputError(faults)
    markers = MarkerSet(
        standing.placed,
        QUANTITIES["size"].read(size, where="--size"),
        standing.companions,
        {**standing.sizes, **given_sizes},
        given_names,
    )
    shots = find_shots(images, group_by)
    if viewpoints not in get_args(Viewpoints):
        allowed = "each (image its own), numbered (images of one number share one), one (for all images)"
        raise InputError(Fault("unknown choice of viewpoints", "--viewpoints", f"'{viewpoints}'", allowed))
    if viewpoints == "numbered":
        bare = [shot for shot in shots if not shot.number]
        allowed = "a name such as cable6_2kgf_01.png"
        if bare:
            raise InputError([Fault("the image has no number", str(shot.path), allowed=allowed) for shot in bare])
    glimpses: list[Glimpse] = []
    unclear: dict[str, tuple[int, ...]] = {}
    for i, shot in enumerate(shots):
        name = str(shot.path)
        viewpoint = {"each": name, "numbered": shot.number, "one": ""}[viewpoints]
        try:
            detection = detect_markers(read_image(shot.path), dictionary, lens, where=name)
        except InputError as error:
            faults.extend(error.faults)
        else:
            glimpses.append(Glimpse(name, shot.group, viewpoint, detection.corners))
            unclear[name] = detection.unclear
        if progress is not None:
            progress(i + 1, len(shots))
    if faults:
        raise DatasetError(faults)
    poses = estimate_poses(lens, markers, glimpses)
    table = marker_table(markers, glimpses, poses, unclear)
    write_new_file(out, table.csv())
    return MarkerRun(table, poses)


def _by_number(text: str, option: str, example: str) -> dict[int, str]:
    """`1=S1,2=S2` as a mapping."""
    found: dict[int, str] = {}
    faults: list[Fault] = []
    for part in filter(None, (part.strip() for part in text.split(","))):
        number, _, value = (piece.strip() for piece in part.partition("="))
        if not (is_number(number) and value):
            faults.append(Fault("this is not a marker assignment", option, f"'{part}'", example))
        elif int(number) in found:
            faults.append(Fault(f"marker {number} is named twice", option, f"'{text}'"))
        else:
            found[int(number)] = value
    if faults:
        raise InputError(faults)
    return found


def _pixels(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]} px"
