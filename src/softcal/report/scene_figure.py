"""Scenes side by side with titles, labels, a scale bar and, for displacements, a colour bar."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.report.scene import Projection, Scene
from softcal.report.scene_render import Rendering, panel_size
from softcal.report.style import DISPLACEMENT, FAINT, INK, MUTED, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SCALE_BAR = 0.14  # [in], beneath the pictures
_NO_PICTURE = "no picture: the 3-D renderer\ndoes not work on this machine"
_WIDE = 5.8  # [in], a figure that fits three legend columns


@dataclass(frozen=True)
class ScenePicture:
    """A drawn figure; note: why the pictures are missing, or ""."""

    figure: Figure
    note: str


def draw_side_by_side(
    scenes: tuple[Scene, ...],
    cameras: tuple[Projection, ...],
    rendering: Rendering,
    *,
    largest: float | None = None,
    colours: Mapping[str, str] | None = None,
) -> ScenePicture:
    """Scenes next to each other; `largest` [m] adds the colour bar of a displacement, `colours` a legend."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    panel, tall = panel_size(cameras[0])  # all lengths of the layout in inches
    lines = 1 + max(scene.title.count("\n") for scene in scenes)
    width = 0.16 + panel * len(scenes)
    columns = 3 if width > _WIDE else 2
    foot = 0.62 if largest else 0.1 + 0.195 * math.ceil(len(colours) / columns) if colours else 0.08
    foot += _SCALE_BAR
    title = 0.12 + 0.2 * lines
    height = title + tall + foot
    with house_style():
        figure = new_figure(width, height)
        figure.set_layout_engine("none")  # pictures keep their aspect ratio, so their axes are placed explicitly
        for index, (scene, camera) in enumerate(zip(scenes, cameras, strict=True)):
            place = ((0.08 + index * panel) / width, foot / height, panel / width, tall / height)
            axes = figure.add_axes(place)
            _frame(axes, camera)
            if rendering.pictures:
                axes.imshow(rendering.pictures[index], extent=_millimetres(camera), aspect="auto", zorder=1)
                _name_parts(axes, scene, camera)
            else:
                axes.text(0.5, 0.5, _NO_PICTURE, transform=axes.transAxes, ha="center", color=MUTED)
            axes.set_title(scene.title)
        _scale_bar(figure.axes[0], cameras[0])
        if largest:
            shades = ScalarMappable(Normalize(0, 1e3 * largest), DISPLACEMENT)
            bar = figure.colorbar(
                shades, cax=figure.add_axes((0.12, 0.45 / height, 0.76, 0.12 / height)), orientation="horizontal"
            )
            bar.set_label("Displacement from rest [mm]", labelpad=2)
            bar.outline.set_visible(False)  # type: ignore[operator]
        if colours:
            patches = [Patch(facecolor=colour, edgecolor=MUTED, label=name) for name, colour in colours.items()]
            figure.legend(handles=patches, loc="lower center", ncols=columns)
        return ScenePicture(figure, rendering.note)


def _millimetres(camera: Projection) -> tuple[float, float, float, float]:
    left, right, bottom, top = camera.window
    return 1e3 * left, 1e3 * right, 1e3 * bottom, 1e3 * top


def _frame(axes: Axes, camera: Projection) -> None:
    left, right, bottom, top = _millimetres(camera)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_axis_off()


def _name_parts(axes: Axes, scene: Scene, camera: Projection) -> None:
    """Labels in the margin on the nearer side, spread in height, each with a thin line to its part."""
    left, right, bottom, top = _millimetres(camera)
    if not scene.labels:
        return
    crowd = 1e3 * camera.project(
        np.concatenate([part.extent for part in scene.parts if part.bulky and part.opacity > 0.5])
    )
    middle = 0.5 * (crowd[:, 0].min() + crowd[:, 0].max())
    reach = [1e3 * camera.project(label.at)[:, :2] for label in scene.labels]
    on_left = [float(candidates[:, 0].mean()) < middle for candidates in reach]
    anchors = np.stack([_clearest(at, crowd[:, :2], left=side) for at, side in zip(reach, on_left, strict=True)])
    height = 0.06 * (top - bottom)
    edge = 0.02 * (right - left)
    lowest = np.inf
    for index in np.argsort(-anchors[:, 1]):
        x, y = anchors[index]
        lowest = min(y + 1.5 * height, lowest - height, top - 0.3 * height)
        near_left = on_left[index]
        axes.annotate(
            scene.labels[index].text, (x, y), xytext=(left + edge if near_left else right - edge, lowest),
            fontsize=9, color=INK,
            ha="left" if near_left else "right", va="center", zorder=5,
            bbox={"facecolor": "white", "edgecolor": FAINT, "alpha": 0.9, "boxstyle": "round,pad=0.25"},
            arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip


def _clearest(candidates: Floats, crowd: Floats, *, left: bool) -> Floats:
    """Anchor of a label's line: among the candidates nearly furthest from the crowd, the one nearest to the label."""
    from scipy.spatial import KDTree

    distance = KDTree(crowd).query(candidates)[0]
    clear = candidates[distance >= 0.5 * distance.max()]
    return clear[np.argmin(clear[:, 0] if left else -clear[:, 0])]


def _scale_bar(axes: Axes, camera: Projection) -> None:
    left, right, bottom, _ = _millimetres(camera)
    wanted = 0.25 * (right - left)
    power = 10 ** np.floor(np.log10(wanted))
    length = max(step * power for step in (1, 2, 5) if step * power <= wanted)
    # Beneath the picture, where no part of the robot is.
    axes.plot(
        [left, left + length], [bottom, bottom], color=INK, linewidth=2.0, solid_capstyle="butt", zorder=6,
        clip_on=False,
    )  # fmt: skip
    axes.annotate(
        f"{length:g} mm", (left + length, bottom), (4, 0), textcoords="offset points", ha="left", va="center",
        fontsize=8.5, color=INK, annotation_clip=False,
    )  # fmt: skip
