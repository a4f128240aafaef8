"""How long a search or a fleet goes on: said where it is known, and nowhere else."""

from __future__ import annotations

import os
import socket
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from watch_case import NOW, add_trials, live_record, write_json, write_run

from softcal.calibration.results.result import Trial
from softcal.plugins.watch.live import live_sign
from softcal.plugins.watch.run_reader import RunReader
from softcal.plugins.watch.watched import WatchedRun, WatchedSearch
from softcal.plugins.watch.words import fleet_time_left, search_time_left

HOST = socket.gethostname()
TRIALS = tuple(Trial(number, {"E": 1e6}, "COMPLETE", 1.0) for number in range(30))


def searched(**changes: Any) -> WatchedSearch:
    """A search of 100 trials that has done 30 in 60 s, without what `changes` say of its sign of life."""
    began = (NOW - timedelta(seconds=61)).isoformat()
    live = live_sign(live_record(os.getpid(), HOST, **{"total": 100, "began": began, **changes}))
    return WatchedSearch("joint", "joint", "tpe", TRIALS, 100, live, written=NOW, seconds=60.0)


def test_a_search_says_what_its_trials_take_at_most():
    assert search_time_left(searched(), NOW) == "at most 2 min 20 s more at this rate"
    assert search_time_left(replace(searched(), seconds=0.6), NOW) == "at most 2 s more at this rate"


@pytest.mark.parametrize(
    "search",
    [
        searched(total=None),
        searched(total=30),
        searched(stage="importances (fANOVA)"),
        searched(ended=True),
        searched(began=None),
        replace(searched(), trials=()),
        replace(searched(), seconds=0.0),
        replace(searched(), written=None),
        replace(searched(), live=None),
        replace(searched(), seconds=200.0),  # more than this process has worked: it was resumed
        replace(searched(), written=NOW - timedelta(seconds=100)),  # resumed, and no trial of its own yet
    ],
)
def test_a_search_whose_time_is_not_known_says_nothing(search: WatchedSearch):
    assert search_time_left(search, NOW) == ""


def test_the_rate_is_that_of_the_folder_as_it_is_written(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [3.0] * 5)  # each of 2 s
    began = (NOW - timedelta(seconds=11)).isoformat()
    write_json(place / "live.json", live_record(os.getpid(), HOST, began=began))
    os.utime(place / "optuna.journal", (NOW.timestamp(), NOW.timestamp()))
    (search,) = RunReader(tmp_path).read().searches
    assert search_time_left(search, NOW) == "at most 30 s more at this rate"


def fleet(ages: list[float], host: str = HOST, **changes: Any) -> WatchedRun:
    """A fleet of 10 that began 100 s ago, whose finished specimens ended so many seconds ago."""
    began = (NOW - timedelta(seconds=100)).isoformat()
    given: dict[str, Any] = {"total": 10, "done": len(ages), "stage": "specimens", "began": began, **changes}
    live = live_sign(live_record(os.getpid(), host, **given))
    done = [WatchedSearch(f"{k}", f"{k}", ended=NOW - timedelta(seconds=age)) for k, age in enumerate(ages)]
    return WatchedRun("fleet", "fleet", (*done, WatchedSearch("x", "x")), live=live)


def test_a_fleet_says_what_its_specimens_take_from_those_that_it_finished():
    assert fleet_time_left(fleet([60.0, 20.0]), NOW) == "about 5 min 20 s more at this rate"
    # Resumed 100 s ago: what was finished before it is not of its rate.
    assert fleet_time_left(fleet([900.0, 800.0, 60.0, 20.0]), NOW) == "about 4 min 0 s more at this rate"
    for silent in (
        fleet([900.0]),
        fleet([]),
        fleet([20.0], done=10),
        fleet([20.0], ended=True),
        fleet([20.0], host="elsewhere", updated=(NOW - timedelta(hours=1)).isoformat()),
        replace(fleet([20.0]), live=None),
    ):
        assert fleet_time_left(silent, NOW) == ""


def test_a_fleet_is_read_with_its_sign_of_life(tmp_path: Path):
    write_json(tmp_path / "fleet.json", {"format": 1, "specimens": ["a"]})
    assert RunReader(tmp_path).read().live is None
    write_json(tmp_path / "live.json", live_record(1, "elsewhere", done=4))
    live = RunReader(tmp_path).read().live
    assert live is not None
    assert live.done == 4
    (tmp_path / "live.json").write_text("{")
    assert RunReader(tmp_path).read().unreadable == ("live.json cannot be read: it is not whole.",)
