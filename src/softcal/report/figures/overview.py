"""The measured effort of actuators, such as cables' force, and the twin's, of every experiment of the headline."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.experiments.driven import driven_whole
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.force_displacement import effort_axes
from softcal.report.format import channel_scale, result_label
from softcal.report.headline import headline
from softcal.report.style import SERIES, house_style, new_figure
from softcal.sensing.channel import channel_name, in_a_word

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Curves = tuple[tuple[Floats, Floats], tuple[Floats, Floats]]
"""Coordinate and effort in display units, measured and simulated."""


@register_figure("overview")
def overview(content: ReportContent) -> Iterator[Drawing]:
    """Effort over coordinate of all experiments of the headline, measured and simulated, by the kind of actuator."""
    whose, charts = headline(content).twin, overview_curves(content)
    for pair, curves in charts.items():
        label, word = channel_name(pair[1]).label.lower(), in_a_word(pair[1])
        caption = f"Measured {label} (points) and {whose} (lines): {result_label(content.headline)}."
        of = word if len(charts) > 1 else ""
        yield Drawing(draw_overview(curves, pair), caption, of=of, title=f"Measured {word} and the twin")


def draw_overview(drawn: Mapping[str, Curves], pair: tuple[str, str]) -> Figure:
    """Experiments of one calibration: the measured effort as points, the twin as lines, over the coordinate.

    Parameters
    ----------
    drawn
        Experiment -> its curves.
    pair
        Kinds of channel of the coordinate and of the effort.
    """
    from matplotlib.lines import Line2D

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
        effort_axes(axes, f"Measured {in_a_word(pair[1])} (points) and the twin (lines)", pair)
        figure.legend(handles=handles, loc="outside lower center", ncols=2 if alone else columns)
        return figure


def overview_curves(content: ReportContent) -> dict[tuple[str, str], dict[str, Curves]]:
    """Kinds of coordinate and effort -> experiment of the headline -> its curves, of those with one actuator that is
    driven by the one and compared by the other at all samples.
    """
    found: dict[tuple[str, str], dict[str, Curves]] = {}
    for name, fit in content.headline_result.experiments.items():
        experiment = content.experiments[name]
        data, of = experiment.prepared, driven_whole(experiment.prepared)
        if of is None or experiment.drive not in of.names:
            continue
        (compared,) = set(of.names) - {experiment.drive}
        if len(fit.measured.get(compared, ())) != data.n_samples or compared not in fit.simulated:
            continue
        scale = channel_scale(data.channels[compared].unit).factor
        driven = data.values(experiment.drive) / channel_scale(data.channels[experiment.drive].unit).factor
        measured, simulated = (
            (driven, values) if compared == of.effort else (values, driven)
            for values in (np.asarray(side[compared]) / scale for side in (fit.measured, fit.simulated))
        )
        coordinate, effort = of.kinds
        found.setdefault((coordinate.name, effort.name), {})[name] = measured, simulated
    return found
