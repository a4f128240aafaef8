"""Results and scores as their records have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softcal.watch.reading import clean, finite, numbers
from softcal.watch.watched import WatchedEstimate, WatchedResult, WatchedScore


def watched_result(record: Mapping[str, Any]) -> WatchedResult:
    """The result of a search, or of a specimen."""
    parameters, notes = record.get("parameters"), record.get("notes")
    found: list[WatchedEstimate] = []
    for name, one in (parameters if isinstance(parameters, Mapping) else {}).items():
        value = finite(one.get("value")) if isinstance(one, Mapping) else None
        if value is None:
            continue
        ends = [finite(end) for end in one["interval"]] if isinstance(one.get("interval"), list) else []
        low, high = ends if len(ends) == 2 else (None, None)
        interval = None if low is None or high is None else (low, high)
        found.append(
            WatchedEstimate(clean(name, 200), value, clean(one.get("unit"), 30), interval, one.get("at_bound") is True)
        )
    return WatchedResult(
        tuple(found),
        finite(record.get("loss")),
        clean(record.get("status")),
        tuple(clean(note) for note in (notes if isinstance(notes, list) else [])[:100]),
    )


def watched_score(record: Mapping[str, Any]) -> WatchedScore:
    """The score of a benchmark's case."""
    rows: list[tuple[str, str, float, float, float]] = []
    splits = record.get("splits")
    for split, one in (splits if isinstance(splits, Mapping) else {}).items():
        points = one.get("points") if isinstance(one, Mapping) else None
        named = (
            {"all points": one.get("all_points"), **(points if isinstance(points, Mapping) else {})}
            if isinstance(one, Mapping)
            else {}
        )
        for name, error in named.items():
            held = numbers(error)
            if {"rms", "mean", "largest"} <= held.keys():
                rows.append((clean(split, 60), clean(name, 100), held["rms"], held["mean"], held["largest"]))
    return WatchedScore(clean(record.get("case"), 100), clean(record.get("method"), 100), tuple(rows[:500]))
