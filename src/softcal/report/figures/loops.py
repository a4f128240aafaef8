"""Whole cycles over the travel: effort and angles, measured and simulated, and the energy that each cycle loses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from softcal.calibration.results.result import ExperimentFit
from softcal.experiments.dataset import Dataset
from softcal.experiments.driven import DrivenChannels
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import axis_label, channel_scale, file_stem, result_label
from softcal.report.style import MEASURED, SIMULATED, count_axis, house_style, new_figure
from softcal.sensing.sensors.pose import ANGLES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@register_figure("fit", place=1)
def loops(content: ReportContent) -> Iterator[Drawing]:
    """Effort and angles over the coordinate through whole cycles, and the energy that each of them loses."""
    for label, result in content.results.items():
        for name, fit in result.experiments.items():
            if not fit.cycles or fit.driven is None:
                continue
            alone = file_stem(label) == file_stem(name)
            who = name if alone else f"{name}, {result_label(label)}"
            caption = f"{who}: whole cycles, measured and simulated, and the energy that each of them loses."
            figure = draw_loops(name, content.experiments[name].prepared, fit, fit.driven)
            yield Drawing(figure, caption, of=name if alone else f"{name} by {label}", title=f"Whole cycles: {who}")


def draw_loops(title: str, data: Dataset, fit: ExperimentFit, of: DrivenChannels) -> Figure:
    """Panels of effort and of every compared angle over the coordinate, and of the energy lost by cycle.

    Parameters
    ----------
    title
        Title of the figure.
    data
        The samples, with their cycles.
    fit
        Their measured and simulated values, and the energies of each cycle.
    of
        The actuator that goes through the cycles.
    """
    angles = [kind.name for kind in ANGLES if kind.name in fit.simulated]
    coordinate, effort = of.names
    cycle = np.zeros(data.n_samples) if data.cycle is None else data.cycle
    with house_style():
        figure = new_figure(5.2, 3.5 + 2.2 * (len(angles) + 1))
        heights = [3.2, *(2.2 for _ in angles), 1.8]
        axes, *others, last = figure.subplots(len(heights), 1, height_ratios=heights)
        for below, channel in zip([axes, *others], [effort, *angles], strict=True):
            scale = channel_scale(fit.units[channel])
            for family, colour, width in ((fit.measured, MEASURED, 1.1), (fit.simulated, SIMULATED, 1.3)):
                travel = family.get(coordinate, fit.measured[coordinate]) / channel_scale(fit.units[coordinate]).factor
                values = family.get(channel, fit.measured[channel]) / scale.factor
                shown = np.isfinite(travel) & np.isfinite(values) & (cycle >= 0)
                name = "measured" if family is fit.measured else "simulated"
                below.plot(travel[shown], values[shown], color=colour, linewidth=width, alpha=0.75, label=name)
            below.set_xlabel(axis_label(coordinate))
            below.set_ylabel(axis_label(channel))
        axes.set_title(title)
        axes.legend(loc="upper left")
        numbers = np.array([cycle.measured.number + 1 for cycle in fit.cycles])
        for k, (colour, name) in enumerate(((MEASURED, "measured"), (SIMULATED, "simulated"))):
            lost = [1e3 * getattr(cycle, name).lost_energy for cycle in fit.cycles]
            last.bar(numbers + 0.4 * (k - 0.5), lost, width=0.38, color=colour, alpha=0.8, label=name)
        last.set_ylabel("Lost [mJ]")
        count_axis(last, "Cycle")
        last.grid(visible=False, axis="x")
        figure.align_ylabels([axes, *others, last])
        return figure
