"""The result of a search: values, bounds, errors, importances, and what a person should know about them."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from softcal.calibration.experiment import PULLEY_FRICTION, Experiment
from softcal.calibration.loss import rms, rms_detrended
from softcal.calibration.observation import Observation
from softcal.calibration.optimiser_tpe import fanova_importance
from softcal.calibration.problem import Evaluation, Problem
from softcal.calibration.result import CalibrationResult, Estimate, ExperimentFit, Trial
from softcal.calibration.sensitivity import Statistics, local_statistics


@dataclass(frozen=True)
class Account:
    """How a search went: its settings and final sentence, its cost (wall_s [s]), and what identifies it."""

    settings: Mapping[str, Any]
    status: str
    n_solves: int
    wall_s: float
    hashes: Mapping[str, str]


def conclude(problem: Problem, best: Evaluation, trials: tuple[Trial, ...], account: Account) -> CalibrationResult:
    """The result whose best evaluation is `best`."""
    if best.loss is None:
        raise ValueError("the best evaluation has no loss")
    space = problem.space
    method, seed = str(account.settings["method"]), int(account.settings["seed"])
    if method == "least-squares":
        local = local_statistics(space, problem.loss, best.theta, best.blocks)
        kind = "sensitivity"
    else:
        local = _global_statistics(problem, trials, seed)
        kind = "fanova"
    at_bound = space.at_bound(best.theta)
    n_failed = sum(trial.state == "FAILED" for trial in trials)
    return CalibrationResult(
        parameters={
            p.label: Estimate(
                best.theta[p.label], p.unit, at_bound[p.label], p.lower, p.upper, local.standard_errors[p.label]
            )
            for p in space.parameters
        },
        loss=best.loss,
        loss_name=problem.loss.name,
        method=method,
        seed=seed,
        n_solves=account.n_solves,
        n_factorisations=sum(trial.n_factorisations for trial in trials),
        wall_s=account.wall_s,
        status=account.status,
        experiments={e.name: _fit(e, best.observations[e.name]) for e in problem.experiments},
        importance=local.importance,
        trials=trials,
        n_failed_trials=n_failed,
        hashes=account.hashes,
        versions=installed_versions(),
        notes=(*local.notes, *_notes(problem, at_bound, trials, n_failed)),
        extra={"importance_kind": kind, **account.settings},
    )


def installed_versions() -> dict[str, str]:
    """Versions of what decides a result."""
    versions = {"python": platform.python_version()}
    for package in ("softcal", "numpy", "scipy", "numba", "pypardiso", "optuna", "scikit-learn"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def _global_statistics(problem: Problem, trials: tuple[Trial, ...], seed: int) -> Statistics:
    errors: dict[str, float | None] = dict.fromkeys(problem.space.labels)
    completed = [(dict(trial.theta), trial.loss) for trial in trials if trial.loss is not None]
    try:
        return Statistics(errors, fanova_importance(problem.space, completed, seed), ())
    except KeyboardInterrupt:
        # It takes long after a thousand trials, and what was searched for is found: only the importances are missing.
        return Statistics(errors, {}, ("The importances are missing: their computation was stopped by the user.",))


def _fit(experiment: Experiment, seen: Observation) -> ExperimentFit:
    channels = experiment.dataset.channels
    errors = {channel: seen.predicted[channel] - channels[channel].values for channel in experiment.compared}
    return ExperimentFit(
        rmse={channel: rms(error) for channel, error in errors.items()},
        rmse_detrended={channel: rms_detrended(error) for channel, error in errors.items()},
        measured={name: channel.values for name, channel in channels.items()},
        simulated=dict(seen.predicted),
        units={**seen.units, **{name: channel.unit for name, channel in channels.items()}},
        response=dict(seen.response),
    )


def _notes(problem: Problem, at_bound: Mapping[str, bool], trials: tuple[Trial, ...], n_failed: int) -> list[str]:
    notes = [
        f"{label} stands at a bound of its range; the bounds, not the data, decide it."
        for label in at_bound
        if at_bound[label]
    ]
    if n_failed:
        first = next(trial for trial in trials if trial.state == "FAILED")
        where = ", ".join(f"{name} = {value:.4g}" for name, value in first.theta.items())
        notes.append(f"{n_failed} of {len(trials)} trials could not be simulated; the first at {where}: {first.reason}")
    if PULLEY_FRICTION in problem.space.targets:
        notes.append(
            "Tensions and their errors are on the neck's side under the nominal pulley friction, "
            "so that the friction that was found cannot make them look smaller."
        )
    return notes
