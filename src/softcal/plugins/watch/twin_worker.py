"""Simulates the twin of a run once, in a process of its own, and draws it: its shape at the end of its load path, and
what it measures beside what was measured.

Run as `python -m softcal.plugins.watch.twin_worker SHAPE`: standard input is a JSON object {folder, label, theta},
where theta [SI by label] is missing or null before the first trial; SHAPE is the GLB file to write, and fit-0.png and
so on are written beside it. Standard output is a JSON object: `units` by parameter, `bounds` by parameter, of the
shape `title`, `largest` displacement [m] and `trouble`, a sentence where there is no shape; of the figures their
`captions`, and `missing`, sentences on experiments that are not drawn; `cpu`, the processor time that it took [s].
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

from softcal.errors import SoftcalError
from softcal.report.robot_view import robot_points
from softcal.report.scene_twin import bending_axes

if TYPE_CHECKING:
    from softcal.project.project import Project
    from softcal.twin.response import Response

NICE = 10  # below the run itself, which shares the machine
FINE = 120.0  # [dots per inch] of the figures


def main(shape: Path) -> None:
    """Answer one request."""
    from softcal.workflows.calibrated_shapes import furthest_experiment
    from softcal.workflows.calibration import project_at
    from softcal.workflows.run_folder import project_of_run
    from softcal.workflows.simulation import simulate

    request = json.load(sys.stdin)
    answer: dict[str, Any] = {"units": {}, "bounds": {}, "title": "", "largest": 0.0, "trouble": ""}
    try:
        project, settings = project_of_run(request["folder"])
        units = {name: info.unit for name, info in project.parameters.items()}
        free = () if project.space is None else project.space.parameters
        for parameter in free:
            name = next(iter(parameter.targets), parameter.name)
            units[parameter.label] = units.get(name, units.get(parameter.name, "1"))
        answer |= {"units": units, "bounds": {p.label: [p.lower, p.upper] for p in free}}
        if theta := request.get("theta"):
            label = request["label"]
            names = [label] if label in project.experiments else list(project.experiments)
            names = [name for name in names if name not in settings.hold_out] or list(project.experiments)
            tied = {**project.tied, **{p.label: p.targets for p in free}}
            at_values = project_at(project, theta, tied, names)
            furthest = furthest_experiment(at_values, names)
            is_driven = at_values.experiments[furthest].drives
            known = {furthest: simulate(at_values, experiment=furthest, snapshots=True)} if is_driven else {}
            answer |= _shape(at_values, names, known, shape)
            from softcal.plugins.watch.fit_drawing import fit_drawings, fits_at
            from softcal.report.style import as_png

            fits, missing = fits_at(at_values, names, known)
            captions: list[str] = []
            for drawing in fit_drawings(at_values, label, fits):
                (shape.parent / f"fit-{len(captions)}.png").write_bytes(as_png(drawing.figure, FINE))
                captions.append(drawing.caption)
            answer |= {"captions": captions, "missing": missing}
    except SoftcalError as error:
        answer["trouble"] = str(error)
    json.dump({**answer, "cpu": time.process_time()}, sys.stdout)


def _shape(at_values: Project, names: Sequence[str], known: Mapping[str, Response], path: Path) -> dict[str, Any]:
    """Write the twin's shape in the experiment with the largest drive, from its response."""
    from softcal.report.scene import Surface
    from softcal.report.scene_glb import scene_glb
    from softcal.report.scene_twin import displacements, twin_scenes
    from softcal.workflows.calibrated_shapes import equilibrium_shapes, from_undeformed
    from softcal.workflows.simulation import twin_view

    # The twin at rest and at the end of its load path, or a sentence on why it cannot be shown.
    name, response = next(iter(known.items()), (names[0], None))
    if response is None:
        found = from_undeformed(equilibrium_shapes(at_values, names[:1])) or f"{name}: the twin has no shape."
    elif response.succeeded:
        found = twin_view(at_values.robot, response) or f"{name}: the twin has one shape only."
    else:
        found = f"{name}: {response.status}"
    if isinstance(found, str):
        return {"trouble": found}
    scenes = twin_scenes(found)
    rest, bent = scenes.scenes
    outlines = [part for part in rest.parts if isinstance(part, Surface)]
    up, towards = bending_axes(found)
    level = towards - (towards @ up) * up
    if np.linalg.norm(level) < 0.5 * np.linalg.norm(towards):  # it bends downwards: its own length is to the right
        points = robot_points(found.robot)
        flat = (points - points.mean(axis=0)) @ (np.eye(3) - np.outer(up, up))
        level = np.linalg.eigh(flat.T @ flat)[1][:, -1]
    path.write_bytes(scene_glb(bent.parts, outlines, up, level))
    largest = max((float(values.max()) for values in displacements(found.rest, found.bent).values()), default=0.0)
    return {"title": found.bent.label, "largest": largest}


if __name__ == "__main__":
    os.nice(NICE)
    main(Path(sys.argv[1]))
