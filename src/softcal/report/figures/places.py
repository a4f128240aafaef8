"""Chart of measured and simulated marker positions with the twin's shapes, in two views."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.calibration.results.result import ExperimentFit
from softcal.checks import Floats, Ints
from softcal.geometry.fine_surface import fine_surface
from softcal.geometry.surface import boundary
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import result_label
from softcal.report.headline import headline
from softcal.report.outline import View, outline, two_views
from softcal.report.robot_view import robot_points
from softcal.report.style import FAINT, INK, MUTED, SERIES, house_style, new_figure
from softcal.report.twin_view import EquilibriumShapes
from softcal.sensing.channel import positions
from softcal.twin.facing import up_direction
from softcal.twin.response import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# In inches: height of the pictures, greatest width of both, and margins.
_PANEL, _WIDEST = 3.4, 9.0
_LEFT, _GAP, _HEAD, _FOOT = 0.75, 0.25, 0.35, 0.85
_COLUMNS = 6
_THIN = 1e-6  # of the markers' largest extent: a smaller second extent means that they are collinear


@register_figure("fit", place=1)
def places(content: ReportContent) -> Iterator[Drawing]:
    """Measured and simulated marker positions of the headline, in two views with the twin's shapes."""
    if content.equilibria is None:
        return
    fits = content.headline_result.experiments
    found = {name: markers_of(fits[name]) for name in content.equilibria.shapes if name in fits}
    markers = {name: one for name, one in found.items() if one is not None}
    if not markers:
        return
    title = result_label(content.headline)
    caption = (
        f"{title}: measured and simulated marker positions in the robot's frame, with the shapes of "
        f"{headline(content).twin}."
    )
    left = len(fits) - len(content.equilibria.shapes)
    caption += f" {left} further experiments are omitted." if left > 0 else ""
    yield Drawing(draw_places(title, content.equilibria, markers), caption, title=f"Places of the markers: {title}")


@dataclass(frozen=True)
class Markers:
    """Marker positions in the robot's frame [m], shape (n, 3): every state of every measured marker."""

    measured: Floats
    simulated: Floats


def markers_of(fit: ExperimentFit) -> Markers | None:
    """Measured and simulated markers of one experiment in the robot's frame; None if the frame is undetermined.

    The transform from the bench's frame is fitted to the twin's markers, known in both frames; it needs three
    markers that are not collinear.
    """
    measured, simulated, twin = (_stacked(values, fit) for values in (fit.measured, fit.simulated, fit.response))
    if not len(twin):
        return None
    seen = np.isfinite(measured).all(axis=1)
    measured, simulated, twin = measured[seen], simulated[seen], twin[seen]
    if np.allclose(simulated, twin, rtol=0.0, atol=1e-12):
        return Markers(measured, simulated)
    here, there = simulated - simulated.mean(axis=0), twin - twin.mean(axis=0)
    sizes = np.linalg.svd(here, compute_uv=False)
    if sizes[1] < _THIN * sizes[0]:
        return None
    left, _, right = np.linalg.svd(there.T @ here)
    R = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return Markers((measured - simulated.mean(axis=0)) @ R.T + twin.mean(axis=0), twin)


def draw_places(title: str, equilibria: EquilibriumShapes, markers: Mapping[str, Markers]) -> Figure:
    """Open circles: measured; crosses: simulated; the twin's shape in each experiment, undeformed in grey.

    Parameters
    ----------
    title
        Title of the figure.
    equilibria
        The twin's shapes by experiment [m].
    markers
        Experiment -> places of its markers [m].
    """
    from matplotlib.lines import Line2D

    known = np.concatenate([part for one in markers.values() for part in (one.measured, one.simulated)])
    bodies = [points for shape in equilibria.shapes.values() for points in shape.points.values()]
    extent = np.concatenate([robot_points(equilibria.robot), known, *bodies])
    views = two_views(extent, up_direction(equilibria.robot))
    # Left, right, bottom and top of a picture [mm], with a margin; its width is at least a third of its height.
    frames: list[tuple[float, float, float, float]] = []
    for view in views:
        flat = view.flat(extent)
        low, high = flat.min(axis=0), flat.max(axis=0)
        margin = 0.08 * float(high[1] - low[1])
        middle, half = 0.5 * (low[0] + high[0]), 0.5 * (high[0] - low[0]) + margin
        half = max(half, (high[1] - low[1]) / 6)
        frames.append((middle - half, middle + half, low[1] - margin, high[1] + margin))
    shares = [(right - left) / (top - bottom) for left, right, bottom, top in frames]
    high = min(_PANEL, _WIDEST / sum(shares))
    width, height = _LEFT + sum(shares) * high + _GAP + 0.1, _FOOT + high + _HEAD
    with house_style():
        figure = new_figure(width, height)
        figure.set_layout_engine("none")  # both pictures have one scale, so their axes are placed explicitly
        at = _LEFT
        for k, (view, (left, right, bottom, top)) in enumerate(zip(views, frames, strict=True)):
            axes = figure.add_axes((at / width, _FOOT / height, shares[k] * high / width, high / height))
            at += shares[k] * high + _GAP
            axes.set(xlim=(left, right), ylim=(bottom, top), xlabel=f"{view.right_name} [mm]")
            if k:
                axes.tick_params(labelleft=False)
            else:
                axes.set_ylabel(f"{view.up_name} [mm]")
                axes.set_title(title)
            _draw_shape(axes, view, equilibria.undeformed, equilibria.tets, FAINT, MUTED)
            for i, (name, shape) in enumerate(equilibria.shapes.items()):
                colour = SERIES[i % len(SERIES)]
                _draw_shape(axes, view, shape, equilibria.tets, None, colour)
                if name in markers:
                    measured, simulated = (view.flat(at) for at in (markers[name].measured, markers[name].simulated))
                    for one, other in zip(measured, simulated, strict=True):
                        axes.plot(*np.stack([one, other]).T, color=colour, linewidth=1.0, zorder=3)
                    axes.plot(*measured.T, "o", color=colour, fillstyle="none", markersize=5.0, zorder=4)
                    axes.plot(*simulated.T, "x", color=colour, markersize=4.5, zorder=4)
        entries = [
            Line2D([], [], color=SERIES[i % len(SERIES)], label=name) for i, name in enumerate(equilibria.shapes)
        ]
        entries += [
            Line2D([], [], color=MUTED, label="undeformed"),
            Line2D([], [], color=INK, marker="o", fillstyle="none", linestyle="none", label="measured"),
            Line2D([], [], color=INK, marker="x", linestyle="none", label="simulated"),
        ]
        figure.legend(handles=entries, loc="lower center", ncols=min(len(entries), _COLUMNS))
        return figure


def _draw_shape(
    axes: Axes, view: View, shape: Snapshot, tets: Mapping[str, Ints], fill: str | None, colour: str
) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    for body, cells in tets.items():
        fine = fine_surface(boundary(cells))
        flat, triangles = view.flat(fine.at(shape.points[body])), fine.triangles
        if fill is not None:
            axes.add_collection(PolyCollection(list(flat[triangles]), facecolors=fill, edgecolors=fill, zorder=1))
        lines = flat[outline(flat, triangles)]
        axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=1.0, alpha=0.8, zorder=2))
    for nodes in shape.rods.values():
        axes.plot(*view.flat(nodes).T, color=colour, linewidth=1.5, alpha=0.8, zorder=2)
    for points in shape.routes.values():
        axes.plot(*view.flat(points).T, color=colour, linewidth=0.6, alpha=0.6, zorder=2)


def _stacked(values: Mapping[str, Floats], fit: ExperimentFit) -> Floats:
    """All states of the markers of `fit`, marker by marker, shape (n, 3); empty if a marker has no values."""
    parts: list[Floats] = []
    for marker in fit.distances:
        columns = [values.get(str(part)) for part in positions(marker)]
        present = [column for column in columns if column is not None]
        if len(present) < 3:
            return np.empty((0, 3))
        parts.append(np.stack(present, axis=1))
    return np.concatenate(parts) if parts else np.empty((0, 3))
