"""Scenes before the fit: the robot undeformed, under its loads and at the ends of experiments, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softcal.checks import Ints
from softcal.report.scene import Projection, Scene, bending_camera, extent_points
from softcal.report.scene_twin import bending_axes, displacements, twin_parts
from softcal.report.twin_view import TwinView
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot

MOST = 4  # side by side


@dataclass(frozen=True)
class StartScenes:
    """Scenes in one projection; largest: the largest displacement [m], top of the colour scale."""

    scenes: tuple[Scene, ...]
    cameras: tuple[Projection, ...]
    largest: float


def start_scenes(
    robot: Robot, undeformed: Snapshot, shapes: Mapping[str, Snapshot], tets: Mapping[str, Ints]
) -> StartScenes | None:
    """The undeformed shape and the most displaced ones, coloured by displacement; None if nothing moved.

    Parameters
    ----------
    robot
        The robot.
    undeformed
        Its shape without loads.
    shapes
        Title -> shape.
    tets
        Body -> connectivity of `Snapshot.points` (n_tets, 4 or 10).
    """
    views = {name: TwinView(robot, undeformed, shape, tets) for name, shape in shapes.items()}
    moved = {name: displacements(view.rest, view.bent) for name, view in views.items()}
    furthest = {name: max(float(d.max()) for d in parts.values()) for name, parts in moved.items()}
    largest = max(furthest.values(), default=0.0)
    if largest <= 0.0:
        return None
    chosen = set(sorted(furthest, key=lambda name: -furthest[name])[: MOST - 1])
    far = views[max(furthest, key=lambda name: furthest[name])]
    scenes = [Scene("Undeformed", *twin_parts(far, undeformed, None, largest))]
    scenes += [
        Scene(name, *twin_parts(view, view.bent, moved[name], largest))
        for name, view in views.items()
        if name in chosen
    ]
    camera = bending_camera(extent_points(tuple(scenes)), *bending_axes(far))
    return StartScenes(tuple(scenes), (camera,) * len(scenes), largest)
