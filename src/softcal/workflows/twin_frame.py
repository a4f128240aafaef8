"""The twin along its load path, for a frame of the report: the shapes that this has, and splines between them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.report.format import number
from softcal.report.twin_view import TwinFrame, TwinView
from softcal.sensing.channel import channel_name
from softcal.sensing.sensors.pose import angles
from softcal.twin.response import Response
from softcal.units import format_quantity

MOST_SHAPES, MOST_TRIANGLES = 24, 12_000  # of a body
MOST_LETTERS = 600_000  # of the page
DEGREE = 96  # of the polynomials that follow the splines
STEP = "step of the test"


def twin_frame(view: TwinView, response: Response) -> TwinFrame | None:
    """The twin along its pull; None where nothing is pulled, or the page were too large.

    Parameters
    ----------
    view
        The twin.
    response
        Its response to the pull, with shapes.
    """
    from numpy.polynomial import chebyshev
    from scipy.interpolate import CubicSpline

    from softcal.export.reduced import Input, terms_at
    from softcal.export.shape_modes import shape_modes
    from softcal.report.twin_page import drawn, shown_channels, shown_unit, twin_page

    chosen = np.unique(np.linspace(0, len(response.snapshots) - 1, MOST_SHAPES).round().astype(int))
    shapes = [response.snapshots[k] for k in chosen]
    first, pulled = shapes[0], [*shapes[0].controls]
    if np.all(np.diff([one.drive for one in shapes]) < 0.0):  # a vacuum: the slider goes from the lowest to none
        shapes = shapes[::-1]
    if not pulled:
        return None
    parts = {part.name: part for part in view.robot.actuated}
    controls = {kind.unit: kind.name for kind in parts[pulled[0]].channels}
    places, control = np.array([one.drive for one in shapes]), controls.get(first.drive_unit, "")
    if not control or np.any(np.diff(places) <= 0.0):  # of several actuators, or to and fro
        places, control = np.arange(1.0, len(shapes) + 1.0), ""
    channels = {
        f"{name}.{parts[name].channels[1].name}": np.array([one.efforts[name] for one in shapes]) for name in pulled
    }
    efforts = [*channels]
    for plate in view.robot.plates:
        if not plate.fixed and plate.name in first.plates:
            poses = np.array([(*at, *angles(turned)) for at, turned in (one.plates[plate.name] for one in shapes)])
            keys = ("x", "y", "z", "pitch", "roll", "yaw")
            channels |= {f"{plate.name}.{key}": poses[:, k] for k, key in enumerate(keys)}
    for name in first.markers:
        at = np.array([one.markers[name] for one in shapes])
        channels |= {f"{name}.{axis}": at[:, k] for k, axis in enumerate("xyz")}
    if control == parts[pulled[0]].channels[0].name:
        channels[f"{pulled[0]}.{control}"] = places
    if len(channels) == len(efforts):
        return None
    half, middle = 0.5 * np.ptp(places), 0.5 * (places[0] + places[-1])
    powers, nodes = np.arange(DEGREE + 1)[:, None], chebyshev.chebpts1(2 * DEGREE)

    def fitted(values: Floats) -> dict[str, Any]:
        coefficients = chebyshev.chebfit(nodes, CubicSpline(places, values)(middle + half * nodes), DEGREE)
        return {"powers": powers.tolist(), "coefficients": coefficients.tolist()}

    name, unit, default = (pulled[0], first.drive_unit, first.drive) if control else (STEP, "", places[0])
    driven = Input(name, unit, float(places[0]), float(places[-1]), float(default), control)
    model = {
        "inputs": [asdict(driven)],
        "plates": [],
        "coordinates": [*channels],
        "markers": [],
        "directions": [[1.0]],
        **fitted(np.column_stack([*channels.values()])),
        "bands": None,
    }
    seen = drawn(view, shapes, MOST_TRIANGLES)
    modes, shown = shape_modes(seen.rest, seen.points, fitted), shown_channels(channels)
    data = {
        "model": model,
        "shapes": modes.data,
        "parts": seen.parts,
        "view": seen.view,
        "inputs": [[driven.derivative]],
        "efforts": efforts,
        **shown,
        "units": {**shown["units"], driven.derivative: shown_unit(places, unit)},
    }
    page = twin_page("", data)
    if len(page) > MOST_LETTERS:
        return None
    told = f"The twin along its load path: {len(shapes)} equilibria, and splines between them"
    if control:
        along = response.channels[driven.derivative]
        kept = (along >= places[0]) & (along <= places[-1])
        terms = terms_at((along[kept, None] - middle) / half, np.eye(1), powers)
        apart = dict(zip(channels, (terms @ np.array(model["coefficients"])).T, strict=True))
        apart = {name: values - response.channels[name][kept] for name, values in apart.items()}
        points: dict[str, list[Floats]] = {}
        for name, difference in apart.items():
            points.setdefault(channel_name(name).point, []).append(difference)
        away = [np.linalg.norm(of, axis=0).max(initial=0.0) for point, of in points.items() if point]
        away.append(modes.distance(np.eye(1), (places[:, None] - middle) / half, seen.points))
        size = format_quantity(max(away), "m", digits=2)
        told += f". At the samples of the test what is drawn is within {size} of the twin"
        if driven.derivative not in efforts:
            share = np.abs(apart[efforts[0]]).max(initial=0.0) / max(np.abs(channels[efforts[0]]).max(), 1e-300)
            told += f", and the {parts[pulled[0]].channels[1].name} within {number(100.0 * share, 2)} % of its largest"
    return TwinFrame(page, len(shown["measures"]), f"{told}.")
