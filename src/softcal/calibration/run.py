"""calibrate(problem): ask, evaluate, store, tell, until the search is over; then build the result."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from softcal.calibration.fingerprint import fingerprints
from softcal.calibration.hold_out import fitted_part, predicted
from softcal.calibration.interrupts import interrupts_held, stoppable
from softcal.calibration.optimiser import OPTIMISERS, Journal, Optimiser, Proposal
from softcal.calibration.outcome import Account, conclude, installed_versions
from softcal.calibration.payload import encode
from softcal.calibration.problem import Evaluation, Problem
from softcal.calibration.recall import recalled
from softcal.calibration.result import CalibrationResult, Trial
from softcal.calibration.result_files import write_result
from softcal.calibration.settings import SearchSettings
from softcal.calibration.store import RunStore, StoredTrial
from softcal.calibration.workers import Evaluator
from softcal.errors import CalibrationError, Fault, ParameterError, StorageError


@dataclass(frozen=True)
class Progress:
    """Progress of a calibration: trials done and in all (at most), failed ones, and the best so far (None before the
    first).

    stage: the present computation, where it is not a trial: those after the search may take long.
    """

    done: int
    total: int
    failed: int
    best_loss: float | None
    best_theta: Mapping[str, float] | None
    stage: str = ""


Observer = Callable[[Progress], None]


def calibrate(
    problem: Problem,
    settings: SearchSettings | None = None,
    *,
    workers: int = 1,
    store: Path | None = None,
    resume: bool = False,
    hashes: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
    progress: Observer | None = None,
    **changes: Any,
) -> CalibrationResult:
    """Find the free parameters of a problem, all its experiments jointly.

    Ctrl-C ends the search (as other signals do, see `interrupts`); the result is then the best of the trials so far,
    and its status says so. With more than one worker a script must guard its own start with `if __name__ ==
    "__main__":`.

    Parameters
    ----------
    problem
        The robot, the experiments, the free parameters and the loss.
    settings
        Settings of the search; `SearchSettings()` when None.
    workers
        Processes. Every method gives the same result for any number, up to the last digits, in which the linear
        solver's threads (cores over workers) round differently. `tpe` asks for four trials at a time, so more than four
        workers do not help it; a resumed run keeps the number that it began with.
    store
        Run folder: every trial is stored there at once, and the result at the end. None stores nothing.
    resume
        Resume the run in `store`, exactly as if it had not stopped.
    hashes, files
        What else identifies the run (a resume with another is refused), and texts to store with it.
    progress
        Called after every trial, and before a long computation after the search (its `stage` names that).
    changes
        Settings by their names, such as `method="tpe", trials=100`, in the place of those in `settings`.

    Raises
    ------
    ParameterError
        For a setting that does not exist or makes no sense, or an experiment that cannot be held out.
    StorageError
        Where the folder cannot be used, or holds a run of something else.
    CalibrationError
        Where no trial could be simulated, or a worker died. The trials are stored.
    """
    began = time.perf_counter()
    settings = _settled((settings or SearchSettings()).changed(**changes), workers)
    identity = {**fingerprints(problem), **(hashes or {})}
    whole, problem = problem, fitted_part(problem, settings.hold_out)
    with contextlib.ExitStack() as stack:
        with interrupts_held():
            run = _open(store, resume, identity, settings, files)
            if run is not None:
                stack.enter_context(run)
                settings = replace(settings, batch=run.batch)
        optimiser = OPTIMISERS[settings.method].begin(problem, settings)
        journal = None
        if run is not None:
            with interrupts_held():
                journal = optimiser.journal(run.folder)
        tally = _Tally(problem, run, journal, began)
        evaluator = stack.enter_context(Evaluator(problem, workers=workers, jacobian=optimiser.needs_jacobian))
        stopped = _search(optimiser, evaluator, tally, progress)
        if tally.best is None:
            raise CalibrationError(_no_result(tally, stopped))
        status = _stopped_status(tally, optimiser, stopped) if stopped else optimiser.status
        converged = False if stopped and optimiser.converged is not None else optimiser.converged
        account = Account(settings, status, tally.n_solves, tally.elapsed(), identity, converged)
        if optimiser.statistics == "fanova":
            _tell_stage(progress, tally, optimiser, "importances (fANOVA)")
        result = conclude(problem, tally.best, tuple(tally.trials), account)
        if settings.hold_out:
            _tell_stage(progress, tally, optimiser, f"prediction of {', '.join(settings.hold_out)}")
            theta = {name: estimate.value for name, estimate in result.parameters.items()}
            held_out, notes = predicted(whole, theta, settings.hold_out)
            result = replace(result, held_out=held_out, notes=(*result.notes, *notes))
        if run is not None:
            write_result(result, run.folder)
        return result


def calibrate_each(
    problem: Problem, *, store: Path | None = None, resume: bool = False, **options: Any
) -> dict[str, CalibrationResult]:
    """Calibrate every experiment alone, as paper A does; result by experiment, run folders below `store`.

    Options as for `calibrate`. When resumed, experiments that were not begun are begun.

    Raises
    ------
    SoftcalError
        As `calibrate`.
    """
    results: dict[str, CalibrationResult] = {}
    for experiment in problem.experiments:
        folder = None if store is None else store / experiment.name
        begun = folder is not None and (folder / "run.json").is_file()
        results[experiment.name] = calibrate(
            problem.alone(experiment.name), store=folder, resume=resume and begun, **options
        )
    return results


@dataclass
class _Tally:
    """The trials of a run so far, and the folder they are stored in."""

    problem: Problem
    run: RunStore | None
    journal: Journal | None
    began: float
    trials: list[Trial] = field(default_factory=list[Trial])
    best: Evaluation | None = None
    n_solves: int = 0
    n_failed: int = 0
    earlier: float = 0.0  # wall time [s] of the sessions before this one

    def __post_init__(self) -> None:
        self.known = self.run.stored() if self.run is not None else {}
        self.earlier = max((stored.elapsed for stored in self.known.values()), default=0.0)

    def elapsed(self) -> float:
        return self.earlier + time.perf_counter() - self.began

    def recall(self, proposal: Proposal) -> Evaluation | None:
        """The evaluation of a proposal in an earlier session, or None."""
        stored = self.known.get(proposal.number)
        if stored is None or self.run is None:
            return None
        return recalled(self.problem, proposal, stored, self.run.folder)

    def note(self, number: int, evaluation: Evaluation, *, jacobian: bool) -> None:
        """Count a trial, and store it if it is new."""
        complete = evaluation.loss is not None
        trial = Trial(
            number,
            dict(evaluation.theta),
            "COMPLETE" if complete else "FAILED",
            evaluation.loss,
            evaluation.failure,
            evaluation.seconds,
            evaluation.n_factorisations,
            dict(evaluation.experiment_losses),
            evaluation.errors,
        )
        better = evaluation.loss is not None and (
            self.best is None or self.best.loss is None or evaluation.loss < self.best.loss
        )
        if self.run is not None and number not in self.known:
            payload = encode(evaluation.observations) if complete and (jacobian or better) else None
            self.run.append(StoredTrial(trial, evaluation.n_solves, self.elapsed(), payload))
        if self.journal is not None:
            self.journal.keep(trial)
        self.trials.append(trial)
        self.n_solves += evaluation.n_solves
        self.n_failed += not complete
        if better:
            self.best = evaluation


def _search(optimiser: Optimiser, evaluator: Evaluator, tally: _Tally, progress: Observer | None) -> str:
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
                    if progress is not None:
                        progress(_progress(tally, optimiser))
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
    )


def _tell_stage(progress: Observer | None, tally: _Tally, optimiser: Optimiser, stage: str) -> None:
    if progress is not None:
        with contextlib.suppress(KeyboardInterrupt):  # there is no search any more to be stopped
            progress(_progress(tally, optimiser, stage))


def _settled(settings: SearchSettings, workers: int) -> SearchSettings:
    """The settings made complete by the optimiser that they name."""
    if workers < 1:
        raise ParameterError(Fault("there must be a worker", "workers", got=str(workers), allowed="1 or more"))
    return OPTIMISERS.named(settings.method).settled(settings)


def _open(
    folder: Path | None,
    resume: bool,
    identity: Mapping[str, str],
    settings: SearchSettings,
    files: Mapping[str, str] | None,
) -> RunStore | None:
    if folder is None:
        if resume:
            raise StorageError(Fault("there is no run to resume without its folder", "store"))
        return None
    if resume:
        grows = OPTIMISERS[settings.method].grows
        return RunStore.resume(folder, identity=identity, settings=settings.record(), grows=grows)
    versions = installed_versions()
    return RunStore.create(folder, identity=identity, settings=settings.record(), versions=versions, files=files)


def _no_result(tally: _Tally, stopped: str) -> str:
    if stopped:
        return f"Stopped by {stopped} before any trial could be completed ({len(tally.trials)} failed)."
    reason, count = Counter(trial.reason for trial in tally.trials).most_common(1)[0]
    return (
        f"All {len(tally.trials)} trials failed: the twin could not be simulated anywhere. The commonest reason "
        f"({count} times): {reason} Try: narrower bounds, a stiffer start, or softcal check."
    )


def _stopped_status(tally: _Tally, optimiser: Optimiser, stopped: str) -> str:
    kept = " Resume the run to go on." if tally.run is not None else ""
    return (
        f"Stopped by {stopped} after {len(tally.trials)} of at most {optimiser.total} trials; "
        f"this is the best so far.{kept}"
    )
