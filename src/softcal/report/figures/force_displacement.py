"""Paper A's Fig. 3: the measured effort over the coordinate of an actuator, such as force over displacement, and any
other record as it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.experiments.driven import driven_whole
from softcal.experiments.steps.noise import NOISE_STEPS
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import axis_label, channel_scale, joined
from softcal.report.style import BLUE, LOOP, MUTED, ORANGE, count_axis, house_style, new_figure
from softcal.sensing.channel import channel_name, in_a_word, kinds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@register_figure("bench")
def force_displacement(content: ReportContent) -> Iterator[Drawing]:
    """The measurements: effort over coordinate with the samples of the fit, else each channel over time."""
    for name, experiment in content.experiments.items():
        of = driven_whole(experiment.prepared) or driven_whole(experiment.raw)
        if of is None and any(channel_name(channel).point for channel in experiment.raw.channels):
            continue  # the rows are states with positions, for which a chart over the samples is of no use
        if of is not None:
            drawn = experiment.corrected or experiment.raw
            later = steps_between(experiment.prepared, len(drawn.provenance))
            caption = f"{name}: the record in light tones, the samples used for the fit in blue."
            if drawn.cycle is None and later:
                caption += f" Steps between the two: {joined(later)}."
            title = f"The measured {in_a_word(of.effort)} of {name}"
            yield Drawing(draw_force_displacement(experiment, of.names), caption, of=name, title=title)
        else:
            later = steps_between(experiment.prepared, len(experiment.raw.provenance))
            used = f"; the fit uses it after {joined(later)}" if later else ""
            yield Drawing(
                draw_record(experiment.raw), f"{name}: the record{used}.", of=name, title=f"The record of {name}"
            )


def steps_between(data: Dataset, after: int) -> list[str]:
    """Steps after the first `after` that changed samples, each once; stating noise changes none."""
    return list(dict.fromkeys(step.name for step in data.provenance[after:] if step.name not in NOISE_STEPS))


def draw_force_displacement(experiment: ExperimentContent, pair: tuple[str, str]) -> Figure:
    """Paper A's Fig. 3: all cycles in light tones, the first one distinct, the fitted branch on top.

    Parameters
    ----------
    experiment
        Its record, and what was fitted.
    pair
        The channels of the coordinate and of the effort.
    """
    with house_style():
        figure = new_figure()
        axes = figure.add_subplot()
        record = experiment.corrected or experiment.raw
        if set(pair) <= record.channels.keys():
            draw_cycles(axes, record, *pair)
        if set(pair) <= experiment.prepared.channels.keys():
            data = experiment.prepared
            few = data.n_samples <= 25
            for piece in _cycle_pieces(data):
                axes.plot(
                    *_shown(data, piece, *pair), color=BLUE, linewidth=2.2, marker="o" if few else "",
                    markersize=3.5, label="used for the fit" if piece.start == 0 else None, zorder=4,
                )  # fmt: skip
        effort_axes(axes, experiment.name, pair)
        axes.legend(loc="upper left")
        return figure


def draw_record(data: Dataset) -> Figure:
    """A dataset as recorded: effort and all else over the coordinate if an actuator has both, otherwise each channel
    over time.
    """
    names = [name for name in data.channels if name != "time" and not channel_name(name).is_deviation] or ["time"]
    with house_style():
        if (of := driven_whole(data)) is not None:
            pair = of.names
            place = {kind: k for k, kind in enumerate(kinds())}
            others = [name for name in names if name not in pair]
            others.sort(key=lambda name: place.get(channel_name(name).kind.name, len(place)))
            figure = new_figure(5.2, 3.5 + 2.1 * len(others))
            axes, *beneath = figure.subplots(1 + len(others), 1, squeeze=False)[:, 0]
            draw_cycles(axes, data, *pair)
            effort_axes(axes, data.name, pair)
            axes.legend(loc="upper left")
            for below, name in zip(beneath, others, strict=True):
                draw_cycles(below, data, pair[0], name)
                below.set_xlabel(axes.get_xlabel())
                below.set_ylabel(channel_scale(data.channels[name].unit).axis(channel_name(name).label))
                below.set_xlim(axes.get_xlim())
            return figure
        figure = new_figure(5.2, 1.2 + 1.5 * len(names))
        stack = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        timed = "time" in data.channels and names != ["time"]
        x = data.values("time") if timed else np.arange(data.n_samples)
        for axes, name in zip(stack, names, strict=True):
            scale = channel_scale(data.channels[name].unit)
            axes.plot(x, data.values(name) / scale.factor, color=BLUE, linewidth=1.2)
            axes.set_ylabel(scale.axis(channel_name(name).label))
        stack[0].set_title(data.name)
        if timed:
            stack[-1].set_xlabel("Time [s]")
        else:
            count_axis(stack[-1], "Sample")
        return figure


def draw_cycles(axes: Axes, data: Dataset, over: str, channel: str) -> None:
    """Cycles of a channel over another one: samples outside cycles, the first cycle, later ones.

    Parameters
    ----------
    axes
        Where they are drawn, in display units.
    data
        A record; without cycles it is drawn as measured.
    over, channel
        Channels of the horizontal and of the vertical axis.
    """
    if data.cycle is None:
        axes.plot(*_shown(data, slice(None), over, channel), color=MUTED, linewidth=1.0, label="as measured")
        return
    seen: set[str] = set()
    first = float(np.min(data.cycle[data.cycle >= 0], initial=np.inf))
    last = int(np.max(data.cycle, initial=0))
    for piece in _cycle_pieces(data):
        number = data.cycle[piece.start]
        if number < 0:
            label, colour, line = "outside any cycle", MUTED, ":"
        elif number == first:
            label, colour, line = f"cycle {int(number) + 1}", ORANGE, "-"
        else:
            label, colour, line = f"cycles {int(first) + 2} to {last + 1}", LOOP, "-"
        axes.plot(
            *_shown(data, piece, over, channel), color=colour, linestyle=line, linewidth=1.2,
            label=None if label in seen else label, zorder=3 if number == first else 2,
        )  # fmt: skip
        seen.add(label)


def _cycle_pieces(data: Dataset) -> list[slice]:
    if data.cycle is None:
        return [slice(0, data.n_samples)]
    cuts = [0, *(np.flatnonzero(np.diff(data.cycle)) + 1).tolist(), data.n_samples]
    return [slice(start, stop) for start, stop in pairwise(cuts)]


def _shown(data: Dataset, rows: slice, *channels: str) -> Iterator[Floats]:
    """Rows of channels in display units."""
    return (data.values(name)[rows] / channel_scale(data.channels[name].unit).factor for name in channels)


def effort_axes(axes: Axes, title: str, pair: tuple[str, str]) -> None:
    """Title and axes of a chart of effort over coordinate, which begin at zero.

    Parameters
    ----------
    axes
        The axes, in display units.
    title
        Title of the chart.
    pair
        The channels of the coordinate and of the effort.
    """
    axes.set_title(title)
    axes.set_xlabel(axis_label(pair[0]))
    axes.set_ylabel(axis_label(pair[1]))
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
