"""Paper A's Fig. 6: channels over the trajectory, measured and simulated, with their residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from softcal.calibration.results.result import ExperimentFit
from softcal.checks import Floats
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import Scale, channel_scale, file_stem, joined, result_label
from softcal.report.style import INK, MEASURED, MUTED, SIMULATED, count_axis, house_style, new_figure
from softcal.sensing.channel import channel_name, channel_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@register_figure("fit", place=2)
def trajectory(content: ReportContent) -> Iterator[Drawing]:
    """Every channel of every experiment over its samples, measured and simulated, with the residual beneath."""
    for label, result in content.results.items():
        for name, fit in result.experiments.items():
            path = trajectory_panels(content.experiments[name], fit)
            if not path.panels:
                continue
            alone = file_stem(label) == file_stem(name)
            who = name if alone else f"{name}, {result_label(label).lower() if label == 'joint' else label}"
            caption = f"{who}: measured and simulated; the residual is simulated minus measured."
            silent = [panel.label.lower() for panel in path.panels if panel.measured is None]
            if silent:
                caption += f" The {joined(silent)} was not measured; only the simulated one is shown."
            if any(panel.repeat is not None for panel in path.panels):
                caption += " The darker band holds 95 % of further samples of the same set-up."
            if any(panel.band is not None for panel in path.panels):
                caption += " The lighter band holds 95 % of the samples of a further test on a new set-up of this kind."
            if path.abscissa.note:
                caption += f" {path.abscissa.note}"
            yield Drawing(
                draw_trajectory(path),
                caption,
                of=name if alone else f"{name} by {label}",
                title=f"Measured and simulated: {who}",
            )


@dataclass(frozen=True)
class Abscissa:
    """The horizontal axis of a trajectory in display units.

    note: why it is not the expected one, or ""; is_count: whether it numbers the samples.
    """

    values: Floats
    label: str
    note: str = ""
    is_count: bool = False


@dataclass(frozen=True)
class TrajectoryPanel:
    """One channel over the trajectory in display units; measured and residual are None if not measured.

    band: half the width of the 95 % band of a further experiment, on a new set-up; repeat: of a further sample of the
    same one; None where that is not known.
    """

    channel: str
    label: str
    scale: Scale
    measured: Floats | None
    simulated: Floats
    residual: Floats | None
    band: Floats | None = None
    repeat: Floats | None = None


@dataclass(frozen=True)
class TrajectoryPanels:
    """One experiment, measured and simulated. pieces: slices of consecutive samples that a line joins."""

    experiment: str
    abscissa: Abscissa
    panels: tuple[TrajectoryPanel, ...]
    pieces: tuple[slice, ...]


def trajectory_panels(experiment: ExperimentContent, fit: ExperimentFit) -> TrajectoryPanels:
    """Panels in order: force, pitch, shortening, other non-position channels."""
    order = ("tension", "pitch", "shortening")
    names = [name for name in order if name in fit.simulated]
    placed = {name for name in fit.simulated if channel_name(name).point in fit.distances}
    names += [name for name in fit.simulated if name not in {*order, *placed} and name in fit.measured]
    panels: list[TrajectoryPanel] = []
    for name in names:
        scale = channel_scale(fit.units.get(name, channel_unit(name) or "1"))
        simulated = np.asarray(fit.simulated[name], dtype=np.float64) / scale.factor
        measured = fit.measured.get(name)
        shown = None if measured is None else np.asarray(measured, dtype=np.float64) / scale.factor
        residual = None if shown is None else simulated - shown
        band, repeat = (sizes[name] / scale.factor if name in sizes else None for sizes in (fit.bands, fit.repeats))
        panels.append(TrajectoryPanel(name, channel_name(name).label, scale, shown, simulated, residual, band, repeat))
    n_samples = len(panels[0].simulated) if panels else 0
    abscissa = _abscissa(experiment, n_samples)
    data, cuts = experiment.prepared, [0, n_samples]
    if data.cycle is not None and data.n_samples == n_samples:
        cuts[1:1] = (np.flatnonzero(np.diff(data.cycle)) + 1).tolist()
    pieces = tuple(slice(start, stop) for start, stop in pairwise(cuts))
    return TrajectoryPanels(experiment.name, abscissa, tuple(panels), pieces)


def _abscissa(experiment: ExperimentContent, n_samples: int) -> Abscissa:
    data = experiment.prepared
    if data.n_samples != n_samples:
        note = f"{n_samples} samples were compared, the prepared data has {data.n_samples}; the axis is their number."
        return Abscissa(np.arange(n_samples, dtype=np.float64), "Sample", note, is_count=True)
    for name in (experiment.drive, "time"):
        if name in data.channels and np.all(np.diff(data.values(name)) >= 0):
            scale = channel_scale(data.channels[name].unit)
            return Abscissa(data.values(name) / scale.factor, scale.axis(channel_name(name).label))
    return Abscissa(np.arange(n_samples, dtype=np.float64), "Sample", is_count=True)


def draw_trajectory(
    path: TrajectoryPanels, width: float = 5.2, make: Callable[[float, float], Figure] = new_figure
) -> Figure:
    """Paper A's Fig. 6: measured and simulated channels over the trajectory, the residual beneath each.

    Parameters
    ----------
    path
        The experiment.
    width
        Width of the figure [in].
    make
        From its width and height to an empty figure.
    """
    rows: list[tuple[TrajectoryPanel, str]] = []
    for panel in path.panels:
        rows.append((panel, "values"))
        if panel.residual is not None:
            rows.append((panel, "residual"))
    heights = [2.0 if kind == "values" else 0.85 for _, kind in rows]
    with house_style():
        figure = make(width, 0.9 + sum(heights) * 0.92)
        stack = figure.subplots(len(rows), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axes, (panel, kind) in zip(stack, rows, strict=True):
            if kind == "values":
                draw_channel(axes, path, panel)
                if panel.measured is None:
                    text = f"{panel.label.lower()} was not measured"
                    axes.text(0.02, 0.95, text, transform=axes.transAxes, va="top", fontsize=8.5, color=MUTED)
            else:
                _draw_residual(axes, path, panel)
        stack[0].set_title(path.experiment)
        # Above all, where it covers no curve.
        figure.legend(*stack[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, borderaxespad=0.1)
        label_abscissa(stack[-1], path.abscissa)
        figure.align_ylabels(list(stack))
        return figure


def draw_channel(
    axes: Axes, path: TrajectoryPanels, panel: TrajectoryPanel, name: str = "simulated", colour: str = SIMULATED
) -> None:
    """One channel, measured if it was, and simulated with its bands.

    Parameters
    ----------
    axes
        Where it is drawn.
    path
        The experiment.
    panel
        The channel.
    name, colour
        Of the simulated line.
    """
    few = len(panel.simulated) <= 60
    for piece in path.pieces:
        named = piece.start == 0
        x = path.abscissa.values[piece]
        for words, (band, alpha) in _bands(panel).items():
            low, high = (panel.simulated[piece] + side * band[piece] for side in (-1, 1))
            label = words if named else None
            axes.fill_between(x, low, high, color=SIMULATED, alpha=alpha, linewidth=0, label=label)
        if panel.measured is not None:
            axes.plot(
                x, panel.measured[piece], color=MEASURED, linestyle="" if few else "-",
                marker="o" if few else "", markersize=3.5, markerfacecolor="none", linewidth=2.6,
                alpha=1.0 if few else 0.45, label="measured" if named else None,
            )  # fmt: skip
        axes.plot(
            x, panel.simulated[piece], color=colour, marker=_lone(piece), markersize=4.5, label=name if named else None
        )
    axes.set_ylabel(panel.scale.axis(panel.label))


def label_abscissa(axes: Axes, abscissa: Abscissa) -> None:
    """The label of the horizontal axis."""
    if abscissa.is_count:
        count_axis(axes, abscissa.label)
    else:
        axes.set_xlabel(abscissa.label)


def _bands(panel: TrajectoryPanel) -> dict[str, tuple[Floats, float]]:
    """Of each 95 % band, the wider one first: its words, half its width and how opaque it is."""
    bands = {"95 %, new set-up": (panel.band, 0.13), "95 %, same set-up": (panel.repeat, 0.28)}
    return {words: (band, alpha) for words, (band, alpha) in bands.items() if band is not None}


def _draw_residual(axes: Axes, path: TrajectoryPanels, panel: TrajectoryPanel) -> None:
    assert panel.residual is not None  # noqa: S101 - the caller lists residual rows only where there is one
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for piece in path.pieces:
        x, off = path.abscissa.values[piece], panel.residual[piece]
        for band, alpha in _bands(panel).values():
            axes.fill_between(x, -band[piece], band[piece], color=SIMULATED, alpha=alpha, linewidth=0)
        axes.plot(x, off, color=SIMULATED, linewidth=1.2, marker=_lone(piece), markersize=4.5)
    band = panel.band if panel.repeat is None else panel.repeat  # a wider one is cut, so that residuals are seen
    widest = 0.0 if band is None else float(np.nanmax(band))
    reach = 1.15 * max(float(np.nanmax(np.abs(panel.residual))), widest) or 1.0
    axes.set_ylim(-reach, reach)
    axes.set_ylabel(panel.scale.axis("Residual"))
    axes.locator_params(axis="y", nbins=3)


def _lone(piece: slice) -> str:
    """Plot marker for a piece of one sample, which a line does not show."""
    return "D" if piece.stop - piece.start == 1 else ""
