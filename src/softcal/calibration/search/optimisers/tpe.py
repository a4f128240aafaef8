"""Paper A's search: Optuna's tree-structured Parzen estimator with the settings that the paper ran."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softcal.calibration.problem.option import Option
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.results.trial_journal import distributions
from softcal.calibration.search.optimiser import Optimiser, Proposal, register_optimiser
from softcal.calibration.search.settings import SearchSettings
from softcal.limits import LIMITS

if TYPE_CHECKING:
    import optuna


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
        sampler = tpe_sampler(seed, startup_trials)
        self._study = optuna.create_study(sampler=sampler, direction="minimize")
        self._distributions = distributions(space)
        self._trials, self._batch = trials, batch
        self._asked: dict[int, optuna.trial.Trial] = {}
        self._told = 0

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


def tpe_sampler(seed: int, startup_trials: int = STARTUP_TRIALS) -> optuna.samplers.TPESampler:
    """Optuna's estimator with the paper's settings."""
    import optuna

    return optuna.samplers.TPESampler(
        multivariate=False,
        group=False,
        n_startup_trials=startup_trials,
        n_ei_candidates=24,
        constant_liar=False,
        seed=seed,
    )
