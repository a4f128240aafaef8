"""The study that processes share: what counts as a trial, signs of life, and outcomes that are there once."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_twin import NU, E
from shared_processes import joined, outcome, study_at

from softcal.calibration.search import shared_study
from softcal.calibration.search.optimiser import Proposal
from softcal.calibration.search.shared_study import SharedStudy
from softcal.calibration.search.storage_url import StorageUrl, UnansweredError
from softcal.errors import StorageError


@pytest.fixture
def journal(tmp_path: Path) -> str:
    return f"journal:{tmp_path / 'shared.journal'}"


def asked(study: SharedStudy, total: int, count: int = 1) -> tuple[Proposal, ...]:
    study.outcomes()
    return study.ask(total, count)


def test_no_more_trials_begin_than_are_wanted_and_those_of_a_race_are_pruned(journal: str) -> None:
    with joined(journal) as one, joined(journal) as other:
        other.outcomes()
        assert [proposal.number for proposal in asked(one, 2, 5)] == [0, 1]
        assert other.ask(2, 5) == ()  # which did not see them begin
        assert asked(other, 2, 5) == ()
        with study_at(journal) as study:
            assert [trial.state.name for trial in study.trials] == ["RUNNING", "RUNNING", "PRUNED"]


def test_a_trial_that_waited_is_asked_for_once_and_none_begins_in_excess(tmp_path: Path) -> None:
    database = StorageUrl("a database", url=f"sqlite:///{tmp_path / 'optuna.db'}")
    with joined(database) as one, joined(database) as other:
        (left,) = one.ask(2, 1)
        other.outcomes()
        one.give_back()
        assert [proposal.number for proposal in other.ask(2, 1)] == [2]  # it did not see that 1 waits
        (again,) = asked(one, 2, 5)
        assert (again.number, dict(again.theta)) == (1, dict(left.theta))
        assert [trial.state.name for trial in one._storage.read()] == ["FAIL", "RUNNING", "RUNNING"]
        assert asked(other, 2, 5) == ()


def test_the_trials_are_read_once_for_each(journal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from optuna.storages import JournalStorage

    reads, read = [0], JournalStorage.get_all_trials

    def counted(*args: Any, **options: Any) -> Any:
        reads[0] += 1
        return read(*args, **options)

    with joined(journal) as one:
        monkeypatch.setattr(JournalStorage, "get_all_trials", counted)
        for _ in range(12):  # more than begin at random
            (proposal,) = asked(one, 20)
            one.tell(outcome(proposal.number, proposal.theta))
        assert reads == [12]


def test_a_trial_without_a_sign_of_life_is_given_up_and_its_point_tried_again_once(
    journal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(shared_study, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda _: None))
    with joined(journal) as silent, joined(journal) as one, joined(journal) as other:
        (lost,) = silent.ask(1, 1)
        assert asked(one, 1, 1) == () == asked(other, 1, 1)
        clock[0] = shared_study.GRACE - 1
        silent._storage.say(0, "beat", 1)
        assert asked(one, 1, 1) == () == asked(other, 1, 1)
        clock[0] = 2 * shared_study.GRACE - 2
        assert asked(one, 1, 1) == () == asked(other, 1, 1)
        clock[0] = 2 * shared_study.GRACE
        (again,) = asked(one, 1, 1)
        assert dict(again.theta) == dict(lost.theta)
        assert asked(other, 1, 1) == ()
        assert not silent.tell(outcome(lost.number, lost.theta))
        assert one.tell(outcome(again.number, again.theta))
        assert list(other.outcomes()) == [again.number]


def test_no_trial_is_given_up_for_a_time_when_the_database_did_not_answer(
    journal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(shared_study, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda _: None))
    with joined(journal) as silent, joined(journal) as one:
        silent.ask(1, 1)
        assert asked(one, 1) == ()
        with monkeypatch.context() as patch:
            patch.setattr(one._storage, "read", unanswered)
            with pytest.raises(UnansweredError):
                one.outcomes()
        clock[0] = 2 * shared_study.GRACE
        assert asked(one, 1) == ()
        clock[0] = 4 * shared_study.GRACE
        assert len(asked(one, 1)) == 1


def test_what_was_begun_as_the_database_stopped_to_answer_is_given_up_and_not_kept_alive(
    journal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(shared_study, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda _: None))
    with joined(journal) as one:
        with monkeypatch.context() as patch:
            patch.setattr(one, "_sampler", unanswered)
            with pytest.raises(UnansweredError):
                one.ask(1, 1)
        assert asked(one, 1) == ()
        clock[0] = 2 * shared_study.GRACE
        assert [proposal.number for proposal in asked(one, 1)] == [1]


def test_an_outcome_whose_receipt_was_lost_is_told_once(journal: str) -> None:
    with joined(journal) as one:
        (proposal,) = one.ask(1, 1)
        assert one.tell(outcome(0, proposal.theta))
        assert one.tell(outcome(0, proposal.theta))
        assert list(one.outcomes()) == [0]


def unanswered(*args: object) -> None:
    raise UnansweredError("gone")


def test_a_failure_that_was_told_just_before_its_trial_was_given_up_counts_once(journal: str) -> None:
    with joined(journal) as one, joined(journal) as other:
        (proposal,) = asked(one, 1, 1)
        told = {**shared_study.attributes(outcome(0, proposal.theta, None)), "failed": True}
        one._storage.say(proposal.number, "softcal", told)
        other._give_up(proposal.number)
        assert one.tell(outcome(0, proposal.theta, None))
        assert asked(other, 1, 1) == ()
        assert list(other.outcomes()) == [0]


def test_signs_of_life_come_by_themselves(journal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_study, "BEAT", 0.01)
    with joined(journal) as one, study_at(journal) as study:
        asked(one, 1, 1)
        while study.trials[0].user_attrs.get("beat", 0) < 2:
            pass


def test_a_mistake_of_softcals_own_is_not_told_as_the_storages(journal: str) -> None:
    many: Any = "many"
    with joined(journal) as one, pytest.raises(TypeError):
        one.ask(many, 1)


@pytest.mark.parametrize(
    "values",
    [
        {E: 1e12, NU: 0.4},
        {E: float("inf")},
        {E: float("nan")},
        {E: -1.0},
        {E: "much"},
        {E: None},
        {E: True},
        {E: [1e6]},
        {"nobody": 1.0},
    ],
    ids=str,
)
def test_values_that_are_none_of_the_search_are_left_out_where_others_enqueue_them(
    values: dict[str, Any], journal: str, recwarn: pytest.WarningsRecorder
) -> None:
    """Evaluated, such a trial would end every process that reads the study, for ever."""
    with joined(journal) as one:
        with study_at(journal) as study:
            study.enqueue_trial(values)
            study.enqueue_trial({E: 1.5e6})
            given = len(recwarn)
        first, second = asked(one, 2, 5)
        assert len(recwarn) == given
        assert (first.number, first.theta[E], second.number) == (1, 1.5e6, 2)
        assert one.impossible == 1
        with study_at(journal) as study:
            assert [trial.state.name for trial in study.trials] == ["FAIL", "RUNNING", "RUNNING"]


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE trial_values SET value = value * 0.99",
        "UPDATE trial_params SET param_value = param_value * 1.000001",
        """UPDATE trial_user_attributes SET value_json = replace(value_json, '"n_solves": 1', '"n_solves": 2')""",
        "UPDATE trials SET number = 1 - number",
    ],
    ids=["loss", "parameter", "outcome", "number"],
)
def test_a_trial_that_was_changed_in_the_database_is_refused(change: str, tmp_path: Path) -> None:
    import sqlalchemy

    database = StorageUrl("a database", url=f"sqlite:///{tmp_path / 'optuna.db'}")
    with joined(database) as one:
        for proposal in asked(one, 2, 2):
            one.tell(outcome(proposal.number, proposal.theta, 0.1 + proposal.number))
    with joined(database) as other:
        assert [stored.trial.loss for stored in other.outcomes().values()] == [0.1, 1.1]
    engine = sqlalchemy.create_engine(database.url)
    with engine.begin() as connection:
        assert connection.execute(sqlalchemy.text(change)).rowcount >= 2
    engine.dispose()
    with joined(database) as other, pytest.raises(StorageError, match=r"trial \d of the .* changed after it was told"):
        other.outcomes()


@pytest.mark.parametrize(
    "change", ["UPDATE trial_user_attributes SET value_json = 'x'", "UPDATE trial_values SET value_type = 'INF_POS'"]
)
def test_a_database_whose_content_makes_no_sense_is_not_said_to_be_out_of_reach(change: str, tmp_path: Path) -> None:
    import sqlalchemy

    database = StorageUrl("a database", url=f"sqlite:///{tmp_path / 'optuna.db'}")
    with joined(database) as one:
        (proposal,) = asked(one, 1)
        one.tell(outcome(proposal.number, proposal.theta, 0.1))
        engine = sqlalchemy.create_engine(database.url)
        with engine.begin() as connection:
            connection.execute(sqlalchemy.text(change))
        engine.dispose()
        with pytest.raises(StorageError, match=r"a database: the shared study cannot be read; got .* another database"):
            with joined(database) as other:
                other.outcomes()
