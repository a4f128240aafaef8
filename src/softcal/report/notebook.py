"""What a notebook shows of robots, responses and results beside their tables; see `softcal.display`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from softcal.calibration.results.result import CalibrationResult
from softcal.display import drawn
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.fine_surface import fine_surface
from softcal.geometry.surface import boundary
from softcal.report.content import JOINT, ExperimentContent, ReportContent
from softcal.report.scene import Part, Surface, Tube, bending_camera, length_scale
from softcal.report.scene_twin import displacements
from softcal.report.sketch import draw_sketch
from softcal.report.style import DISPLACEMENT, FAINT, ORANGE, as_png
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot

FINE = 90.0  # [dots per inch]
MOST = 3  # experiments whose fit is shown
_ROD, _CABLE = 0.015, 0.007  # radii over the size of the robot


@drawn.register
def robot_picture(robot: Robot) -> Iterator[bytes]:
    """The robot at rest, with its regions, cables and loads."""
    from softcal.report.check_figures import robot_scenes

    scenes, cameras = robot_scenes(robot)
    yield as_png(draw_sketch(scenes[0].parts, cameras[0]), FINE)


@drawn.register
def response_picture(response: Response) -> Iterator[bytes]:
    """The shape that is furthest from the first one, coloured by displacement, over the first one in grey."""
    if len(response.snapshots) < 2:
        return
    rest = response.snapshots[0]
    bent = max(
        response.snapshots[1:], key=lambda shape: max(float(d.max()) for d in displacements(rest, shape).values())
    )
    moved = displacements(rest, bent)
    start, end = (np.concatenate([*shape.points.values(), *shape.rods.values()]) for shape in (rest, bent))
    size, away = length_scale(start), np.linalg.norm(end - start, axis=1)
    # A response knows no direction of gravity: its longest axis is upright, with the end that moves on top.
    middle = start - start.mean(axis=0)
    up = np.linalg.eigh(middle.T @ middle)[1][:, -1]
    up = up if away @ (middle @ up) >= 0.0 else -up
    parts, behind = _parts(response, bent, moved, size), _parts(response, rest, None, size)
    cables = [path for shape in (rest, bent) for path in shape.cables.values()]
    camera = bending_camera(np.concatenate([start, end, *cables]), up, (end - start).mean(axis=0))
    yield as_png(draw_sketch(parts, camera, behind), FINE)


@drawn.register
def result_pictures(result: CalibrationResult) -> Iterator[bytes]:
    """The loss against the trials, and the first experiments, measured and simulated."""
    from softcal.report.figures.distances import distances
    from softcal.report.figures.history import draw_history, search_history
    from softcal.report.figures.trajectory import trajectory

    experiments: dict[str, ExperimentContent] = {}
    for name, fit in result.experiments.items():
        samples = Dataset(name, {channel: Channel(y, fit.units[channel]) for channel, y in fit.measured.items()})
        drive = next((channel for channel in fit.measured if channel not in fit.simulated and channel != "time"), "")
        experiments[name] = ExperimentContent(name, samples, samples, drive=drive)
    label = next(iter(experiments)) if len(experiments) == 1 else JOINT
    content = ReportContent("", {label: result}, experiments)
    if len((losses := search_history(result.trials)).losses):
        yield as_png(draw_history("Loss of the trials", losses), FINE)
    for figure, most in ((trajectory, MOST), (distances, 1)):
        for drawing in islice(figure(content), most):
            yield as_png(drawing.figure, FINE)


def _parts(response: Response, shape: Snapshot, moved: dict[str, np.ndarray] | None, size: float) -> list[Part]:
    """Bodies, rods and cables of a shape; moved [m]: displacements that colour it, grey and without cables if None."""
    from matplotlib import colormaps

    largest = max((float(d.max()) for d in (moved or {}).values()), default=0.0) or 1.0
    shades = {name: colormaps[DISPLACEMENT](d / largest)[:, :3] for name, d in (moved or {}).items()}
    parts: list[Part] = []
    for name, tets in response.tets.items():
        fine, colours = fine_surface(boundary(tets)), shades.get(name)
        parts.append(
            Surface(fine.at(shape.points[name]), fine.triangles, colour=FAINT if colours is None else fine.at(colours))
        )
    parts += [Tube(nodes, _ROD * size, colour=shades.get(name, FAINT)) for name, nodes in shape.rods.items()]
    cables = {} if moved is None else shape.cables
    return parts + [Tube(path, _CABLE * size, colour=ORANGE) for path in cables.values()]
