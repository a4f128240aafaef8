"""A run's folder as the page reads it: half-written, damaged, made up; and what the page says of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from watch_case import HOST, NOW, RESULT, add_trials, gone, live_record, write_fleet, write_json, write_run

from softcal.calibration.results.result import Trial
from softcal.plugins.watch import trials
from softcal.plugins.watch.charts import MOST_POINTS, loss_chart, parameter_chart
from softcal.plugins.watch.live import live_sign, process_exists, process_start
from softcal.plugins.watch.reading import Unreadable, clean, read_record
from softcal.plugins.watch.run_reader import RunReader
from softcal.plugins.watch.twin import ParameterFacts, run_of
from softcal.plugins.watch.watched import WatchedResult, WatchedSearch
from softcal.plugins.watch.words import (
    best_rows,
    failed_rows,
    run_state,
    search_rows,
    share_done,
    state_sentence,
    time_text,
    trials_text,
)


def files(folder: Path) -> dict[str, tuple[int, int]]:
    return {str(p): (p.stat().st_mtime_ns, p.stat().st_size) for p in folder.rglob("*") if p.is_file()}


def test_trials_are_read_as_they_come(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    reader = RunReader(tmp_path)
    (search,) = reader.read().searches
    assert (search.done, search.total, search.best, search.course(NOW)) == (0, 20, None, "waiting")
    add_trials(place, [3.0, None, 2.0])
    (search,) = reader.read().searches
    assert search.best is not None
    assert (search.done, search.best.number, search.best.loss, len(search.failed)) == (3, 2, 2.0, 1)
    assert search.failed[0].reason == "it broke."
    add_trials(place, [2.5, 1.0])
    (search,) = reader.read().searches
    assert search.best is not None
    assert (search.done, search.best.number, search.best.loss) == (5, 4, 1.0)
    assert search.best.theta == {"bar.youngs_modulus": 1.04e6}


def test_reading_writes_nothing(tmp_path: Path):
    add_trials(write_run(tmp_path) / "calibrations" / "joint", [3.0, None])
    before = files(tmp_path)
    RunReader(tmp_path).read()
    assert files(tmp_path) == before


def test_a_line_that_is_half_written_is_read_when_it_is_whole(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [3.0, 2.0])
    journal = place / "optuna.journal"
    whole = journal.read_bytes()
    journal.write_bytes(whole[:-40])
    reader = RunReader(tmp_path)
    assert reader.read().searches[0].done == 1
    with journal.open("ab") as file:
        file.write(whole[-40:])
    (search,) = reader.read().searches
    assert (search.done, search.unreadable) == (2, ())


def test_a_new_journal_in_the_place_of_the_old_one_is_read_anew(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [3.0, 2.0, 1.0])
    reader = RunReader(tmp_path)
    assert reader.read().searches[0].done == 3
    (place / "optuna.journal").unlink()
    add_trials(place, [5.0])
    assert [trial.loss for trial in reader.read().searches[0].trials] == [5.0]


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '{"calibrations": 3}', "\xff\xfe", "nul", '{"a": ' + "[" * 20000])
def test_a_damaged_record_is_a_sentence_or_nothing(text: str, tmp_path: Path):
    (tmp_path / "run.json").write_text(text, encoding="latin-1")
    run = RunReader(tmp_path).read()
    assert run.searches == ()
    assert all("run.json" in sentence and sentence.endswith(".") for sentence in run.unreadable)
    assert bool(run.unreadable) == (text != '{"calibrations": 3}')


@pytest.mark.parametrize(
    "data", [b"no journal\nat all\n", b"\x80\x04cposix\nsystem\n", b'{"op_code":4}\n{"op_code":4}\n', b"[]\n{}\n"]
)
def test_a_damaged_journal_is_a_sentence(data: bytes, tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    (place / "optuna.journal").write_bytes(data)
    (search,) = RunReader(tmp_path).read().searches
    assert search.trials == ()
    assert search.unreadable == ("optuna.journal cannot be read: it is damaged.",)


@pytest.mark.parametrize("label", ["..", "../../outside", "/etc", "a/b", "", "\0", 7, None])
def test_a_calibration_outside_the_folder_is_refused(label: object, tmp_path: Path):
    write_run(tmp_path / "outside")
    write_json(tmp_path / "run" / "run.json", {"calibrations": [label], "project": "p"})
    run = RunReader(tmp_path / "run").read()
    assert run.searches == ()
    assert "names a calibration that cannot be one" in run.unreadable[0]


def test_links_that_lead_out_of_the_folder_are_not_followed(tmp_path: Path):
    secret = tmp_path / "secret"
    add_trials(write_run(secret) / "calibrations" / "joint", [1.0])
    write_json(secret / "calibrations" / "joint" / "live.json", live_record(1, HOST))
    (secret / "report.html").write_text("secret")
    run = write_run(tmp_path / "run", labels=["joint", "linked"])
    (run / "calibrations" / "joint" / "optuna.journal").symlink_to(secret / "calibrations" / "joint" / "optuna.journal")
    (run / "report.html").symlink_to(secret / "report.html")
    for path in (run / "calibrations" / "linked").iterdir():
        path.unlink()
    (run / "calibrations" / "linked").rmdir()
    (run / "calibrations" / "linked").symlink_to(secret / "calibrations" / "joint")
    seen = RunReader(run).read()
    assert [(search.done, search.live) for search in seen.searches] == [(0, None), (0, None)]
    assert seen.report == ""


def test_a_pipe_in_the_place_of_a_file_does_not_block(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    os.mkfifo(place / "optuna.journal")
    os.mkfifo(place / "live.json")
    (search,) = RunReader(tmp_path).read().searches
    assert (search.trials, search.live, search.result) == ((), None, None)


def test_texts_can_be_shown_whatever_they_are(tmp_path: Path):
    (tmp_path / "run.json").write_text('{"project": "\\ud800<b>\\u0007", "calibrations": []}')
    name = RunReader(tmp_path).read().name
    assert name.encode() == b"?<b> "
    assert len(clean("x" * 9000)) == 2001


def test_a_record_is_not_read_if_it_is_no_object(tmp_path: Path):
    (tmp_path / "live.json").write_text("[]")
    with pytest.raises(Unreadable, match=r"live.json is no record of softcal's\."):
        read_record(tmp_path, "live.json")


def watched(**changes: object) -> WatchedSearch:
    return WatchedSearch("joint", "calibrations/joint", **changes)  # type: ignore[arg-type]


def test_a_process_that_works_is_running_and_one_that_is_gone_is_said_to_be():
    here = live_sign(live_record(os.getpid(), HOST, age=2))
    assert watched(live=here).course(NOW) == "running"
    assert state_sentence(watched(live=here), NOW) == ""
    now, stage = datetime.now(UTC), "importances (fANOVA)"
    late = live_sign(live_record(os.getpid(), HOST, now=now, began=now.isoformat(), stage=stage))
    later = now + timedelta(seconds=600)
    assert watched(live=late).course(later) == "running"
    assert state_sentence(watched(live=late), later) == "importances (fANOVA); last sign of life 10 min 0 s ago"
    left = watched(live=live_sign(live_record(gone(), HOST, age=600)))
    assert left.course(NOW) == "left"
    expected = "No process works on this run. Its last sign of life was 10 min 0 s ago."
    assert state_sentence(left, NOW) == f"{expected} The same command with --resume goes on with it."


def test_another_process_that_has_the_number_by_now_is_not_taken_for_the_search(tmp_path: Path):
    # This process began months after the search; of one that tells no beginning nothing is known.
    for changes in ({}, {"began": None}):
        other = live_sign(live_record(os.getpid(), HOST, age=600, **changes))
        assert watched(live=other).course(NOW) == "silent"
        said = "It gave no sign of life for 10 min 0 s; whether a process works on it is not known."
        assert state_sentence(watched(live=other), NOW) == said
        assert watched(live=other, result=WatchedResult((), None, "", ()), ended=NOW).course(NOW) == "ended"
    write_fleet(tmp_path, a="DONE", b=None)
    place = tmp_path / "specimens" / "b" / "calibrations" / "joint"
    write_run(tmp_path / "specimens" / "b")
    write_json(place / "live.json", live_record(os.getpid(), HOST, age=600))
    told = "It gave no sign of life lately; whether a process works on this fleet is not known."
    later = datetime.now(UTC) + timedelta(seconds=90)
    assert run_state(RunReader(tmp_path).read(), later) == ("silent", told)


def test_a_process_began_when_it_did():
    before = datetime.now(UTC)
    with subprocess.Popen(["sleep", "60"]) as process:
        began = process_start(process.pid)
        process.kill()
    assert began is not None
    assert abs((began - before).total_seconds()) < 60
    assert process_start(process.pid) is None
    assert process_start(2**40) is None


def test_a_search_that_ended_without_a_result_is_not_running_in_a_process_that_goes_on():
    ended = watched(live=live_sign(live_record(os.getpid(), HOST, age=5, ended=True)))
    assert ended.course(NOW) == "left"
    said = "The search ended without a result. Its last sign of life was 5 s ago."
    assert state_sentence(ended, NOW) == said
    other = watched(live=live_sign(live_record(1, "other", age=5, ended=True)))
    assert state_sentence(other, NOW) == said


def test_a_process_on_another_machine_is_judged_by_its_last_sign():
    assert watched(live=live_sign(live_record(1, "other", age=5))).course(NOW) == "running"
    silent = watched(live=live_sign(live_record(1, "other", age=300)))
    assert silent.course(NOW) == "silent"
    assert state_sentence(silent, NOW) == "It runs on other, and gave no sign of life for 5 min 0 s."


def test_without_a_sign_of_life_the_file_is_what_is_known():
    fresh, old = NOW - timedelta(seconds=10), NOW - timedelta(seconds=3700)
    assert watched(written=fresh).course(NOW) == "running"
    assert watched(written=old).course(NOW) == "silent"
    said = "Nothing was written for 1 h 1 min; whether a process works on this run is not known."
    assert state_sentence(watched(written=old), NOW) == said


def test_a_result_ends_a_search_until_it_is_resumed(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [3.0])
    write_json(place / "result.json", RESULT)
    now = datetime.now(UTC)
    (search,) = RunReader(tmp_path).read().searches
    assert search.course(now) == "ended"
    assert state_sentence(search, now) == "All 20 trials were run."
    assert share_done(search, now) == 1.0
    later = (now + timedelta(seconds=30)).isoformat()
    write_json(place / "live.json", live_record(os.getpid(), HOST, now=now, began=later))
    assert RunReader(tmp_path).read().searches[0].course(now) == "running"
    write_json(place / "live.json", live_record(os.getpid(), HOST, now=now))
    assert RunReader(tmp_path).read().searches[0].course(now) == "ended"


def test_a_zombie_is_no_process():
    with subprocess.Popen([sys.executable, "-c", ""], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.read()  # it has ended, and nobody has waited for it
        while Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
            pass
        assert not process_exists(process.pid)
    assert process_exists(os.getpid())
    assert not process_exists(0)
    assert not process_exists(2**40)


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"pid": "x", "workers": 3, "began": "yesterday"},
        {"pid": 10**400, "updated": 5, "workers": [None, {"name": []}]},
    ],
)
def test_a_made_up_sign_of_life_is_read(record: dict[str, object]):
    live = live_sign(json.loads(json.dumps(record)))
    assert (live.pid, live.began, live.updated) == (None, None, None)
    assert not live.has_process
    state_sentence(watched(live=live), NOW)


def test_words_of_a_running_search(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [3.0, None, 2.0])
    write_json(place / "live.json", live_record(os.getpid(), HOST))
    (search,) = RunReader(tmp_path).read().searches
    assert trials_text(search) == "3 of at most 20"
    assert time_text(search, NOW) == "10 min 0 s"
    assert share_done(search, NOW) == pytest.approx(0.15)
    facts = ParameterFacts({"bar.youngs_modulus": "Pa"}, {"bar.youngs_modulus": (1e5, 4e7)})
    assert best_rows(search, facts) == [
        {"name": "bar.youngs_modulus", "value": "1.02 MPa", "range": "100 kPa to 40 MPa"}
    ]
    assert best_rows(search, ParameterFacts())[0]["value"] == "1.02e+06 (SI)"
    assert failed_rows(search, facts) == [{"trial": 1, "reason": "it broke.", "at": "bar.youngs_modulus 1.01 MPa"}]


def test_without_a_sign_of_life_the_time_is_that_of_the_last_trial(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    assert time_text(RunReader(tmp_path).read().searches[0], NOW) == "–"
    add_trials(place, [3.0] * 35)
    assert time_text(RunReader(tmp_path).read().searches[0], NOW) == "1 min 10 s"


def test_words_of_a_result_are_those_of_its_record(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    write_json(place / "result.json", RESULT)
    run = RunReader(tmp_path).read()
    assert best_rows(run.searches[0], ParameterFacts()) == [
        {"name": "bar.youngs_modulus", "value": "1.3 MPa", "range": "1.2 to 1.4 MPa"},
        {"name": "front.slack", "value": "5 mm (at a bound)", "range": "–"},
    ]
    assert run.searches[0].result is not None
    assert run.searches[0].result.notes == ("The slack is at a bound.",)


def test_a_folder_of_runs_and_of_scores_is_shown_as_one(tmp_path: Path):
    add_trials(write_run(tmp_path / "a") / "calibrations" / "joint", [1.0])
    write_run(tmp_path / "b", labels=["one", "two"])
    error = {"rms": 0.001, "mean": 0.002, "most_95": 0.003, "largest": 0.004}
    split = {"n_samples": 2, "points": {"tip": error}, "all_points": None, "channels": {}, "coverage": None}
    write_json(tmp_path / "c" / "score.json", {"case": "beam", "method": "softcal", "splits": {"fit": split}})
    run = RunReader(tmp_path).read()
    assert [row["label"] for row in search_rows(run, NOW)] == ["a", "b: one", "b: two"]
    assert run.scores[0].rows == (("fit", "tip", 0.001, 0.002, 0.004),)
    assert [run_of(search) for search in run.searches] == ["a", "b", "b"]


def test_numbers_that_none_of_softcal_s_are_do_not_stop_the_page(tmp_path: Path):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [1e-308, 1e308])
    write_json(place / "live.json", live_record(os.getpid(), HOST, total=10**300, done=10**300))
    (search,) = RunReader(tmp_path).read().searches
    assert search.live is not None
    assert (search.live.total, search.live.done) == (None, None)
    assert [trial.loss for trial in search.trials] == [1e-308, None]
    json.dumps([loss_chart(search), parameter_chart(search, ParameterFacts())], allow_nan=False)


def test_the_search_at_work_is_shown_first(tmp_path: Path):
    write_run(tmp_path, labels=["one", "two", "joint"])
    reader = RunReader(tmp_path)
    write_json(tmp_path / "calibrations" / "two" / "live.json", live_record(os.getpid(), HOST))
    shown = reader.read().now_at(NOW)
    assert shown is not None
    assert shown.label == "two"
    write_json(tmp_path / "calibrations" / "two" / "result.json", RESULT)
    shown = reader.read().now_at(datetime.now(UTC))
    assert shown is not None
    assert shown.label == "joint"


def test_a_folder_that_is_not_there_is_one_without_a_run(tmp_path: Path):
    run = RunReader(tmp_path / "later").read()
    assert (run.name, run.searches, run.unreadable) == ("later", (), ())


def test_a_chart_of_many_trials_has_few_points_and_the_best():
    trials = [Trial(n, {"E": 1e6 + n}, "COMPLETE", 5.0 + n % 7) for n in range(20000)]
    trials[12345] = Trial(12345, {"E": 2e6}, "COMPLETE", 0.5)
    search = watched(trials=tuple(trials))
    chart = loss_chart(search)
    assert len(chart["series"][0]["data"]) <= MOST_POINTS + 1
    assert [12345, 0.5] in chart["series"][0]["data"]
    assert chart["series"][1]["data"] == [[0, 5.0], [12345, 0.5], [19999, 0.5]]
    assert len(parameter_chart(search, ParameterFacts())["series"][0]["data"]) <= MOST_POINTS + 1


@pytest.mark.parametrize("count", [1, 2, 3, 14, 30])
@pytest.mark.parametrize("losses", [[1.0], [0.0, -1.0], [1e-9, 1e9], [None], []])
def test_charts_of_any_number_of_parameters_and_losses(count: int, losses: list[float | None]):
    theta = {f"part{k}.youngs_modulus": 1e6 for k in range(count)}
    trials = [Trial(n, theta, "FAILED" if loss is None else "COMPLETE", loss) for n, loss in enumerate(losses)]
    search = watched(trials=tuple(trials))
    known = ParameterFacts(dict.fromkeys(theta, "Pa"), dict.fromkeys(theta, (1e5, 4e7)))
    for facts in (ParameterFacts(), known):
        json.dumps([loss_chart(search), parameter_chart(search, facts)], allow_nan=False)


def test_a_journal_that_is_too_large_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    place = write_run(tmp_path) / "calibrations" / "joint"
    add_trials(place, [3.0, 2.0, 1.0])
    reader = RunReader(tmp_path)
    assert reader.read().searches[0].done == 3
    with (place / "optuna.journal").open("ab") as file:
        file.truncate(2**33)
    assert reader.read().searches[0].unreadable == ("optuna.journal cannot be read: it has more than 268435456 bytes.",)
    with (place / "optuna.journal").open("ab") as file:
        file.truncate(2**27)  # a line of zeros
    assert reader.read().searches[0].unreadable == ("optuna.journal cannot be read: it is damaged.",)
    (place / "optuna.journal").unlink()
    add_trials(place, [3.0, 2.0, 1.0])
    monkeypatch.setattr(trials, "MOST_VALUES", 2)
    assert reader.read().searches[0].unreadable == ("optuna.journal has more trials than the page shows.",)


def test_the_end_of_the_page_does_not_wait_for_a_folder_that_is_read(tmp_path: Path):
    """As of a journal of many trials, or of a server that no longer answers."""
    code = f"""
import asyncio, time
from pathlib import Path
from softcal.plugins.watch.watch import Watch
watch = Watch(Path({str(tmp_path)!r}))
watch.reader.read = lambda: time.sleep(60)
async def page():
    try:
        await asyncio.wait_for(watch.now(), 0.2)
    except TimeoutError:
        print("left")
asyncio.run(page())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout == "left\n"
