"""Paper A's search: Optuna's tree-structured Parzen estimator with the settings that the paper ran."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.calibration.fanova import distributions
from softcal.calibration.optimiser import Optimiser, Proposal, register_optimiser
from softcal.calibration.option import Option
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Evaluation, Problem
from softcal.calibration.result import Trial
from softcal.calibration.settings import SearchSettings
from softcal.calibration.store import JOURNAL, TRIALS, storing
from softcal.errors import Fault, StorageError
from softcal.limits import LIMITS

if TYPE_CHECKING:
    import optuna
    from optuna.storages.journal import JournalFileOpenLock


STARTUP_TRIALS = 10  # the paper's


@register_optimiser
class TpeOptimiser(Optimiser):
    """TPE by Optuna. batch: points asked for before the first is evaluated; it decides the course of the search.
    startup_trials: random points before the first that is proposed by the estimator.

    Optuna 5 changed its defaults (multivariate sampling, constant liar); the paper's are pinned here.
    """

    name = "tpe"
    title = "sequential model-based search (TPE)"
    default_trials = 1000
    options = (Option("startup_trials", LIMITS["trials"], STARTUP_TRIALS),)
    batch = 4  # so many workers can share the search, which is the same for any number of them

    @classmethod
    def begin(cls, problem: Problem, settings: SearchSettings) -> TpeOptimiser:
        trials, batch, startup = settings.trials or 0, settings.batch or 1, int(settings.options["startup_trials"])
        return cls(problem.space, trials=trials, seed=settings.seed, batch=batch, startup_trials=startup)

    def __init__(
        self, space: SearchSpace, *, trials: int, seed: int, batch: int = 1, startup_trials: int = STARTUP_TRIALS
    ) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(
            multivariate=False,
            group=False,
            n_startup_trials=startup_trials,
            n_ei_candidates=24,
            constant_liar=False,
            seed=seed,
        )
        self._study = optuna.create_study(sampler=sampler, direction="minimize")
        self._space, self._distributions = space, distributions(space)
        self._trials, self._batch = trials, batch
        self._asked: dict[int, optuna.trial.Trial] = {}
        self._told = 0

    def journal(self, folder: Path) -> OptunaJournal:
        return OptunaJournal(folder / JOURNAL, self._space)

    def ask(self) -> tuple[Proposal, ...]:
        proposals: list[Proposal] = []
        for _ in range(min(self._batch, self._trials - self._told)):
            trial = self._study.ask(self._distributions)
            self._asked[trial.number] = trial
            proposals.append(Proposal(trial.number, dict(trial.params)))
        return tuple(proposals)

    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        import optuna

        trial = self._asked.pop(proposal.number)
        if evaluation.loss is None:
            self._study.tell(trial, state=optuna.trial.TrialState.FAIL)
        else:
            self._study.tell(trial, evaluation.loss)
        self._told += 1

    @property
    def total(self) -> int:
        return self._trials

    @property
    def status(self) -> str:
        if self._told < self._trials:
            return f"{self._told} of {self._trials} trials are done."
        return f"All {self._trials} trials were run."


class OptunaJournal:
    """The trials in a file that Optuna's own tools read (study "softcal"); the run's own store is authoritative.

    Optuna cannot resume a search where it stopped, since its sampler's random state is not stored; therefore a resumed
    search is given the recorded trials of `trials.sqlite` again, and this file only follows.
    """

    def __init__(self, path: Path, space: SearchSpace) -> None:
        import optuna
        from optuna.storages.journal import JournalFileBackend

        self._path = path
        self._distributions = distributions(space)
        with self._whole():
            storage = optuna.storages.JournalStorage(JournalFileBackend(str(path), lock_obj=_no_lock(path)))
            self._study = optuna.create_study(storage=storage, study_name="softcal", load_if_exists=True)
            self._held = self._study.get_trials(deepcopy=False)

    def keep(self, trial: Trial) -> None:
        """Add a trial that the file does not have yet.

        Raises
        ------
        StorageError
            Where it cannot be written, or holds another trial under that number.
        """
        import optuna

        failed = trial.loss is None
        if trial.number < len(self._held):
            held = self._held[trial.number]
            if held.params != dict(trial.theta) or (held.values is None) != failed:
                raise self._damaged(f"its trial {trial.number} is another one")
            return
        frozen = optuna.trial.create_trial(
            state=optuna.trial.TrialState.FAIL if failed else optuna.trial.TrialState.COMPLETE,
            value=trial.loss,
            params=dict(trial.theta),
            distributions=self._distributions,
            user_attrs={"reason": trial.reason} if failed else {},
        )
        with self._whole():
            self._study.add_trial(frozen)

    @contextlib.contextmanager
    def _whole(self) -> Generator[None]:
        """Turn an error of Optuna's for a damaged or truncated journal into a sentence."""
        import optuna

        broken = (ValueError, LookupError, TypeError, AttributeError, AssertionError, optuna.exceptions.OptunaError)
        try:
            with storing(self._path):
                yield
        except broken as error:
            raise self._damaged(str(error) or type(error).__name__) from error

    def _damaged(self, why: str) -> StorageError:
        attempt = f"move it away: it is written again from {TRIALS}"
        return StorageError(Fault("Optuna's journal of the run cannot be read", str(self._path), why, attempt=attempt))


def _no_lock(path: Path) -> JournalFileOpenLock:
    """A lock that is always free: `trials.sqlite` is locked by the one process that writes in the folder.

    Optuna's is a file, which a process that is killed leaves behind, and which the next one waits for.
    """
    from optuna.storages.journal import JournalFileOpenLock

    class NoLock(JournalFileOpenLock):
        def acquire(self) -> bool:
            return True

        def release(self) -> None:
            pass

    return NoLock(str(path))
