"""The state of a run from its folder, as frozen data; a folder is read while another process writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Literal

from softcal.calibration.results.result import Trial
from softcal.plugins.watch.live import LONG, LiveSign
from softcal.plugins.watch.reading import Unreadable, clean, finite, numbers
from softcal.plugins.watch.report_figures import DrawnFigure
from softcal.units import unit_factor

Course = Literal["waiting", "running", "silent", "left", "ended", "failed"]
"""Of a search: not begun, at work, without a sign of life, its process gone, with a result, failed as a whole."""


@dataclass(frozen=True)
class WatchedEstimate:
    """A parameter of a result as its record has it [unit]; interval: of 95 %, or None."""

    name: str
    value: float
    unit: str
    interval: tuple[float, float] | None
    at_bound: bool


@dataclass(frozen=True)
class WatchedResult:
    """The result of a search as its record has it: estimates, loss, sentence on its end, notes."""

    estimates: tuple[WatchedEstimate, ...]
    loss: float | None
    status: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class WatchedSearch:
    """One search of a run.

    Attributes
    ----------
    label
        Its name in the run; place: its folder, relative to that of the run.
    method
        Its method; "" where the record does not say so.
    trials
        Every trial that is done, in order.
    total
        Number of trials, at most; None where it is not known.
    live
        Its last sign of life, or None.
    result
        Its result, or None before the end.
    written, ended
        When its trials, and its result, were last written, or None.
    seconds
        How long it had worked on it when its last trial was recorded [s].
    failure
        Why a specimen of a fleet FAILED, a sentence; "" otherwise.
    unreadable
        What of it cannot be read, a sentence each.
    is_open
        Whether it is a specimen of a fleet without a record of its own yet, so that a result is not its end.
    """

    label: str
    place: str
    method: str = ""
    trials: tuple[Trial, ...] = ()
    total: int | None = None
    live: LiveSign | None = None
    result: WatchedResult | None = None
    written: datetime | None = None
    ended: datetime | None = None
    seconds: float = 0.0
    failure: str = ""
    unreadable: tuple[str, ...] = ()
    is_open: bool = False

    @property
    def done(self) -> int:
        """Number of trials that are done."""
        return len(self.trials) or (self.live.done or 0 if self.live is not None else 0)

    @property
    def best(self) -> Trial | None:
        """The trial with the lowest loss."""
        return min(
            (trial for trial in self.trials if trial.loss is not None),
            key=lambda trial: trial.loss or 0.0,
            default=None,
        )

    @property
    def failed(self) -> tuple[Trial, ...]:
        """The trials that FAILED."""
        return tuple(trial for trial in self.trials if trial.loss is None)

    def course(self, now: datetime) -> Course:
        """State of the search."""
        if self.failure:
            return "failed"
        course = None if self.live is None else self.live.course(now)
        if self.result is not None and not self.is_open and not (course == "running" and self.is_resumed):
            return "ended"
        if course is not None:
            return course
        if self.written is None:
            return "waiting"
        return "running" if (now - self.written).total_seconds() <= LONG else "silent"

    @property
    def is_resumed(self) -> bool:
        """Whether the search was resumed after its result was written."""
        began = None if self.live is None else self.live.began
        return began is not None and self.ended is not None and began > self.ended


@dataclass(frozen=True)
class WatchedScore:
    """The score of a benchmark's case as its record has it: method, and rows (split, of, RMS, mean, largest) [SI]."""

    case: str
    method: str
    rows: tuple[tuple[str, str, float, float, float], ...]


@dataclass(frozen=True)
class WatchedRun:
    """A run folder.

    Attributes
    ----------
    name
        Name of the project, or of the folder.
    kind
        "calibration", "sweep", "fleet", "benchmark", "runs" for a folder of runs, or "" where nothing is there yet.
    searches
        Its searches, in order.
    created
        When it began, or None.
    report
        Place of its report in the folder, or "".
    figures
        Those of its report.
    live
        The last sign of life of a fleet as a whole, or None.
    scores
        Of benchmarks.
    unreadable
        What of it cannot be read, a sentence each.
    values
        Fixed parameters [SI].
    """

    name: str
    kind: str = ""
    searches: tuple[WatchedSearch, ...] = ()
    created: datetime | None = None
    report: str = ""
    figures: tuple[DrawnFigure, ...] = ()
    live: LiveSign | None = None
    scores: tuple[WatchedScore, ...] = ()
    unreadable: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict[str, float])

    def now_at(self, now: datetime) -> WatchedSearch | None:
        """The search to show first: the one at work, else the joint one or the last with trials."""
        for wanted in ("running", "left", "silent"):
            for search in self.searches:
                if search.course(now) == wanted:
                    return search
        named = {search.label: search for search in self.searches}
        done = [search for search in self.searches if search.trials] or list(self.searches)
        return named.get("joint") or (done[-1] if done else None)


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
        value, unit, ends = finite(one.get("value")), clean(one.get("unit"), 30), one.get("interval")
        interval: tuple[float, float] | None = None  # two numbers about the value
        if value is not None and isinstance(ends, list) and len(ends) == 2:
            low, high = map(finite, ends)
            if low is not None and high is not None and low <= value <= high:
                interval = low, high
        try:
            is_unit = unit_factor(unit, unit) == 1.0
        except ValueError:
            is_unit = False
        has_no = [
            what
            for what, is_there in (
                ("value", value is not None),
                ("unit", is_unit),
                ("interval", interval is not None or ends is None),
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
