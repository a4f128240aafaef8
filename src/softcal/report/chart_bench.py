"""Charts of measurements and the twin's response: cycles, trajectories, the overview."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.calibration.result import CalibrationResult
from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.experiments.names import is_deviation
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.format import channel_label, scale_of
from softcal.report.series import TrajectoryPanel, TrajectoryPanels
from softcal.report.style import (
    BLUE,
    INK,
    LOOP,
    MEASURED,
    MUTED,
    ORANGE,
    SERIES,
    SIMULATED,
    house_style,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ANGLES = ("pitch", "roll", "yaw")


def has_force_displacement(data: Dataset) -> bool:
    """Whether a dataset has the channels of a force–displacement chart."""
    return "shortening" in data.channels and "tension" in data.channels


def draw_force_displacement(experiment: ExperimentContent) -> Figure:
    """Paper A's Fig. 3: all cycles in light tones, the first one distinct, the fitted branch on top."""
    with house_style():
        figure = new_figure()
        axes = figure.add_subplot()
        record = experiment.corrected or experiment.raw
        if has_force_displacement(record):
            draw_cycles(axes, record)
        if has_force_displacement(experiment.prepared):
            data = experiment.prepared
            few = data.n_samples <= 25
            for piece in _cycle_pieces(data):
                axes.plot(
                    *_over_displacement(data, piece), color=BLUE, linewidth=2.2, marker="o" if few else "",
                    markersize=3.5, label="used for the fit" if piece.start == 0 else None, zorder=4,
                )  # fmt: skip
        _force_displacement_axes(axes, experiment.name)
        axes.legend(loc="upper left")
        return figure


def draw_record(data: Dataset) -> Figure:
    """A dataset as recorded: force and angles over displacement if measured, otherwise each channel over time."""
    with house_style():
        if has_force_displacement(data):
            angles = [name for name in _ANGLES if name in data.channels]
            figure = new_figure(5.2, 3.5 + 2.1 * len(angles))
            axes, *beneath = figure.subplots(1 + len(angles), 1, squeeze=False)[:, 0]
            draw_cycles(axes, data)
            _force_displacement_axes(axes, data.name)
            axes.legend(loc="upper left")
            for below, name in zip(beneath, angles, strict=True):
                draw_cycles(below, data, name)
                below.set_xlabel("Displacement [mm]")
                below.set_ylabel(scale_of("rad").axis(channel_label(name)))
                below.set_xlim(axes.get_xlim())
            return figure
        names = [name for name in data.channels if name != "time" and not is_deviation(name)] or ["time"]
        figure = new_figure(5.2, 1.2 + 1.5 * len(names))
        stack = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        timed = "time" in data.channels and names != ["time"]
        x = data.values("time") if timed else np.arange(data.n_samples)
        for axes, name in zip(stack, names, strict=True):
            scale = scale_of(data.channels[name].unit)
            axes.plot(x, data.values(name) / scale.factor, color=BLUE, linewidth=1.2)
            axes.set_ylabel(scale.axis(channel_label(name)))
        stack[0].set_title(data.name)
        stack[-1].set_xlabel("Time [s]" if timed else "Sample")
        return figure


def draw_cycles(axes: Axes, data: Dataset, channel: str = "tension") -> None:
    """Cycles of force, or another channel, over displacement: samples outside cycles, the first cycle, later ones."""
    if data.cycle is None:
        axes.plot(*_over_displacement(data, slice(None), channel), color=MUTED, linewidth=1.0, label="as measured")
        return
    seen: set[str] = set()
    first = float(np.min(data.cycle[data.cycle >= 0], initial=np.inf))
    last = int(np.max(data.cycle, initial=0))
    for piece in _cycle_pieces(data):
        number = data.cycle[piece.start]
        if number < 0:
            label, colour, line = "outside any cycle", MUTED, ":"
        elif number == first:
            label, colour, line = f"cycle {int(number) + 1}", ORANGE, "-"
        else:
            label, colour, line = f"cycles {int(first) + 2} to {last + 1}", LOOP, "-"
        axes.plot(
            *_over_displacement(data, piece, channel), color=colour, linestyle=line, linewidth=1.2,
            label=None if label in seen else label, zorder=3 if number == first else 2,
        )  # fmt: skip
        seen.add(label)


def _cycle_pieces(data: Dataset) -> list[slice]:
    if data.cycle is None:
        return [slice(0, data.n_samples)]
    cuts = [0, *(np.flatnonzero(np.diff(data.cycle)) + 1).tolist(), data.n_samples]
    return [slice(start, stop) for start, stop in pairwise(cuts)]


def _over_displacement(data: Dataset, rows: slice, channel: str = "tension") -> tuple[Floats, Floats]:
    shown = data.values(channel)[rows] / scale_of(data.channels[channel].unit).factor
    return data.values("shortening")[rows] / scale_of("m").factor, shown


def _force_displacement_axes(axes: Axes, title: str) -> None:
    axes.set_title(title)
    axes.set_xlabel("Displacement [mm]")
    axes.set_ylabel("Cable force [N]")
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))


def draw_trajectory(path: TrajectoryPanels, width: float = 5.2) -> Figure:
    """Paper A's Fig. 6: measured and simulated channels over the trajectory, the residual beneath each.

    width: of the figure [in].
    """
    rows: list[tuple[TrajectoryPanel, str]] = []
    for panel in path.panels:
        rows.append((panel, "values"))
        if panel.residual is not None:
            rows.append((panel, "residual"))
    heights = [2.0 if kind == "values" else 0.85 for _, kind in rows]
    with house_style():
        figure = new_figure(width, 0.9 + sum(heights) * 0.92)
        stack = figure.subplots(len(rows), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axes, (panel, kind) in zip(stack, rows, strict=True):
            if kind == "values":
                _draw_values(axes, path, panel)
            else:
                _draw_residual(axes, path, panel)
        stack[0].set_title(path.experiment)
        # Beside the title, where it covers no curve.
        stack[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
        stack[-1].set_xlabel(path.abscissa.label)
        figure.align_ylabels(list(stack))
        return figure


def _draw_values(axes: Axes, path: TrajectoryPanels, panel: TrajectoryPanel) -> None:
    few = len(panel.simulated) <= 60
    for piece in path.pieces:
        named = piece.start == 0
        x = path.abscissa.values[piece]
        if panel.measured is not None:
            axes.plot(
                x, panel.measured[piece], color=MEASURED, linestyle="" if few else "-", marker="o" if few else "",
                markersize=3.5, markerfacecolor="none", linewidth=2.6, alpha=1.0 if few else 0.45,
                label="measured" if named else None,
            )  # fmt: skip
        axes.plot(
            x, panel.simulated[piece], color=SIMULATED, marker=_lone(piece), markersize=4.5,
            label="simulated" if named else None,
        )  # fmt: skip
    axes.set_ylabel(panel.scale.axis(panel.label))
    if panel.measured is None:
        text = f"{panel.label.lower()} was not measured"
        axes.text(0.02, 0.95, text, transform=axes.transAxes, va="top", fontsize=8.5, color=MUTED)


def _draw_residual(axes: Axes, path: TrajectoryPanels, panel: TrajectoryPanel) -> None:
    assert panel.residual is not None  # noqa: S101 - the caller lists residual rows only where there is one
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for piece in path.pieces:
        x, off = path.abscissa.values[piece], panel.residual[piece]
        axes.plot(x, off, color=SIMULATED, linewidth=1.2, marker=_lone(piece), markersize=4.5)
    reach = 1.15 * float(np.nanmax(np.abs(panel.residual))) or 1.0
    axes.set_ylim(-reach, reach)
    axes.set_ylabel(panel.scale.axis("Residual"))
    axes.locator_params(axis="y", nbins=3)


def _lone(piece: slice) -> str:
    """Plot marker for a piece of one sample, which a line does not show."""
    return "D" if piece.stop - piece.start == 1 else ""


def draw_overview(content: ReportContent, result: CalibrationResult) -> Figure:
    """All experiments of one calibration: measured force as points, the twin as lines, over the cable's travel."""
    from matplotlib.lines import Line2D

    found = {name: overview_curves(content.experiments[name], result) for name in result.experiments}
    drawn = {name: curves for name, curves in found.items() if curves is not None}
    alone, columns = len(drawn) == 1, _legend_columns(drawn)
    with house_style():
        figure = new_figure(5.2, 3.5 + 0.19 * (1 if alone else math.ceil(len(drawn) / columns)))
        axes = figure.add_subplot()
        handles: list[Line2D] = []
        for index, (name, ((x, y), (x_twin, y_twin))) in enumerate(drawn.items()):
            look, most = _look(index), 40 if len(drawn) < 4 else 20
            shown = np.unique(np.linspace(0, len(x) - 1, min(len(x), most)).round().astype(int))
            points: dict[str, Any] = {"marker": look.marker, "markersize": 4, "markerfacecolor": "white"}
            line: dict[str, Any] = {"linestyle": look.line, "linewidth": 1.8}
            axes.plot(x[shown], y[shown], color=look.colour, linestyle="", **points)
            axes.plot(x_twin, y_twin, color=look.colour, **line)
            if alone:
                handles.append(Line2D([], [], color=look.colour, linestyle="", label=f"{name}, measured", **points))
                handles.append(Line2D([], [], color=look.colour, label="twin", **line))
            else:
                handles.append(Line2D([], [], color=look.colour, label=name, **points, **line))
        _force_displacement_axes(axes, "Measured force (points) and the twin (lines)")
        figure.legend(handles=handles, loc="outside lower center", ncols=2 if alone else columns)
        return figure


@dataclass(frozen=True)
class _Look:
    colour: str
    marker: str
    line: str


def _look(index: int) -> _Look:
    """Style of test number `index`: a colour and a marker; markers and line styles change when the colours repeat."""
    turn, place = divmod(index, len(SERIES))
    return _Look(SERIES[place], "osD^vP"[(place + turn) % 6], ("-", "--", ":", "-.")[turn % 4])


def _legend_columns(names: Collection[str]) -> int:
    """Number of legend columns that fit the longest name, reduced to make the rows even."""
    widest = 0.6 + 0.065 * max(map(len, names), default=0)  # [in], with the handle
    most = max(1, min(3, int(5.0 / widest)))
    return math.ceil(len(names) / math.ceil(len(names) / most)) if names else 1


def overview_curves(
    experiment: ExperimentContent, result: CalibrationResult
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]] | None:
    """Measured and simulated (travel [mm], force [N]), or None where the compared samples do not match the data."""
    fit, data, factor = result.experiments[experiment.name], experiment.prepared, scale_of("m").factor
    compared = "tension" if experiment.drive == "shortening" else "shortening"
    driven = data.channels.get(experiment.drive)
    if driven is None or compared not in fit.measured or len(fit.measured[compared]) != data.n_samples:
        return None
    measured, simulated = (np.asarray(side[compared], dtype=np.float64) for side in (fit.measured, fit.simulated))
    if compared == "tension":
        return (driven.values / factor, measured), (driven.values / factor, simulated)
    return (measured / factor, driven.values), (simulated / factor, driven.values)
