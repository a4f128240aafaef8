"""Scenes side by side with titles, labels, a scale bar and, for displacements, a colour bar."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.report.scene import Projection, Scene
from softcal.report.scene_labels import name_parts
from softcal.report.scene_render import Rendering, panel_size
from softcal.report.style import DISPLACEMENT, INK, MUTED, house_style, new_figure

if TYPE_CHECKING:
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
    """Scenes next to each other, with a scale bar.

    Parameters
    ----------
    scenes
        From left to right.
    cameras
        The projection of each scene.
    rendering
        The picture of each scene, or none.
    largest
        Top of the colour bar of displacements [m]; None: no bar.
    colours
        Name -> colour of the legend's entries; None: no legend.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    panel, tall = panel_size(cameras[0])  # all lengths of the layout in inches
    lines = 1 + max(scene.title.count("\n") for scene in scenes)
    width = 0.16 + panel * len(scenes)
    columns = 3 if width > _WIDE else 2
    legend = 0.1 + 0.195 * math.ceil(len(colours) / columns) if colours else 0.0
    foot = _SCALE_BAR + (0.62 if largest else 0.0 if colours else 0.08) + legend
    title = 0.12 + 0.2 * lines
    height = title + tall + foot
    with house_style():
        figure = new_figure(width, height)
        figure.set_layout_engine("none")  # pictures keep their aspect ratio, so their axes are placed explicitly
        for index, (scene, camera) in enumerate(zip(scenes, cameras, strict=True)):
            place = ((0.08 + index * panel) / width, foot / height, panel / width, tall / height)
            axes = figure.add_axes(place)
            left, right, bottom, top = _millimetres(camera)
            axes.set_xlim(left, right)
            axes.set_ylim(bottom, top)
            axes.set_axis_off()
            if rendering.pictures:
                axes.imshow(rendering.pictures[index], extent=(left, right, bottom, top), aspect="auto", zorder=1)
                name_parts(axes, scene, camera)
            else:
                axes.text(0.5, 0.5, _NO_PICTURE, transform=axes.transAxes, ha="center", color=MUTED)
            axes.set_title(scene.title)
        axes, (left, right, bottom, _) = figure.axes[0], _millimetres(cameras[0])
        wanted = 0.25 * (right - left)
        power = 10 ** np.floor(np.log10(wanted))
        length = max(step * power for step in (1, 2, 5) if step * power <= wanted)
        # A bar of length beneath the picture, where no part of the robot is.
        axes.plot(
            [left, left + length], [bottom, bottom], color=INK, linewidth=2.0, solid_capstyle="butt", zorder=6,
            clip_on=False,
        )  # fmt: skip
        axes.annotate(
            f"{length:g} mm", (left + length, bottom), (4, 0), textcoords="offset points", ha="left", va="center",
            fontsize=8.5, color=INK, annotation_clip=False,
        )  # fmt: skip
        if largest:
            shades = ScalarMappable(Normalize(0, 1e3 * largest), DISPLACEMENT)
            bar = figure.colorbar(
                shades,
                cax=figure.add_axes((0.12, (0.45 + legend) / height, 0.76, 0.12 / height)),
                orientation="horizontal",
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
