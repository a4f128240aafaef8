"""Names of parts beside a scene: a column on each side, no more names than fit, with a line from each to its part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.report.scene import Projection, Scene
from softcal.report.scene_render import panel_size
from softcal.report.style import FAINT, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE, _PAD = 9.0, 0.25  # [pt] of the letters, and of the box around them as a share of that
_ROW = 0.235  # [in], from one name to the next below it


def name_parts(axes: Axes, scene: Scene, camera: Projection) -> None:
    """Names in the margin on the nearer side, each with a thin line to its part.

    Where two columns have no room beside each other, names of both sides have no height in common. Of names that do not
    fit above each other, some at even steps from the highest to the lowest part are kept.

    Parameters
    ----------
    axes
        Where they are drawn, in mm.
    scene
        Its labels and parts.
    camera
        The projection of the picture.
    """
    from matplotlib.textpath import TextPath
    from scipy.spatial import KDTree

    if not scene.labels:
        return
    left, right, bottom, top = (1e3 * side for side in camera.window)
    wide, tall = panel_size(camera)
    row, edge = _ROW / tall * (top - bottom), 0.02 * (right - left)
    parts = [part.extent for part in scene.parts if part.bulky and part.opacity > 0.5]
    crowd = 1e3 * camera.project(np.concatenate(parts))[:, :2]
    middle = 0.5 * (crowd[:, 0].min() + crowd[:, 0].max())
    reach = [1e3 * camera.project(label.at)[:, :2] for label in scene.labels]
    on_left = np.array([at[:, 0].mean() < middle for at in reach])
    anchors, tree = np.zeros((len(reach), 2)), KDTree(crowd)
    for k, at in enumerate(reach):
        taken = anchors[:k][on_left[:k] == on_left[k], 1]
        # Of its points nearly furthest from the crowd the one nearest to the name, a row away from others if it can be.
        distance = tree.query(at)[0]
        clear = at[distance >= 0.5 * distance.max()]
        apart = clear[(np.abs(clear[:, 1:] - taken) >= row).all(axis=1)]
        best = apart if len(apart) else clear
        anchors[k] = best[np.argmin(best[:, 0] if on_left[k] else -best[:, 0])]
    low, high = bottom + 0.8 * row, top - 0.5 * row  # the lowest is clear of the scale bar
    widths = np.array([TextPath((0, 0), one.text, size=_SIZE).get_extents().width for one in scene.labels])
    sides = [np.flatnonzero(on_left), np.flatnonzero(~on_left)]
    needed = sum(float(widths[side].max(initial=0.0)) + 4 * _PAD * _SIZE for side in sides) / 72
    for column in sides if needed < 0.96 * wide else [np.arange(len(scene.labels))]:
        kept, most = column[np.argsort(-anchors[column, 1])], 1 + int((high - low) / row)
        if len(kept) > most:
            kept = kept[np.linspace(0, len(kept) - 1, most).round().astype(int)]
        heights = spread(anchors[kept, 1] + 1.5 * row, low, high, row)
        for index, height in zip(kept.tolist(), heights, strict=True):
            near_left, (x, y) = bool(on_left[index]), anchors[index]
            axes.annotate(
                scene.labels[index].text, (x, y), xytext=(left + edge if near_left else right - edge, height),
                fontsize=_SIZE, color=INK,
                ha="left" if near_left else "right", va="center", zorder=5,
                bbox={"facecolor": "white", "edgecolor": FAINT, "alpha": 0.9, "boxstyle": f"round,pad={_PAD}"},
                arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip


def spread(wanted: Floats, low: float, high: float, row: float) -> list[float]:
    """Heights at least a row apart, near the wanted ones.

    Parameters
    ----------
    wanted
        Descending (n,); they have room between the ends.
    low, high
        Ends of the heights.
    row
        Least distance of two.
    """
    places = wanted.tolist()
    for k, height in enumerate(places):
        places[k] = min(height, places[k - 1] - row if k else high)
    for k in reversed(range(len(places))):
        places[k] = max(places[k], places[k + 1] + row if k + 1 < len(places) else low)
    return places
