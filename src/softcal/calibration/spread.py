"""How far the experiments of a joint fit differ in a parameter that they share, in SI."""

from __future__ import annotations

import numpy as np

from softcal.calibration.between_experiments import Between
from softcal.calibration.estimator import Estimator
from softcal.calibration.intervals import box_intervals
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.random_effects import Spread
from softcal.checks import Floats


def spread(space: SearchSpace, z: Floats, between: Between, found: Estimator, known: np.ndarray) -> Spread:
    """The comparison of experiments, in SI; z: the joint minimum (size,) in the unit box, known: the parameters that
    have an interval.
    """
    j, label = between.column, space.labels[between.column]
    effects = between.effects

    def model(value: float) -> float:
        moved = z.copy()
        moved[j] = min(max(value, 0.0), 1.0)
        return space.to_model(moved)[label]

    ends = None
    if between.has_interval and j in known:
        at = int(np.flatnonzero(known == j)[0])
        # A further experiment differs from the mean by as much as those that were made.
        further = np.zeros((1, len(known)))
        further[0, at] = effects.spread
        root = np.concatenate([found.root[:, known], further])
        dof = np.where(np.arange(len(known)) == at, _dof(between, found), found.dof[known])
        low, high = box_intervals(z[known], found.minimum[known], root, dof)[0][at]
        ends = (model(low), model(high))
    size = effects.spread * abs(float(space.jacobian(z)[j]))
    values = {name: model(z[j] + step) for name, step in between.steps.items()}
    return Spread(values, effects.q, len(values) - 1, effects.chance, size, ends, between.weights, between.kind)


def _dof(between: Between, found: Estimator) -> float:
    """Degrees of freedom of the variance of a further experiment's own value (Satterthwaite): the variance of the mean,
    and that between the experiments, which is in both and has one less than there are experiments.
    """
    j, further = between.column, between.effects.spread**2
    mean = sum(float(part[j]) for part in found.variances.values())
    between_them = float(found.variances.get(between.kind, np.zeros(j + 1))[j])
    scatter = ((between_them + further) ** 2 - between_them**2) / between.effects.dof
    scatter += mean**2 / float(found.dof[j])
    return (mean + further) ** 2 / scatter if scatter > 0 else np.inf
