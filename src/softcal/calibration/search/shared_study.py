"""One study of Optuna's that several processes search together, on one machine or many, whoever of them dies.

A trial counts as soon as it begins, so that no more begin than are wanted; one that began too many by a race is pruned.
Every process shows that its trials are alive by an attribute that it changes every ten seconds. Others judge that by
their own clocks: a trial whose attribute has not changed for a minute is given up, and its point is tried again. What a
trial gave is one attribute, "softcal", written before its state. So at any instant it is there whole, or not at all.

Optuna has such means for databases (heartbeat, retry of stale trials), but none for journal files, and they do not see
a trial whose process ended before its first sign of life. This is one means for both.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from softcal.calibration.problem.fingerprint import differences, identity_faults
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.results.stored import Count, Record
from softcal.calibration.results.trial_journal import StoredTrial, as_stored, attributes
from softcal.calibration.search.optimiser import Proposal
from softcal.calibration.search.storage_url import StorageUrl, UnansweredError
from softcal.calibration.search.study_storage import StudyStorage
from softcal.errors import Fault, StorageError

if TYPE_CHECKING:
    import optuna

FORMAT = 1
OUTCOME = "softcal"  # the attribute of a study that says what it is, and that of a trial that says what it gave
_FAILED = "failed"  # in the outcome: it is one although there is no loss
_BEAT = "beat"
_RETRIED = "retry of"
_LARGEST = 1e100  # of a loss: what is computed from larger ones is not finite
BEAT, GRACE = 10.0, 60.0  # [s] between signs of life; without one after which a trial is given up
_BEGINNING = 5.0  # [s] that a process may take between making a study and saying what it is
# A column of MySQL's holds 64 KB, so that a longer attribute is several. These are written before the one that says how
# many there are, so that it is there whole or not at all.
_LONGEST = 60_000  # [characters, each a byte] of an attribute
_PIECE = _LONGEST // 2  # as the text of a text, in which a quotation mark is two characters
_PIECES = "pieces"


class _About(Record):
    """Description of a study, as its first process wrote it."""

    format: Count
    identity: dict[str, str]
    settings: dict[str, Any]


@dataclass(frozen=True)
class StudyIdentity:
    """Description of the search of a shared study.

    Attributes
    ----------
    name
        Its name in the storage.
    identity, settings
        As those of a run: hash by the name of what is hashed, and the settings of the search.
    """

    name: str
    identity: Mapping[str, str]
    settings: Mapping[str, Any]


def joinable_trials(place: StorageUrl, about: StudyIdentity, space: SearchSpace) -> Mapping[int, StoredTrial] | None:
    """Every trial with its outcome so far of a study that a storage has already; None where it can be made. Nothing of
    it is made or changed.

    Parameters
    ----------
    place, about
        The storage, and what the study must be of.
    space
        The search space.

    Raises
    ------
    StorageError
        Where the storage cannot be reached or made, or has a study of that name that is of something else, or whose
        trials cannot be read.
    """
    import optuna

    if place.is_new():
        return None
    with place.opened() as storage, place.answering():
        try:
            study = optuna.load_study(storage=storage, study_name=about.name)
        except KeyError:
            return None
        trials = study.get_trials(deepcopy=False)
        if (held := attribute(study.user_attrs, OUTCOME)) is not None:
            _require_same(place, about, held)
        elif trials and attribute(study.user_attrs, OUTCOME) is None:
            raise _not_softcals(place, about)  # softcal says what a study is before its first trial
        if study.directions != [optuna.study.StudyDirection.MINIMIZE]:
            raise StorageError(Fault("the shared study does not minimise its objective", place.shown, about.name))
        return {one.number: _outcome(one, place, about, space) for one in trials if _is_outcome(one)}


class SharedStudy:
    """A study of a storage, made or joined. To be closed, best by `with`: trials not told are then left to others.

    sampler: from a seed to Optuna's sampler. Every trial has its own, whose seed follows from the search's and the
    number of the trial, so that no two processes draw the same random numbers.

    Attributes
    ----------
    impossible
        Number of trials that waited in the study, and were left out since their values are not in its search space.

    Raises
    ------
    StorageError
        Where it cannot be reached, or is the study of something else.
    """

    def __init__(
        self,
        place: StorageUrl,
        about: StudyIdentity,
        space: SearchSpace,
        *,
        seed: int,
        sampler: Callable[[int], optuna.samplers.BaseSampler],
    ) -> None:
        self._place, self._about, self._space = place, about, space
        self._seed, self._sampler = seed, sampler
        self._mine: set[int] = set()
        self._seen: dict[int, tuple[object, float]] = {}  # number -> the last sign of life, and when it was first seen
        self._outcomes: dict[int, StoredTrial] = {}
        self.impossible = 0
        with contextlib.ExitStack() as stack:
            storage = stack.enter_context(place.opened())
            with self._answering():
                self._storage = StudyStorage(storage)
                self._study = self._joined(self._storage.as_optunas)
                self._storage.choose(about.name)
            self._open = stack.pop_all()
        self._over = threading.Event()
        self._beats = threading.Thread(target=self._beat, daemon=True)
        self._beats.start()

    def __enter__(self) -> SharedStudy:
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        self._beats.join(timeout=1.0)
        with self._open, contextlib.suppress(StorageError):  # else the others give them up, in a minute
            self.give_back()

    def outcomes(self) -> Mapping[int, StoredTrial]:
        """Every trial with its outcome so far, by number, of whichever process.

        Raises
        ------
        StorageError
            Where the study cannot be reached, or holds a trial that is none of softcal's.
        """
        try:
            with self._answering():
                trials = self._storage.read()
                for frozen in trials:
                    if frozen.number not in self._outcomes and _is_outcome(frozen):
                        self._outcomes[frozen.number] = _outcome(frozen, self._place, self._about, self._space)
                return dict(sorted(self._outcomes.items()))
        except UnansweredError:
            self._seen.clear()  # no sign of life could be seen meanwhile
            raise

    def ask(self, total: int, count: int) -> tuple[Proposal, ...]:
        """Points for this process to evaluate, at most `count`; none where all of `total` had begun when `outcomes`
        last looked.

        Raises
        ------
        StorageError
            Where the study cannot be reached, or holds a trial that is none of softcal's.
        """
        asked: list[Proposal] = []
        before = set(self._mine)
        try:
            with self._answering():
                self._give_up_stale()
                while len(asked) < count:
                    trials = self._storage.trials
                    waiting = any(t.state.name == "WAITING" and t.number not in self._mine for t in trials)
                    if not waiting and len(_counted(trials) | self._mine) >= total:
                        break  # no trial is left to repeat, and `total` trials have begun
                    trial = self._study.ask()
                    self._mine.add(trial.number)
                    if trial.number >= total and total <= sum(n < trial.number for n in _counted(self._storage.read())):
                        self._end(trial.number, "PRUNED")  # another process was faster
                        self._mine.remove(trial.number)
                        continue
                    if not self._is_possible(trial.number):
                        self._end(trial.number, "FAIL")
                        self._mine.remove(trial.number)
                        self._storage.read()
                        self.impossible += 1
                        continue
                    seed = np.random.SeedSequence((self._seed, trial.number)).generate_state(1)[0]
                    self._study.sampler = self._sampler(int(seed))
                    for p in self._space.parameters:
                        trial.suggest_float(p.label, p.lower, p.upper, log=p.scale == "log")
                    asked.append(Proposal(trial.number, dict(trial.params)))
        except StorageError:
            self._mine = before  # those begun here get no signs of life, and are given up in a minute
            raise
        return tuple(asked)

    def _is_possible(self, number: int) -> bool:
        """Whether the values that a trial has, such as those with which another program enqueued it, are of the search.

        Evaluated, one that is not would be an outcome that no process could read.
        """
        begun = self._storage.trial(number)
        values = {**begun.system_attrs.get("fixed_params", {}), **begun.params}
        bounds = {p.label: (p.lower, p.upper) for p in self._space.parameters}
        return values.keys() <= bounds.keys() and all(
            type(value) in (int, float) and bounds[name][0] <= value <= bounds[name][1]
            for name, value in values.items()
        )

    def tell(self, stored: StoredTrial) -> bool:
        """Record the outcome of a trial that was asked for; False where others have given it up meanwhile.

        Raises
        ------
        StorageError
            Where the study cannot be reached.
        """
        import optuna

        trial, number = stored.trial, stored.trial.number
        values = None if trial.loss is None else [trial.loss]
        told = True
        with self._answering():
            try:
                set_attribute(
                    partial(self._storage.say, number), OUTCOME, {**attributes(stored), _FAILED: values is None}
                )
                self._storage.end(number, "FAIL" if values is None else "COMPLETE", values)
            except optuna.exceptions.UpdateFinishedTrialError:
                told = _is_outcome(self._storage.trial(number))  # as where the answer to telling it was lost
        self._mine.discard(number)
        return told

    def give_back(self) -> None:
        """Leave the trials that were asked for and not told to the other processes.

        Raises
        ------
        StorageError
            Where the study cannot be reached.
        """
        with self._answering():
            for number in list(self._mine):
                self._give_up(number)
                self._mine.discard(number)

    def _joined(self, storage: optuna.storages.BaseStorage) -> optuna.Study:
        import optuna

        about = {"format": FORMAT, "identity": dict(self._about.identity), "settings": dict(self._about.settings)}
        try:
            study = optuna.create_study(storage=storage, study_name=self._about.name, direction="minimize")
            set_attribute(study.set_user_attr, OUTCOME, about)
        except optuna.exceptions.DuplicatedStudyError:
            study = optuna.load_study(storage=storage, study_name=self._about.name)
            began = time.monotonic()
            while (held := attribute(study.user_attrs, OUTCOME)) is None and time.monotonic() - began < _BEGINNING:
                time.sleep(0.1)
            if held is None and study.get_trials(deepcopy=False):
                raise _not_softcals(self._place, self._about) from None
            if held is None:  # its first process ended before it could say what it is
                set_attribute(study.set_user_attr, OUTCOME, about)
        _require_same(self._place, self._about, attribute(study.user_attrs, OUTCOME))
        return study

    def _give_up_stale(self) -> None:
        """Give up every trial of another process that has shown no sign of life for a minute."""
        now = time.monotonic()
        running = {t.number: t.user_attrs.get(_BEAT) for t in self._storage.trials if t.state.name == "RUNNING"}
        self._seen = {
            number: self._seen[number] if number in self._seen and self._seen[number][0] == beat else (beat, now)
            for number, beat in running.items()
            if number not in self._mine
        }
        if stale := [number for number, (_, since) in self._seen.items() if now - since > GRACE]:
            for number in stale:
                self._give_up(number)
            self._storage.read()

    def _give_up(self, number: int) -> None:
        """End a trial without an outcome, and have its point tried again, unless it ended before."""
        if not self._end(number, "FAIL"):
            return
        ended = self._storage.trial(number)
        if not _is_outcome(ended) and ended.params:
            self._study.enqueue_trial(ended.params, user_attrs={_RETRIED: number})

    def _end(self, number: int, state: str) -> bool:
        """End a trial; False where it has ended already."""
        import optuna

        try:
            self._storage.end(number, state)
        except optuna.exceptions.UpdateFinishedTrialError:
            return False
        return True

    def _beat(self) -> None:
        beat = 0
        while not self._over.wait(BEAT):
            beat += 1
            for number in list(self._mine):
                with contextlib.suppress(StorageError), self._answering():
                    self._storage.say(number, _BEAT, beat)

    def _answering(self) -> contextlib.AbstractContextManager[None]:
        return self._place.answering()


def _outcome(
    frozen: optuna.trial.FrozenTrial, place: StorageUrl, about: StudyIdentity, space: SearchSpace
) -> StoredTrial:
    """The outcome of a trial.

    Raises
    ------
    StorageError
        Where it is none of softcal's.
    """
    held = attribute(frozen.user_attrs, OUTCOME)
    why = "" if isinstance(held, dict) else "it has no outcome of softcal's"
    bounds = {p.label: (p.lower, p.upper) for p in space.parameters}
    numbers = {name: value for name, value in frozen.params.items() if isinstance(value, int | float)}  # others: below
    if not why and not (
        frozen.params.keys() == bounds.keys()
        and all(bounds[name][0] <= value <= bounds[name][1] for name, value in numbers.items())
    ):
        why = "its parameters are not those of the search, or out of their bounds"
    losses = [value for value in frozen.values or () if isinstance(value, int | float)]
    if not why and any(abs(loss) > _LARGEST for loss in losses):
        why = "its loss is larger than any"
    if not why:
        try:
            return as_stored(frozen, {**held, "number": frozen.number}, Path())
        except ValidationError as error:
            why = "; ".join(one["msg"].removeprefix("Value error, ") for one in error.errors())
    what = f"trial {frozen.number} of the study {about.name} cannot be read: {why}"
    raise StorageError(Fault(what, place.shown, attempt="another storage"))


def _require_same(place: StorageUrl, wanted: StudyIdentity, held: Any) -> None:
    where, name = f"{place.shown}, study {wanted.name}", "the shared study"
    form = held.get("format") if isinstance(held, dict) else None
    if form != FORMAT:
        attempt = "another version of softcal, or another storage"
        raise StorageError(Fault(f"{name} is of another format", where, str(form), str(FORMAT), attempt))
    try:
        about = _About.model_validate(held)
    except ValidationError as error:
        raise StorageError(Fault(f"{name} cannot be read", where, f"{error.error_count()} faults")) from error
    other = f"{name} began with other settings"
    faults = [
        *identity_faults(name, where, about.identity, wanted.identity),
        *differences(other, where, about.settings, wanted.settings, ignored=("trials",)),
    ]
    if faults:
        raise StorageError(faults)


def _not_softcals(place: StorageUrl, about: StudyIdentity) -> StorageError:
    return StorageError(Fault("the study was not made by softcal", place.shown, about.name))


def _counted(trials: Collection[optuna.trial.FrozenTrial]) -> set[int]:
    """The numbers of the trials that have an outcome, or may still have one."""
    return {trial.number for trial in trials if not trial.state.is_finished() or _is_outcome(trial)}


def _is_outcome(trial: optuna.trial.FrozenTrial) -> bool:
    """Whether a trial has ended with an outcome: a loss, or the reason why the twin could not be simulated."""
    if trial.state.name != "FAIL":
        return trial.state.name == "COMPLETE"
    held = attribute(trial.user_attrs, OUTCOME)
    return isinstance(held, dict) and held.get(_FAILED) is True


def set_attribute(set_one: Callable[[str, Any], None], key: str, value: Any) -> None:
    """Set an attribute of a study or a trial, a long one in pieces.

    Parameters
    ----------
    set_one
        `set_user_attr` of the study or the trial.
    key, value
        The attribute.
    """
    text = json.dumps(value)
    if len(text) <= _LONGEST:
        set_one(key, value)
        return
    pieces = [text[begin : begin + _PIECE] for begin in range(0, len(text), _PIECE)]
    for index, piece in enumerate(pieces):
        set_one(f"{key} {index}", piece)
    set_one(key, {_PIECES: len(pieces)})


def attribute(attributes: Mapping[str, Any], key: str) -> Any:
    """The value of an attribute; None where it was not set, or its pieces are not there."""
    held = attributes.get(key)
    if not isinstance(held, dict) or held.keys() != {_PIECES}:
        return held
    try:
        return json.loads("".join(attributes[f"{key} {index}"] for index in range(held[_PIECES])))
    except (LookupError, TypeError, ValueError):
        return None
