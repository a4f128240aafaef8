"""Charts of the estimates: intervals by calibration, and the plausible range of Eq. (5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from softcal.calibration.result import CalibrationResult, Estimate
from softcal.materials.infill import PrintInfill
from softcal.report.format import (
    NORMAL_95,
    Scale,
    estimate_scale,
    estimate_text,
    find_parameter,
    number,
    parameter_label,
    parameter_name,
    result_label,
    scale_of,
)
from softcal.report.style import BLUE, FAINT, GREEN, INK, MUTED, RED, house_style, new_figure, plain_log_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def forest_rows(base: str, results: Mapping[str, CalibrationResult]) -> dict[str, Estimate]:
    """Row label -> estimate of one parameter (name without experiment) over all calibrations and experiments."""
    rows: dict[str, Estimate] = {}
    for label, result in results.items():
        for name, estimate in result.parameters.items():
            parts = parameter_name(name)
            if parts.base == base:
                own = not parts.experiment or parts.experiment == label
                rows[label if own else f"{parts.experiment}, {result_label(label).lower()}"] = estimate
    return rows


def draw_forest(name: str, results: Mapping[str, CalibrationResult]) -> Figure:
    """Forest plot of one parameter over the calibrations that have it: value, 95 % interval if known, bounds."""
    rows = forest_rows(name, results)
    with house_style():
        figure = new_figure(5.2, 1.3 + 0.42 * len(rows))
        axes = figure.add_subplot()
        first = next(iter(rows.values()))
        scale = estimate_scale(first)
        _draw_rows(axes, rows, scale)
        low, high = min(e.lower for e in rows.values()), max(e.upper for e in rows.values())
        reach = [edge for estimate in rows.values() for edge in _interval(estimate)]
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
        axes.set_title(parameter_label(name))
        axes.set_xlabel(scale.axis(parameter_label(name)))
        if axes.get_legend_handles_labels()[1]:
            figure.legend(loc="outside lower center", ncols=2)
        return figure


def forest_caption(name: str, results: Mapping[str, CalibrationResult]) -> str:
    """Caption of a parameter's chart."""
    having = forest_rows(name, results).values()
    drawn = [estimate for estimate in having if estimate.interval is not None or estimate.standard_error]
    bars = "bars are 95 % intervals" if drawn else "no intervals are known"
    bars += " within the bounds" if any(estimate.is_held for estimate in drawn) else ""
    marker = "; open marker: at a bound" if any(estimate.at_bound for estimate in having) else ""
    return f"{parameter_label(name)} ({name}) by calibration; {bars}{marker}."


def draw_plausible_modulus(infill: PrintInfill, results: Mapping[str, CalibrationResult]) -> Figure | None:
    """Eq. (5): plausible range of E for this print, with the estimates; None if no E was calibrated."""
    rows: dict[str, Estimate] = {}
    for label, result in results.items():
        name = find_parameter(result.parameters, "youngs_modulus")
        if name is not None:
            rows[label] = result.parameters[name]
    if not rows:
        return None
    scale = scale_of("Pa")
    low, high = (bound / scale.factor for bound in infill.effective_modulus)
    bulk = [bound / scale.factor for bound in infill.bulk_youngs_modulus]
    with house_style():
        figure = new_figure(5.2, 1.9 + 0.38 * len(rows))
        axes = figure.add_subplot()
        axes.axvspan(low, high, color=GREEN, alpha=0.18, linewidth=0)
        axes.axvspan(*bulk, color=MUTED, alpha=0.15, linewidth=0)
        _draw_rows(axes, rows, scale)
        values = [edge / scale.factor for estimate in rows.values() for edge in _interval(estimate)]
        plain_log_axis(axes, min(low, *(v for v in values if v > 0)) / 1.5, max(*bulk, *values) * 1.5)
        top = axes.get_xaxis_transform()
        axes.text((low * high) ** 0.5, 1.02, f"printed: {number(low)}–{number(high)} MPa", transform=top,
                  ha="center", va="bottom", fontsize=8.5, color=INK)  # fmt: skip
        axes.text((bulk[0] * bulk[1]) ** 0.5, 1.02, f"bulk: {bulk[0]:.3g}–{bulk[1]:.3g} MPa", transform=top,
                  ha="center", va="bottom", fontsize=8.5, color=MUTED)  # fmt: skip
        axes.set_xlabel("E [MPa]")
        gamma = f"{infill.exponent[0]:.3g}–{infill.exponent[1]:.3g}"
        figure.suptitle(
            f"$E_\\mathrm{{eff}} = E_\\mathrm{{bulk}}\\,\\phi^\\gamma$,  φ = {infill.infill:.3g}, γ = {gamma}",
            fontsize=10,
        )
        return figure


def _draw_rows(axes: Axes, rows: Mapping[str, Estimate], scale: Scale) -> None:
    for row, (label, estimate) in enumerate(rows.items()):
        joint = label == "joint"
        colour = RED if estimate.at_bound else INK if joint else BLUE
        value = estimate.value / scale.factor
        low, high = (edge / scale.factor for edge in _interval(estimate))
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


def _interval(estimate: Estimate) -> tuple[float, float]:
    """The 95 % interval; the value twice if there is no standard error."""
    if estimate.interval is not None:
        return estimate.interval
    reach = NORMAL_95 * (estimate.standard_error or 0.0)
    return estimate.value - reach, estimate.value + reach
