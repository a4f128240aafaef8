"""The picture of a state that was reached: the robot there over rest, the places that were wanted, the obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.geometry.obstacle import Obstacle
from softcal.report.robot_view import robot_points
from softcal.report.scene import Ball, Part, Scene, Surface, Wire, bending_camera, extent_points, length_scale
from softcal.report.scene_twin import bending_axes, displacements, twin_parts
from softcal.report.sketch import draw_sketch
from softcal.report.style import FAINT, GREEN, MUTED, RED
from softcal.report.twin_view import TwinView

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINT, LINE, SEEN_THROUGH = 0.02, 0.005, 0.35  # radii over the size of the robot, and the opacity of obstacles
SAME = 1e-3  # of the robot's size: a place within it counts as reached in the picture


@dataclass(frozen=True)
class ReachView:
    """The contents of the drawing.

    Attributes
    ----------
    twin
        The robot at rest, and in the state that was reached.
    places
        Plate or marker -> the place (3,) that was wanted and the one that was reached [m].
    obstacles
        Name -> obstacle.
    """

    twin: TwinView
    places: Mapping[str, tuple[Floats, Floats]]
    obstacles: Mapping[str, Obstacle]


def draw_reach(view: ReachView) -> Figure:
    """The robot coloured by its displacement, over rest in grey; each place wanted as a green ball where it is reached,
    else as a red one with a line to the place reached; the obstacles translucent.
    """
    robot = view.twin.robot
    size = length_scale(robot_points(robot))
    moved = displacements(view.twin.rest, view.twin.bent)
    largest = max(float(values.max()) for values in moved.values())
    bent, _ = twin_parts(view.twin, view.twin.bent, moved, largest)
    rest, _ = twin_parts(view.twin, view.twin.rest, None, largest)
    parts: list[Part] = [*bent]
    for wanted, reached in view.places.values():
        is_there = float(np.linalg.norm(wanted - reached)) < SAME * size
        parts.append(Ball(wanted, POINT * size, colour=GREEN if is_there else RED))
        if not is_there:
            parts.append(Wire((np.stack([wanted, reached]),), LINE * size, colour=RED))
    for obstacle in view.obstacles.values():
        points, triangles = obstacle.drawn(robot_points(robot).mean(axis=0), size)
        parts.append(Surface(points, triangles, colour=MUTED, opacity=SEEN_THROUGH))
    behind = [Surface(one.points, one.triangles, colour=FAINT) for one in rest if isinstance(one, Surface)]
    up, towards = bending_axes(view.twin)
    shown = extent_points((Scene("", (*parts, *behind)),))
    return draw_sketch(parts, bending_camera(shown, up, towards), behind)
