"""Which parameters the losses of many trials depend on: fANOVA by Optuna, as in paper A."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from softcal.calibration.problem.parameters import SearchSpace

if TYPE_CHECKING:
    import optuna


def distributions(space: SearchSpace) -> dict[str, optuna.distributions.BaseDistribution]:
    """The search space as Optuna sees it."""
    import optuna

    return {
        p.label: optuna.distributions.FloatDistribution(p.lower, p.upper, log=p.scale == "log")
        for p in space.parameters
    }


def fanova_importance(space: SearchSpace, trials: list[tuple[dict[str, float], float]], seed: int) -> dict[str, float]:
    """fANOVA importances by label from completed trials (theta, loss); empty where they are not defined.

    That is with fewer than two trials, or when all losses are equal.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    if len(trials) < 2 or len({loss for _, loss in trials}) < 2:
        return {}
    study = optuna.create_study(direction="minimize")
    known = distributions(space)
    study.add_trials(
        [optuna.trial.create_trial(params=theta, distributions=known, value=loss) for theta, loss in trials]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        found = optuna.importance.get_param_importances(
            study, evaluator=optuna.importance.FanovaImportanceEvaluator(seed=seed)
        )
    return {label: float(found[label]) for label in space.labels}
