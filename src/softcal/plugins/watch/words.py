"""Texts and tables of the page on a search; pure functions of the data that was read."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any

from softcal.calibration.results.digits import format_interval
from softcal.plugins.watch.live import LONG
from softcal.plugins.watch.twin import ParameterFacts
from softcal.plugins.watch.watched import Course, WatchedRun, WatchedSearch
from softcal.units import format_quantity

STATES: dict[Course, str] = {
    "waiting": "Not begun",
    "running": "Running",
    "silent": "No sign of life",
    "left": "Stopped",
    "ended": "Done",
    "failed": "Failed",
}
_OF_FLEETS: dict[Course, str] = {
    "waiting": "No specimen was begun.",
    "running": "Choose a specimen for its trials.",
    "silent": "It gave no sign of life lately; whether a process works on this fleet is not known.",
    "left": "No process works on this fleet. The same command with --resume goes on with it.",
    "ended": "Choose a specimen for its trials.",
}
MOST_FAILED = 200  # rows of the table


def state_sentence(search: WatchedSearch, now: datetime) -> str:
    """Sentence on the activity of the search, or on why it has none."""
    course, live = search.course(now), search.live
    if course == "failed":
        return search.failure
    if course == "ended":
        return "" if search.result is None else search.result.status
    if course == "waiting":
        return "No trial has been evaluated."
    if course == "running":
        stage = "" if live is None else live.stage
        late = live is not None and live.age(now) > 60.0
        return stage + (f"{'; ' if stage else ''}last sign of life {span(live.age(now))} ago" if live and late else "")
    if live is not None:
        last = "" if live.updated is None else f" Its last sign of life was {span(live.age(now))} ago."
        if live.ended:
            return f"The search ended without a result.{last}" if search.result is None else search.result.status
        if course == "left":
            return f"No process works on this run.{last} The same command with --resume goes on with it."
        if live.is_here:
            return f"It gave no sign of life for {span(live.age(now))}; whether a process works on it is not known."
        return f"It runs on {live.host}, and gave no sign of life for {span(live.age(now))}."
    written = "" if search.written is None else f" for {span((now - search.written).total_seconds())}"
    return f"Nothing was written{written}; whether a process works on this run is not known."


def trials_text(search: WatchedSearch) -> str:
    """Text on the number of trials done, and of all trials."""
    if not search.trials and (search.result is not None or search.failure):
        return "–"  # of a finished specimen, whose trials are read when it is chosen
    if search.total is None or search.done > search.total:
        return str(search.done)
    return f"{search.done} of {'' if search.done == search.total else 'at most '}{search.total}"


def share_done(search: WatchedSearch, now: datetime) -> float:
    """The share of the trials that are done, 1 with a result."""
    if search.course(now) in ("ended", "failed"):
        return 1.0
    return min(search.done / search.total, 1.0) if search.total else 0.0


def time_text(search: WatchedSearch, now: datetime) -> str:
    """Duration of the process's work; without a sign of life, until its last trial."""
    live = search.live
    if live is None or live.began is None:
        return span(search.seconds) if search.trials or search.seconds else "–"
    end = now if search.course(now) == "running" else live.updated or now
    return span(max((end - live.began).total_seconds(), 0.0))


def best_rows(search: WatchedSearch, facts: ParameterFacts) -> list[dict[str, Any]]:
    """The parameters with the values of the result, or of the best trial before it."""
    if search.result is not None and search.result.estimates:
        return [
            {
                "name": one.name,
                "value": format_quantity(one.value, one.unit) + (" (at a bound)" if one.at_bound else ""),
                "range": "–" if one.interval is None else _range(*one.interval, one.unit),
            }
            for one in search.result.estimates
        ]
    if search.best is None:
        return []
    return [
        {
            "name": name,
            "value": _shown(value, facts.units.get(name)),
            "range": _range(*facts.bounds[name], facts.units.get(name)) if name in facts.bounds else "–",
        }
        for name, value in search.best.theta.items()
    ]


def failed_rows(search: WatchedSearch, facts: ParameterFacts) -> list[dict[str, Any]]:
    """The last failed trials, latest first: number, reason, parameters."""
    return [
        {
            "trial": trial.number,
            "reason": trial.reason or "no reason is recorded",
            "at": ", ".join(f"{name} {_shown(value, facts.units.get(name))}" for name, value in trial.theta.items()),
        }
        for trial in reversed(search.failed[-MOST_FAILED:])
    ]


def fleet_text(run: WatchedRun, now: datetime) -> str:
    """Text on the number of finished searches or specimens."""
    what = "specimens" if run.kind == "fleet" else "searches"
    courses = [search.course(now) for search in run.searches]
    failed = courses.count("failed")
    finished = courses.count("ended") + failed
    parts = [f"{finished} of {len(courses)} {what} finished"]
    parts += [f"{failed} of them failed"] if failed else []
    parts += [f"{courses.count('running')} in work"] if "running" in courses else []
    return ", ".join(parts)


def share_finished(run: WatchedRun, now: datetime) -> float:
    """The share of the searches that are finished."""
    courses = [search.course(now) for search in run.searches]
    return (courses.count("ended") + courses.count("failed")) / len(courses) if courses else 0.0


def run_state(run: WatchedRun, now: datetime) -> tuple[Course, str]:
    """Activity of a whole fleet, or of a folder without a search, and a remark on it."""
    courses = [search.course(now) for search in run.searches]
    if not courses:
        return ("ended", "") if run.scores else ("waiting", "There is no run in this folder yet.")
    if share_finished(run, now) == 1.0:
        return "ended", _OF_FLEETS["ended"]
    # A fleet that gives no sign of life itself does what its specimens do; between two of them none is in work for a
    # moment, and what is next was written just now.
    signs = [sign for search in run.searches if (sign := search.live.updated if search.live else search.ended)]
    if run.live is not None:
        course = run.live.course(now)
    elif "running" in courses or any((now - sign).total_seconds() <= LONG for sign in signs):
        course = "running"
    elif "silent" in courses:
        course = "silent"
    else:
        course = "left" if signs else "waiting"
    return course, _OF_FLEETS[course]


def search_rows(run: WatchedRun, now: datetime) -> list[dict[str, Any]]:
    """A row for every search of a run."""
    return [
        {
            "place": search.place,
            "label": search.label,
            "state": STATES[search.course(now)],
            "trials": trials_text(search),
            "best": _loss_of(search),
            "failed": len(search.failed),
        }
        for search in run.searches
    ]


def _loss_of(search: WatchedSearch) -> str:
    loss = search.best.loss if search.best is not None else search.result.loss if search.result is not None else None
    return "–" if loss is None else f"{loss:.5g}"


def worker_rows(search: WatchedSearch) -> list[dict[str, Any]]:
    """A row for every worker."""
    workers = () if search.live is None else search.live.workers
    return [{"name": one.name, "state": one.state, "done": one.done} for one in workers]


def score_rows(run: WatchedRun) -> list[dict[str, Any]]:
    """A row for every part and point of every benchmark's score [mm]."""
    return [
        {
            "key": f"{score.case} {score.method} {split} {of}",
            "case": score.case,
            "method": score.method,
            "split": split,
            "of": of,
            "rms": format_quantity(rms, "m", digits=3),
            "mean": format_quantity(mean, "m", digits=3),
            "largest": format_quantity(largest, "m", digits=3),
        }
        for score in run.scores
        for split, of, rms, mean, largest in score.rows
    ]


def span(seconds: float) -> str:
    """A time in whole units: "12 s", "3 min 5 s", "2 h 10 min"."""
    whole = int(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _shown(value: float, unit: str | None) -> str:
    return f"{value:.4g} (SI)" if unit is None else format_quantity(value, unit)


def _range(low: float, high: float, unit: str | None) -> str:
    if unit is None:
        return f"{low:.4g} to {high:.4g} (SI)"
    return format_interval((low, high), unit)


_BEGINNING = 10.0  # [s] that a search may take before its sign of life


def search_time_left(search: WatchedSearch, now: datetime) -> str:
    """What the trials of a running search take at most; "" before the first, after the last, and where it was resumed.

    A resumed search may have other workers than before, and its journal does not say which trials were whose.
    """
    live = search.live
    if live is None or live.began is None or live.stage or search.written is None or search.course(now) != "running":
        return ""
    worked = (search.written - live.began).total_seconds()
    is_resumed = search.seconds > worked + _BEGINNING
    if not search.trials or not live.total or live.total <= search.done or search.seconds <= 0.0 or is_resumed:
        return ""
    seconds = math.ceil(search.seconds / search.done * (live.total - search.done))
    return f"at most {span(seconds)} more at this rate"


def fleet_time_left(run: WatchedRun, now: datetime) -> str:
    """What the specimens of a running fleet take, from those finished since it began or was resumed."""
    live = run.live
    if live is None or live.began is None or not live.is_at_work(now) or not live.total or live.done is None:
        return ""
    done = [search for search in run.searches if not search.is_open]
    ends = [search.ended for search in done if search.ended is not None and search.ended > live.began]
    if not ends or live.total <= live.done:
        return ""
    seconds = (max(ends) - live.began).total_seconds()
    return f"about {span(seconds / len(ends) * (live.total - live.done))} more at this rate"
