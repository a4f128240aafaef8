"""The course of a search that several processes share: each asks the study for points, evaluates and tells them.

Each process has a run folder of its own, which gets every trial of the study as it is told, by whichever process, and
in the end the result from the best of them, evaluated again there with its derivatives.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.results.result import Trial
from softcal.calibration.results.store import RunStore
from softcal.calibration.results.stored import contradiction
from softcal.calibration.results.trial_journal import JOURNAL, STUDY, StoredTrial, stored_trials
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.interrupts import interrupts_held, stoppable
from softcal.calibration.search.live import told_live
from softcal.calibration.search.optimisers.tpe import TpeOptimiser, tpe_sampler
from softcal.calibration.search.outcome import Account
from softcal.calibration.search.search import (
    Found,
    Observer,
    Progress,
    Search,
    announcing,
    derived,
    no_result,
    open_run,
    trial_of,
)
from softcal.calibration.search.shared_study import SharedStudy, StudyIdentity, joinable_trials
from softcal.calibration.search.storage_url import UnansweredError, storage_url
from softcal.errors import CalibrationError, Fault, ParameterError, StorageError
from softcal.executors.each import executor_of
from softcal.executors.executor import Executor

_PAUSE = 0.5  # [s] between two looks at the trials of others
OUTAGE = 300.0  # [s] for which a database that does not answer is asked again
_T = TypeVar("_T")
_SAME = 1e-6  # relative; of a loss that is computed again on another machine


@dataclass(frozen=True)
class Sharing:
    """Settings of a shared search.

    Attributes
    ----------
    storage
        `journal:FILE`, or the URL of a PostgreSQL or MySQL database.
    study
        The name of the study there.
    """

    storage: str = field(repr=False)
    study: str = STUDY


def require_shareable(search: Search, sharing: Sharing, folder: Path | None = None) -> None:
    """Raise unless a search can be shared; leaves nothing of it in the storage.

    Parameters
    ----------
    search, sharing
        What is searched, and the study that it is to share.
    folder
        Folder of a run that is resumed.

    Raises
    ------
    ParameterError
        For another method than `tpe`.
    StorageError
        Where there is no such storage, it does not answer, or its study is of something else or not that of the run.
    """
    if search.optimiser is not TpeOptimiser:
        what, got = "only the method tpe can be shared by several processes", f"method {search.optimiser.name}"
        raise ParameterError(Fault(what, "--storage", got, TpeOptimiser.name, "--method tpe"))
    there = joinable_trials(storage_url(sharing.storage), _about(search, sharing), search.problem.space)
    if folder is not None:
        _require_of(there or {}, stored_trials(folder), folder)


@contextlib.contextmanager
def searched_together(
    search: Search,
    *,
    sharing: Sharing,
    workers: int | Executor = 1,
    store: Path | None = None,
    resume: bool = False,
    files: Mapping[str, str] | None = None,
    progress: Observer | None = None,
) -> Generator[Found]:
    """Take part in a search by TPE until all its trials are done, those of other processes too.

    Parameters
    ----------
    search, sharing
        What is searched, and the study that is shared.
    workers, store, resume, files, progress
        See `searched`.

    Raises
    ------
    ParameterError
        Where there is no worker, or the method is another than `tpe`.
    StorageError
        Where the folder or the study cannot be used, or is of something else.
    CalibrationError
        Where no trial could be simulated, or there are no workers any more. The trials are stored.
    """
    began = time.perf_counter()
    require_shareable(search, sharing, store if resume else None)
    shared = replace(search, settings={**search.settings, "study": sharing.study})
    with executor_of(workers) as executor, contextlib.ExitStack() as stack:
        with interrupts_held():
            run = open_run(shared, store, resume, files)
            if run is not None:
                stack.enter_context(run)
        study = stack.enter_context(
            SharedStudy(
                storage_url(sharing.storage),
                _about(search, sharing),
                search.problem.space,
                seed=search.settings["seed"],
                sampler=partial(tpe_sampler, startup_trials=int(search.settings["startup_trials"])),
            )
        )
        tally = _SharedTally(search.problem, study, run, int(search.settings["trials"]), began)
        evaluator = stack.enter_context(Evaluator(search.problem, workers=executor, jacobian=False))
        tell = stack.enter_context(told_live(None if run is None else run.folder, executor, progress))
        stopped = _course(tally, evaluator, executor, tell)
        trials = tally.trials
        if (number := tally.best) is None:
            raise CalibrationError(no_result(list(trials.values()), stopped))

        announce = announcing(tell, tally.progress)
        announce("derivatives at the best trial")
        best, other = _evaluated(search.problem, trials[number])
        n, mine = len(tally.told), f"{tally.mine} of them by this process"
        status = f"All {n} trials were run, {mine}."
        if stopped:
            status = f"Stopped by {stopped} after {n} of {tally.total} trials, {mine}; this is the best so far."
        if study.impossible:
            status += f" Left out, since out of the search space: {study.impossible} that others enqueued."
        account = Account(
            TpeOptimiser.name,
            search.settings["seed"],
            search.settings,
            " ".join(filter(None, (status, other))),
            sum(told.n_solves for told in tally.told.values()) + 2 * best.n_solves,
            tally.elapsed(),
            search.identity,
        )
        announce("importances (fANOVA)")
        yield Found(best, tuple(trials.values()), account, None if run is None else run.folder, announce)


class _SharedTally:
    """The trials of a shared study so far, and the folder of this process."""

    def __init__(self, problem: Problem, study: SharedStudy, run: RunStore | None, total: int, began: float) -> None:
        self.problem, self.study, self.total = problem, study, total
        self._run, self._began = run, began
        self.told: Mapping[int, StoredTrial] = {}
        self.mine = 0
        self._kept = dict(run.stored()) if run is not None else {}
        self._earlier = max((stored.elapsed for stored in self._kept.values()), default=0.0)

    @property
    def trials(self) -> dict[int, Trial]:
        return {number: told.trial for number, told in self.told.items()}

    @property
    def best(self) -> int | None:
        """The number of the trial with the lowest loss."""
        losses = {n: told.trial.loss for n, told in self.told.items() if told.trial.loss is not None}
        return min(losses, key=losses.__getitem__) if losses else None

    def elapsed(self) -> float:
        return self._earlier + time.perf_counter() - self._began

    def tell(self, number: int, evaluation: Evaluation) -> None:
        """Tell the study what a trial of this process gave."""
        stored = StoredTrial(trial_of(number, evaluation), evaluation.n_solves, self.elapsed(), None)
        self.mine += self.study.tell(stored)

    def look(self) -> bool:
        """Read the trials that any process has told; True if there were new ones."""
        n_before = len(self.told)
        told = self.study.outcomes()
        if self._run is not None:
            _require_of(told, self._kept, self._run.folder)
            for number, one in told.items():
                if number not in self._kept:
                    self._run.append(one.trial, n_solves=one.n_solves, elapsed=self.elapsed())
                self._kept[number] = one
        self.told = told
        return len(told) > n_before

    def progress(self, stage: str = "") -> Progress:
        best = None if self.best is None else self.told[self.best].trial
        n_failed = sum(told.trial.loss is None for told in self.told.values())
        return Progress(
            len(self.told),
            max(self.total, len(self.told)),
            n_failed,
            None if best is None else best.loss,
            None if best is None else best.theta,
            stage,
        )


def _about(search: Search, sharing: Sharing) -> StudyIdentity:
    settings = {name: value for name, value in search.settings.items() if name != "batch"}
    return StudyIdentity(sharing.study, search.identity, settings)


def _course(tally: _SharedTally, evaluator: Evaluator, executor: Executor, tell: Observer) -> str:
    """Take part until all trials are done; returns what interrupted it, "" where nothing did."""
    try:
        with stoppable() as stop:

            def answered(ask: Callable[[], _T]) -> _T:
                # Asked again for five minutes where the database does not answer, unless the user stops.
                began: float | None = None
                while True:
                    stop.heed()
                    try:
                        with interrupts_held():
                            return ask()
                    except UnansweredError:
                        began = time.monotonic() if began is None else began
                        if time.monotonic() - began >= OUTAGE:
                            raise
                    tell(tally.progress("an answer of the database"))
                    time.sleep(_PAUSE)

            while True:
                if answered(tally.look):
                    tell(tally.progress())
                if len(tally.told) >= tally.total:
                    break
                proposals = answered(partial(tally.study.ask, tally.total, executor.count))
                if not proposals:
                    tell(tally.progress("trials of other processes"))
                    time.sleep(_PAUSE)
                for proposal, evaluation in evaluator.evaluate(proposals):
                    answered(partial(tally.tell, proposal.number, evaluation))
    except KeyboardInterrupt as asked:
        with interrupts_held(), contextlib.suppress(StorageError):
            tally.study.give_back()
            tally.look()
        return str(asked) or "the user"
    return ""


def _evaluated(problem: Problem, trial: Trial) -> tuple[Evaluation, str]:
    """The best trial evaluated again, here and with its derivatives, and a sentence where it gives another loss.

    Raises
    ------
    CalibrationError
        Where it cannot be simulated here.
    """
    again = problem.evaluate(trial.theta)
    if again.loss is None or trial.loss is None:
        raise CalibrationError(
            f"The best trial of the study, {trial.number}, cannot be simulated again by this process: {again.failure} "
            "Its trials are kept. Try: the versions of softcal that the other processes have."
        )
    with contextlib.suppress(KeyboardInterrupt):
        again = derived(problem, again)
    other = ""
    if again.loss is None or not math.isclose(again.loss, trial.loss, rel_tol=_SAME):
        there, here = f"Trial {trial.number}, the best, had the loss {trial.loss:.6g}", f"{again.loss:.6g}"
        other = f"{there}; evaluated again by this process it has {here}."
    return replace(again, loss=trial.loss), other


def _require_of(told: Mapping[int, StoredTrial], kept: Mapping[int, StoredTrial], folder: Path) -> None:
    """Raise unless a study has the trials that a run's folder keeps of it.

    Raises
    ------
    StorageError
        With the first trial that is not there, or another one.
    """
    for number, one in kept.items():
        if (held := told.get(number)) is None or (held is not one and held.trial != one.trial):
            why = (
                f"they are of another study: trial {number} is {'not' if held is None else 'another one'} in the study"
            )
            raise contradiction(folder / JOURNAL, "the trials of the run", why)
