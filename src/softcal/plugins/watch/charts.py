"""Charts of a search's trials, as options of ECharts: loss against trials, and the parameters of the trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from softcal.calibration.results.result import Trial
from softcal.plugins.watch.twin import ParameterFacts
from softcal.plugins.watch.watched import WatchedRun, WatchedSearch
from softcal.report.format import parameter_label
from softcal.units import readable_unit, unit_factor

INK, MUTED, GRID, BLUE, RED, PALE = "#1f2937", "#6b7280", "#e5e7eb", "#0072b2", "#d55e00", "#9fc5de"
MOST_POINTS = 1500  # that are drawn of many trials
MOST_AXES = 14
WIDE = 20.0  # ratio of the ends of an axis from which on it is logarithmic
_TEXT = {"color": MUTED, "fontSize": 12}


def loss_chart(search: WatchedSearch) -> dict[str, Any]:
    """Loss of every trial, and the best so far; failed trials are marks at the foot."""
    done = [trial for trial in search.trials if trial.loss is not None]
    losses = [trial.loss for trial in done if trial.loss is not None]
    best = best_so_far(search.trials)
    last = search.trials[-1].number if search.trials else 0
    steps = [[number, loss] for number, loss in best]
    if steps and steps[-1][0] != last:
        steps.append([last, steps[-1][1]])
    positive = bool(losses) and min(losses) > 0.0
    logarithmic = positive and max(losses) / min(losses) > WIDE
    points = [[trial.number, trial.loss] for trial in thinned(done)]
    failed = [[trial.number, 0.02] for trial in thinned(search.failed)]
    return {
        "animation": False,
        "color": [PALE, BLUE, RED],
        "grid": {"left": 8, "right": 20, "top": 38, "bottom": 30, "containLabel": True},
        "legend": {"top": 0, "left": 0, "itemWidth": 16, "textStyle": _TEXT, "selectedMode": False},
        "tooltip": {"trigger": "item", "renderMode": "richText"},
        "xAxis": {
            "type": "value", "name": "trial", "nameLocation": "middle", "nameGap": 26, "min": 0, "max": max(last, 1),
            "minInterval": 1, "axisLabel": _TEXT, "nameTextStyle": _TEXT, "splitLine": {"show": False},
        },
        "yAxis": [
            {
                "type": "log" if logarithmic else "value", "scale": True, "axisLabel": _TEXT,
                "splitLine": {"lineStyle": {"color": GRID}}, "splitNumber": 4,
            },
            {"type": "value", "min": 0, "max": 1, "show": False},
        ],
        "series": [
            {"name": "trials", "type": "scatter", "symbolSize": 5, "data": points},
            {"name": "best so far", "type": "line", "step": "end", "symbol": "none", "data": steps},
            {
                "name": "failed", "type": "scatter", "symbol": "triangle", "symbolSize": 8, "yAxisIndex": 1,
                "data": failed,
            },
        ],
    }  # fmt: skip


def parameter_chart(search: WatchedSearch, facts: ParameterFacts) -> dict[str, Any]:
    """The trials' parameters: loss over one, a map of two, a line for each trial over more, the best ones in front."""
    done = sorted(
        (t for t in thinned([t for t in search.trials if t.loss is not None])), key=lambda t: -(t.loss or 0.0)
    )
    names = list(done[-1].theta)[:MOST_AXES] if done else []
    done = [trial for trial in done if all(name in trial.theta for name in names)]
    base: dict[str, Any] = {"animation": False, "tooltip": {"renderMode": "richText"}}
    if not done:
        return {**base, "series": []}
    axes: list[dict[str, Any]] = []
    for name in names:  # its unit, and the ends of its axis
        values = [trial.theta[name] for trial in done]
        low, high = facts.bounds.get(name, (min(values), max(values)))
        low, high = min(low, *values), max(high, *values)
        si_unit = facts.units.get(name, "")
        middle = math.sqrt(low * high) if low > 0.0 else max(abs(low), abs(high))
        unit = readable_unit(middle, si_unit) if si_unit else ""
        factor = unit_factor(unit, si_unit) if si_unit else 1.0
        shown = "" if unit in ("", "1") else f" [{unit}]"
        kind = "log" if low > 0.0 and high / low >= WIDE else "value"
        lines = parameter_label(name, names).replace(" (", "\n").replace(", ", "\n").removesuffix(")") + shown.replace(
            " [", "\n["
        )
        axes.append(
            {
                "name": f"{name}{shown}",
                "lines": lines,
                "factor": factor,
                "type": kind,
                "min": _round(low / factor),
                "max": _round(high / factor),
            }
        )
    losses = [trial.loss or 0.0 for trial in done]
    rows = [[trial.theta[name] / axis["factor"] for name, axis in zip(names, axes)] + [trial.loss] for trial in done]
    ordered = sorted(losses)
    high = ordered[min(len(ordered) - 1, math.ceil(0.6 * len(ordered)))]
    shades = {
        "type": "continuous", "show": len(names) > 1,
        "min": ordered[0], "max": high if high > ordered[0] else ordered[0] + 1.0,
        "dimension": len(names), "calculable": False, "orient": "horizontal", "left": "center", "top": 0,
        "itemHeight": 110, "itemWidth": 10, "text": ["worse", "low loss"], "textStyle": _TEXT,
        "inRange": {"color": ["#0072b2", "#8fbbd6", "#dfe5ea"]}, "outOfRange": {"color": "#e5e8ec"}, "inverse": False,
    }  # fmt: skip
    if len(names) == 1:
        scale = "log" if min(losses) > 0.0 and max(losses) / min(losses) > WIDE else "value"
        loss_axis = {"type": scale, "name": "loss", "scale": True, "axisLabel": _TEXT, "nameTextStyle": _TEXT}
        x = {**_cartesian(axes[0]), "nameLocation": "middle", "nameGap": 28}
        grid = {"left": 12, "right": 20, "top": 34, "bottom": 34, "containLabel": True}
        return {**base, "grid": grid, "xAxis": x, "yAxis": loss_axis,
                "color": [BLUE], "series": [{"type": "scatter", "symbolSize": 6, "data": rows}]}  # fmt: skip
    if len(names) == 2:
        grid = {"left": 12, "right": 20, "top": 48, "bottom": 34, "containLabel": True}
        x = {**_cartesian(axes[0]), "nameLocation": "middle", "nameGap": 28}
        return {**base, "grid": grid, "visualMap": shades, "xAxis": x, "yAxis": _cartesian(axes[1]),
                "series": [{"type": "scatter", "symbolSize": 7, "data": rows}]}  # fmt: skip
    width = {"lineStyle": {"width": 1.5, "opacity": 0.7}}
    return {
        **base,
        "visualMap": shades,
        "parallel": {"left": 40, "right": 50, "top": 96, "bottom": 14},
        "parallelAxis": [
            {"dim": i, "name": axis["lines"], "type": axis["type"], "min": axis["min"], "max": axis["max"],
             "nameTextStyle": {**_TEXT, "fontSize": 11, "lineHeight": 13}, "axisLabel": {**_TEXT, "fontSize": 10},
             "splitNumber": 3, "nameGap": 10}
            for i, axis in enumerate(axes)
        ],
        "series": [{"type": "parallel", "smooth": False, "data": rows, **width}],
    }  # fmt: skip


def fleet_chart(run: WatchedRun) -> dict[str, Any]:
    """The first parameter of every finished specimen with its 95 % interval."""
    done = [search for search in run.searches if not search.is_open]
    found = [(search.label, one) for search in done if search.result for one in search.result.estimates[:1]]
    if not found:
        return {"animation": False, "series": []}
    name, si_unit = found[0][1].name, found[0][1].unit
    same = [(label, one) for label, one in found if one.name == name and one.unit == si_unit]
    unit = readable_unit(sorted(one.value for _, one in same)[len(same) // 2], si_unit)
    factor = unit_factor(unit, si_unit)
    ends = [
        [one.value, one.value, *(one.interval or (one.value, one.value))] for _, one in same
    ]  # as a candle's: open, close, lowest, highest
    shown = "" if unit == "1" else f" [{unit}]"
    return {
        "animation": False,
        "tooltip": {"renderMode": "richText", "trigger": "item"},
        "grid": {"left": 8, "right": 20, "top": 34, "bottom": 8, "containLabel": True},
        "xAxis": {
            "type": "category", "data": [label for label, _ in same], "axisLabel": {**_TEXT, "hideOverlap": True},
        },
        "yAxis": {
            "type": "value", "name": f"{name}{shown}", "scale": True, "axisLabel": _TEXT,
            "nameTextStyle": {**_TEXT, "align": "left"}, "splitLine": {"lineStyle": {"color": GRID}},
        },
        "series": [
            {
                "name": "95 % interval", "type": "candlestick", "barMaxWidth": 6,
                "itemStyle": dict.fromkeys(("color", "color0", "borderColor", "borderColor0", "borderColorDoji"), PALE),
                "data": [[value / factor for value in four] for four in ends],
            },
            {
                "name": name, "type": "scatter", "symbolSize": 5, "itemStyle": {"color": BLUE},
                "data": [one.value / factor for _, one in same],
            },
        ],
    }  # fmt: skip


def best_so_far(trials: Sequence[Trial]) -> list[tuple[int, float]]:
    """Number and loss of every trial that was better than all before it."""
    found: list[tuple[int, float]] = []
    for trial in trials:
        if trial.loss is not None and (not found or trial.loss < found[-1][1]):
            found.append((trial.number, trial.loss))
    return found


def thinned(trials: Sequence[Trial], most: int = MOST_POINTS) -> list[Trial]:
    """Every so-manieth of many trials, with the best one among them."""
    if len(trials) <= most:
        return list(trials)
    step = math.ceil(len(trials) / most)
    best = min((t for t in trials if t.loss is not None), key=lambda t: t.loss or 0.0, default=None)
    kept = list(trials[::step])
    return kept if best is None or best in kept else sorted([*kept, best], key=lambda t: t.number)


def _round(value: float) -> float:
    """An end of an axis, as short as a label should be."""
    return float(f"{value:.3g}")


def _cartesian(axis: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": axis["type"], "name": axis["name"], "min": axis["min"], "max": axis["max"],
        "axisLabel": {**_TEXT, "hideOverlap": True},
        "nameTextStyle": {**_TEXT, "align": "left"}, "splitLine": {"lineStyle": {"color": GRID}},
    }  # fmt: skip
