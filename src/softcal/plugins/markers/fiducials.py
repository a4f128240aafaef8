"""Fiducial patterns: ArUco markers and ChArUco boards, as textures to render and to print."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, InputError, unknown
from softcal.extras import require_extra

if TYPE_CHECKING:
    import cv2.aruco

require_extra("markers", "cv2", where="markers")

_LARGEST_BOARD = 100  # squares along a side


@dataclass(frozen=True)
class CharucoBoard:
    """A chessboard with a marker in every white square.

    columns, rows: squares along x and y. square, marker: their sides [m]. dictionary: of the markers, by OpenCV's
    name. legacy: boards with an even number of rows as OpenCV drew them before 4.6, with a white first square.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str
    legacy: bool = False

    def __post_init__(self) -> None:
        n_markers = self.columns * self.rows // 2
        known = dictionary_size(self.dictionary)
        faults = [
            Fault(what, "the board", got, allowed)
            for wrong, what, got, allowed in (
                (
                    not (3 <= self.columns <= _LARGEST_BOARD and 3 <= self.rows <= _LARGEST_BOARD),
                    "the number of squares does not make a board",
                    f"{self.columns} x {self.rows}",
                    f"3 to {_LARGEST_BOARD} squares along each side",
                ),
                (
                    not 0 < self.marker < self.square,
                    "the marker does not fit into its square",
                    f"markers of {self.marker * 1e3:g} mm in squares of {self.square * 1e3:g} mm",
                    "a marker smaller than its square",
                ),
                (
                    n_markers > known,
                    "the dictionary has too few markers for the board",
                    f"{n_markers} white squares",
                    f"{known} markers in {self.dictionary}",
                ),
            )
            if wrong
        ]
        if faults:
            raise InputError(faults)

    def __str__(self) -> str:
        return (
            f"{self.columns}x{self.rows} squares of {self.square * 1e3:g} mm, markers of {self.marker * 1e3:g} mm "
            f"from {self.dictionary}{', legacy pattern' if self.legacy else ''}"
        )

    def opencv(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's object for the board."""
        import cv2

        size = (self.columns, self.rows)
        board = cv2.aruco.CharucoBoard(size, self.square, self.marker, find_dictionary(self.dictionary))
        board.setLegacyPattern(self.legacy)
        return board


def dictionary_names() -> list[str]:
    """The names of OpenCV's ArUco dictionaries."""
    import cv2

    return sorted(name for name in dir(cv2.aruco) if re.fullmatch(r"DICT_\w+", name))


def find_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of a name.

    Raises
    ------
    InputError
        Where there is none.
    """
    import cv2

    known = dictionary_names()
    if name not in known:
        raise InputError(unknown("there is no such dictionary of markers", "--dictionary", name, known))
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def dictionary_size(name: str) -> int:
    """Number of markers in a dictionary."""
    return len(find_dictionary(name).bytesList)


def marker_modules(dictionary: str) -> int:
    """Modules along a marker's side, its black border included."""
    return int(find_dictionary(dictionary).markerSize) + 2


def marker_texture(dictionary: str, marker_id: int) -> Floats:
    """One texel for each module: 0 black, 1 white, with a white module around.

    Raises
    ------
    InputError
        Where the dictionary has no such marker.
    """
    import cv2

    found, n_markers = find_dictionary(dictionary), dictionary_size(dictionary)
    if not 0 <= marker_id < n_markers:
        raise InputError(Fault(f"{dictionary} has no such marker", "--ids", str(marker_id), f"0 to {n_markers - 1}"))
    modules = cv2.aruco.generateImageMarker(found, marker_id, marker_modules(dictionary)) / 255.0
    return np.pad(np.asarray(modules, dtype=np.float64), 1, constant_values=1.0)


def board_texture(board: CharucoBoard) -> Floats:
    """The board without margin, at a resolution with whole texels per module of its markers."""
    modules = marker_modules(board.dictionary)
    ratio = board.marker / board.square
    # The markers' place in their square must be whole, too: half of what is left over on both sides.
    side = next(
        (
            n
            for n in range(2 * modules, 400)
            if all((abs(x - round(x)) < 1e-6 and x > 0.5) for x in (n * ratio / modules, n * (1 - ratio) / 2))
        ),
        24 * modules,
    )
    image = board.opencv().generateImage((board.columns * side, board.rows * side), marginSize=0, borderBits=1)
    return np.asarray(image, dtype=np.float64) / 255.0
