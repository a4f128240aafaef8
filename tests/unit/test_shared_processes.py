"""A search that several processes share: every trial is there once, whoever is killed, in files and on servers."""

from __future__ import annotations

import contextlib
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from postgres_server import postgres_folder, postgres_served
from shared_processes import at_end, joined, outcome, processes, require_whole, shared, until

from softcal.calibration.results.trial_journal import stored_trials
from softcal.calibration.search import shared_study, storage_url


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_study, "BEAT", 0.2)
    monkeypatch.setattr(shared_study, "GRACE", 2.0)


def storages(*long: str) -> pytest.MarkDecorator:
    """The test on every storage; on those named here it is a long one."""
    marks = {name: pytest.mark.long if name in long else () for name in ("journal", "postgresql", "mysql")}
    return pytest.mark.parametrize("place", [pytest.param(n, marks=m) for n, m in marks.items()], indirect=True)


@pytest.fixture
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A storage without a study."""
    if request.param == "journal":
        return f"journal:{tmp_path / 'shared.journal'}"
    url = request.getfixturevalue(request.param)
    with storage_url.storage_url(url).opened() as storage:
        for study in storage.get_all_studies():
            storage.delete_study(study._study_id)
    return url


@pytest.mark.slow
@storages("mysql")
def test_the_trials_of_a_process_that_is_killed_are_tried_again(place: str, tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    with processes(folders, place, 24, pause=0.1) as (first, second):
        until(first, 4)
        first.kill()
        assert at_end(second) == 0
    require_whole(place, 24, folders[1:])


@storages()
def test_an_outcome_of_any_length_is_there_whole(place: str) -> None:
    """Of a thousand experiments it is longer than a column of MySQL's."""
    with joined(place) as one, joined(place) as other:
        (proposal,) = one.ask(1, 1)
        losses = {f"specimen {i} pulled to the front": i / 3 for i in range(1000)}
        told = outcome(proposal.number, proposal.theta)
        told = replace(
            told, trial=replace(told.trial, experiment_losses=losses, errors={e: {"a": 1 / 3} for e in losses})
        )
        assert one.tell(told)
        assert other.outcomes() == {0: told} == one.outcomes()


@pytest.mark.slow
def test_a_shared_search_goes_on_after_all_its_processes_were_killed(tmp_path: Path, quick: None) -> None:
    place, folders = f"journal:{tmp_path / 'shared.journal'}", [tmp_path / "a", tmp_path / "b"]
    with processes(folders, place, 24, pause=0.1) as begun:
        until(begun[0], 4)
        for process in begun:
            process.send_signal(signal.SIGKILL)
    held = stored_trials(folders[0])
    assert 4 <= len(held) < 24
    result = shared(tmp_path / "a", place, 24, resume=True)
    require_whole(place, 24, folders[:1])
    assert {number: stored.trial for number, stored in held.items()}.items() <= {
        t.number: t for t in result.trials
    }.items()


@pytest.mark.long
def test_a_database_that_is_started_again_ends_no_process_and_loses_no_trial(tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    with postgres_folder() as folder, contextlib.ExitStack() as stack:
        with postgres_served(folder) as url:
            begun = stack.enter_context(processes(folders, url, 40, pause=0.1))
            until(begun[0], 4)
        with postgres_served(folder):
            assert [at_end(process) for process in begun] == [0, 0]
            require_whole(url, 40, folders)


@pytest.mark.slow
@storages("journal", "postgresql", "mysql")
def test_hundreds_of_trials_by_eight_processes_two_of_them_killed(place: str, tmp_path: Path) -> None:
    folders = [tmp_path / str(i) for i in range(8)]
    with processes(folders, place, 400) as begun:
        until(begun[0], 100)
        begun[0].kill()
        until(begun[1], 200)
        begun[1].kill()
        with ThreadPoolExecutor(6) as pool:
            assert list(pool.map(at_end, begun[2:])) == [0] * 6
    require_whole(place, 400, folders[2:])


@pytest.mark.long
@storages()
def test_processes_that_are_killed_at_random_and_begun_again_lose_and_double_nothing(
    place: str, tmp_path: Path
) -> None:
    folders = [tmp_path / str(i) for i in range(3)]
    done = 0
    while done < 60:
        done += 10
        with processes(folders, place, 80, pause=0.05) as begun:
            until(begun[done % 3], min(done, 60))
    with processes(folders, place, 80) as begun:
        with ThreadPoolExecutor(3) as pool:
            assert list(pool.map(at_end, begun)) == [0, 0, 0]
    require_whole(place, 80, folders)
