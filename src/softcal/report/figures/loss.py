"""The loss over the searched parameters: paper A's Fig. 5, or profiles by the derivatives at the best point."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.calibration.results.digits import estimate_text, value_text
from softcal.calibration.results.result import SearchResult
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.statistics.estimate import Estimate
from softcal.materials.catalogue import LAWS, constants_of
from softcal.report.content import Landscape, ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.parameter import interval
from softcal.report.format import (
    Scale,
    estimate_scale,
    number,
    parameter_label,
    result_label,
    scale_of,
)
from softcal.report.style import (
    BLUE,
    FAINT,
    INK,
    MUTED,
    ORANGE,
    SEQUENTIAL,
    house_style,
    new_figure,
    plain_log_axis,
    plain_log_ticks,
)
from softcal.report.surfaces import searched_pair
from softcal.twin.parameter_name import parameter_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Above this many points a scatter is rasterised inside the SVG, which keeps the file small.
MANY_POINTS = 300
_COLUMNS = 2  # of profiles
_DECADE = 10.0


@register_figure("search", place=1)
def loss(content: ReportContent) -> Iterator[Drawing]:
    """The loss over the parameters: near the best values by derivatives, or over one or two at all trials."""
    for label, result in content.calibrations.items():
        title = f"Loss over the parameters: {result_label(label)}"
        if result.method in OPTIMISERS and OPTIMISERS[result.method].statistics == "sensitivity":
            if curves := {name: one for name, one in result.parameters.items() if one.profile}:
                caption = (
                    f"{result_label(label)}: the loss over each parameter, least over all others, as the derivatives "
                    "at the best values (star) predict it. Shaded: the 95 % interval, which includes errors that the "
                    "loss does not have."
                )
                yield Drawing(draw_profiles(title, curves, result), caption, of=label, title=title)
            continue
        grid = content.landscapes.get(label) or grid_of_trials(result)
        figure = draw_loss_map(title, result, grid) or draw_loss_profile(title, result)
        if figure is not None:
            what = "on a grid" if grid else "at the trials"
            others = len(result.parameters) - 2
            seen = (
                f", projected along {others} further parameter{'s' * (others > 1)}" if others > 0 and not grid else ""
            )
            caption = (
                f"{result_label(label)}: the loss {what}{seen}; star: the optimum; dashed: the bounds of the search."
            )
            yield Drawing(figure, caption, of=label)


def grid_of_trials(result: SearchResult) -> Landscape | None:
    """The trials as a grid over both parameters; None if they do not fill a grid."""
    pair = searched_pair(result)
    if pair is None or len(result.parameters) != 2:
        return None
    x_name, y_name = pair
    trials = [trial for trial in result.trials if x_name in trial.theta and y_name in trial.theta]
    x = np.unique([trial.theta[x_name] for trial in trials])
    y = np.unique([trial.theta[y_name] for trial in trials])
    if min(len(x), len(y)) < 3 or len(x) * len(y) != len(trials):
        return None
    loss = np.zeros((len(y), len(x)))
    failed = np.ones((len(y), len(x)), dtype=np.int64)
    for trial in trials:
        if trial.loss is not None and trial.state == "COMPLETE":
            at = np.searchsorted(y, trial.theta[y_name]), np.searchsorted(x, trial.theta[x_name])
            loss[at], failed[at] = trial.loss, 0
    return Landscape(x_name, y_name, x, y, loss, failed)


def draw_profiles(title: str, curves: Mapping[str, Estimate], result: SearchResult) -> Figure:
    """A panel for each parameter: the least loss over its values, its interval, and the best value.

    Parameters
    ----------
    title
        Title of the figure.
    curves
        Parameter -> its estimate, with the least losses over its values.
    result
        The calibration.
    """
    rows = math.ceil(len(curves) / _COLUMNS)
    with house_style():
        figure = new_figure(5.2, 1.0 + 2.2 * rows)
        grid = figure.subplots(rows, min(len(curves), _COLUMNS), sharey=True, squeeze=False)
        for axes in grid.flat[len(curves) :]:
            axes.set_visible(False)
        for axes, (name, estimate) in zip(grid.flat, curves.items(), strict=False):
            draw_profile(axes, name, estimate, result)
        for axes in grid[:, 0]:
            axes.set_ylabel("Loss")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.suptitle(title, x=0.02, ha="left", fontsize=10.0, fontweight="bold", color=INK)
        return figure


def draw_profile(axes: Axes, name: str, estimate: Estimate, result: SearchResult) -> None:
    """The least loss over one parameter.

    Parameters
    ----------
    axes
        Where it is drawn.
    name
        The parameter.
    estimate
        Its estimate, with the least losses over its values.
    result
        The calibration.
    """
    scale = estimate_scale(estimate)
    values, losses = np.array(estimate.profile).T
    x = values / scale.factor
    low, high = (end / scale.factor for end in interval(estimate))
    axes.axvspan(low, high, color=FAINT, alpha=0.45, linewidth=0.0, label="95 % interval")
    axes.plot(x, losses, color=BLUE, label="loss, by derivatives")
    axes.plot(
        [estimate.value / scale.factor], [result.loss], marker="*", markersize=13, color=ORANGE,
        markeredgecolor=INK, linestyle="", clip_on=False, zorder=5, label="best value",
    )  # fmt: skip
    _axis_of_values(axes, estimate, x[0], x[-1])
    axes.set_xlabel(scale.axis(parameter_label(name, result.parameters)))


def draw_loss_map(title: str, result: SearchResult, landscape: Landscape | None) -> Figure | None:
    """Paper A's Fig. 5: the loss over two parameters, as contours of a grid if there is one, else as trials.

    None if fewer than two parameters were searched and there is no landscape; see `draw_loss_profile`.

    Parameters
    ----------
    title
        Title of the figure.
    result
        The calibration, with its trials.
    landscape
        The loss over a grid of two parameters; None: the trials are drawn.
    """
    pair = (landscape.x_name, landscape.y_name) if landscape else searched_pair(result)
    if pair is None:
        return None
    with house_style():
        figure = new_figure(5.2, 3.9)
        draw_surface(axes := figure.add_subplot(), title, result, pair, landscape)
        if axes.get_legend_handles_labels()[1]:
            figure.legend(loc="outside lower center", ncols=4, fontsize=8.5, markerscale=0.75)
        return figure


def draw_surface(
    axes: Axes, title: str, result: SearchResult, pair: tuple[str, str], landscape: Landscape | None
) -> None:
    """See `draw_loss_map`; draws into existing axes.

    Parameters
    ----------
    axes
        Where it is drawn.
    title
        Title of the axes.
    result
        The calibration, with its trials.
    pair
        The two parameters.
    landscape
        The loss over a grid of both; None: the trials are drawn.
    """
    scales = tuple(_scale(result, name) for name in pair)
    shown = _draw_contours(axes, landscape, scales) if landscape else _draw_trials(axes, result, pair, scales)
    if shown is not None:
        bar = axes.figure.colorbar(shown, ax=axes, pad=0.02, aspect=28)
        bar.set_label("Loss (dark is better)")
        bar.outline.set_visible(False)  # type: ignore[operator]
        low, high = bar.norm.vmin, bar.norm.vmax
        if low and high and low > 0:
            plain_log_ticks(bar.ax.yaxis, low, high)
    x, y = (result.parameters.get(name) for name in pair)
    if x is not None and y is not None:
        left, right = x.lower / scales[0].factor, x.upper / scales[0].factor
        bottom, top = y.lower / scales[1].factor, y.upper / scales[1].factor
        axes.plot(
            [left, right, right, left, left], [bottom, bottom, top, top, bottom], color=MUTED, linestyle="--",
            linewidth=1.0, label="bounds", zorder=3,
        )  # fmt: skip
        _axis_of_values(axes, x, left, right, margin=0.05)
        _axis_of_values(axes, y, bottom, top, margin=0.05, upright=True)
        _draw_optimum(axes, result, {pair[0]: x, pair[1]: y}, (x.value / scales[0].factor, y.value / scales[1].factor))
    axes.set_xlabel(scales[0].axis(parameter_label(pair[0], result.parameters)))
    axes.set_ylabel(scales[1].axis(parameter_label(pair[1], result.parameters)))
    axes.set_title(title)
    axes.grid(False)


def draw_loss_profile(title: str, result: SearchResult) -> Figure | None:
    """The loss over the only searched parameter; None if there are no trials to draw."""
    name = next(iter(result.parameters), None)
    if name is None:
        return None
    with house_style():
        figure = new_figure(5.2, 3.4)
        draw_trials_over(figure.add_subplot(), title, result, name)
        return figure


def draw_trials_over(axes: Axes, title: str, result: SearchResult, name: str) -> None:
    """The losses of all trials over one parameter.

    Parameters
    ----------
    axes
        Where they are drawn.
    title
        Title of the axes.
    result
        The calibration, with its trials.
    name
        The parameter.
    """
    estimate, scale = result.parameters[name], _scale(result, name)
    done = sorted((t.theta[name], t.loss) for t in result.trials if t.loss is not None and name in t.theta)
    x, loss = (np.array(side) for side in zip(*done, strict=True)) if done else (np.array([]), np.array([]))
    axes.plot(x / scale.factor, loss, color=BLUE, marker="o", markersize=3.5, linewidth=1.0)
    axes.plot(
        [estimate.value / scale.factor], [result.loss], marker="*", markersize=15, color=ORANGE,
        markeredgecolor=INK, linestyle="", label=f"optimum: {estimate_text(estimate)}",
    )  # fmt: skip
    if len(loss) and loss.min() > 0:
        axes.set_yscale("log")
        plain_log_ticks(axes.yaxis, *axes.get_ylim())
    _axis_of_values(axes, estimate, estimate.lower / scale.factor, estimate.upper / scale.factor, margin=0.05)
    axes.set_xlabel(scale.axis(parameter_label(name)))
    axes.set_ylabel("Loss")
    axes.set_title(title)
    axes.legend(loc="best")


def _scale(result: SearchResult, name: str) -> Scale:
    estimate = result.parameters.get(name)
    if estimate is not None:
        return estimate_scale(estimate)
    constant = constants_of(LAWS).get(parameter_name(name).kind)
    return scale_of(constant.quantity.unit) if constant is not None else Scale("", 1.0)


def _draw_contours(axes: Axes, landscape: Landscape, scales: tuple[Scale, ...]) -> Any:
    x, y = landscape.x / scales[0].factor, landscape.y / scales[1].factor
    failed = np.zeros(landscape.loss.shape, dtype=bool) if landscape.failed is None else landscape.failed.astype(bool)
    loss = np.ma.masked_array(landscape.loss, failed)
    norm, levels = _loss_norm(loss.compressed())
    if failed.any():
        rows, columns = np.nonzero(failed)
        axes.plot(x[columns], y[rows], "x", color=MUTED, markersize=4, label="could not be simulated")
    if levels is None:
        return axes.pcolormesh(x, y, loss, cmap=SEQUENTIAL, norm=norm, shading="nearest")
    clipped = np.ma.clip(loss, levels[0], levels[-1])
    shown = axes.contourf(x, y, clipped, levels=levels, cmap=SEQUENTIAL, norm=norm)
    axes.contour(x, y, clipped, levels=levels[1:-1:2], colors="white", linewidths=0.4, alpha=0.6)
    return shown


def _draw_trials(axes: Axes, result: SearchResult, pair: tuple[str, str], scales: tuple[Scale, ...]) -> Any:
    known = [trial for trial in result.trials if pair[0] in trial.theta and pair[1] in trial.theta]
    done = [trial for trial in known if trial.state == "COMPLETE" and trial.loss is not None]
    failed = [trial for trial in known if trial.state == "FAILED"]
    if failed:
        at = [[trial.theta[name] / scale.factor for trial in failed] for name, scale in zip(pair, scales, strict=True)]
        axes.plot(*at, "x", color=MUTED, markersize=4, label=f"failed trials ({len(failed)})")
    if not done:
        return None
    done.sort(key=lambda trial: -(trial.loss or 0.0))
    at = [[trial.theta[name] / scale.factor for trial in done] for name, scale in zip(pair, scales, strict=True)]
    loss = np.array([trial.loss for trial in done], dtype=np.float64)
    return axes.scatter(
        *at, c=loss, cmap=SEQUENTIAL, norm=_loss_norm(loss)[0], s=14 if len(done) > MANY_POINTS else 26,
        edgecolors="none", rasterized=len(done) > MANY_POINTS, label=f"trials ({len(done)})",
    )  # fmt: skip


def _loss_norm(loss: np.ndarray[Any, Any]) -> tuple[Any, np.ndarray[Any, Any] | None]:
    """Logarithmic colours over the lower nine tenths of the losses, and contour levels; none if all are equal."""
    from matplotlib.colors import LogNorm, Normalize

    if not len(loss) or loss.min() <= 0 or loss.max() / loss.min() < 1.0001:
        return Normalize(), None
    low, high = float(loss.min()), float(np.quantile(loss, 0.9))
    high = max(high, 1.01 * low)
    return LogNorm(low, high, clip=True), np.geomspace(low, high, 15)


def _axis_of_values(
    axes: Axes, estimate: Estimate, low: float, high: float, *, margin: float = 0.0, upright: bool = False
) -> None:
    """An axis of a parameter's values: logarithmic where its search is, and for a modulus over more than a decade."""
    if estimate.scale == "log" or (estimate.unit == "Pa" and 0.0 < _DECADE * low < high):
        more = (high / low) ** margin
        plain_log_axis(axes, low / more, high * more, upright=upright)
    else:
        more = margin * (high - low)
        (axes.set_ylim if upright else axes.set_xlim)(low - more, high + more)


def _draw_optimum(axes: Axes, result: SearchResult, of: Mapping[str, Estimate], at: tuple[float, float]) -> None:
    axes.plot(
        *at, marker="*", markersize=16, color=ORANGE, markeredgecolor=INK, linestyle="", label="optimum", zorder=5
    )
    lines = [f"{parameter_label(name, result.parameters)} = {value_text(e)}" for name, e in of.items()]
    across, up = axes.transAxes.inverted().transform(axes.transData.transform(at))
    right, upper = across > 0.5, up > 0.5
    axes.annotate(
        "\n".join([*lines, f"loss {number(result.loss)}"]), at, xytext=(-16 if right else 16, -16 if upper else 16),
        textcoords="offset points", ha="right" if right else "left", va="top" if upper else "bottom", fontsize=8.5,
        color=INK, bbox={"facecolor": "white", "edgecolor": FAINT, "alpha": 0.92, "boxstyle": "round,pad=0.35"},
        arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.8}, zorder=6,
    )  # fmt: skip
