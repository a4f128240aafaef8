"""The course of every search: ask, evaluate, store, tell, until it is over."""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.results.payload import decode, encode
from softcal.calibration.results.result import Trial
from softcal.calibration.results.store import RunStore
from softcal.calibration.results.stored import contradiction, read_bytes
from softcal.calibration.results.trial_journal import JOURNAL, StoredTrial
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.interrupts import interrupts_held, stoppable
from softcal.calibration.search.live import told_live
from softcal.calibration.search.optimiser import Optimiser, Proposal
from softcal.calibration.search.outcome import Account, installed_versions
from softcal.errors import CalibrationError, Fault, StorageError
from softcal.executors.each import executor_of
from softcal.executors.executor import Executor


@dataclass(frozen=True)
class Progress:
    """Progress of a search.

    Attributes
    ----------
    done, total, failed
        Number of trials done, of all (at most), and of failed ones.
    best_loss, best_theta
        The lowest loss so far and its values [SI by label]; None before the first.
    stage
        The present computation, where it is not a trial: those after the search may take long.
    is_limit
        Whether `total` is a limit, before which a search ends that has found its minimum.
    """

    done: int
    total: int
    failed: int
    best_loss: float | None
    best_theta: Mapping[str, float] | None
    stage: str = ""
    is_limit: bool = False

    @property
    def count(self) -> str:
        """The trials that are done, of how many: "12/120", or "12 of at most 120"."""
        is_open = self.is_limit and self.done < self.total
        return f"{self.done} of at most {self.total}" if is_open else f"{self.done}/{self.total}"


Observer = Callable[[Progress], None]


@dataclass(frozen=True)
class Search:
    """The problem of a search, and its settings.

    Attributes
    ----------
    problem
        What is evaluated.
    optimiser
        The optimiser's class.
    begin
        From the number of points that are asked for at once to the optimiser itself.
    settings
        The complete settings as a run stores them and a result reports them; among them `seed` and `batch`.
    identity
        What identifies the run: name of the input -> hash.
    derives
        Whether the best evaluation is made again with the jacobian where the optimiser needs none.
    """

    problem: Problem
    optimiser: type[Optimiser]
    begin: Callable[[int], Optimiser]
    settings: Mapping[str, Any]
    identity: Mapping[str, str]
    derives: bool = False


@dataclass(frozen=True)
class Found:
    """The outcome of a search.

    Attributes
    ----------
    best
        The evaluation with the lowest loss.
    trials
        Every evaluation, in order.
    account
        Its settings, its end and its cost.
    folder
        Where it is stored, or None.
    announce
        Tells the observer of a long computation after the search.
    """

    best: Evaluation
    trials: tuple[Trial, ...]
    account: Account
    folder: Path | None
    announce: Callable[[str], None]


@contextlib.contextmanager
def searched(
    search: Search,
    *,
    workers: int | Executor = 1,
    store: Path | None = None,
    resume: bool = False,
    files: Mapping[str, str] | None = None,
    progress: Observer | None = None,
) -> Generator[Found]:
    """Run a search; its folder and workers are released at the end of the context, when the result is made and written.

    Parameters
    ----------
    search
        What is searched, and how.
    workers
        An executor, or a number of processes.
    store, resume, files
        Folder of the run, whether it is resumed, and texts to keep with it by file name.
    progress
        Called after every trial.

    Raises
    ------
    ParameterError
        Where there is no worker.
    StorageError
        Where the folder cannot be used, or holds a run of something else.
    CalibrationError
        Where no trial could be simulated, or there are no workers any more. The trials are stored.
    """
    began = time.perf_counter()
    settings = dict(search.settings)
    with executor_of(workers) as executor, contextlib.ExitStack() as stack:
        with interrupts_held():
            run = open_run(search, store, resume, files)
            if run is not None:
                stack.enter_context(run)
                settings["batch"] = run.batch
        optimiser = search.begin(settings["batch"])
        tally = _Tally(search.problem, run, began)
        evaluator = Evaluator(search.problem, workers=executor, jacobian=optimiser.needs_jacobian)
        tell = stack.enter_context(told_live(None if run is None else run.folder, executor, progress))
        stopped = _course(optimiser, stack.enter_context(evaluator), tally, tell)
        if tally.best is None:
            raise CalibrationError(no_result(tally.trials, stopped))

        announce = announcing(tell, lambda stage: _progress(tally, optimiser, stage))
        if search.derives and not optimiser.needs_jacobian:
            announce("derivatives at the best trial")
            with contextlib.suppress(KeyboardInterrupt):
                tally.derive()
        status = optimiser.status
        if stopped:
            status = (
                f"Stopped by {stopped} after {len(tally.trials)} of at most {optimiser.total} trials; "
                f"this is the best so far.{' Resume the run to go on.' * (run is not None)}"
            )
        account = Account(
            optimiser.name,
            settings["seed"],
            settings,
            status,
            tally.n_solves,
            tally.elapsed(),
            search.identity,
            False if stopped and optimiser.converged is not None else optimiser.converged,
        )

        if optimiser.statistics == "fanova":
            announce("importances (fANOVA)")
        yield Found(tally.best, tuple(tally.trials), account, None if run is None else run.folder, announce)


def announcing(tell: Observer, progress: Callable[[str], Progress]) -> Callable[[str], None]:
    """What tells an observer of each long computation after a search, given the progress at a stage."""

    def announce(stage: str) -> None:
        with contextlib.suppress(KeyboardInterrupt):  # there is no search any more to be stopped
            tell(progress(stage))

    return announce


@dataclass
class _Tally:
    """The trials of a run so far, and the folder they are stored in."""

    problem: Problem
    run: RunStore | None
    began: float
    trials: list[Trial] = field(default_factory=list[Trial])
    best: Evaluation | None = None
    best_number: int = 0
    n_solves: int = 0
    n_failed: int = 0
    earlier: float = 0.0  # wall time [s] of the sessions before this one

    def __post_init__(self) -> None:
        self.known = dict(self.run.stored()) if self.run is not None else {}
        self.earlier = max((stored.elapsed for stored in self.known.values()), default=0.0)

    def elapsed(self) -> float:
        return self.earlier + time.perf_counter() - self.began

    def recall(self, proposal: Proposal) -> Evaluation | None:
        """The evaluation of a proposal in an earlier session, or None."""
        stored = self.known.get(proposal.number)
        if stored is None or self.run is None:
            return None
        return recalled(self.problem, proposal, stored, self.run.folder / JOURNAL)

    def note(self, number: int, evaluation: Evaluation, *, jacobian: bool) -> None:
        """Count a trial, and store it if it is new."""
        complete = evaluation.loss is not None
        trial = trial_of(number, evaluation)
        better = evaluation.loss is not None and (
            self.best is None or self.best.loss is None or evaluation.loss < self.best.loss
        )
        if self.run is not None:
            needed = complete and (jacobian or better)
            if number not in self.known:
                arrays = encode(evaluation.observations) if needed else None
                self.run.append(trial, n_solves=evaluation.n_solves, elapsed=self.elapsed(), arrays=arrays)
            elif needed and not evaluation.observations:
                path, what = self.run.folder / JOURNAL, f"trial {number} of the run"
                raise contradiction(path, what, "its arrays are not kept with it")
        self.trials.append(trial)
        self.n_solves += evaluation.n_solves
        self.n_failed += not complete
        if better:
            self.best, self.best_number = evaluation, number

    def derive(self) -> None:
        """Complete the best evaluation by its jacobian, unless an earlier session did, or it cannot be computed."""
        best = self.best
        if best is None:
            return
        self.n_solves += best.n_solves
        if all(block.jacobian is not None for block in best.blocks):
            return
        found = derived(self.problem, best)
        with interrupts_held():
            if self.run is not None and found is not best:
                self.run.keep(self.best_number, encode(found.observations))
            self.best = found


def trial_of(number: int, evaluation: Evaluation) -> Trial:
    """An evaluation as a trial of a search."""
    return Trial(
        number,
        dict(evaluation.theta),
        "FAILED" if evaluation.loss is None else "COMPLETE",
        evaluation.loss,
        evaluation.failure,
        evaluation.seconds,
        evaluation.n_factorisations,
        dict(evaluation.experiment_losses),
        evaluation.errors,
    )


def derived(problem: Problem, evaluation: Evaluation) -> Evaluation:
    """An evaluation completed by its jacobian; itself where that cannot be computed."""
    found = problem.evaluate(evaluation.theta, jacobian=True)
    if found.loss is None:
        return evaluation
    seen = {
        name: replace(observation, derivatives=found.observations[name].derivatives)
        for name, observation in evaluation.observations.items()
    }
    one = evaluation
    return problem.judge(one.theta, seen, one.n_solves, one.n_factorisations, one.seconds)


def _course(optimiser: Optimiser, evaluator: Evaluator, tally: _Tally, tell: Observer) -> str:
    """Run the search to its end; returns what interrupted it, "" where nothing did."""
    try:
        with stoppable() as stop:
            while proposals := optimiser.ask():
                recalled = {p.number: found for p in proposals if (found := tally.recall(p)) is not None}
                fresh = evaluator.evaluate([p for p in proposals if p.number not in recalled])
                for proposal in proposals:
                    stop.heed()
                    evaluation = recalled.get(proposal.number) or next(fresh)[1]
                    with interrupts_held():  # a trial is in all files and in the result, or in none of them
                        tally.note(proposal.number, evaluation, jacobian=optimiser.needs_jacobian)
                    optimiser.tell(proposal, evaluation)
                    tell(_progress(tally, optimiser))
    except KeyboardInterrupt as asked:
        return str(asked) or "the user"
    return ""


def _progress(tally: _Tally, optimiser: Optimiser, stage: str = "") -> Progress:
    best = tally.best
    return Progress(
        len(tally.trials),
        optimiser.total,
        tally.n_failed,
        None if best is None else best.loss,
        None if best is None else best.theta,
        stage,
        optimiser.expected is not None,
    )


def open_run(search: Search, folder: Path | None, resume: bool, files: Mapping[str, str] | None) -> RunStore | None:
    """The folder of a search, new or resumed; None where nothing is to be stored.

    Parameters
    ----------
    search
        What is searched, and how.
    folder, resume, files
        Folder of the run, whether it is resumed, and texts to keep with it by file name.

    Raises
    ------
    StorageError
        Where the folder cannot be used, or holds a run of something else.
    """
    if folder is None:
        if resume:
            raise StorageError(Fault("a run is resumed from its folder, which is missing", "store"))
        return None
    space, identity, settings = search.problem.space, search.identity, search.settings
    if resume:
        return RunStore.resume(folder, space, identity=identity, settings=settings, grows=search.optimiser.grows)
    versions = installed_versions()
    return RunStore.create(folder, space, identity=identity, settings=settings, versions=versions, files=files)


def no_result(trials: Sequence[Trial], stopped: str) -> str:
    """Why a search without a completed trial has no result; stopped: what interrupted it, or ""."""
    if stopped:
        return f"Stopped by {stopped} before any trial could be completed ({len(trials)} failed)."
    reason, count = Counter(trial.reason for trial in trials).most_common(1)[0]
    return (
        f"All {len(trials)} trials failed: the twin could not be simulated anywhere. The most frequent reason "
        f"({count} times): {reason} Try: narrower bounds, a stiffer start, or softcal check."
    )


_SAME = 1e-9  # relative; of a loss that is computed again from the same numbers


def recalled(problem: Problem, proposal: Proposal, stored: StoredTrial, journal: Path) -> Evaluation:
    """The evaluation of a proposal, from the trial that is kept under its number in the journal of a run.

    Parameters
    ----------
    problem, proposal
        The problem, and what is to be evaluated.
    stored, journal
        The trial, and the journal that it is from.

    Raises
    ------
    StorageError
        Where the trial is another one, or its arrays are damaged or give another loss.
    """
    trial = stored.trial
    if dict(trial.theta) != dict(proposal.theta):
        raise StorageError(
            Fault(
                f"trial {proposal.number} on disk is not the one that this search would ask for",
                where=str(journal),
                got=str(dict(trial.theta)),
                allowed=str(dict(proposal.theta)),
                attempt="the versions that run.json names, or a new folder",
            )
        )
    if (path := stored.arrays) is None:
        return Evaluation(
            trial.theta,
            trial.loss,
            trial.reason,
            (),
            {},
            trial.experiment_losses,
            None,
            stored.n_solves,
            trial.n_factorisations,
            trial.seconds,
            trial.errors,
        )
    what = f"trial {trial.number} of the run"
    observations = decode(read_bytes(path, what), path, what)
    try:
        for experiment in problem.experiments:
            seen = observations[experiment.name]
            for values in (*seen.predicted.values(), *([seen.derivatives.rates] if seen.derivatives else [])):
                if values.shape[:1] != (experiment.dataset.n_samples,):
                    raise ValueError(f"{values.shape} values for {experiment.dataset.n_samples} samples")
            for values in (*seen.predicted.values(), seen.derivatives.rates, *seen.response.values()):
                if not np.isfinite(values).all():
                    raise ValueError("values that are not finite")
        again = problem.judge(trial.theta, observations, stored.n_solves, trial.n_factorisations, trial.seconds)
    except (KeyError, ValueError) as error:
        raise contradiction(path, what, f"its arrays are not those of this problem ({error})") from error
    if trial.loss is None or again.loss is None or not math.isclose(again.loss, trial.loss, rel_tol=_SAME):
        raise contradiction(path, what, f"its arrays give the loss {again.loss}, and not {trial.loss}")
    return again
