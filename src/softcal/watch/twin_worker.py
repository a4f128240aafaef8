"""Simulates the twin of a run once, in a process of its own, and writes the shape at the end of its load path.

Run as `python -m softcal.watch.twin_worker SHAPE`: standard input is a JSON object {folder, label, theta}, where theta
[SI by label] is missing or null before the first trial; SHAPE is the GLB file to write. Standard output is a JSON
object: `units` by parameter, `bounds` by parameter, and of the shape `title`, `largest` displacement [m] and `trouble`,
a sentence where there is no shape; `cpu`, the processor time that it took [s].
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import SoftcalError
from softcal.report.robot_view import robot_points
from softcal.report.scene_twin import bending_axes

if TYPE_CHECKING:
    from softcal.project.project import Project
    from softcal.report.twin_view import TwinView

NICE = 10  # below the run itself, which shares the machine


def main(shape: Path) -> None:
    """Answer one request."""
    from softcal.workflows.run_folder import project_of_run

    request = json.load(sys.stdin)
    answer: dict[str, Any] = {"units": {}, "bounds": {}, "title": "", "largest": 0.0, "trouble": ""}
    try:
        project, settings = project_of_run(request["folder"])
        answer |= _parameters(project)
        if request.get("theta"):
            label = request["label"]
            names = [label] if label in project.experiments else list(project.experiments)
            names = [name for name in names if name not in settings.hold_out] or list(project.experiments)
            answer |= _shape(project, request["theta"], names, shape)
    except SoftcalError as error:
        answer["trouble"] = str(error)
    json.dump({**answer, "cpu": time.process_time()}, sys.stdout)


def _parameters(project: Project) -> dict[str, Any]:
    """Units of all parameters, and bounds and scale of the free ones, by label."""
    units = {name: info.unit for name, info in project.parameters.items()}
    free = () if project.space is None else project.space.parameters
    for parameter in free:
        name = next(iter(parameter.targets), parameter.name)
        units[parameter.label] = units.get(name, units.get(parameter.name, "1"))
    return {"units": units, "bounds": {p.label: [p.lower, p.upper] for p in free}}


def _shape(project: Project, theta: Mapping[str, float], names: Sequence[str], path: Path) -> dict[str, Any]:
    """Simulate the twin at theta in the experiment with the largest drive, and write its shape."""
    from softcal.report.scene import Surface
    from softcal.report.scene_glb import scene_glb
    from softcal.report.scene_twin import displacements, twin_scenes

    found = _view(project, theta, names)
    if isinstance(found, str):
        return {"trouble": found}
    scenes = twin_scenes(found)
    rest, bent = scenes.scenes
    outlines = [part for part in rest.parts if isinstance(part, Surface)]
    path.write_bytes(scene_glb(bent.parts, outlines, *_axes(found)))
    largest = max((float(values.max()) for values in displacements(found).values()), default=0.0)
    return {"title": found.bent.label, "largest": largest}


def _axes(view: TwinView) -> tuple[Floats, Floats]:
    """Up, and what is shown to the right: the direction of bending, or where that is down the robot's own length."""
    up, towards = bending_axes(view)
    level = towards - (towards @ up) * up
    if np.linalg.norm(level) >= 0.5 * np.linalg.norm(towards):
        return up, level
    points = robot_points(view.robot)
    flat = (points - points.mean(axis=0)) @ (np.eye(3) - np.outer(up, up))
    return up, np.linalg.eigh(flat.T @ flat)[1][:, -1]


def _view(project: Project, theta: Mapping[str, float], names: Sequence[str]) -> TwinView | str:
    """The twin at rest and at the end of its load path, or why it cannot be shown."""
    from softcal.workflows.calibrated_shapes import equilibrium_shapes, from_undeformed
    from softcal.workflows.calibration import project_at
    from softcal.workflows.furthest import furthest_experiment
    from softcal.workflows.simulation import simulate, twin_view

    free = () if project.space is None else project.space.parameters
    tied = {**project.tied, **{p.label: p.targets for p in free}}
    at_values = project_at(project, theta, tied, names)
    experiment = furthest_experiment(at_values, names)
    if not at_values.experiments[experiment].drives:
        return from_undeformed(equilibrium_shapes(at_values, [experiment])) or f"{experiment}: the twin has no shape."
    response = simulate(at_values, experiment=experiment, snapshots=True)
    if not response.succeeded:
        return f"{experiment}: {response.status}"
    return twin_view(at_values.robot, response) or f"{experiment}: the twin has one shape only."


if __name__ == "__main__":
    os.nice(NICE)
    main(Path(sys.argv[1]))
