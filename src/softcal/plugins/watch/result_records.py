"""Results and scores as their records have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softcal.plugins.watch.reading import Unreadable, clean, finite, numbers
from softcal.plugins.watch.watched import WatchedEstimate, WatchedResult, WatchedScore
from softcal.units import unit_factor


def watched_result(record: Mapping[str, Any], place: str) -> WatchedResult:
    """The result of a search, or of a specimen; place: of its file.

    Raises
    ------
    Unreadable
        Where a parameter has a value, a unit or an interval that is none.
    """
    parameters, notes = record.get("parameters"), record.get("notes")
    found: list[WatchedEstimate] = []
    for name, one in (parameters if isinstance(parameters, Mapping) else {}).items():
        one = one if isinstance(one, Mapping) else {}
        value, unit, interval = finite(one.get("value")), clean(one.get("unit"), 30), _interval(one)
        has_no = [
            what
            for what, is_there in (
                ("value", value is not None),
                ("unit", _is_unit(unit)),
                ("interval", interval is not None or one.get("interval") is None),
            )
            if not is_there
        ]
        if value is None or has_no:
            raise Unreadable(f"{clean(place)} cannot be read: {clean(name, 200)} has no {has_no[0]} that can be one.")
        found.append(WatchedEstimate(clean(name, 200), value, unit, interval, one.get("at_bound") is True))
    return WatchedResult(
        tuple(found),
        finite(record.get("loss")),
        clean(record.get("status")),
        tuple(clean(note) for note in (notes if isinstance(notes, list) else [])[:100]),
    )


def _is_unit(text: str) -> bool:
    try:
        return unit_factor(text, text) == 1.0
    except ValueError:
        return False


def _interval(one: Mapping[str, Any]) -> tuple[float, float] | None:
    """Two numbers about the value of a parameter; None for anything else."""
    ends = one.get("interval")
    if not isinstance(ends, list) or len(ends) != 2:
        return None
    low, value, high = map(finite, (ends[0], one.get("value"), ends[1]))
    return None if low is None or value is None or high is None or not low <= value <= high else (low, high)


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
