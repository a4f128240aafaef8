"""Paper B's Fig. 4: the distance of every marker in every experiment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import result_label
from softcal.report.positions import MM, Place, places
from softcal.report.style import INK, SERIES, house_style, keep_tick_labels_apart, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Hatching distinguishes markers once the colours repeat.
_HATCHES = ("", "////", "....", "xxxx")


@register_figure("fit", place=2)
def distances(content: ReportContent) -> Iterator[Drawing]:
    """The distance of every marker from its measured position, by experiment."""
    for label, result in content.results.items():
        if found := places(result):
            caption = (
                f"{result_label(label)}: distance of every marker from its measured position; bars are means over "
                "the states, lines go to the largest"
            )
            held_out = any(place.held_out for place in found)
            caption += "; pale: held out of the fit and predicted." if held_out else "."
            yield Drawing(
                draw_distances(result_label(label), found),
                caption,
                of=label,
                title=f"Distance of the markers: {result_label(label)}",
            )


def draw_distances(title: str, found: Sequence[Place]) -> Figure:
    """Bars: mean distance; lines: largest; pale bars: held out of the fit and predicted."""
    markers = list(dict.fromkeys(marker for place in found for marker in place.fit.distances))
    length = found[0].fit.length
    factor = MM if length is None else 100 / length
    width = 0.8 / len(markers)
    with house_style():
        figure = new_figure(max(5.2, 0.9 + 0.75 * len(found)), 3.4)
        axes = figure.add_subplot()
        for k, marker in enumerate(markers):
            named = False
            for i, place in enumerate(found):
                distance = place.fit.distances.get(marker)
                if distance is None:
                    continue
                at, colour = i + (k - 0.5 * (len(markers) - 1)) * width, SERIES[k % len(SERIES)]
                axes.bar(
                    at, factor * distance.mean, 0.9 * width, color=colour, alpha=0.4 if place.held_out else 1.0,
                    label=None if named else marker, hatch=_HATCHES[k // len(SERIES) % len(_HATCHES)],
                    edgecolor="white", linewidth=0.0,
                )  # fmt: skip
                axes.plot([at, at], [factor * distance.mean, factor * distance.max], color=INK, linewidth=1.0)
                named = True
        names = [f"{place.experiment}\n(predicted)" if place.held_out else place.experiment for place in found]
        axes.set_xticks(range(len(found)), names)
        axes.grid(visible=False, axis="x")
        axes.set_ylabel("Distance [mm]" if length is None else "Distance [% of length]")
        axes.set_title(title)
        axes.legend(loc="upper left", ncols=min(len(markers), 4))
        axes.margins(y=0.2 + 0.09 * math.ceil(len(markers) / 4))
        keep_tick_labels_apart(axes)
        return figure
