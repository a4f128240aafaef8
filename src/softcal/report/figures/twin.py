"""Paper A's Figs 2 and 4: the twin at rest and bent."""

from __future__ import annotations

from collections.abc import Iterator

from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import joined
from softcal.report.headline import headline
from softcal.report.robot_view import ROUTE, WALL, actuator_legend, has_materials, material_legend
from softcal.report.scene_figure import ScenePicture, draw_side_by_side
from softcal.report.scene_render import render_scenes
from softcal.report.scene_twin import twin_scenes
from softcal.report.twin_view import TwinView


@register_figure("twin")
def twin(content: ReportContent) -> Iterator[Drawing]:
    """The twin at the headline's values, at rest and bent, coloured by displacement."""
    if content.twin is None:
        return
    drawn, robot = draw_twin(content.twin), content.twin.robot
    states = "undeformed and in equilibrium"
    if content.twin.bent.controls:  # it is driven
        states = "at rest and " + ("at its largest pitch" if content.twin.bent.plates else "furthest from it")
    drawn_as = ["the bent shape is coloured by its displacement"]
    drawn_as += ["the one at rest by its materials"] if has_materials(robot) else []
    drawn_as += ["fixed regions are dark grey"] if any(len(body.fixed) for body in robot.bodies) else []
    words = {ROUTE: "the tubes", WALL: "the surfaces inside"}
    drawn_as += [f"{words[colour]} are {kind}s" for kind, colour in actuator_legend(robot).items()]
    shaped = {plate.disc is not None for plate in robot.plates}
    drawn_as += ["the discs are rigid plates"] if True in shaped else []
    drawn_as += ["lines are around what a rigid plate holds, and lead to what it carries"] if False in shaped else []
    whose = headline(content).twin
    caption = f"{whose[0].upper()}{whose[1:]} {states}, to one scale: {joined(drawn_as)}."
    yield Drawing(drawn.figure, caption, shown="png", note=drawn.note, title=f"The twin {states}")


def draw_twin(view: TwinView) -> ScenePicture:
    """The twin at rest and bent, side by side in one projection."""
    found = twin_scenes(view)
    cameras = (found.camera, found.camera)
    materials = material_legend(view.robot) if has_materials(view.robot) else None
    rendering = render_scenes(found.scenes, cameras)
    return draw_side_by_side(found.scenes, cameras, rendering, largest=found.largest, colours=materials)
