"""Experiments that are kept out of a fit and predicted by it afterwards: a test of the twin beyond the fitted data.

Parameters shared by all experiments keep the value that was found without these. An experiment's own parameters (the
frame of its set-up, its slack) cannot be known from others; these alone are fitted to the predicted experiment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.results.fit import experiment_fit
from softcal.calibration.results.result import HeldOut
from softcal.calibration.search.descent import Descent
from softcal.calibration.statistics.band import half_width, noise_of
from softcal.calibration.statistics.estimate import Remark
from softcal.calibration.statistics.estimator import Estimator, estimator
from softcal.calibration.statistics.noise import Noise
from softcal.checks import Floats
from softcal.errors import Fault, ParameterError, unknown
from softcal.twin.parameters import robot_parameters

# Trajectories for the fit of an experiment's own nuisances; the problem is nearly linear.
_BUDGET = 30


def fitted_part(problem: Problem, hold_out: Sequence[str]) -> Problem:
    """The problem without the experiments that are held out.

    Raises
    ------
    ParameterError
        For an experiment that does not exist, where none is left, or where one has a parameter of the robot of its own.
    """
    names = [experiment.name for experiment in problem.experiments]
    faults: list[Fault] = []
    for name in dict.fromkeys(hold_out):
        if name not in names:
            faults.append(unknown("there is no such experiment to hold out", "hold_out", name, names))
    if set(names) <= set(hold_out):
        faults.append(Fault("no experiment is left to fit", "hold_out", got=", ".join(hold_out)))
    of_robot = robot_parameters(problem.robot)
    faults += [
        Fault("an experiment with a robot of its own cannot be predicted", "hold_out", p.label, "shared parameters")
        for p in problem.space.parameters
        if not p.serves(*(name for name in names if name not in hold_out))
        and any(target in of_robot for target in p.targets)
    ]
    if faults:
        raise ParameterError(faults)
    return problem.only([name for name in names if name not in hold_out])


def predicted(
    problem: Problem, theta: Mapping[str, float], hold_out: Sequence[str], fitted: Evaluation
) -> tuple[dict[str, HeldOut], tuple[Remark, ...]]:
    """The twin's prediction of each experiment that was held out, and remarks on those that failed.

    Parameters
    ----------
    problem, theta
        The problem with all experiments, and the calibrated parameters [SI by label].
    hold_out
        Names of the experiments to predict.
    fitted
        The evaluation of the others, from whose residuals the predictions have their bands.
    """
    bands = _Bands.of(fitted_part(problem, hold_out), fitted)
    found: dict[str, HeldOut] = {}
    notes: list[Remark] = []
    for experiment in problem.experiments:
        if experiment.name not in hold_out:
            continue
        evaluation, own, unsettled = _predict(problem, theta, experiment, with_slopes=bands is not None)
        if evaluation is None or evaluation.loss is None:
            reason = "" if evaluation is None else evaluation.failure
            notes.append(Remark(f"{experiment.name} was held out and cannot be predicted: {reason}"))
            continue
        if unsettled:
            labels = ", ".join(p.label for p in own)
            text = (
                f"{experiment.name} was held out. The fit of its own parameters ({labels}), needed for its prediction"
            )
            notes.append(Remark(f"{text}, did not converge: {unsettled}"))
        widths = {} if bands is None else bands.of_prediction(problem.alone(experiment.name), evaluation)
        fit = experiment_fit(experiment, evaluation.observations[experiment.name], widths)
        values = {p.label: evaluation.theta[p.label] for p in own}
        found[experiment.name] = HeldOut(evaluation.experiment_losses[experiment.name], fit, values)
    return found, tuple(notes)


def _predict(
    problem: Problem, theta: Mapping[str, float], experiment: Experiment, *, with_slopes: bool
) -> tuple[Evaluation | None, list[FreeParameter], str]:
    """The prediction, the experiment's own parameters, and how their fit ended where it did not converge, else "".

    with_slopes: whether its derivatives by the parameters of the others are wanted, too.
    """
    alone = problem.alone(experiment.name)
    own = [p for p in alone.space.parameters if p.label not in theta]
    if not own:
        return alone.evaluate({label: theta[label] for label in alone.space.labels}, jacobian=True), own, ""
    shared = [p for p in alone.space.parameters if p.label in theta]
    held = {target: theta[p.label] for p in shared for target in p.targets}
    placed = replace(experiment, settings={**experiment.settings, **held})
    part = replace(alone, experiments=(placed,), space=SearchSpace(tuple(own)))
    descent = Descent(part.space, part.loss, np.clip(part.space.to_search(part.space.start), 0.0, 1.0), _BUDGET)
    evaluation: Evaluation | None = None
    while descent.next is not None:
        evaluation = part.evaluate(part.space.to_model(descent.next), jacobian=True)
        descent.tell(evaluation)
    evaluation = descent.best if descent.best is not None else evaluation
    unsettled = "" if descent.converged else descent.status
    if with_slopes and evaluation is not None and evaluation.loss is not None:
        everything = {**evaluation.theta, **{p.label: theta[p.label] for p in shared}}
        evaluation = alone.evaluate(everything, jacobian=True)
    return evaluation, own, unsettled


@dataclass(frozen=True)
class _Bands:
    """The 95 % bands of predictions: the errors of the estimates carried on, and the noise of a measurement."""

    space: SearchSpace
    loss: Loss
    slopes: Floats
    found: Estimator
    fitted: Sequence[Block]

    @classmethod
    def of(cls, part: Problem, fitted: Evaluation) -> _Bands | None:
        """From the fit of the other experiments; None where it has no derivatives, or too few measurements."""
        space, blocks = part.space, fitted.blocks
        if any(block.jacobian is None for block in blocks) or sum(len(b.residual) for b in blocks) <= space.size:
            return None
        z = np.clip(space.to_search(fitted.theta), 0.0, 1.0)
        slopes = space.jacobian(z)
        serves = space.serving(e.name for e in part.experiments)
        uncertain = part.uncertain if any(block.systematic is not None for block in blocks) else ()
        found = estimator(part.loss, z, slopes, blocks, serves, uncertain)
        return None if found.spent else cls(space, part.loss, slopes, found, blocks)

    def of_prediction(self, alone: Problem, seen: Evaluation) -> dict[str, Floats]:
        """Channel -> half the width (n,) [SI] at its measured samples; of channels of a kind that was fitted.

        alone: the problem of this experiment. Where it has parameters of its own, which follow the estimates of the
        others by their fit to it, the slopes are those that remain after that fit. Where the loss takes the noise of
        each experiment as its own, that of this one is the largest of the others.
        """
        labels = alone.space.labels
        shared = [i for i, label in enumerate(labels) if label in self.space.labels]
        place = [self.space.labels.index(labels[i]) for i in shared]
        # The noise of a block's group, or the largest of the same channel of the fitted ones; None where unknown.
        known, noise = self.found.noise, dict[str, Noise | None]()
        for block in (one for one in seen.blocks if one.experiment):
            groups = (self.loss.noise_group(one) for one in self.fitted if one.channel == block.channel)
            largest = max((known[g] for g in groups if g in known), key=lambda one: one.size, default=None)
            group = self.loss.noise_group(block)
            noise[group] = known.get(group, largest)
        found = replace(self.found, noise={name: one for name, one in noise.items() if one is not None})
        blocks = [
            (block, block.jacobian)
            for block in seen.blocks
            if block.experiment and block.jacobian is not None and self.loss.noise_group(block) in found.noise
        ]
        if not blocks:
            return {}
        sigma = np.concatenate([np.broadcast_to(noise_of(self.loss, b, found), len(b.residual)) for b, _ in blocks])
        jacobian = np.concatenate([jacobian for _, jacobian in blocks]) / sigma[:, None]
        own = np.delete(jacobian, shared, axis=1)
        slopes = np.zeros((len(jacobian), self.space.size))
        slopes[:, place] = jacobian[:, shared] * self.slopes[place]
        slopes = sigma[:, None] * (slopes - own @ np.linalg.lstsq(own, slopes, rcond=None)[0])
        ends = np.cumsum([len(block.residual) for block, _ in blocks])
        return {
            block.channel: half_width(self.loss, block, part, found.within_bounds, found)
            for (block, _), part in zip(blocks, np.split(slopes, ends[:-1]), strict=True)
        }
