"""Statistics from the jacobian at the optimum: standard errors, intervals, and the parameters that the data identify.

The covariance is the loss's own (`softcal.calibration.estimator`), the intervals stay within the bounds of the search
(`softcal.calibration.intervals`). Both hold for noise that is independent from sample to sample. Neighbouring samples
of one test share most of their error (friction, hysteresis, the mesh), so on real benches these are lower limits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.estimator import PRIOR, Estimator, estimator
from softcal.calibration.intervals import beyond_bounds, box_intervals
from softcal.calibration.loss import Block, Loss, rms
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.result import Estimate, Note
from softcal.checks import Floats
from softcal.units import plain

# A parameter with a larger share of an unidentifiable direction cannot be distinguished from the others in it.
_MIXED = 0.01
# Residuals this many times larger than the stated noise are reported in a note.
_TOO_LARGE = 1.5
NOISE_ALONE = (
    "The standard errors include independent noise only. The errors of the mesh, the material law and the model of the "
    "rig are not included, and are usually larger."
)


@dataclass(frozen=True)
class Statistics:
    """What is known of the parameters at the values found.

    Attributes
    ----------
    standard_errors
        Label -> standard error [SI], or None where it is not defined.
    importance
        Label -> share [-], sum 1.
    notes
        Remarks on how far they can be trusted.
    intervals
        Label -> ends of the 95 % interval [SI], or None.
    beyond
        Label of a parameter at a bound -> its distance from the best value without the bound, in standard errors [-].
    """

    standard_errors: Mapping[str, float | None]
    importance: Mapping[str, float]
    notes: tuple[Note, ...]
    intervals: Mapping[str, tuple[float, float] | None] = field(default_factory=dict[str, tuple[float, float] | None])
    beyond: Mapping[str, float] = field(default_factory=dict[str, float])

    def estimates(self, space: SearchSpace, theta: Mapping[str, float]) -> dict[str, Estimate]:
        """The values theta [SI by label] with the statistics of each."""
        at_bound = space.at_bound(theta)
        return {
            p.label: Estimate(
                theta[p.label],
                p.unit,
                at_bound[p.label],
                p.lower,
                p.upper,
                self.standard_errors.get(p.label),
                self.intervals.get(p.label),
                p.of,
                self.beyond.get(p.label),
                p.scale,
            )
            for p in space.parameters
        }


def local_statistics(space: SearchSpace, loss: Loss, theta: Mapping[str, float], blocks: Sequence[Block]) -> Statistics:
    """Standard errors, intervals and importances at theta [SI by label]; the blocks must have jacobians.

    A parameter at a bound has an interval, but no standard error; with as many parameters as measurements, none has
    either. The importance of a parameter is its share of the squared change of all channels, over each channel's
    misfit, per range of the parameter: a local measure, unlike fANOVA.
    """
    z = np.clip(space.to_search(theta), 0.0, 1.0)
    slopes = space.jacobian(z)
    found = estimator(loss, z, slopes, blocks)
    importance = _importance(space, loss, blocks, slopes)
    errors: dict[str, float | None] = dict.fromkeys(space.labels)
    intervals: dict[str, tuple[float, float] | None] = dict.fromkeys(space.labels)
    mixed = np.abs(found.unseen).max(axis=0, initial=0.0) > _MIXED
    saturated = sum(len(block.residual) for block in blocks) <= space.size  # a prior is a measurement
    notes = list(_notes(space, found, mixed, saturated=saturated))
    if found.spent or mixed.all() or saturated:
        return Statistics(errors, importance, tuple(notes), intervals)
    known = np.flatnonzero(~mixed)
    ends, stated = box_intervals(z[known], found.minimum[known], found.root[:, known], found.dof[known])
    at_bound = space.at_bound(theta)
    lower, upper = z.copy(), z.copy()
    lower[known], upper[known] = ends.T
    low, high = space.to_model(lower), space.to_model(upper)
    for j, error in zip(known, stated, strict=True):
        label = space.labels[j]
        intervals[label] = (min(low[label], theta[label]), max(high[label], theta[label]))
        errors[label] = None if at_bound[label] else float(error * abs(slopes[j]))
    held = beyond_bounds(found.minimum[known], found.root[:, known])
    labels = [space.labels[j] for j in known]
    beyond = {label: float(far) for label, far in zip(labels, held, strict=True) if at_bound[label]}
    return Statistics(errors, importance, (*notes, Note(NOISE_ALONE)), intervals, beyond)


def _importance(space: SearchSpace, loss: Loss, blocks: Sequence[Block], slopes: Floats) -> dict[str, float]:
    felt = np.zeros(space.size)
    for block in blocks:
        if block.jacobian is not None:
            missed = loss.stated_noise(block)
            if missed is None:
                missed = np.full(len(block.residual), max(rms(block.residual), 1e-12 * rms(block.measured) + 1e-300))
            felt += np.sum((block.jacobian * slopes / missed[:, None]) ** 2, axis=0)
    return dict(zip(space.labels, (felt / felt.sum()).tolist(), strict=True)) if felt.sum() > 0 else {}


def _notes(space: SearchSpace, found: Estimator, mixed: np.ndarray, *, saturated: bool) -> Sequence[Note]:
    notes: list[Note] = []
    has_errors = not (found.spent or mixed.all() or saturated)
    if mixed.any():
        notes.append(Note(_blind_note([p for p, is_mixed in zip(space.labels, mixed, strict=True) if is_mixed])))
    for group, noise in found.noise.items():
        if noise.stated and noise.size > _TOO_LARGE:
            text = _excess_note(group, noise.size, widened=has_errors, priors=PRIOR in found.noise)
            notes.append(Note(text, "warning"))
    if found.spent and not saturated:
        notes.append(Note(_spent_note(found.spent)))
    return notes


def _excess_note(channel: str, factor: float, *, widened: bool, priors: bool) -> str:
    text = (
        f"The residuals of {channel} are {plain(factor, 2)} times the stated noise: the model of the robot or of the "
        "rig is incomplete, or the stated noise is too small."
    )
    if not widened:
        return text
    return f"{text} The standard errors are increased accordingly{', except for the share of the priors' * priors}."


def _spent_note(groups: Sequence[str]) -> str:
    return (
        f"There are as many parameters as measurements of {' and of '.join(groups)}: neither the noise nor standard "
        "errors can be estimated."
    )


def _blind_note(mixed: Sequence[str]) -> str:
    if len(mixed) == 1:
        return f"The data do not depend on {mixed[0]}: its value is arbitrary and no standard error is given."
    named = f"{', '.join(mixed[:-1])} and {mixed[-1]}"
    return f"The data cannot separate {named}: only a combination of them is determined. Fix one of them."
