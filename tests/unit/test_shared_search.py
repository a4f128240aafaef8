"""One process's part in a search that several share: what it finds, says and refuses."""

from __future__ import annotations

import itertools
import json
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import optuna
import pytest
from fake_twin import E, all_necks_fail, soft_necks_fail
from shared_processes import require_whole, shared, study_at
from test_calibration_run import problem_of

from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.trial_journal import stored_trials
from softcal.calibration.run import calibrate
from softcal.calibration.search import shared_search, shared_study
from softcal.calibration.search.search import trial_of
from softcal.calibration.search.shared_search import Sharing
from softcal.calibration.search.shared_study import SharedStudy
from softcal.calibration.search.storage_url import UnansweredError, storage_url
from softcal.errors import CalibrationError, ParameterError, StorageError


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
    fewer = shared(tmp_path / "d", journal, 6)
    assert fewer.status == "All 15 trials were run, 0 of them by this process."
    assert fewer.trials == more.trials


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


def test_the_best_trial_of_another_machine_is_told_where_its_loss_is_another_here(
    journal: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def halved(number: int, evaluation: Any) -> Any:
        trial = trial_of(number, evaluation)
        return trial if trial.loss is None else replace(trial, loss=trial.loss / 2)

    with monkeypatch.context() as there:
        there.setattr(shared_search, "trial_of", halved)
        shared(None, journal, 6, seed=3)
    with study_at(journal) as study:
        best = study.best_trial
    other = shared(tmp_path / "a", journal, 6, seed=3)
    told = f"Trial {best.number}, the best, had the loss {best.value:.6g}; evaluated again by this process it has"
    assert told in other.status
    assert load_result(tmp_path / "a").loss == best.value


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
    assert not (tmp_path / "shared.journal.other").exists()
    with storage_url(f"{journal}.other").opened() as storage:
        optuna.create_study(study_name="another", storage=storage)
        before = (tmp_path / "shared.journal.other").read_bytes()
    with pytest.raises(StorageError, match="they are of another study: trial 0 is not in the study"):
        shared(tmp_path / "a", f"{journal}.other", 3, resume=True)
    assert (tmp_path / "shared.journal.other").read_bytes() == before


def test_another_method_is_refused(journal: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"only the method tpe can be shared.*got method grid"):
        calibrate(problem_of(), method="grid", store=tmp_path / "a", sharing=Sharing(journal))
    assert list(tmp_path.iterdir()) == []


def test_a_database_that_does_not_answer_is_asked_again_for_a_while(
    journal: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("outcomes", "ask", "tell"):
        monkeypatch.setattr(SharedStudy, name, unanswered_every_third_time(getattr(SharedStudy, name)))
    monkeypatch.setattr(shared_search, "_PAUSE", 0.0)
    stages: list[str] = []
    result = shared(tmp_path / "a", journal, 6, progress=lambda told: stages.append(told.stage))
    assert len(result.trials) == 6
    assert result.status == "All 6 trials were run, 6 of them by this process."
    assert "an answer of the database" in stages
    require_whole(journal, 6, [tmp_path / "a"])
    monkeypatch.setattr(shared_search, "OUTAGE", 0.0)
    with pytest.raises(StorageError, match="gone"):
        shared(tmp_path / "b", journal, 12)


def unanswered_every_third_time(method: Any) -> Any:
    calls = itertools.count(1)

    def called(*args: Any) -> Any:
        if next(calls) % 3 == 0:
            raise UnansweredError("gone")
        return method(*args)

    return called


def test_a_folder_that_is_in_use_is_refused_and_nothing_is_made_in_the_storage(journal: str, tmp_path: Path) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(StorageError, match="a: the folder is not empty"):
        shared(folder, journal, 3)
    assert list(tmp_path.iterdir()) == [folder]


def test_a_study_that_is_none_of_softcals_or_of_another_format_is_refused(tmp_path: Path) -> None:
    url = f"journal:{tmp_path / 'other'}"
    with study_at(url, new=True) as study:
        study.optimize(lambda trial: trial.suggest_float("x", 0, 1), n_trials=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shared_study, "_BEGINNING", 0.0)
        with pytest.raises(StorageError, match="not made by softcal"):
            shared(tmp_path / "a", url, 3)
    assert not (tmp_path / "a").exists()
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


DAMAGES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "none": (lambda held: bytes(range(256)), "no journal of a study"),
    "of other things": (lambda held: b'{"a": 1}\n[]\n', "no journal of a study"),
    "one line of another program": (lambda held: b'{"x": 1}', "no journal of a study"),
    "zeros inside": (lambda held: held[:700] + bytes(40) + held[740:], "no journal of a study, or it is damaged"),
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
