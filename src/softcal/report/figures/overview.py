"""The measured force and the twin's, of every experiment of the headline."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.calibration.results.result import SearchResult
from softcal.checks import Floats
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.force_displacement import force_displacement_axes
from softcal.report.format import result_label, scale_of
from softcal.report.headline import headline
from softcal.report.style import SERIES, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@register_figure("overview")
def overview(content: ReportContent) -> Iterator[Drawing]:
    """Force over displacement of all experiments of the headline, measured and simulated."""
    if has_curves(content):
        whose = headline(content).twin
        caption = f"Measured cable force (points) and {whose} (lines): {result_label(content.headline)}."
        yield Drawing(draw_overview(content, content.headline_result), caption, title="Measured force and the twin")


def has_curves(content: ReportContent) -> bool:
    """Whether there is an experiment whose force over displacement can be drawn."""
    result = content.headline_result
    return any(overview_curves(content.experiments[name], result) for name in result.experiments)


def draw_overview(content: ReportContent, result: SearchResult) -> Figure:
    """All experiments of one calibration: measured force as points, the twin as lines, over the cable's travel."""
    from matplotlib.lines import Line2D

    pairs = {name: overview_curves(content.experiments[name], result) for name in result.experiments}
    drawn = {name: curves for name, curves in pairs.items() if curves is not None}
    # As many columns of the legend as fit the longest name, fewer where that makes the rows even.
    widest = 0.6 + 0.065 * max(map(len, drawn), default=0)  # [in], with the handle
    most = max(1, min(3, int(5.0 / widest)))
    alone, columns = len(drawn) == 1, (math.ceil(len(drawn) / math.ceil(len(drawn) / most)) if drawn else 1)
    with house_style():
        figure = new_figure(5.2, 3.5 + 0.19 * (1 if alone else math.ceil(len(drawn) / columns)))
        axes = figure.add_subplot()
        handles: list[Line2D] = []
        for index, (name, ((x, y), (x_twin, y_twin))) in enumerate(drawn.items()):
            # Markers and line styles change when the colours repeat.
            turn, place = divmod(index, len(SERIES))
            colour, marker, style = SERIES[place], "osD^vP"[(place + turn) % 6], ("-", "--", ":", "-.")[turn % 4]
            most = 40 if len(drawn) < 4 else 20
            shown = np.unique(np.linspace(0, len(x) - 1, min(len(x), most)).round().astype(int))
            points: dict[str, Any] = {"marker": marker, "markersize": 4, "markerfacecolor": "white"}
            line: dict[str, Any] = {"linestyle": style, "linewidth": 1.8}
            axes.plot(x[shown], y[shown], color=colour, linestyle="", **points)
            axes.plot(x_twin, y_twin, color=colour, **line)
            if alone:
                handles.append(Line2D([], [], color=colour, linestyle="", label=f"{name}, measured", **points))
                handles.append(Line2D([], [], color=colour, label="twin", **line))
            else:
                handles.append(Line2D([], [], color=colour, label=name, **points, **line))
        force_displacement_axes(axes, "Measured force (points) and the twin (lines)")
        figure.legend(handles=handles, loc="outside lower center", ncols=2 if alone else columns)
        return figure


def overview_curves(
    experiment: ExperimentContent, result: SearchResult
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
