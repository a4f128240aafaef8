"""The twin as a page to pull: its parts as surfaces and tubes whose points follow the inputs; see `twin.js`."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.report.page import TEMPLATES, render
from softcal.report.scene import Ball, FlatDisc, Part, Surface, Tube, Wire, bending_camera
from softcal.report.scene_twin import bending_axes, displacements, twin_parts
from softcal.report.style import DISPLACEMENT, INK
from softcal.report.twin_view import TwinView
from softcal.sensing.channel import channel_name
from softcal.twin.response import Snapshot
from softcal.units import readable_unit, unit_factor

STILL = 1e-2  # of the largest change of its unit: a channel that changes less is not shown
SHADES = 9  # colours of the scale of displacements
RINGS = 9  # points along the axis of a ball
SLENDER, ROUND = 12, 48  # sides of a tube, and of a disc
ABOVE = 1.02  # length of a hole over the thickness of its disc, so that it is seen


@dataclass(frozen=True)
class Drawn:
    """Parts of the twin in several shapes.

    Attributes
    ----------
    parts
        What does not change, for the page.
    rest, points
        Their points one after the other at rest (n_points, 3) and in each shape (n_shapes, n_points, 3) [m].
    view
        For the page: the camera, the middle of its window and half its sides [m], the colours of displacements, and the
        largest displacement [m].
    """

    parts: Sequence[Mapping[str, Any]]
    rest: Floats
    points: Floats
    view: Mapping[str, Any]


def drawn(view: TwinView, shapes: Sequence[Snapshot], most: int | None = None) -> Drawn:
    """The parts of the twin in shapes, in the colours of the displacement from rest.

    Parameters
    ----------
    view
        The twin at rest, and where it is bent most.
    shapes
        The shapes.
    most
        Triangles of a body for which its surface is coarser.
    """
    from matplotlib import colormaps

    moved = displacements(view.rest, view.bent)
    # A cable that is taut in one of them is drawn as taut in all.
    taut = {name: max(abs(one.efforts[name]) for one in shapes) for name in view.rest.efforts}
    parts = [
        [one for part in twin_parts(view, replace(shape, efforts=taut), moved, 1.0, most)[0] for one in _elements(part)]
        for shape in (view.rest, *shapes)
    ]
    rest, *points = np.array([np.concatenate([at for _, at in elements]) for elements in parts])
    camera = bending_camera(np.reshape(points, (-1, 3)), *bending_axes(view))
    axes, window = np.stack([camera.right, camera.up, camera.back]), np.reshape(camera.window, (2, 2))
    deep = np.array(points) @ camera.back
    is_shaded = np.concatenate([np.full(len(at), facts["colour"] is None) for facts, at in parts[0]])
    middle = np.array([*window.mean(axis=1), 0.5 * (deep.min() + deep.max())])
    sight = {
        "camera": axes.tolist(),
        "middle": (middle @ axes).tolist(),
        "half": (0.5 * np.ptp(window, axis=1)).tolist(),
        "shades": colormaps[DISPLACEMENT](np.linspace(0.0, 1.0, SHADES))[:, :3].round(4).tolist(),
        "largest": float(np.linalg.norm((points - rest)[:, is_shaded], axis=2).max(initial=0.0)),
    }
    return Drawn([{**facts, "n": len(at)} for facts, at in parts[0]], rest, np.array(points), sight)


def shown_channels(values: Mapping[str, Floats]) -> dict[str, Any]:
    """For the page, of channels with values (n,) [SI]: the `measures`, channels that change, the `first` one of the
    chart, and their `units`.
    """
    kinds = {name: channel_name(name).kind for name in values}
    change, most = {name: float(np.ptp(of)) for name, of in values.items()}, dict[str, float]()
    for name, kind in kinds.items():
        most[kind.unit] = max(most.get(kind.unit, 0.0), change[name])
    measures = [name for name, kind in kinds.items() if change[name] > STILL * most[kind.unit]]
    first = max(measures, key=lambda name: (kinds[name].is_angle, kinds[name].is_position, change[name]))
    units = {name: shown_unit(of, kinds[name].unit) for name, of in values.items()}
    return {"measures": measures, "first": first, "units": units}


def shown_unit(values: Floats, unit: str) -> tuple[str, float]:
    """The unit in which the page shows values [unit], and how many of it are one of theirs."""
    name = readable_unit(float(np.abs(values).max(initial=0.0)), unit) if unit else "1"
    return {"deg": "°", "1": ""}.get(name, name.replace("*", " ")), 1.0 / unit_factor(name, unit or "1")


def twin_page(
    title: str,
    data: Mapping[str, Any],
    kinds: Sequence[str] = (),
    statements: Sequence[str] = (),
    estimates: Sequence[tuple[str, str, str]] = (),
) -> str:
    """The page as HTML.

    Parameters
    ----------
    title
        The name of the project; "" for a frame of another page, which has its own.
    data
        What `twin.js` reads, see its class `Twin`; arrays are written as their bytes in base 64.
    kinds
        What the sliders may set: kinds of efforts, and of coordinates; empty where there is no choice.
    statements
        Sentences on what the page shows, and on its errors.
    estimates
        Label, value and interval of the calibrated parameters.
    """

    def as_text(values: np.ndarray) -> str:
        return b64encode(values.tobytes()).decode("ascii")

    text = json.dumps(data, separators=(",", ":"), allow_nan=False, default=as_text).replace("<", "\\u003c")
    return render(
        TEMPLATES / "twin.html.j2",
        title=title,
        data=text,
        statements=statements,
        estimates=estimates,
        kinds=kinds,
    )


def _elements(part: Part) -> list[tuple[dict[str, Any], Floats]]:
    """A part as surfaces and tubes: what does not change, and points (n, 3) [m]."""
    match part:
        case Surface():
            used, triangles = np.unique(part.triangles, return_inverse=True)
            return [(_facts(part, triangles=triangles.astype("<u4")), part.points[used])]
        case Tube():
            radii = np.broadcast_to(part.radius, len(part.path))
            return [(_facts(part, radii=radii.tolist(), sides=SLENDER), part.path)]
        case Wire():
            return [(_facts(part, radii=[part.radius] * len(path), sides=SLENDER // 2), path) for path in part.paths]
        case Ball():
            turn = np.linspace(0.0, np.pi, RINGS)
            path = part.at + np.outer(part.radius * np.cos(turn), [0.0, 0.0, 1.0])
            return [(_facts(part, radii=(part.radius * np.sin(turn)).tolist(), sides=SLENDER), path)]
        case FlatDisc():
            half = 0.5 * part.thickness * part.axis
            disc = _facts(part, radii=[part.radius] * 2, sides=ROUND)
            hole = {**_facts(part, radii=[part.hole_radius] * 2, sides=SLENDER), "colour": _rgb(INK)}
            ends = [(hole, np.stack([at - ABOVE * half, at + ABOVE * half])) for at in part.holes]
            return [(disc, np.stack([part.centre - half, part.centre + half])), *ends]
        case _:
            raise TypeError(f"a page has no {type(part).__name__}")


def _facts(part: Part, **own: object) -> dict[str, Any]:
    """colour: RGB from 0 to 1, or None for that of the displacement."""
    return {"colour": _rgb(part.colour) if isinstance(part.colour, str) else None, "opacity": part.opacity, **own}


def _rgb(name: str) -> list[float]:
    from matplotlib.colors import to_rgb

    return [round(value, 4) for value in to_rgb(name)]
