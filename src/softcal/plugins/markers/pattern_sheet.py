"""Printable SVG sheets of markers and boards at true scale."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, InputError
from softcal.plugins.markers.fiducials import CharucoBoard, board_texture, marker_modules, marker_texture

_PAPER = 0.190  # printable width of an A4 sheet [m]
_MARGIN = 0.010  # [m]
_RULER = 0.050  # length of the control line [m]
_FOOT = 0.016  # height of the foot with that line [m]
_LABEL = 0.005  # height of the line under a marker [m]


def board_sheet(board: CharucoBoard) -> str:
    """SVG of a board, with a control line to verify the scale of the print."""
    width, height = board.columns * board.square, board.rows * board.square
    parts = [_pattern(board_texture(board), _MARGIN, _MARGIN, width, height)]
    return _sheet(parts, max(width, 2 * _RULER), height, f"ChArUco {board}")


def marker_sheet(dictionary: str, ids: Sequence[int], size: float) -> str:
    """SVG of markers with their numbers. Cut along the grey lines.

    Parameters
    ----------
    dictionary
        Name of the markers' dictionary.
    ids
        Their numbers.
    size
        Side of the black square [m].

    Raises
    ------
    InputError
        For a size that does not fit on the sheet, or an unknown marker.
    """
    tile = size * (marker_modules(dictionary) + 2) / marker_modules(dictionary)
    if not 0 < tile <= _PAPER:
        raise InputError(
            Fault("markers of this size cannot be laid out", "--size", f"{size * 1e3:g} mm", "1 mm to about 140 mm")
        )
    n_columns = max(1, int(_PAPER / (tile + _LABEL)))
    parts: list[str] = []
    for i, number in enumerate(ids):
        row, column = divmod(i, n_columns)
        x, y = _MARGIN + column * (tile + _LABEL), _MARGIN + row * (tile + _LABEL)
        parts.append(_pattern(marker_texture(dictionary, number), x, y, tile, tile))
        parts.append(
            f'<rect x="{_mm(x)}" y="{_mm(y)}" width="{_mm(tile)}" height="{_mm(tile)}" fill="none" stroke="#bbb" '
            f'stroke-width="0.1"/>'
        )
        parts.append(_text(x, y + tile + 0.0035, f"{number}"))
    height = (1 + (len(ids) - 1) // n_columns) * (tile + _LABEL)
    return _sheet(parts, _PAPER, height, f"{dictionary}, black squares of {size * 1e3:g} mm")


def _pattern(texture: Floats, x: float, y: float, width: float, height: float) -> str:
    """Black parts of a texture as one path: runs of each row, equal rows joined."""
    is_black = texture < 0.5
    changes = [0, *(1 + np.flatnonzero(np.any(is_black[1:] != is_black[:-1], axis=1))), len(texture)]
    wide, high = width / texture.shape[1], height / texture.shape[0]
    runs: list[str] = []
    for top, bottom in pairwise(changes):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], is_black[top].astype(int), [0]])))
        for left, right in edges.reshape(-1, 2):
            across = _mm((right - left) * wide)
            runs.append(
                f"M{_mm(x + left * wide)} {_mm(y + top * high)}h{across}v{_mm((bottom - top) * high)}h-{across}z"
            )
    return f'<path shape-rendering="crispEdges" d="{"".join(runs)}"/>'


def _sheet(parts: Sequence[str], width: float, height: float, title: str) -> str:
    across, down = width + 2 * _MARGIN, height + 2 * _MARGIN + _FOOT
    foot = _MARGIN + height + _FOOT / 2
    line = f"M{_mm(_MARGIN)} {_mm(foot)}h{_mm(_RULER)}m0 -1v2m-{_mm(_RULER)} 0v-2"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{_mm(across)}mm" height="{_mm(down)}mm" '
            f'viewBox="0 0 {_mm(across)} {_mm(down)}">',
            f'<rect width="{_mm(across)}" height="{_mm(down)}" fill="#fff"/>',
            *parts,
            f'<path d="{line}" fill="none" stroke="#000" stroke-width="0.2"/>',
            _text(_MARGIN, foot + 0.005, f"Print at 100 %: this line is {_mm(_RULER)} mm long. {title}"),
            "</svg>",
            "",
        ]
    )


def _text(x: float, y: float, text: str) -> str:
    return f'<text x="{_mm(x)}" y="{_mm(y)}" font-family="sans-serif" font-size="3">{text}</text>'


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.6g}"
