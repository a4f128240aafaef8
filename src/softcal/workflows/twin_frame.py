"""The twin along its pull, for a frame of the report: the shapes that its load path has, and splines between them."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.report.format import number
from softcal.report.twin_view import TwinFrame, TwinView
from softcal.twin.response import Response
from softcal.units import format_quantity
from softcal.workflows.simulation import turning_angle

MOST_SHAPES, MOST_TRIANGLES = 24, 12_000  # of a body
MOST_LETTERS = 600_000  # of the page
KINDS = {"m": "shortening", "N": "tension"}  # unit of a drive -> what it is


def twin_frame(view: TwinView, response: Response) -> TwinFrame | None:
    """The twin along its pull; None where no cable is pulled, another actuator is driven, or its page were too large.

    Parameters
    ----------
    view
        The twin.
    response
        Its response to the pull, with shapes.
    """
    from scipy.interpolate import CubicSpline

    from softcal.export.shape_modes import hermite, shape_modes
    from softcal.report.twin_page import drawn, twin_page

    chosen = np.unique(np.linspace(0, len(response.snapshots) - 1, MOST_SHAPES).round().astype(int))
    shapes = [response.snapshots[k] for k in chosen]
    first, pulled = shapes[0], [*shapes[0].controls]
    if not pulled or not {cable.name for cable in view.robot.cables}.issuperset(pulled):
        return None  # the page knows tensions alone
    places, kind = np.array([one.drive for one in shapes]), KINDS.get(first.drive_unit, "step")
    if kind == "step" or np.any(np.diff(places) <= 0.0):  # of several cables, or to and fro
        places, kind = np.arange(1.0, len(shapes) + 1.0), "step"
    measures = {f"{name}.tension": np.array([one.tensions.get(name, 0.0) for one in shapes]) for name in pulled}
    moving = [plate.name for plate in view.robot.plates if not plate.fixed and plate.name in first.plates]
    at = {name: np.array([one.plates[name][0] for one in shapes]) for name in moving}
    for name in moving:
        back = first.plates[name][1].T
        measures[f"{name}.rotation"] = np.array([turning_angle(back @ one.plates[name][1]) for one in shapes])
    at |= {name: np.array([one.markers[name] for one in shapes]) for name in first.markers}
    measures |= {f"{name}.displacement": np.linalg.norm(there - there[0], axis=1) for name, there in at.items()}
    model = {"cables": pulled[:1], "axes": [places.tolist()], "rows": [], "error": {}}
    seen = drawn(view, shapes, MOST_TRIANGLES)
    modes = shape_modes(model, seen.points, np.zeros((0, 1)), seen.points[:0])
    path = {
        "name": "step of the test" if kind == "step" else f"{kind} of {pulled[0]}",
        "kind": kind,
        "axes": model["axes"],
        "measures": [*measures],
        "nodes": hermite(model, np.column_stack([*measures.values()])),
    }
    page = twin_page("", {"path": path, "shapes": modes.data, "parts": seen.parts, "view": seen.view, "markers": []})
    if len(page) > MOST_LETTERS:
        return None
    told = f"The twin along its pull: {len(shapes)} equilibria of its load path, and splines between them"
    if kind != "step":
        along = response.channels[f"{pulled[0]}.{kind}"]
        kept = (along >= places[0]) & (along <= places[-1])

        def away(values: Floats, *channels: str) -> float:  # the splines from the response, at its samples
            exact = np.stack([response.channels[name][kept] for name in channels], axis=1)
            read = CubicSpline(places, values.reshape(len(shapes), -1))(along[kept])
            return float(np.linalg.norm(read - exact, axis=1).max(initial=0.0))

        apart = [away(there, *(f"{name}.{axis}" for axis in "xyz")) for name, there in at.items()]
        size = format_quantity(max([modes.error, *apart]), "m", digits=2)
        told += f". At the samples of the test what is drawn is within {size} of the twin"
        if kind == "shortening":
            tension = measures[f"{pulled[0]}.tension"]
            share = away(tension, f"{pulled[0]}.tension") / max(float(tension.max()), 1e-300)
            told += f", and the tension within {number(100.0 * share, 2)} % of its largest"
    return TwinFrame(page, len(measures), f"{told}.")
