"""The study that processes share: what counts as a trial, signs of life, and outcomes that are there once."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from shared_processes import joined, outcome, study_at

from softcal.calibration import shared_study


@pytest.fixture
def journal(tmp_path: Path) -> str:
    return f"journal:{tmp_path / 'shared.journal'}"


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


def test_a_mistake_of_softcals_own_is_not_told_as_the_storages(journal: str) -> None:
    with joined(journal) as one, pytest.raises(KeyError):
        one.tell(outcome(7, {}))
