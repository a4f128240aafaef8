"""Paper B's Fig. 5: selected configurations of the twin in one state, with the measured marker positions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from softcal.calibration.results.digits import value_text
from softcal.calibration.statistics.estimate import Estimate
from softcal.report.compared import Compared
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.overview import overview_curves
from softcal.report.format import number, parameter_label
from softcal.report.robot_view import robot_points
from softcal.report.scene import Ball, Part, Scene, Tube, bending_camera, extent_points, length_scale
from softcal.report.scene_figure import ScenePicture, draw_side_by_side
from softcal.report.scene_render import render_scenes
from softcal.report.scene_twin import displacements, twin_parts
from softcal.twin.facing import up_direction
from softcal.units import format_quantity

if TYPE_CHECKING:
    from softcal.report.twin_view import TwinView

_LONGEST = 30  # characters of parameters above a shape


@register_figure("compared", place=3)
def configurations(content: ReportContent) -> Iterator[Drawing]:
    """The twin's shapes at selected values, beside the measured markers."""
    compared = content.compared
    if compared is None or len(compared.configurations) < 2:
        return
    drawn = draw_configurations(compared, content.headline_result.parameters)
    caption = (
        f"{compared.state}: the twin at selected values, with the root mean square distance of its markers (blue) "
        "from their measured positions (orange). Colour: displacement from rest, one scale for all."
    )
    section = "compared" if overview_curves(content) else "overview"
    yield Drawing(
        drawn.figure, caption, shown="png", note=drawn.note, section=section, title="The twin at selected values"
    )


def draw_configurations(compared: Compared, estimates: Mapping[str, Estimate]) -> ScenePicture:
    """Shapes side by side in one projection; measured markers as balls, joined by a line to the simulated position.

    estimates: label of a parameter -> its estimate, whose interval is shown beside an equal value of a shape.
    """
    from softcal.report.style import RED, SKY

    views = compared.configurations
    largest = max(
        float(values.max()) for view in views for values in displacements(view.twin.rest, view.twin.bent).values()
    )
    shapes: list[Scene] = []
    for view in views:
        moved = displacements(view.twin.rest, view.twin.bent)
        parts, labels = twin_parts(view.twin, view.twin.bent, moved, largest)
        size = length_scale(robot_points(view.twin.robot))
        extra: list[Part] = [Ball(at, 0.013 * size, colour=RED) for at in view.measured.values()]
        for name, at in view.simulated.items():
            if np.linalg.norm(at - view.measured[name]) > 0.01 * size:
                extra.append(Tube(np.stack([view.measured[name], at]), 0.003 * size, colour=RED))
        plates = {plate.name for plate in view.twin.robot.plates}
        kept = tuple(label for label in labels if label.text in plates)
        if compared.length is None:
            error = f"{number(1e3 * view.distance)} mm"
        else:
            error = f"{number(100 * view.distance / compared.length)} %"
        texts: list[str] = []
        for name, value in view.parameters.items():
            known = estimates.get(name)
            text = format_quantity(value, compared.units[name])
            if known is not None and known.value == value:
                text = value_text(known)
            texts.append(f"{parameter_label(name, compared.units)} {text}")
        n_shown = max(1, sum(len(", ".join(texts[: k + 1])) <= _LONGEST for k in range(len(texts))))
        shown = ", ".join(texts[:n_shown]) + (", …" if n_shown < len(texts) else "")
        shapes.append(Scene(f"{view.name}: {error}\n{shown}", (*parts, *extra), kept))
    scenes = tuple(shapes)
    moved = [_mean_place(view.twin, bent=True) - _mean_place(view.twin, bent=False) for view in views]
    camera = bending_camera(extent_points(scenes), up_direction(views[0].twin.robot), np.mean(moved, axis=0))
    cameras = (camera,) * len(scenes)
    return draw_side_by_side(
        scenes, cameras, render_scenes(scenes, cameras), colours={"marker, measured": RED, "marker, simulated": SKY}
    )


def _mean_place(view: TwinView, *, bent: bool) -> np.ndarray:
    shape = view.bent if bent else view.rest
    return np.concatenate([*shape.points.values(), *shape.rods.values()]).mean(axis=0)
