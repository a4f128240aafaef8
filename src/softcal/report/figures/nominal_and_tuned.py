"""Paper B's Fig. 4: the error of every section in every state, nominal against tuned."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, groupby
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.report.comparison import NominalComparison, comparison
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.style import (
    BLUE,
    FAINT,
    INK,
    LOOP,
    MUTED,
    house_style,
    keep_tick_labels_apart,
    lay_out,
    new_figure,
    overlapping,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Bars are labelled with their value up to this many in a row.
_NUMBERED = 24
_LABELLED = 60  # states; of more, only the experiments are named
_BAR = 0.4


@register_figure("compared", place=2)
def nominal_and_tuned(content: ReportContent) -> Iterator[Drawing]:
    """The distance of every marker in every state, at the nominal values and at the tuned ones."""
    bars = comparison(content)
    if bars is not None:
        caption = f"Distance of every marker from its measured position, nominal and {bars.tuned_name}, in every state."
        yield Drawing(draw_comparison(bars), caption, title=f"Distance of the markers, nominal and {bars.tuned_name}")


def draw_comparison(bars: NominalComparison) -> Figure:
    """Bars of each marker's distance from its measured position: a row per marker, or one row for a single state."""
    n = len(bars.states)
    with house_style():
        if n == 1:
            figure = new_figure(max(6.5, 1.5 + 0.8 * len(bars.markers)), 3.2)
            axes = figure.add_subplot()
            _draw_bars(axes, bars.nominal[:, 0], bars.tuned[:, 0], bars.tuned_name)
            axes.set_xticks(range(len(bars.markers)), bars.markers)
            axes.set_ylabel(f"Distance [{bars.unit}{' of length' if bars.unit == '%' else ''}]")
            axes.set_title(" ".join(dict.fromkeys(part for part in (bars.experiments[0], bars.states[0]) if part)))
            axes.legend(loc="upper left")
            axes.margins(y=0.18)
            keep_tick_labels_apart(axes)
            return figure
        width = min(max(5.2, 1.2 + 0.5 * n), 11.0)
        figure = new_figure(width, 1.2 + 1.45 * len(bars.markers))
        stack = figure.subplots(len(bars.markers), 1, squeeze=False, sharex=True)[:, 0]
        for row, axes in enumerate(stack):
            _draw_bars(axes, bars.nominal[row], bars.tuned[row], bars.tuned_name)
            axes.set_title(bars.markers[row])
            axes.margins(x=0.01, y=0.2)
            axes.set_ylabel(f"[{bars.unit}]")
        _name_states(stack[-1], bars)
        for axes in stack[:-1]:
            axes.tick_params(axis="x", length=0)
        unit = " [% of length]" if bars.unit == "%" else f" [{bars.unit}]"
        figure.supylabel(f"Distance from measured position{unit}", fontsize=9)
        for axes in stack:
            axes.set_ylabel("")
        numbers = [[t for t in axes.texts if t.get_text().replace(".", "", 1).isdigit()] for axes in stack]
        # The bars' labels are smaller where they overlap, and invisible where they still do.
        for size in (7.0, 6.0, 5.0):
            for text in chain(*numbers):
                text.set_fontsize(size)
            lay_out(stack[0])
            if not any(map(overlapping, numbers)):
                break
        else:
            for text in chain(*numbers):
                text.set_visible(False)
        handles, labels = stack[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=2)
        return figure


def _draw_bars(axes: Axes, nominal: Floats, tuned: Floats, tuned_name: str) -> None:
    at = np.arange(len(nominal))
    for shift, values, colour, name in ((-_BAR / 2, nominal, LOOP, "nominal"), (_BAR / 2, tuned, BLUE, tuned_name)):
        bars = axes.bar(at + shift, np.nan_to_num(values), _BAR * 0.94, color=colour, label=name)
        if len(at) <= _NUMBERED:
            digits = [".1g" if value < 0.095 else ".1f" if value < 9.95 else ".0f" for value in values]
            texts = [f"{v:{n}}" if np.isfinite(v) else "" for v, n in zip(values, digits, strict=True)]
            axes.bar_label(bars, texts, fontsize=7 if len(at) > 8 else 8, padding=1.5, color=INK)
    for i in np.flatnonzero(~np.isfinite(tuned)):
        axes.annotate(
            "not\nseen", (float(i), 0.0), (0, 2), textcoords="offset points", ha="center", fontsize=7, color=MUTED
        )
    axes.grid(visible=False, axis="x")


def _name_states(axes: Axes, bars: NominalComparison) -> None:
    """Label the axis with the states and, below them, their experiments."""
    groups = [(name, [i for i, _ in held]) for name, held in groupby(enumerate(bars.experiments), lambda item: item[1])]
    alone = all(len(held) == 1 for _, held in groups)
    if alone:
        names = [f"{name}\n{bars.states[held[0]]}".strip() for name, held in groups]
        axes.set_xticks(range(len(names)), names, rotation=90 if len(names) > 8 else 0)
        return
    axes.set_xticks(range(len(bars.states)), bars.states if len(bars.states) <= _LABELLED else [])
    crowded = len(bars.states) > 9
    axes.tick_params(axis="x", labelrotation=90 if crowded else 0, labelsize=8)
    longest = max(map(len, bars.states))
    below = -(0.34 + 0.055 * longest) if crowded else -0.34
    texts = [
        axes.text(
            float(np.mean(held)),
            below,
            name,
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize=9,
            color=INK,
            fontweight="bold",
        )
        for name, held in groups
        if len(held) > 1 or name not in bars.states[held[0]]
    ]
    lay_out(axes)
    if overlapping(texts):
        for text in texts:
            text.set_text(text.get_text().replace(" (", "\n(").replace("_", "_\n"))
        lay_out(axes)
    if overlapping(texts):
        for text in texts:
            text.set_text(text.get_text().replace("\n", ""))
            text.set_rotation(90)
    for _, held in groups[1:]:
        axes.axvline(held[0] - 0.5, ymin=below, color=FAINT, linewidth=0.8, clip_on=False)
    axes.tick_params(axis="x", color=MUTED)
