"""The workspace: its shape and border, coloured by how far and how softly the robot moves; its singular poses."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from softcal.analysis.workspace import Workspace, compliance_unit, workspace_sentences
from softcal.checks import Floats
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import channel_scale, scale_of
from softcal.report.section import Block, Gallery, Small, register_section
from softcal.report.style import BLUE, FAINT, INK, RED, SEQUENTIAL, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORST = "mobility, worst direction"


@register_section("Where the robot reaches", place=85)
def workspace_section(content: ReportContent) -> Iterator[Block]:
    """The workspace of the calibrated twin."""
    if content.workspace_note:
        yield Small(content.workspace_note, alone=True)
    if content.workspace is not None:
        yield from workspace_sentences(content.workspace)
    yield Gallery()


@register_figure("workspace-section")
def workspace(content: ReportContent) -> Iterator[Drawing]:
    """The workspace within the limits of the commands: border, mobility, compliance, singular poses."""
    if content.workspace is not None:
        yield Drawing(draw_workspace(content.workspace), workspace_caption(content.workspace), title="The workspace")


def workspace_caption(found: Workspace) -> str:
    """Caption of the drawing."""
    ends = "; ".join(f"{name} {low:g} to {high:g} {found.units[name]}" for name, (low, high) in found.ranges.items())
    singular = " Diamonds: singular poses." if found.singular else ""
    compliance = (
        " Compliance: displacement by a force along the channel, the commands staying." if _softness(found) else ""
    )
    return (
        f"Equilibria at commands within {ends}. Dots: states on the border, beyond which no commands near them lead."
        f"{singular} Mobility in the worst direction: the share of the robot's extent, or of one radian, by which a "
        f"change of the commands by their whole range moves it there, to first order.{compliance}"
    )


def draw_workspace(found: Workspace) -> Figure:
    """A panel for the mobility and each compliance over one or two channels; over three, one for each pair of them."""
    from matplotlib.collections import LineCollection, PolyCollection

    k = len(found.channels)
    quantities: dict[str, Floats] = {WORST: np.array([state.mobility[-1] for state in found.states])}
    quantities |= _softness(found) if k < 3 else {}
    pairs = [*combinations(range(k), 2)] or [(0, 0)]
    panels = [(pair, label, values) for label, values in quantities.items() for pair in pairs]
    with house_style():
        figure = new_figure(1.0 + 3.6 * len(panels), 3.4)
        for axes, (pair, label, values) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            names = [found.channels[i] for i in pair]
            scales, border = [channel_scale(found.units[name]) for name in names], list(found.border)
            places = found.places[:, list(pair)] / [scale.factor for scale in scales]
            lost = [[state.channels[name] for name in names] for state in found.singular]
            lost = np.reshape(lost, (-1, 2)) / [scale.factor for scale in scales]
            if k == 1:
                order = np.argsort(places[:, 0])
                axes.plot(places[order, 0], values[order], color=BLUE)
                axes.plot(places[border, 0], values[border], "o", color=INK, markersize=4)
                for x in lost[:, 0]:
                    axes.axvline(x, color=RED, linestyle="--")
                axes.set(xlabel=scales[0].axis(names[0]), ylabel=label, ylim=(0.0, None))
                continue
            outline = list(places[np.array(found.outline)])
            if k == 2:
                shown = axes.tripcolor(  # pyright: ignore[reportCallIssue] (its stubs know no triangles by position)
                    places[:, 0], places[:, 1], np.array(found.simplices), values, cmap=SEQUENTIAL, shading="gouraud"
                )  # fmt: skip
                axes.add_collection(LineCollection(outline, colors=INK, linewidths=1.0))
                axes.plot(places[border, 0], places[border, 1], ".", color=INK, markersize=3)
            else:  # the states in front of the shape's silhouette
                axes.add_collection(PolyCollection(outline, facecolors=FAINT, edgecolors=FAINT))
                shown = axes.scatter(places[:, 0], places[:, 1], 5.0, values, cmap=SEQUENTIAL, linewidths=0.0)
            axes.plot(lost[:, 0], lost[:, 1], "D", color=RED, markersize=5)
            axes.autoscale_view()
            spans = np.ptp(places, axis=0)
            if scales[0].unit == scales[1].unit and spans.max() < 3.0 * spans.min():
                axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel=scales[0].axis(names[0]), ylabel=scales[1].axis(names[1]))
            axes.grid(visible=False)
            if k == 2 or pair == pairs[-1]:
                figure.colorbar(shown, ax=axes, pad=0.02, aspect=28, label=label)
        return figure


def _softness(found: Workspace) -> dict[str, Floats]:
    """Label -> compliance of all states, of those channels that have one."""
    labels: dict[str, Floats] = {}
    for name in found.channels:
        values = [state.compliances.get(name, np.nan) for state in found.states]
        if np.isfinite(values).any():
            scale = scale_of(compliance_unit(found.units[name]), float(np.nanmax(values)))
            labels[scale.axis(f"compliance {name}")] = np.array(values) / scale.factor
    return labels
