"""A fleet's folder as the page reads it, and what it says of the fleet; records that are damaged."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from watch_case import HOST, NOW, RESULT, add_trials, gone, live_record, write_fleet, write_json, write_run

from softcal.plugins.watch.charts import fleet_chart
from softcal.plugins.watch.live import live_sign
from softcal.plugins.watch.run_reader import RunReader
from softcal.plugins.watch.twin import ParameterFacts, run_of
from softcal.plugins.watch.watched import WatchedRun
from softcal.plugins.watch.words import (
    best_rows,
    fleet_text,
    fleet_time_left,
    run_state,
    search_rows,
    share_done,
    share_finished,
    span,
    state_sentence,
)


def test_a_fleet_is_its_specimens(tmp_path: Path):
    write_fleet(tmp_path, a="DONE", b="FAILED", c="WORK", d=None)
    write_json(tmp_path / "specimens" / "c" / "calibrations" / "joint" / "live.json", live_record(os.getpid(), HOST))
    reader = RunReader(tmp_path)
    run = reader.read()
    rows = [tuple(row[name] for name in ("label", "state", "trials", "best")) for row in search_rows(run, NOW)]
    assert rows == [
        ("a", "Done", "–", "0.5"),
        ("b", "Failed", "–", "–"),
        ("c", "Running", "2 of at most 20", "2"),
        ("d", "Not begun", "0", "–"),
    ]
    assert fleet_text(run, NOW) == "2 of 4 specimens finished, 1 of them failed, 1 in work"
    assert state_sentence(run.searches[1], NOW) == "all trials failed."
    assert [run_of(search) for search in run.searches] == [f"specimens/{name}" for name in "abcd"]
    # The trials of one that is finished are read when it is chosen.
    whole = [reader.whole(search) for search in run.searches]
    assert [len(search.trials) for search in whole] == [2, 2, 2, 0]
    assert [search.course(NOW) for search in whole] == ["ended", "failed", "running", "waiting"]
    assert whole[0].result == run.searches[0].result
    shown = run.now_at(NOW)
    assert shown is not None
    assert shown.label == "c"
    add_trials(tmp_path / "specimens" / "c" / "calibrations" / "joint", [1.0])
    assert reader.read().searches[2].done == 3


def test_fleets_in_a_folder_are_listed_with_its_runs(tmp_path: Path):
    write_fleet(tmp_path / "one", a="DONE", b="WORK")
    write_fleet(tmp_path / "two", a="FAILED", c="DONE")
    here = {"pid": os.getpid(), "host": HOST, "now": datetime.now(UTC)}
    write_json(tmp_path / "one" / "live.json", live_record(**here))
    place = tmp_path / "one" / "specimens" / "b" / "calibrations" / "joint"
    write_json(place / "live.json", live_record(**here, ended=True))  # its record comes now
    add_trials(write_run(tmp_path / "run") / "calibrations" / "joint", [1.0])
    reader, now = RunReader(tmp_path), datetime.now(UTC)
    run = reader.read()
    rows = [tuple(row[name] for name in ("label", "state", "trials")) for row in search_rows(run, now)]
    assert rows == [
        ("one: a", "Done", "–"),
        ("one: b", "Running", "2 of at most 20"),
        ("run", "Running", "1 of at most 20"),
        ("two: a", "Failed", "–"),
        ("two: c", "Done", "–"),
    ]
    assert [run_of(search) for search in run.searches] == [
        "one/specimens/a", "one/specimens/b", "run", "two/specimens/a", "two/specimens/c"
    ]  # fmt: skip
    assert fleet_text(run, now) == "3 of 5 searches finished, 1 of them failed, 2 in work"
    assert [len(reader.whole(search).trials) for search in run.searches] == [2, 2, 1, 2, 2]
    (tmp_path / "two" / "specimens" / "c.json").write_text("{")
    write_json(tmp_path / "one" / "fleet.json", {"specimens": [".."]})
    assert RunReader(tmp_path).read().unreadable == (
        "one/fleet.json names a specimen that cannot be one: '..'.",
        "two/specimens/c.json cannot be read: it is not whole.",
    )


def test_what_a_fleet_does_as_a_whole(tmp_path: Path):
    now = datetime.now(UTC)
    write_fleet(tmp_path / "new", a=None)
    assert run_state(RunReader(tmp_path / "new").read(), now) == ("waiting", "No specimen was begun.")
    write_fleet(tmp_path / "some", a="DONE", b="FAILED", c=None)
    run = RunReader(tmp_path / "some").read()
    assert run_state(run, now) == ("running", "Choose a specimen for its trials.")
    left = "No process works on this fleet. The same command with --resume goes on with it."
    assert run_state(run, now + timedelta(seconds=90)) == ("left", left)
    assert share_finished(run, now) == pytest.approx(2 / 3)
    write_fleet(tmp_path / "all", a="DONE", b="FAILED")
    later = now + timedelta(days=3)
    assert run_state(RunReader(tmp_path / "all").read(), later) == ("ended", "Choose a specimen for its trials.")
    assert run_state(RunReader(tmp_path / "nothing").read(), now)[0] == "waiting"


def stopped_fleet(folder: Path, **live: Any) -> WatchedRun:
    """A fleet of six whose third specimen was in work when it was stopped, and has a result of its trials so far."""
    write_fleet(folder, s1="DONE", s2="DONE", s3="WORK", s4=None, s5=None, s6=None)
    place = folder / "specimens" / "s3" / "calibrations" / "joint"
    write_json(place / "result.json", {**RESULT, "status": "Stopped by the user after 2 of at most 20 trials."})
    now = datetime.now(UTC)
    write_json(place / "live.json", live_record(os.getpid(), HOST, now=now, ended=True))
    write_json(folder / "live.json", live_record(**{"pid": os.getpid(), "host": HOST, "now": now, **live}))
    return RunReader(folder).read()


LEFT = ("left", "No process works on this fleet. The same command with --resume goes on with it.")
AT_WORK = ("running", "Choose a specimen for its trials.")


def test_a_fleet_that_was_stopped_is_said_to_be_at_once(tmp_path: Path):
    run, now = stopped_fleet(tmp_path, ended=True), datetime.now(UTC)
    assert run_state(run, now) == LEFT
    assert fleet_text(run, now) == "2 of 6 specimens finished"
    assert share_finished(run, now) == pytest.approx(1 / 3)
    assert [row["state"] for row in search_rows(run, now)] == ["Done", "Done", "Stopped", *["Not begun"] * 3]
    assert state_sentence(run.searches[2], now) == "Stopped by the user after 2 of at most 20 trials."
    assert share_done(run.searches[2], now) == pytest.approx(0.1)
    assert fleet_chart(run)["xAxis"]["data"] == ["s1", "s2"]
    killed = stopped_fleet(tmp_path / "killed", pid=gone())
    worker = live_sign(live_record(1, "elsewhere", now=now))  # which does not know it yet
    found = (*killed.searches[:2], replace(killed.searches[2], live=worker), *killed.searches[3:])
    assert run_state(replace(killed, searches=found), now) == LEFT


def test_a_fleet_goes_on_while_its_process_does_whatever_its_specimens_say(tmp_path: Path):
    run, now = stopped_fleet(tmp_path / "here"), datetime.now(UTC)
    assert run_state(run, now) == AT_WORK
    # From the end of its search to its record the fleet works on a specimen.
    assert fleet_text(run, now) == "2 of 6 specimens finished, 1 in work"
    began = (now + timedelta(seconds=5)).isoformat()
    resumed = stopped_fleet(tmp_path / "resumed", began=began)
    assert fleet_text(resumed, now) == "2 of 6 specimens finished"
    assert run_state(resumed, now) == AT_WORK
    other = stopped_fleet(tmp_path / "other", host="elsewhere", age=300, began=began)
    told = "It gave no sign of life lately; whether a process works on this fleet is not known."
    assert run_state(other, now) == ("silent", told)


def test_the_rate_of_a_fleet_is_that_of_its_finished_specimens(tmp_path: Path):
    run, now = stopped_fleet(tmp_path, total=6, done=2, stage="specimens"), datetime.now(UTC)
    ends = [search.ended for search in run.searches[:2] if search.ended is not None]
    late = replace(run.searches[2], ended=now + timedelta(hours=5))
    assert run.live is not None
    assert run.live.began is not None
    assert len(ends) == 2
    expected = (max(ends) - run.live.began).total_seconds() / 2 * 4
    run = replace(run, searches=(*run.searches[:2], late, *run.searches[3:]))
    assert fleet_time_left(run, now) == f"about {span(expected)} more at this rate"


def test_the_chart_of_a_fleet_has_every_finished_specimen(tmp_path: Path):
    write_fleet(tmp_path, a="DONE", b="FAILED", c="DONE")
    chart = fleet_chart(RunReader(tmp_path).read())
    assert chart["xAxis"]["data"] == ["a", "c"]
    assert chart["yAxis"]["name"] == "bar.youngs_modulus [MPa]"
    assert chart["series"][0]["data"] == [pytest.approx([1.3, 1.3, 1.2, 1.4])] * 2
    assert chart["series"][1]["data"] == pytest.approx([1.3, 1.3])


@pytest.mark.parametrize("name", ["..", "a/b", "", "\0", "../../outside"])
def test_a_specimen_outside_the_folder_is_refused(name: str, tmp_path: Path):
    write_json(tmp_path / "run" / "fleet.json", {"specimens": [name]})
    run = RunReader(tmp_path / "run").read()
    assert run.searches == ()
    assert "names a specimen that cannot be one" in run.unreadable[0]


def test_a_damaged_record_of_a_specimen_is_a_sentence(tmp_path: Path):
    write_fleet(tmp_path, a="DONE", b="DONE")
    (tmp_path / "specimens" / "a.json").write_text("{")
    run = RunReader(tmp_path).read()
    assert [search.label for search in run.searches] == ["b"]
    assert run.unreadable == ("specimens/a.json cannot be read: it is not whole.",)


DAMAGED = {
    "a unit that is none": ({"unit": "furlongs"}, "unit"),
    "no text as its unit": ({"unit": [3]}, "unit"),
    "an interval beyond any number": ({"interval": [-1e308, 1e308]}, "interval"),
    "an interval that is turned": ({"interval": [2.0, 1.0]}, "interval"),
    "an interval beside its value": ({"interval": [2e6, 3e6]}, "interval"),
    "an interval of texts": ({"interval": ["a", "b"]}, "interval"),
    "an interval of three": ({"interval": [1.0, 2.0, 3.0]}, "interval"),
    "a value that is none": ({"value": "x"}, "value"),
    "a value beyond any number": ({"value": 1e308}, "value"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_damaged_result_is_a_sentence_and_not_an_error_of_the_page(case: str, tmp_path: Path):
    changes, what = DAMAGED[case]
    name = "bar.youngs_modulus"
    record = {**RESULT, "parameters": {name: {**RESULT["parameters"][name], **changes}}}
    place = write_run(tmp_path / "run") / "calibrations" / "joint"
    add_trials(place, [3.0, 2.0])
    write_json(place / "result.json", record)
    (search,) = RunReader(tmp_path / "run").read().searches
    told = f"cannot be read: {name} has no {what} that can be one."
    assert search.unreadable == (f"calibrations/joint/result.json {told}",)
    assert (search.result, len(search.trials)) == (None, 2)
    assert [row["name"] for row in best_rows(search, ParameterFacts())] == [name]
    fleet = write_fleet(tmp_path / "fleet", a="DONE", b="DONE")
    write_json(fleet / "specimens" / "b.json", {"state": "DONE", "loss": 0.5, **record})
    run = RunReader(fleet).read()
    assert run.unreadable == (f"specimens/b.json {told}",)
    assert fleet_chart(run)["xAxis"]["data"] == ["a"]
