"""The result of a search: values, bounds, errors, importances, and notes on how far they can be trusted."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from typing import Any, TypeVar

from softcal.calibration.experiment import PULLEY_FRICTION
from softcal.calibration.fanova import fanova_importance
from softcal.calibration.fit import experiment_fit, missing_rows
from softcal.calibration.optimiser import OPTIMISERS
from softcal.calibration.problem import Evaluation, Problem
from softcal.calibration.result import Estimate, Note, SearchResult, Trial
from softcal.calibration.sensitivity import Statistics, local_statistics
from softcal.units import AS_WRITTEN, format_quantity

R = TypeVar("R", bound=SearchResult)

NOT_A_MINIMUM = (
    "No standard errors and no intervals: they exist only at a minimum of the loss, and the search did not converge."
)
BEYOND_THE_BOUNDS = "the best fit is beyond it"
WITHIN_THE_BOUNDS = "all 95 % intervals are computed within the bounds"
NOMINAL_FRICTION = (
    "Tensions and their errors are those on the robot's side of the pulleys, computed with the nominal friction, so "
    "that the fitted friction does not scale the errors."
)
NO_ERRORS = (
    "This method gives no standard errors: its best trial is near a minimum of the loss, not at it, and the "
    "derivatives there are not computed. For intervals, use the method least-squares."
)


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
    make: Callable[..., R], problem: Problem, best: Evaluation, trials: tuple[Trial, ...], account: Account, **own: Any
) -> R:
    """The result whose best evaluation is `best`; make: its class, own: what that class has of its own."""
    if best.loss is None:
        raise ValueError("the best evaluation has no loss")
    space = problem.space
    kind = OPTIMISERS[account.method].statistics
    if kind == "sensitivity":
        local = local_statistics(space, problem.loss, best.theta, best.blocks)
        if account.converged is False:
            local = Statistics(dict.fromkeys(space.labels), local.importance, (Note(NOT_A_MINIMUM),))
    else:
        local = _global_statistics(problem, trials, account.seed)
    parameters = local.estimates(space, best.theta)
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
        experiments={e.name: experiment_fit(e, best.observations[e.name]) for e in problem.experiments},
        importance=local.importance,
        trials=trials,
        n_failed_trials=n_failed,
        hashes=account.hashes,
        versions=installed_versions(),
        notes=(*local.notes, *_notes(problem, parameters, trials, n_failed)),
        extra={"importance_kind": kind, **{k: value for k, value in account.settings.items() if k not in own}},
        **own,
    )
    if not result.is_saturated:
        return result
    return replace(result, notes=(*result.notes, saturated_note(result)))


def installed_versions() -> dict[str, str]:
    """Versions of the packages on which a result depends."""
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
        return Statistics(errors, fanova_importance(problem.space, completed, seed), (Note(NO_ERRORS),))
    except KeyboardInterrupt:
        # It takes long after a thousand trials, and the estimates are already found: only the importances are missing.
        missing = "The importances are missing: their computation was stopped by the user."
        return Statistics(errors, {}, (Note(NO_ERRORS), Note(missing)))


def _notes(
    problem: Problem, parameters: Mapping[str, Estimate], trials: tuple[Trial, ...], n_failed: int
) -> list[Note]:
    notes = [bound_note(name, estimate) for name, estimate in parameters.items() if estimate.at_bound]
    for experiment in problem.experiments:
        rows = missing_rows(experiment)
        if rows:
            labels = experiment.dataset.labels or [str(i + 1) for i in range(experiment.dataset.n_samples)]
            named = "; ".join(f"{name} in {_states([labels[i] for i in held])}" for name, held in rows.items())
            n_samples = experiment.dataset.n_samples
            notes.append(Note(f"{experiment.name}: not measured and left out, of {n_samples} states: {named}."))
    if n_failed:
        first = next(trial for trial in trials if trial.state == "FAILED")
        where = ", ".join(f"{name} = {value:.4g}" for name, value in first.theta.items())
        text = f"{n_failed} of {len(trials)} trials could not be simulated; the first at {where}: {first.reason}"
        notes.append(Note(text))
    if PULLEY_FRICTION in problem.space.targets:
        notes.append(Note(NOMINAL_FRICTION))
    return notes


def bound_note(label: str, estimate: Estimate) -> Note:
    """Warning of a parameter at the nearer of its bounds, and on its best value without the bound."""
    lower, upper, value = estimate.lower, estimate.upper, estimate.value
    above = abs(value - upper) <= abs(value - lower)
    side, nearer = ("upper", upper) if above else ("lower", lower)
    text = f"{label} is at its {side} bound of {format_quantity(nearer, estimate.unit, digits=AS_WRITTEN)}"
    if not estimate.is_held:
        return Note(f"{text}: the value is determined by the bound, not by the data.", "warning")
    beyond = f"{BEYOND_THE_BOUNDS}, by about {estimate.beyond:.0f} standard errors; {WITHIN_THE_BOUNDS}"
    return Note(f"{text}: {beyond}.", "warning")


def saturated_note(result: SearchResult) -> Note:
    """Warning of a result that `is_saturated`."""
    n, n_values = len(result.parameters), sum(fit.n_values for fit in result.experiments.values())
    text = f"{n} parameter{'s were' if n > 1 else ' was'} fitted to {n_values} measured value{'s' * (n_values > 1)}"
    return Note(f"{text}, so a close fit is no evidence for these values.", "warning")


def _states(labels: list[str]) -> str:
    shown = ", ".join(labels[:6]) + (", …" if len(labels) > 6 else "")
    return f"state {shown}" if len(labels) == 1 else f"{len(labels)} states ({shown})"
