"""Bars of Sobol indices: what decides the loss and every kind of channel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from softcal.analysis.importance import ImportanceStudy
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import parameter_label
from softcal.report.style import BLUE, INK, RED, SKY, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@register_figure("parameters", place=2)
def importance(content: ReportContent) -> Iterator[Drawing]:
    """Which parameter decides which output over the bounds: Sobol indices, beside fANOVA's importances."""
    if content.importance is not None and content.importance.outputs:
        by_trials = "; diamonds: fANOVA by the trials" if content.importance.fanova else ""
        caption = (
            "Share of the variance of each output over the bounds of the search that a parameter explains: alone "
            f"(dark), and together with others (light). Lines: 95 % intervals{by_trials}."
        )
        yield Drawing(draw_importance(content.importance), caption, title="Which parameter decides what")


def draw_importance(study: ImportanceStudy) -> Figure:
    """A panel per output, a bar per parameter."""
    labels = list(study.ranges)
    places = np.arange(len(labels))[::-1]
    with house_style():
        figure = new_figure(2.2 + 2.0 * len(study.outputs), 1.2 + 0.3 * len(labels))
        panels = figure.subplots(1, len(study.outputs), sharey=True, squeeze=False)[0]
        for axes, (name, output) in zip(panels, study.outputs.items(), strict=True):
            first, total = ([held[label] for label in labels] for held in (output.first, output.total))
            axes.barh(places, [max(one.value, 0.0) for one in total], height=0.6, color=SKY, label="with others")
            axes.barh(places, [max(one.value, 0.0) for one in first], height=0.6, color=BLUE, label="alone")
            errors = [one.error for one in total]
            axes.errorbar([one.value for one in total], places, xerr=errors, fmt="none", ecolor=INK, elinewidth=0.9)
            if name == "loss" and study.fanova:
                shares = [study.fanova[label] for label in labels]
                axes.plot(shares, places, "D", markersize=4, color=RED, linestyle="none", label="fANOVA")
            axes.set_title(name)
            axes.set_xlim(0.0, 1.05)
            axes.set_yticks(places, [parameter_label(label, labels) for label in labels])
            axes.grid(visible=False, axis="y")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return figure
