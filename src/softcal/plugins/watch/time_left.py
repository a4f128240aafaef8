"""How long a search or a fleet goes on at the rate so far; nothing where that is not known."""

from __future__ import annotations

import math
from datetime import datetime

from softcal.plugins.watch.watched import WatchedRun, WatchedSearch
from softcal.plugins.watch.words import span

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
