"""Paper A's Eq. (5): the modulus that a print is expected to have, with the estimates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from softcal.calibration.results.result import SearchResult
from softcal.calibration.statistics.estimate import Estimate
from softcal.materials.infill import PrintInfill
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.parameter import draw_rows, interval
from softcal.report.format import find_parameter, number, scale_of
from softcal.report.style import GREEN, INK, MUTED, house_style, new_figure, plain_log_axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@register_figure("parameters", place=2)
def plausible_modulus(content: ReportContent) -> Iterator[Drawing]:
    """The calibrated moduli beside the range that the print's infill allows."""
    infill = content.print_infill
    figure = None if infill is None else draw_plausible_modulus(infill, content.results)
    if infill is not None and figure is not None:
        low, high = (number(bound / 1e6) for bound in infill.effective_modulus)
        caption = (
            f"Expected modulus of a print with {100 * infill.infill:.3g} % infill: {low} to {high} MPa (green); "
            "solid material: grey."
        )
        yield Drawing(figure, caption, title="The modulus that the infill makes plausible")


def draw_plausible_modulus(infill: PrintInfill, results: Mapping[str, SearchResult]) -> Figure | None:
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
        draw_rows(axes, rows, scale)
        values = [edge / scale.factor for estimate in rows.values() for edge in interval(estimate)]
        plain_log_axis(axes, min(low, *(v for v in values if v > 0)) / 1.5, max(*bulk, *values) * 1.5)
        top = axes.get_xaxis_transform()
        axes.text((low * high) ** 0.5, 1.02, f"printed: {number(low)}–{number(high)} MPa", transform=top,
                  ha="center", va="bottom", fontsize=8.5, color=INK)  # fmt: skip
        axes.text((bulk[0] * bulk[1]) ** 0.5, 1.02, f"bulk: {bulk[0]:.3g}–{bulk[1]:.3g} MPa", transform=top,
                  ha="center", va="bottom", fontsize=8.5, color=MUTED)  # fmt: skip
        axes.set_xlabel("E [MPa]")
        gamma = f"{infill.exponent[0]:.3g}–{infill.exponent[1]:.3g}"
        figure.suptitle(
            f"E_eff = E_bulk φ^γ, φ = {infill.infill:.3g}, γ = {gamma}",
            fontsize=10,
        )
        return figure
