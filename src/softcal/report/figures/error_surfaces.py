"""Paper B's Fig. 3: the error of each section over the grid of a sweep, cell by cell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.analysis.sweep import ALL
from softcal.calibration.results.result import SweepResult
from softcal.checks import Floats
from softcal.report import surfaces
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import Scale, joined, number, parameter_label, scale_of
from softcal.report.style import (
    FAINT,
    INK,
    ORANGE,
    SEQUENTIAL,
    house_style,
    is_uneven,
    new_figure,
    plain_log_ticks,
)
from softcal.report.surfaces import ErrorSurface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The colour scale covers the lower part of the errors; the few largest share the last colour.
_SHOWN = 0.95


@register_figure("compared", place=1)
def error_surfaces(content: ReportContent) -> Iterator[Drawing]:
    """The error of each section over two parameters of a sweep, cell by cell."""
    compared = content.compared
    nominal = {} if compared is None or compared.nominal is None else compared.nominal.parameters
    for result in content.sweeps.values():
        pair, found = surfaces.searched_pair(result), surfaces.error_surfaces(result)
        if pair is None or not found:
            continue
        others = [parameter_label(name) for name in result.parameters if name not in pair]
        held = f", {joined(others)} as in the best cell" if others else ""
        caption = (
            f"Error in every cell of the sweep, section by section{held}; dark is better, each panel has its own "
            "scale; star: best cell; empty: not simulated."
        )
        yield Drawing(
            draw_surfaces(result, pair, found, nominal),
            caption,
            title=f"Error over {joined(map(parameter_label, pair))}",
        )


def draw_surfaces(
    result: SweepResult, pair: tuple[str, str], surfaces: Sequence[ErrorSurface], nominal: Mapping[str, float]
) -> Figure:
    """A panel per surface: cells coloured by error, failed cells empty, the best one marked.

    Parameters
    ----------
    result
        The sweep.
    pair
        Names of the two parameters, across and up.
    surfaces
        Errors over the two, a panel for each.
    nominal
        Nominal values by parameter [SI], marked where they lie within the grid.
    """
    columns = min(3, len(surfaces))
    rows = math.ceil(len(surfaces) / columns)
    x_scale, y_scale = (scale_of(result.parameters[n].unit, result.parameters[n].upper) for n in pair)
    with house_style():
        figure = new_figure(0.6 + 3.3 * columns, 0.5 + 2.75 * rows)
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, surface in zip(panels.flat, surfaces, strict=False):
            _draw_cells(figure, axes, surface, x_scale, y_scale)
            at = tuple(nominal[n] / s.factor for n, s in zip(pair, (x_scale, y_scale), strict=True) if n in nominal)
            if len(at) == 2:
                (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
                if left <= at[0] <= right and bottom <= at[1] <= top:
                    axes.plot(*at, "D", markersize=6, markerfacecolor="white", markeredgecolor=INK, linestyle="",
                              label="nominal values", zorder=5)  # fmt: skip
            axes.set_title("all sections" if surface.section == ALL else surface.section)
            least = f"best {number(surface.best[2])} {surface.unit}".rstrip()
            axes.set_title(least, loc="right", fontsize=8.5, fontweight="normal")
        for k, axes in enumerate(panels.flat[: len(surfaces)]):
            if k + columns >= len(surfaces):
                axes.set_xlabel(x_scale.axis(parameter_label(pair[0], result.parameters)))
                axes.tick_params(labelbottom=True)
            if k % columns == 0:
                axes.set_ylabel(y_scale.axis(parameter_label(pair[1], result.parameters)))
        # One legend for all panels, in an unused panel if there is one.
        drawn = list(panels.flat[: len(surfaces)])
        empty = list(panels.flat[len(surfaces) :])
        handles: dict[str, Any] = {}
        for axes in drawn:
            handles.update({label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)})
        for axes in empty:
            axes.set_axis_off()
        if empty:
            empty[0].legend(list(handles.values()), list(handles), loc="center")
        else:
            figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3)
        return figure


def _draw_cells(figure: Figure, axes: Axes, surface: ErrorSurface, x_scale: Scale, y_scale: Scale) -> None:
    from matplotlib.colors import LogNorm

    x, y = surface.x / x_scale.factor, surface.y / y_scale.factor
    errors = surface.error[np.isfinite(surface.error)]
    # Logarithmic colours, since what matters are ratios of errors; one colour more where all are alike.
    low = max(float(errors.min()), 1e-6 * float(errors.max()), 1e-300)
    high = max(float(np.quantile(errors, _SHOWN)), 1.05 * low)
    shown = axes.pcolormesh(
        _edges(x), _edges(y), np.ma.masked_invalid(surface.error), cmap=SEQUENTIAL,
        norm=LogNorm(low, high, clip=True), edgecolors="white", linewidth=0.4,
    )  # fmt: skip
    bar = figure.colorbar(
        shown, ax=axes, pad=0.02, aspect=22, extend="max" if errors.max() > 1.001 * high else "neither"
    )
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.set_label(f"Error [{surface.unit}]" if surface.unit else "Loss", fontsize=8.5)
    plain_log_ticks(bar.ax.yaxis, low, high)
    if len(surface.failed):
        axes.plot(
            surface.failed[:, 0] / x_scale.factor, surface.failed[:, 1] / y_scale.factor, "x", color=FAINT,
            markersize=4, label="could not be simulated",
        )  # fmt: skip
    at = (surface.best[0] / x_scale.factor, surface.best[1] / y_scale.factor)
    axes.plot(*at, "*", markersize=13, color=ORANGE, markeredgecolor=INK, linestyle="", zorder=6, label="best cell")
    for values, axis, set_scale in ((x, axes.xaxis, axes.set_xscale), (y, axes.yaxis, axes.set_yscale)):
        if is_uneven(values):
            set_scale("log")
            plain_log_ticks(axis, float(values[0]), float(values[-1]))
    axes.grid(False)


def _edges(values: Floats) -> Floats:
    """Where cells around ascending values begin and end, on the scale that the axis is drawn on."""
    if len(values) == 1:
        reach = 0.5 * abs(float(values[0])) or 0.5
        return np.array([values[0] - reach, values[0] + reach])
    shown = np.log(values) if is_uneven(values) else values
    middles = 0.5 * (shown[1:] + shown[:-1])
    edges = np.concatenate([[2 * shown[0] - middles[0]], middles, [2 * shown[-1] - middles[-1]]])
    return np.exp(edges) if is_uneven(values) else edges
