"""The estimates of a parameter with their intervals, by calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from softcal.calibration.results.digits import estimate_text, half_width
from softcal.calibration.results.result import SearchResult
from softcal.calibration.statistics.estimate import Estimate
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import (
    Scale,
    estimate_scale,
    ordered_parameters,
    parameter_label,
    result_label,
)
from softcal.report.headline import headline
from softcal.report.style import BLUE, FAINT, INK, MUTED, RED, house_style, new_figure
from softcal.twin.parameter_name import parameter_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@register_figure("parameters", place=1)
def parameter(content: ReportContent) -> Iterator[Drawing]:
    """Every parameter's estimates and 95 % intervals, by calibration."""
    names = list(dict.fromkeys(parameter_name(name).base for name in ordered_parameters(content.results)))
    for name in names:
        label = parameter_label(name, names)
        caption = forest_caption(name, label, content.results, headline(content).kind)
        title = f"Estimates of {label} with their 95 % intervals"
        yield Drawing(draw_forest(name, label, content.results), caption, of=name, title=title)


def forest_rows(base: str, results: Mapping[str, SearchResult]) -> dict[str, Estimate]:
    """Row label -> estimate of one parameter (name without experiment) over all calibrations and experiments."""
    rows: dict[str, Estimate] = {}
    for label, result in results.items():
        for name, estimate in result.parameters.items():
            parts = parameter_name(name)
            if parts.base == base:
                own = not parts.experiment or parts.experiment == label
                rows[label if own else f"{parts.experiment}, {result_label(label).lower()}"] = estimate
    return rows


def draw_forest(name: str, label: str, results: Mapping[str, SearchResult]) -> Figure:
    """Forest plot of one parameter over the calibrations that have it: value, 95 % interval if known, bounds.

    Parameters
    ----------
    name
        The parameter.
    label
        Its label, as distinct from the other parameters.
    results
        Label -> calibration.
    """
    rows = forest_rows(name, results)
    with house_style():
        figure = new_figure(5.2, 1.3 + 0.42 * len(rows))
        draw_estimates(axes := figure.add_subplot(), label, rows)
        if axes.get_legend_handles_labels()[1]:
            figure.legend(loc="outside lower center", ncols=2)
        return figure


def draw_estimates(axes: Axes, label: str, rows: Mapping[str, Estimate]) -> None:
    """A forest plot in given axes.

    Parameters
    ----------
    axes
        Where it is drawn.
    label
        The parameter's label.
    rows
        Label -> estimate, from the top.
    """
    first = next(iter(rows.values()))
    scale = estimate_scale(first)
    draw_rows(axes, rows, scale)
    low, high = min(e.lower for e in rows.values()), max(e.upper for e in rows.values())
    reach = [edge for estimate in rows.values() for edge in interval(estimate)]
    near_low, near_high = min(reach), max(reach)
    margin = 0.15 * (near_high - near_low) or 0.1 * abs(near_high) or 1.0
    left, right = (
        max(near_low - margin, low - 0.02 * (high - low)),
        min(near_high + margin, high + 0.02 * (high - low)),
    )
    axes.set_xlim(left / scale.factor, right / scale.factor)
    for bound in (low, high):
        if left <= bound <= right:
            named = "bound" if "bound" not in axes.get_legend_handles_labels()[1] else None
            axes.axvline(bound / scale.factor, color=MUTED, linestyle="--", linewidth=1.0, label=named)
    axes.set_title(label)
    axes.set_xlabel(scale.axis(label))


def forest_caption(name: str, label: str, results: Mapping[str, SearchResult], kind: str) -> str:
    """Caption of a parameter's chart.

    Parameters
    ----------
    name
        The parameter.
    label
        Its label.
    results
        Label -> calibration.
    kind
        What the results are, such as "calibration".
    """
    having = forest_rows(name, results).values()
    drawn = [estimate for estimate in having if estimate.interval is not None or estimate.standard_error]
    bars = "bars are 95 % intervals" if drawn else "no intervals are known"
    marker = "; open marker: at a bound" if any(estimate.at_bound for estimate in having) else ""
    return f"{label} ({name}) by {kind}; {bars}{marker}."


def draw_rows(axes: Axes, rows: Mapping[str, Estimate], scale: Scale) -> None:
    """A row of each label: its estimate with its interval.

    Parameters
    ----------
    axes
        Where they are drawn, in units of the scale.
    rows
        Label -> estimate, from the top.
    scale
        Display scale of the values.
    """
    for row, (label, estimate) in enumerate(rows.items()):
        joint = label == "joint"
        colour = RED if estimate.at_bound else INK if joint else BLUE
        value = estimate.value / scale.factor
        low, high = (edge / scale.factor for edge in interval(estimate))
        axes.plot([low, high], [row, row], color=colour, linewidth=2.0, solid_capstyle="butt")
        axes.plot(
            [value], [row], marker="D" if joint else "o", markersize=6, color=colour,
            markerfacecolor="white" if estimate.at_bound else colour,
        )  # fmt: skip
        suffix = ", at a bound" if estimate.at_bound else ""
        axes.annotate(
            f"{estimate_text(estimate)}{suffix}", (value, row), xytext=(0, 6), textcoords="offset points", ha="center",
            fontsize=8, color=INK, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6},
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [result_label(label) for label in rows])
    axes.set_ylim(len(rows) - 0.45, -0.75)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", color=FAINT, alpha=0.4)


def interval(estimate: Estimate) -> tuple[float, float]:
    """The 95 % interval; the value twice if there is no standard error."""
    if estimate.interval is not None:
        return estimate.interval
    reach = half_width(estimate) or 0.0
    return estimate.value - reach, estimate.value + reach
