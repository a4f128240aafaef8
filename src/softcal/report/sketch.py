"""A quick picture of three-dimensional parts without a renderer: their triangles, from the furthest to the nearest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.report.scene import Part, Projection
from softcal.report.style import house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT, WIDEST = 3.2, 6.0  # [in]
_DARKEST = 0.55  # of the light on a triangle that is seen edgewise


def draw_sketch(parts: Sequence[Part], camera: Projection, behind: Sequence[Part] = ()) -> Figure:
    """Parts as they are seen through a camera.

    Parameters
    ----------
    parts
        What is drawn.
    camera
        Its projection.
    behind
        Parts that are drawn first, where the others cover them.
    """
    left, right, bottom, top = camera.window
    width = min(HEIGHT * (right - left) / (top - bottom), WIDEST)
    with house_style():
        figure = new_figure(width, width * (top - bottom) / (right - left))
        figure.set_layout_engine("none")
        draw_parts(figure.add_axes((0.0, 0.0, 1.0, 1.0)), parts, camera, behind)
        return figure


def draw_parts(axes: Axes, parts: Sequence[Part], camera: Projection, behind: Sequence[Part] = ()) -> None:
    """See `draw_sketch`; draws into existing axes.

    Parameters
    ----------
    axes
        Where they are drawn.
    parts
        What is drawn.
    camera
        Its projection.
    behind
        Parts that are drawn first.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    left, right, bottom, top = camera.window
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set(xlim=(left, right), ylim=(bottom, top))
    for layer in (behind, parts):
        seen: list[tuple[Floats, Floats]] = []  # corners (n, 3, 3) in the picture with their depth; colours (n, 4)
        for part in layer:
            mesh = part.mesh().triangulate()
            faces = np.asarray(mesh.regular_faces)
            corners = camera.project(np.asarray(mesh.points))[faces]
            if isinstance(part.colour, str):
                colours = np.tile(to_rgb(part.colour), (len(faces), 1))
            elif "colour" in mesh.cell_data:
                colours = np.asarray(mesh.cell_data["colour"])[:, :3] / 255.0
            else:
                colours = np.asarray(mesh.point_data["colour"])[faces][:, :, :3].mean(axis=1) / 255.0
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            length = np.linalg.norm(normals, axis=1)
            light = _DARKEST + (1.0 - _DARKEST) * np.abs(normals[:, 2]) / np.where(length > 0.0, length, 1.0)
            shaded = np.column_stack([colours * light[:, None], np.full(len(faces), part.opacity)])
            seen.append((corners, shaded))
        if seen:
            corners, colours = (np.concatenate(held) for held in zip(*seen, strict=True))
            order = np.argsort(corners[:, :, 2].mean(axis=1))
            shown = PolyCollection(list(corners[order, :, :2]), facecolors=colours[order])
            shown.set(linewidth=0.3, edgecolor="face")  # no seams between triangles
            axes.add_collection(shown)
