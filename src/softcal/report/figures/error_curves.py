"""The error of each section over a sweep of one parameter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from softcal.analysis.sweep import ALL
from softcal.calibration.results.result import SweepResult
from softcal.report import surfaces
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import parameter_label, scale_of
from softcal.report.style import INK, MUTED, ORANGE, SERIES, house_style, is_uneven, new_figure, plain_log_axis
from softcal.report.surfaces import ErrorCurve

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@register_figure("compared", place=1)
def error_curves(content: ReportContent) -> Iterator[Drawing]:
    """The error of each section over the parameter of a sweep."""
    for result in content.sweeps.values():
        if curves := surfaces.error_curves(result):
            caption = "Error over the sweep, section by section; star: best value."
            yield Drawing(
                draw_curves(result, curves),
                caption,
                title=f"Error over {parameter_label(next(iter(result.parameters)))}",
            )


def draw_curves(result: SweepResult, curves: Sequence[ErrorCurve]) -> Figure:
    """The error of every section over one parameter, the best values marked, failed ones left out."""
    (name,) = result.parameters
    scale = scale_of(result.parameters[name].unit, result.parameters[name].upper)
    units = list(dict.fromkeys(curve.unit for curve in curves))
    with house_style():
        figure = new_figure(5.2, 0.9 + 2.6 * len(units))
        stack = figure.subplots(len(units), 1, squeeze=False, sharex=True)[:, 0]
        for axes, unit in zip(stack, units, strict=True):
            for k, curve in enumerate(c for c in curves if c.unit == unit):
                colour, whole = SERIES[(k - 1) % len(SERIES)], curve.section == ALL
                x = curve.x / scale.factor
                axes.plot(
                    x, curve.error, color=INK if whole else colour, marker="o", markersize=3.5,
                    linewidth=2.0 if whole else 1.3, label="all sections" if whole else curve.section,
                )  # fmt: skip
                if np.isfinite(curve.error).any():
                    least = int(np.nanargmin(curve.error))
                    axes.plot(x[least], curve.error[least], marker="*", markersize=13, color=ORANGE,
                              markeredgecolor=INK, linestyle="", zorder=5)  # fmt: skip
            axes.set_ylabel(f"Error [{unit}]" if unit else "Loss")
            axes.set_ylim(bottom=0.0)
            axes.legend(loc="best", ncols=2)
        failed = [trial.theta[name] / scale.factor for trial in result.trials if trial.loss is None]
        if failed:
            stack[-1].plot(
                failed, np.zeros(len(failed)), "x", color=MUTED, markersize=5, clip_on=False,
                label="could not be simulated",
            )  # fmt: skip
            stack[-1].legend(loc="best", ncols=2)
        values = np.unique([trial.theta[name] / scale.factor for trial in result.trials])
        if is_uneven(values):
            plain_log_axis(stack[-1], float(values[0]) / 1.1, float(values[-1]) * 1.1)
        stack[-1].set_xlabel(scale.axis(parameter_label(name, result.parameters)))
        return figure
