"""Errors of the twin at its nominal values: the reference of a calibration's improvement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.fit import experiment_fit
from softcal.calibration.results.result import ExperimentFit
from softcal.display import displayed
from softcal.twin.parameters import parameter_values


@displayed
@dataclass(frozen=True)
class Nominal:
    """Loss and fits at the nominal values, or why there are none.

    Attributes
    ----------
    parameters
        Label -> nominal value of the free parameters [SI]; without tied parameters whose values differ.
    loss
        The loss; None if the simulation failed.
    fits
        Experiment -> fit.
    errors
        Errors by experiment and channel [SI], as in `Trial.errors`.
    failure
        Why the simulation failed, or "".
    """

    loss: float | None
    failure: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])
    fits: Mapping[str, ExperimentFit] = field(default_factory=dict[str, ExperimentFit])


def nominal(problem: Problem) -> Nominal:
    """Simulate every experiment of a problem at the present values of robot and rig.

    Raises
    ------
    InputError
        For a command that the robot cannot follow.
    """
    held, theta = _as_it_is(problem)
    found = held.evaluate(theta)
    values = {p.label: {problem.known[target].value for target in p.targets} for p in problem.space.parameters}
    present = {label: targets.pop() for label, targets in values.items() if len(targets) == 1}
    if found.loss is None:
        return Nominal(None, found.failure, present)
    fits = {e.name: experiment_fit(e, found.observations[e.name]) for e in problem.experiments}
    return Nominal(found.loss, "", present, found.errors, fits)


def _as_it_is(problem: Problem) -> tuple[Problem, dict[str, float]]:
    """The problem with a single free parameter of one experiment, and its nominal value."""
    of_robot = parameter_values(problem.robot)
    for p in problem.space.parameters:
        for experiment in problem.experiments:
            values = {**of_robot, **experiment.rig_values()}
            target = next((t for t in p.targets if t in values and p.serves(experiment.name)), None)
            if target is not None:
                own = FreeParameter(target, p.unit, p.lower, p.upper, experiment=experiment.name)
                return replace(problem, space=SearchSpace((own,))), {own.label: values[target]}
    raise ValueError("no experiment has any of the free parameters")
