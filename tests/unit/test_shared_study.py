"""Searches that several processes share: every trial is there once, whoever dies; another search is refused."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_twin import NU, E, all_necks_fail, soft_necks_fail
from postgres_server import postgres
from test_calibration_run import problem_of

from softcal.calibration import shared_study, storage_url
from softcal.calibration.optimisers.tpe import tpe_sampler
from softcal.calibration.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.calibration.shared_search import Sharing
from softcal.calibration.shared_study import SharedStudy, StudyIdentity
from softcal.calibration.trial_journal import StoredTrial, stored_trials
from softcal.errors import CalibrationError, ParameterError, StorageError

_PROCESS = """
import sys, time
sys.path[:0] = {path!r}
from pathlib import Path
from fake_twin import soft_necks_fail
from test_calibration_run import problem_of
from softcal.calibration import shared_study
from softcal.calibration.run import calibrate
from softcal.calibration.shared_search import Sharing

shared_study.BEAT, shared_study.GRACE = 0.2, 2.0

def slow(robot, protocol, theta=None, **options):
    time.sleep({pause})
    return soft_necks_fail(robot, protocol, theta, **options)

def tell(progress):
    print(progress.done, flush=True)

calibrate(problem_of(slow), method="tpe", trials={trials}, store=Path({folder!r}), sharing=Sharing({url!r}),
          progress=tell, resume={resume!r})
"""


@contextlib.contextmanager
def processes(
    folders: list[Path], url: str, trials: int, *, pause: float = 0.01, resume: bool = False
) -> Generator[list[subprocess.Popen[str]]]:
    here = Path(__file__).parent
    settings = {"path": [str(here), str(here.parent)], "pause": pause, "trials": trials, "url": url, "resume": resume}
    scripts = [_PROCESS.format(folder=str(folder), **settings) for folder in folders]
    begun = [subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) for script in scripts]
    watchdog = threading.Timer(500, lambda: [one.kill() for one in begun])
    watchdog.start()
    try:
        yield begun
    finally:
        watchdog.cancel()
        for one in begun:
            one.kill()
            one.wait()
            if one.stdout is not None:
                one.stdout.close()


def until(process: subprocess.Popen[str], done: int) -> None:
    """Wait until a process has seen so many trials told."""
    assert process.stdout is not None
    assert any(int(line) >= done for line in process.stdout), "it ended before"


def at_end(process: subprocess.Popen[str]) -> int:
    """The exit code of a process, its output read to the end."""
    assert process.stdout is not None
    process.stdout.read()
    return process.wait()


@contextlib.contextmanager
def study_at(url: str, *, new: bool = False) -> Generator[Any]:
    import optuna

    with storage_url.storage_url(url).opened() as storage:
        if new:
            optuna.create_study(study_name="softcal", storage=storage)
        yield optuna.load_study(study_name="softcal", storage=storage)


def require_whole(url: str, trials: int, folders: list[Path]) -> None:
    """Every trial once, in the study and in every folder, and none that has not ended."""
    with study_at(url) as study:
        held = study.trials
    counts = Counter(trial.state.name for trial in held)
    assert set(counts) <= {"COMPLETE", "FAIL", "PRUNED"}, counts
    told = {t.number: t for t in held if t.state.name == "COMPLETE" or t.user_attrs.get("softcal", {}).get("failed")}
    assert len(told) == trials
    assert all(trial.params.keys() == {E, NU} for trial in told.values())
    assert len({tuple(trial.params.values()) for trial in told.values()}) == trials  # no point is there twice
    for folder in folders:
        kept = stored_trials(folder)
        assert list(kept) == sorted(told)
        for number, stored in kept.items():
            assert dict(stored.trial.theta) == told[number].params
            assert stored.trial.loss == told[number].value
            assert bool(stored.trial.reason) == (stored.trial.loss is None)
        result = load_result(folder)
        assert len(result.trials) == trials
        assert result.loss == min(trial.value for trial in told.values() if trial.value is not None)


@pytest.fixture(scope="module")
def server() -> Generator[str]:
    with postgres() as url:
        yield url


@pytest.fixture(params=["journal", "postgresql"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A storage without a study."""
    if request.param == "journal":
        return f"journal:{tmp_path / 'shared.journal'}"
    url = request.getfixturevalue("server")
    with storage_url.storage_url(url).opened() as storage:
        for study in storage.get_all_studies():
            storage.delete_study(study._study_id)
    return url


def test_the_trials_of_a_process_that_is_killed_are_tried_again(place: str, tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    with processes(folders, place, 24, pause=0.1) as (first, second):
        until(first, 4)
        first.kill()
        assert at_end(second) == 0
    require_whole(place, 24, folders[1:])


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


@pytest.mark.slow
def test_a_thousand_trials_by_eight_processes_two_of_them_killed(place: str, tmp_path: Path) -> None:
    folders = [tmp_path / str(i) for i in range(8)]
    with processes(folders, place, 1000) as begun:
        until(begun[0], 100)
        begun[0].kill()
        until(begun[1], 500)
        begun[1].kill()
        with ThreadPoolExecutor(6) as pool:
            assert list(pool.map(at_end, begun[2:])) == [0] * 6
    require_whole(place, 1000, folders[2:])


@pytest.mark.slow
def test_processes_that_are_killed_at_random_and_begun_again_lose_and_double_nothing(
    place: str, tmp_path: Path
) -> None:
    folders = [tmp_path / str(i) for i in range(3)]
    done = 0
    while done < 60:
        resume = all((folder / "run.json").is_file() for folder in folders)
        done += 10
        with processes(folders, place, 80, pause=0.05, resume=resume) as begun:
            until(begun[done % 3], min(done, 60))
    with processes(folders, place, 80, resume=True) as begun:
        with ThreadPoolExecutor(3) as pool:
            assert list(pool.map(at_end, begun)) == [0, 0, 0]
    require_whole(place, 80, folders)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_study, "BEAT", 0.2)
    monkeypatch.setattr(shared_study, "GRACE", 2.0)


def shared(folder: Path | None, place: str, trials: int, simulate: Any = soft_necks_fail, **options: Any) -> Any:
    given: dict[str, Any] = {"method": "tpe", "trials": trials, **options}
    return calibrate(problem_of(simulate), **given, store=folder, sharing=Sharing(place))


@pytest.fixture
def journal(tmp_path: Path) -> str:
    return f"journal:{tmp_path / 'shared.journal'}"


def test_one_process_alone_does_all_trials_and_later_ones_find_them(journal: str, tmp_path: Path) -> None:
    one = shared(tmp_path / "a", journal, 12)
    assert one.status == "All 12 trials were run, 12 of them by this process."
    assert json.loads((tmp_path / "a" / "run.json").read_text())["settings"]["study"] == "softcal"
    other = shared(tmp_path / "b", journal, 12)
    assert other.status == "All 12 trials were run, 0 of them by this process."
    assert other.trials == one.trials
    assert other.parameters == one.parameters
    more = shared(tmp_path / "c", journal, 15)
    assert more.trials[:12] == one.trials
    assert len(more.trials) == 15
    require_whole(journal, 15, [tmp_path / "c"])


def test_the_random_numbers_of_a_trial_follow_from_its_number_and_the_seed(tmp_path: Path) -> None:
    first, again, other = (
        [dict(t.theta) for t in shared(None, f"journal:{tmp_path / name}", 6, seed=seed).trials]
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    assert first == again
    assert len({theta[E] for theta in first}) == 6
    assert not {theta[E] for theta in first} & {theta[E] for theta in other}


def test_interrupted_it_leaves_its_trial_to_the_others_at_once(journal: str, tmp_path: Path) -> None:
    pressed: list[dict[str, float]] = []

    def press(robot: Any, protocol: Any, theta: Any = None, **options: Any) -> Any:
        if not pressed and len(stored_trials(tmp_path / "a")) == 5:
            pressed.append(theta)
            signal.raise_signal(signal.SIGINT)
        return soft_necks_fail(robot, protocol, theta, **options)

    partial = shared(tmp_path / "a", journal, 9, press)
    assert partial.status.startswith("Stopped by the user after 5 of 9 trials, 5 of them by this process")
    whole = shared(tmp_path / "b", journal, 9)  # its own patience would be a minute
    assert any(dict(t.theta).items() >= pressed[0].items() for t in whole.trials)
    require_whole(journal, 9, [tmp_path / "b"])
    resumed = shared(tmp_path / "a", journal, 9, resume=True)
    assert resumed.trials == whole.trials


def test_all_failed_trials_keep_their_reasons_and_there_is_no_result(journal: str, tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"All 4 trials failed.*No equilibrium beyond 1\.0 mm\."):
        shared(tmp_path / "a", journal, 4, all_necks_fail)
    reasons = [stored.trial.reason for stored in stored_trials(tmp_path / "a").values()]
    assert all("No equilibrium beyond 1.0 mm." in reason for reason in reasons)
    assert len(reasons) == 4
    with study_at(journal) as study:
        outcomes = [trial.user_attrs["softcal"]["reason"] for trial in study.trials]
    assert outcomes == reasons


def test_the_best_trial_of_another_machine_is_told_where_its_loss_is_another_here(journal: str, tmp_path: Path) -> None:
    whole = shared(None, journal, 6, seed=3)
    with study_at(journal) as study:
        best = next(trial for trial in study.trials if trial.value == whole.loss)
    path = Path(journal.removeprefix("journal:"))
    lines = path.read_text().splitlines()
    changed = [line.replace(f'"values":[{best.value}]', f'"values":[{best.value / 2}]') for line in lines]
    assert changed != lines
    path.write_text("\n".join(changed) + "\n")
    other = shared(tmp_path / "a", journal, 6, seed=3)
    told = f"Trial {best.number}, the best, had the loss {best.value / 2:.6g}; evaluated again by this process it has"
    assert told in other.status
    assert "evaluated again" not in whole.status
    assert load_result(tmp_path / "a").loss == best.value / 2


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"problem": {"noise": 0.03}}, r"study softcal: the shared study calibrates something else: experiment 20mm"),
        ({"seed": 9}, r"the shared study began with other settings: seed; got 9; allowed: 1"),
        ({"startup_trials": 3}, r"other settings: startup_trials"),
    ],
    ids=["problem", "seed", "option"],
)
def test_another_search_is_refused_and_nothing_is_made(
    change: dict[str, Any], told: str, journal: str, tmp_path: Path
) -> None:
    shared(None, journal, 3)
    before = Path(journal.removeprefix("journal:")).read_bytes()
    problem = problem_of(soft_necks_fail, **change.pop("problem", {}))
    with pytest.raises(StorageError, match=told):
        calibrate(problem, method="tpe", trials=3, store=tmp_path / "a", sharing=Sharing(journal), **change)
    assert not (tmp_path / "a").exists()
    assert Path(journal.removeprefix("journal:")).read_bytes() == before


def test_a_folder_of_another_study_is_not_resumed(journal: str, tmp_path: Path) -> None:
    shared(tmp_path / "a", journal, 3)
    with pytest.raises(StorageError, match="other settings: study; got nothing; allowed: softcal"):
        calibrate(problem_of(soft_necks_fail), method="tpe", trials=3, store=tmp_path / "a", resume=True)
    with pytest.raises(StorageError, match="they are of another study: trial 0 is not in the study"):
        shared(tmp_path / "a", f"{journal}.other", 3, resume=True)


def test_another_method_is_refused(journal: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"only the method tpe can be shared.*got method grid"):
        calibrate(problem_of(), method="grid", store=tmp_path / "a", sharing=Sharing(journal))
    assert list(tmp_path.iterdir()) == []


def test_a_study_that_is_none_of_softcals_or_of_another_format_is_refused(tmp_path: Path) -> None:
    url = f"journal:{tmp_path / 'other'}"
    with study_at(url, new=True) as study:
        study.optimize(lambda trial: trial.suggest_float("x", 0, 1), n_trials=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shared_study, "_BEGINNING", 0.0)
        with pytest.raises(StorageError, match="not made by softcal"):
            shared(None, url, 3)
    url = f"journal:{tmp_path / 'later'}"
    with study_at(url, new=True) as study:
        study.set_user_attr("softcal", {"format": 2})
    with pytest.raises(StorageError, match="shared study is of another format; got 2; allowed: 1"):
        shared(None, url, 3)
    url = f"journal:{tmp_path / 'damaged'}"
    with study_at(url, new=True) as study:
        study.set_user_attr("softcal", {"format": 1, "identity": 7})
    with pytest.raises(StorageError, match="shared study cannot be read"):
        shared(None, url, 3)
    url = f"journal:{tmp_path / 'mixed'}"
    shared(None, f"{url}-whole", 2)
    with study_at(url, new=True) as study, study_at(f"{url}-whole") as whole:
        study.set_user_attr("softcal", whole.user_attrs["softcal"])
        study.optimize(lambda trial: trial.suggest_float("x", 0, 1), n_trials=1)
    with pytest.raises(StorageError, match="trial 0 of the study softcal cannot be read: it has no outcome"):
        shared(None, url, 3)


def test_a_study_whose_first_process_died_before_it_said_what_it_is_is_taken_over(
    journal: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_study, "_BEGINNING", 0.0)
    with study_at(journal, new=True):
        pass
    assert len(shared(None, journal, 3).trials) == 3


def joined(journal: str, total: int = 0) -> SharedStudy:
    about = StudyIdentity("softcal", {"robot": "a"}, {"seed": 1})
    space = problem_of().space
    return SharedStudy(storage_url.storage_url(journal), about, space, seed=1, sampler=tpe_sampler)


def outcome(number: int, theta: Any, loss: float | None = 1.0) -> StoredTrial:
    from softcal.calibration.result import Trial

    state = "FAILED" if loss is None else "COMPLETE"
    return StoredTrial(Trial(number, theta, state, loss, "" if loss else "No."), 1, 1.0, None)


def test_no_more_trials_begin_than_are_wanted_and_those_of_a_race_are_pruned(
    journal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with joined(journal) as one, joined(journal) as other:
        assert [proposal.number for proposal in one.ask(2, 5)] == [0, 1]
        assert other.ask(2, 5) == ()
        blind, real = [True], other._counted

        def counted(trials: Any) -> set[int]:
            return set() if blind and blind.pop() else real(trials)

        monkeypatch.setattr(other, "_counted", counted)
        assert other.ask(2, 5) == ()
        with study_at(journal) as study:
            assert [trial.state.name for trial in study.trials] == ["RUNNING", "RUNNING", "PRUNED"]


def test_a_trial_without_a_sign_of_life_is_given_up_and_its_point_tried_again_once(
    journal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(shared_study, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda _: None))
    with joined(journal) as silent, joined(journal) as one, joined(journal) as other:
        (lost,) = silent.ask(1, 1)
        assert one.ask(1, 1) == () == other.ask(1, 1)
        clock[0] = shared_study.GRACE - 1
        silent._mine[0].set_user_attr("beat", 1)
        assert one.ask(1, 1) == () == other.ask(1, 1)
        clock[0] = 2 * shared_study.GRACE - 2
        assert one.ask(1, 1) == () == other.ask(1, 1)
        clock[0] = 2 * shared_study.GRACE
        (again,) = one.ask(1, 1)
        assert dict(again.theta) == dict(lost.theta)
        assert other.ask(1, 1) == ()
        assert not silent.tell(outcome(lost.number, lost.theta))
        assert one.tell(outcome(again.number, again.theta))
        assert list(other.outcomes()) == [again.number]


def test_a_failure_that_was_told_just_before_its_trial_was_given_up_counts_once(journal: str) -> None:
    with joined(journal) as one, joined(journal) as other:
        (proposal,) = one.ask(1, 1)
        held = one._mine[proposal.number]
        held.set_user_attr("softcal", {**shared_study.attributes(outcome(0, proposal.theta, None)), "failed": True})
        other._give_up(proposal.number)
        assert not one.tell(outcome(0, proposal.theta, None))
        assert other.ask(1, 1) == ()
        assert list(other.outcomes()) == [0]


def test_signs_of_life_come_by_themselves(journal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_study, "BEAT", 0.01)
    with joined(journal) as one, study_at(journal) as study:
        one.ask(1, 1)
        while study.trials[0].user_attrs.get("beat", 0) < 2:
            pass


DAMAGES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "none": (lambda held: bytes(range(256)), "no journal of a study"),
    "of other things": (lambda held: b'{"a": 1}\n[]\n', "no journal of a study"),
    "one line of another program": (lambda held: b'{"x": 1}', "no journal of a study"),
    "zeros inside": (lambda held: held[:700] + bytes(40) + held[740:], "the shared study cannot be reached"),
}


@pytest.mark.parametrize("case", DAMAGES)
def test_a_damaged_journal_is_refused_and_left_as_it_is(case: str, journal: str) -> None:
    shared(None, journal, 3)
    path, (damage, told) = Path(journal.removeprefix("journal:")), DAMAGES[case]
    path.write_bytes(damage(path.read_bytes()))
    damaged = path.read_bytes()
    with pytest.raises(StorageError, match=told):
        shared(None, journal, 4)
    assert path.read_bytes() == damaged


def test_a_journal_that_was_cut_goes_on(journal: str, tmp_path: Path) -> None:
    shared(None, journal, 3)
    path = Path(journal.removeprefix("journal:"))
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shared_study, "GRACE", 0.0)
        assert len(shared(tmp_path / "a", journal, 5).trials) == 5
    require_whole(journal, 5, [tmp_path / "a"])
