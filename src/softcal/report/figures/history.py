"""The losses of a search, trial by trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.calibration.results.result import Trial
from softcal.checks import Floats, Ints
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.loss import MANY_POINTS
from softcal.report.format import number, result_label
from softcal.report.style import BLUE, MUTED, RED, count_axis, house_style, new_figure, plain_log_ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_FEWEST = 12  # trials


@register_figure("search", place=2)
def history(content: ReportContent) -> Iterator[Drawing]:
    """The loss of every trial of a search, and the best so far; of a few trials, as by derivatives, it says nothing."""
    for label, result in content.calibrations.items():
        search = search_history(result.trials)
        if len(search.losses) >= _FEWEST:
            caption = (
                f"{result_label(label)}: {len(search.losses)} trials, best loss {number(result.loss)}; "
                f"{len(search.failed) or 'none'} failed."
            )
            title = f"Loss of the trials: {result_label(label)}"
            yield Drawing(draw_history(title, search), caption, of=label)


@dataclass(frozen=True)
class SearchHistory:
    """Losses in the order of the trials: numbers (n,), losses (n,), best so far (n,), and numbers of failed trials."""

    numbers: Ints
    losses: Floats
    best: Floats
    failed: Ints


def search_history(trials: Sequence[Trial]) -> SearchHistory:
    """Best loss so far over the completed trials, and the failed trials."""
    done = [(trial.number, trial.loss) for trial in trials if trial.state == "COMPLETE" and trial.loss is not None]
    losses = np.array([loss for _, loss in done], dtype=np.float64)
    return SearchHistory(
        np.array([index for index, _ in done], dtype=np.int64),
        losses,
        np.minimum.accumulate(losses) if len(losses) else losses,
        np.array([trial.number for trial in trials if trial.state == "FAILED"], dtype=np.int64),
    )


def draw_history(title: str, history: SearchHistory) -> Figure:
    """Each trial's loss, the best so far, and the failed trials."""
    with house_style():
        figure = new_figure(5.2, 3.2)
        axes = figure.add_subplot()
        many = len(history.losses) > MANY_POINTS
        axes.plot(
            history.numbers, history.losses, linestyle="", marker="o", markersize=2.5 if many else 4, color=MUTED,
            alpha=0.45, markeredgewidth=0, rasterized=many, label="trials",
        )  # fmt: skip
        axes.step(history.numbers, history.best, where="post", color=BLUE, linewidth=2.0, label="best so far")
        if len(history.losses) and history.losses.min() > 0:
            axes.set_yscale("log")
            plain_log_ticks(axes.yaxis, *axes.get_ylim())
        if len(history.failed):
            axes.plot(
                history.failed, np.full(len(history.failed), 0.97), "x", color=RED, markersize=5,
                transform=axes.get_xaxis_transform(), label=f"failed ({len(history.failed)})", clip_on=False,
            )  # fmt: skip
        count_axis(axes, "Trial")
        axes.set_ylabel("Loss")
        axes.set_title(title)
        figure.legend(loc="outside lower center", ncols=3)
        return figure
