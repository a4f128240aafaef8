"""The scatter of the minimum without one group of measurements at a time: actuators, weights, markers, experiments.

The noise of single samples says nothing of errors that all samples of an actuator, or all positions of a marker, have
in common. The values without each group, d_g away from the joint ones, say it (the jackknife of clusters: Efron 1982;
CR3 of Bell and McCaffrey, Survey Methodology 28, 2002):

    covariance = (k - 1) / k sum d_g d_g^T

Its degrees of freedom for each parameter are those of Bell and McCaffrey: of what white noise would do to the same sum.
With alike groups they are k - 1, and fewer where few groups determine the parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.calibration.statistics.budget import Budget
from softcal.calibration.statistics.correlation import ErrorRecord
from softcal.calibration.statistics.estimator import Estimator
from softcal.calibration.statistics.noise import Source
from softcal.calibration.statistics.reweighted import Reweighted
from softcal.checks import Floats

GROUPS = "groups"
"""The source of error that the scatter among the groups shows."""
UNLIKELY = 0.05
"""Chance below which two estimated scatters differ."""

_SHOWN = ("noise", "experiments", "set-ups", "markers")  # sources of error of the quick intervals that groups may show


@dataclass(frozen=True)
class DeleteOne:
    """Values without each group, in the unit box.

    Attributes
    ----------
    steps
        The minimum without each group less the joint one, shape (k, size).
    dof
        Of each parameter's variance by the groups, shape (size,).
    determined
        Whether each parameter can be found without any of the groups, shape (size,).
    budget
        The scatter among the groups, with the errors that no group shows.
    excess
        What the covariance by the groups is in the mean over that of the minimum, under white noise, for each
        parameter (size,): one or more, where leaving a group out makes the minimum less certain.
    """

    steps: Floats
    dof: Floats
    determined: np.ndarray
    budget: Budget
    excess: Floats

    @property
    def total_dof(self) -> Floats:
        """Of each parameter's variance with the errors that no group shows, which are known, shape (size,)."""
        variances = self.budget.variances
        total = np.sum(list(variances.values()), axis=0)
        shares = np.divide(variances[GROUPS], total, out=np.zeros_like(total), where=total > 0.0)
        return np.where(shares > 1e-9, self.dof / np.maximum(shares, 1e-9) ** 2, np.inf)

    def root(self, found: Estimator) -> Floats:
        """`root.T @ root` is a covariance with the variances by the groups and the estimator's correlations: few groups
        tell the scatter of each parameter, not that of as many parameters together.
        """
        scale = np.linalg.norm(self.budget.root, axis=0) / np.linalg.norm(found.root, axis=0)
        return found.root * np.where(self.determined, scale, 1.0)

    def ratios(self, found: Estimator) -> Floats:
        """The variance (size,) by the groups over that of the estimator by the same errors: one in the mean if both
        are right.
        """
        quick = np.sum([found.variances[kind] for kind in _SHOWN if kind in found.variances], axis=0)
        return self.budget.variances[GROUPS] / self.excess / quick

    def chances(self, found: Estimator) -> Floats:
        """The probability (size,) that two estimates of one variance differ as much, times the number of parameters."""
        from scipy.special import fdtr, fdtrc

        dof = [np.minimum(one, 1e9) for one in (self.dof, found.dof)]
        tail = np.minimum(*(cumulated(*dof, self.ratios(found)) for cumulated in (fdtr, fdtrc)))
        return np.minimum(2 * tail * max(int(self.determined.sum()), 1), 1.0)


def delete_one(groups: Reweighted) -> DeleteOne:
    """Leave out each of the groups."""
    inverses, determined = groups.without
    steps = groups.minima(1.0 - np.eye(len(groups.names))) - groups.minimum
    shares = groups.hessians[:-1] @ groups.inverse
    total = groups.noises.sum(axis=0)
    # Covariance of the pulls of two groups that are left at the minimum, (k, k, size, size).
    scatter = np.einsum("gij,jk,hlk->ghil", shares, total, shares, optimize=True)
    scatter -= np.einsum("gij,hlj->ghil", groups.noises, shares) + np.einsum("gij,hjl->ghil", shares, groups.noises)
    scatter[np.arange(len(steps)), np.arange(len(steps))] += groups.noises
    of_steps = np.einsum("gji,ghil,hjl->jgh", inverses, scatter, inverses, optimize=True)
    trace, squares = np.einsum("jgg->j", of_steps), np.einsum("jgh,jhg->j", of_steps, of_steps)
    dof = np.where(squares > 0.0, trace**2 / np.where(squares > 0.0, squares, 1.0), 1.0)
    k = len(steps)
    of_minimum = np.einsum("ji,ik,jk->j", groups.inverse, total, groups.inverse)
    excess = np.where(of_minimum > 0.0, (k - 1) / k * trace / np.where(of_minimum > 0.0, of_minimum, 1.0), 1.0)
    scattered = Source(GROUPS, "", (ErrorRecord(np.zeros(k), np.zeros_like(steps), steps),), 1.0, np.inf)
    responses = [[np.sqrt((k - 1) / k) * steps], *groups.responses]
    budget = Budget((scattered, *groups.known), responses, steps.shape[1])
    return DeleteOne(steps, dof, determined.all(axis=0) & ~groups.own, budget, excess)
