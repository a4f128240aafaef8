"""The result of a search: values, bounds, errors, importances, and notes on how far they can be trusted."""

from __future__ import annotations

import contextlib
import platform
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from typing import Any, TypeVar

import numpy as np

from softcal.calibration.problem.experiment import PULLEY_FRICTION, Experiment
from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.results.fit import experiment_fit, missing_rows
from softcal.calibration.results.result import SearchResult, Trial
from softcal.calibration.results.trial_journal import distributions
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.search.robot_errors import MAY_MISS, WithRobotErrors, with_robot_errors
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.calibration.statistics.local_model import loss_profiles
from softcal.calibration.statistics.misfit import misfits
from softcal.calibration.statistics.residuals import ResidualRecord, outliers, residual_record, step_of_readings
from softcal.calibration.statistics.sensitivity import Statistics, local_statistics
from softcal.extras import missing
from softcal.units import AS_WRITTEN, format_quantity, plain

R = TypeVar("R", bound=SearchResult)

NOT_A_MINIMUM = (
    "No standard errors and no intervals: they exist only at a minimum of the loss, and the search did not converge."
)
BEYOND_THE_BOUNDS = "the best fit is beyond it"
CONTRADICTED = "model and bounds contradict the data: the errors of this fit are multiplied by the largest such number"
NOMINAL_FRICTION = (
    "Tensions and their errors are those on the robot's side of the pulleys, computed with the nominal friction, so "
    "that the fitted friction does not scale the errors."
)
TOO_FAR = (
    "No standard errors and no intervals: the best trial is several standard errors from a minimum of the loss, so "
    "that its derivatives do not describe it. More trials, or the method least-squares, come closer."
)
NO_DERIVATIVES = "No standard errors and no intervals: the derivatives at the best trial were not computed."
_AWAY = 0.5  # standard errors between the best trial and the minimum from which it is reported
_FAR = 3.0  # from which the derivatives at the trial do not describe the minimum


@dataclass(frozen=True)
class Account:
    """Summary of a search.

    Attributes
    ----------
    method, seed
        Name of the optimiser, and the seed of its random numbers.
    settings
        Its settings as a result reports them.
    status
        How it ended, a sentence.
    n_solves
        Number of simulated trajectories.
    wall_s
        Wall time [s].
    hashes
        What identifies the run: name of the input -> hash.
    converged
        Whether it reached a minimum of the loss; None where it looks for none.
    """

    method: str
    seed: int
    settings: Mapping[str, Any]
    status: str
    n_solves: int
    wall_s: float
    hashes: Mapping[str, str]
    converged: bool | None = None


def conclude(
    make: Callable[..., R],
    problem: Problem,
    best: Evaluation,
    trials: tuple[Trial, ...],
    account: Account,
    *,
    uncertain: tuple[UncertainParameter, ...] | None = None,
    **own: Any,
) -> R:
    """The result of a search.

    Parameters
    ----------
    make, own
        The class of the result, and what that class has of its own.
    problem, best, trials
        The problem, its best evaluation, and all trials.
    account
        How the search went.
    uncertain
        The parameters of the blocks' `systematic`; the problem's where None.
    """
    if best.loss is None:
        raise ValueError("the best evaluation has no loss")
    space = problem.space
    kind = OPTIMISERS[account.method].statistics
    residuals = _residuals(problem.experiments, best.blocks)
    uncertain, doubted = problem.uncertain if uncertain is None else uncertain, WithRobotErrors(best)
    if any(one.is_misfit or one.significance > MAY_MISS for of in residuals.values() for one in of.values()):
        with contextlib.suppress(KeyboardInterrupt):
            doubted = with_robot_errors(problem, best, uncertain)
        best = doubted.best
        uncertain += doubted.errors
    if all(block.jacobian is not None for block in best.blocks):
        local = local_statistics(space, problem.loss, best.theta, best.blocks, uncertain)
    else:
        local = Statistics(dict.fromkeys(space.labels), {}, (Remark(NO_DERIVATIVES),))
    if account.converged is False:
        local = Statistics(dict.fromkeys(space.labels), local.importance, (Remark(NOT_A_MINIMUM),))
    if kind == "fanova":
        local = _of_all_trials(local, problem, best, trials, account.seed)
    parameters = local.estimates(space, best.theta)
    if kind == "sensitivity":
        curves = loss_profiles(space, problem.loss, best.theta, best.blocks, local.intervals)
        parameters = {name: replace(one, profile=curves.get(name, ())) for name, one in parameters.items()}
    n_failed = sum(trial.state == "FAILED" for trial in trials)
    result = make(
        parameters=parameters,
        loss=best.loss,
        loss_name=problem.loss.name,
        method=account.method,
        seed=account.seed,
        n_solves=account.n_solves,
        n_factorisations=sum(trial.n_factorisations for trial in trials),
        wall_s=account.wall_s,
        status=account.status,
        experiments={
            e.name: experiment_fit(e, best.observations[e.name], local.bands.get(e.name), local.repeats.get(e.name))
            for e in problem.experiments
        },
        importance=local.importance,
        spreads=local.spreads,
        left_out=local.left_out,
        residuals=residuals,
        robot_errors={p.name: p.sd for p in doubted.errors},
        trials=trials,
        n_failed_trials=n_failed,
        hashes=account.hashes,
        versions=installed_versions(),
        notes=(*doubted.notes, *local.notes, *_notes(problem, parameters, trials, n_failed)),
        extra={"importance_kind": kind, **{k: value for k, value in account.settings.items() if k not in own}},
        **own,
    )
    if not result.is_saturated:
        return result
    return replace(result, notes=(*result.notes, saturated_note(result)))


def _residuals(experiments: Iterable[Experiment], blocks: Sequence[Block]) -> dict[str, dict[str, ResidualRecord]]:
    found: dict[str, dict[str, ResidualRecord]] = {}
    for experiment in experiments:
        own = [block for block in blocks if block.experiment == experiment.name]
        for block, misfit in zip(own, misfits(own), strict=True):
            if (record := residual_record(block.residual)) is None:
                continue
            rows = np.flatnonzero(experiment.seen(block.channel))[outliers(block.residual)]
            known = replace(
                record,
                significance=misfit.in_residuals,
                outliers=tuple(int(row) + 1 for row in rows),
                step=step_of_readings(block.measured, block.residual),
            )
            explained = misfit.explained if known.is_misfit else {}
            found.setdefault(experiment.name, {})[block.channel] = replace(known, explained=explained)
    return found


def installed_versions() -> dict[str, str]:
    """Versions of the packages on which a result depends."""
    versions = {"python": platform.python_version()}
    for package in ("softcal", "numpy", "scipy", "numba", "pypardiso", "optuna", "scikit-learn"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def _of_all_trials(
    local: Statistics, problem: Problem, best: Evaluation, trials: tuple[Trial, ...], seed: int
) -> Statistics:
    """Statistics at the best of many trials: how far it is from the minimum, and the importances over all of them."""
    if max(_steps(best.theta, local).values(), default=0.0) > _FAR:
        local = Statistics(dict.fromkeys(problem.space.labels), {}, (Remark(TOO_FAR),))
    notes, steps = [*local.notes], _steps(best.theta, local)
    if any(step > _AWAY for step in steps.values()):
        units = {p.label: p.unit for p in problem.space.parameters}
        places = [f"{name} = {format_quantity(local.minimum[name], units[name], digits=4)}" for name in steps]
        notes.append(
            Remark(
                f"The best trial is not at the minimum of the loss but up to {plain(max(steps.values()), 2)} standard "
                f"errors from it; by the derivatives there the minimum is at {', '.join(places)}. The intervals are "
                "those of the minimum, and include the best trial. The method least-squares finds the minimum."
            )
        )
    completed = [(dict(trial.theta), trial.loss) for trial in trials if trial.loss is not None]
    importance: Mapping[str, float] = {}
    if (fault := missing("importance", "sklearn")) is not None:
        notes.append(Remark(f"The importances are missing: {fault}"))
    else:
        try:
            importance = fanova_importance(problem.space, completed, seed)
        except KeyboardInterrupt:
            # It takes long after a thousand trials, and the estimates are already known: only these are missing.
            notes.append(Remark("The importances are missing: their computation was stopped by the user."))
    return replace(local, importance=importance, notes=tuple(notes))


def _steps(theta: Mapping[str, float], local: Statistics) -> dict[str, float]:
    """Label -> distance of the minimum, by the derivatives at theta, in standard errors."""
    errors = {name: error for name, error in local.standard_errors.items() if error and name in local.minimum}
    return {name: abs(local.minimum[name] - theta[name]) / error for name, error in errors.items()}


def _notes(
    problem: Problem, parameters: Mapping[str, Estimate], trials: tuple[Trial, ...], n_failed: int
) -> list[Remark]:
    notes = [bound_note(name, estimate) for name, estimate in parameters.items() if estimate.at_bound]
    notes += [
        prior_note(p, parameters[p.label]) for p in problem.space.parameters if parameters[p.label].contradicts_prior
    ]
    if problem.left_out:
        notes.append(Remark(problem.left_out, "warning"))
    for experiment in problem.experiments:
        rows = missing_rows(experiment)
        if rows:
            labels = experiment.dataset.labels or [str(i + 1) for i in range(experiment.dataset.n_samples)]
            missed: list[str] = []
            for name, held in rows.items():
                shown = ", ".join(labels[i] for i in held[:6]) + (", …" if len(held) > 6 else "")
                missed.append(f"{name} in " + (f"state {shown}" if len(held) == 1 else f"{len(held)} states ({shown})"))
            named = "; ".join(missed)
            n_samples = experiment.dataset.n_samples
            notes.append(Remark(f"{experiment.name} ({n_samples} states): not measured, and so not compared: {named}."))
    if n_failed:
        first = next(trial for trial in trials if trial.state == "FAILED")
        units = {one.label: one.unit for one in problem.space.parameters}
        where = ", ".join(f"{name} = {format_quantity(value, units[name])}" for name, value in first.theta.items())
        text = f"{n_failed} of {len(trials)} trials could not be simulated; the first at {where}: {first.reason}"
        notes.append(Remark(text))
    pulleys = [experiment.rig.pulleys for experiment in problem.experiments]
    corrected = any(one is not None and not one.friction_memory for one in pulleys)
    if corrected and PULLEY_FRICTION in problem.space.targets:
        notes.append(Remark(NOMINAL_FRICTION))
    return notes


def bound_note(label: str, estimate: Estimate) -> Remark:
    """Warning of a parameter at the nearer of its bounds, and on its best value without the bound."""
    lower, upper, value = estimate.lower, estimate.upper, estimate.value
    above = abs(value - upper) <= abs(value - lower)
    side, nearer = ("upper", upper) if above else ("lower", lower)
    text = f"{label} is at its {side} bound of {format_quantity(nearer, estimate.unit, digits=AS_WRITTEN)}"
    if not estimate.is_contradicted:
        return Remark(f"{text}: the value is determined by the bound, not by the data.", "warning")
    return Remark(f"{text}: {beyond_text(estimate)}", "warning")


def beyond_text(estimate: Estimate) -> str:
    """End of a sentence on the distance of the best fit beyond a bound that it contradicts."""
    return f"{BEYOND_THE_BOUNDS}, by about {estimate.beyond:.0f} standard errors; {CONTRADICTED}."


def prior_note(parameter: FreeParameter, estimate: Estimate) -> Remark:
    """Warning of a prior that contradicts the data."""
    mean, sd = (format_quantity(size or 0.0, parameter.unit) for size in (parameter.prior_mean, parameter.prior_sd))
    text = (
        f"{parameter.label} is about {estimate.off_prior:.0f} standard errors from the mean of its prior, {mean} with "
        f"a standard deviation of {sd}: prior and data contradict each other, so that one of them or the model is "
        "wrong; the errors of this fit are multiplied by the largest distance from a prior or a bound."
    )
    return Remark(text, "warning")


def saturated_note(result: SearchResult) -> Remark:
    """Warning of a result that `is_saturated`."""
    n, n_values = len(result.parameters), sum(fit.n_values for fit in result.experiments.values())
    text = f"{n} parameter{'s were' if n > 1 else ' was'} fitted to {n_values} measured value{'s' * (n_values > 1)}"
    return Remark(f"{text}, so a close fit is no evidence for these values.", "warning")


def fanova_importance(space: SearchSpace, trials: list[tuple[dict[str, float], float]], seed: int) -> dict[str, float]:
    """fANOVA importances by label; empty with fewer than two trials, or when all losses are equal.

    Parameters
    ----------
    space
        The search space.
    trials
        Completed ones: theta [SI by label], loss.
    seed
        Seed of fANOVA's random numbers.
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
