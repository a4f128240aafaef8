"""Statistics from the jacobian at the optimum: standard errors, intervals, and the parameters that the data identify.

The covariance is the loss's own (`estimator.py`), with noise that is correlated along the records and
differences between the experiments where the residuals show them. The intervals stay within the bounds of the search
(`intervals.py`).
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.problem.experiment import rig_kind
from softcal.calibration.problem.loss import Block, Loss, fitted_exactly, rms
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.uncertain import MESH_ERROR, UncertainParameter
from softcal.calibration.statistics.band import bands, further_variance, repeat_bands
from softcal.calibration.statistics.between_experiments import Between
from softcal.calibration.statistics.between_markers import MARKERS, n_markers, with_markers
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.calibration.statistics.estimator import (
    Estimator,
    curving,
    estimator,
    linearised,
    unseen_parameters,
    weighed,
)
from softcal.calibration.statistics.intervals import box_intervals
from softcal.calibration.statistics.left_out import LeftOut, left_out
from softcal.calibration.statistics.noise import DRIFT, MISFIT, PRIOR
from softcal.calibration.statistics.random_effects import WORDS, Spread
from softcal.calibration.statistics.residuals import residual_record
from softcal.checks import Floats
from softcal.sensing.channel import channel_name
from softcal.units import format_quantity, plain

# Residuals this many times larger than the noise of the records are reported in a note.
_TOO_LARGE = 1.5
# And residuals this many times smaller, where chance makes them so with a probability below this.
_TOO_SMALL, _BY_CHANCE = 3.0, 1e-3
_TOGETHER = 0.5
"""Two parameters whose standard error falls below this share of itself when the other is known move together."""
INCLUDED = "The intervals include"
INSEPARABLE, NO_EFFECT = "The data cannot separate", "The data do not depend on"
NOT_INCLUDED = (
    INCLUDED + " the noise and its correlation along the records{}. Not included: errors {}of the material law and of "
    "the {}model of the rig that are the same in all tests and leave no residual."
)
MARKERS_DIFFER = (
    "The {} markers differ by more than the noise explains: the intervals are those found with one marker left out at "
    "a time, where these are longer."
)
_FITTED_EXACTLY = "The twin fits {} exactly, so that no noise is known: no standard errors and no intervals."
ONE_EXPERIMENT = "There is one test: by how much tests on this robot differ is not known, nor included."


@dataclass(frozen=True)
class Statistics:
    """Statistics of the parameters at the calibrated values.

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
    shares
        Label -> source of error -> its share of the estimate's variance [-], sum 1.
    spreads
        Label of a shared parameter -> its comparison between the experiments.
    left_out
        Experiment -> how well the others predict it, of three or more.
    bands
        Experiment -> compared channel -> half the width (n,) [SI] of the 95 % band of a further experiment.
    repeats
        The same of a further sample of the same experiment.
    minimum
        Label -> where the minimum is, by the derivatives, within the bounds [SI].
    dof
        Label -> degrees of freedom of the variance [-], where these are finite.
    moved_by
        Label of a parameter of the robot -> errors of instruments that move it by half its interval; see `Estimate`.
    off_prior
        Label of a parameter with a prior -> distance from the prior's mean, in standard errors [-].
    is_exact
        Whether a channel is fitted exactly, so that there are no intervals.
    """

    standard_errors: Mapping[str, float | None]
    importance: Mapping[str, float]
    notes: tuple[Remark, ...]
    intervals: Mapping[str, tuple[float, float] | None] = field(default_factory=dict[str, tuple[float, float] | None])
    beyond: Mapping[str, float] = field(default_factory=dict[str, float])
    shares: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])
    spreads: Mapping[str, Spread] = field(default_factory=dict[str, Spread])
    left_out: Mapping[str, LeftOut] = field(default_factory=dict[str, LeftOut])
    bands: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict[str, Mapping[str, Floats]])
    repeats: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict[str, Mapping[str, Floats]])
    minimum: Mapping[str, float] = field(default_factory=dict[str, float])
    dof: Mapping[str, float] = field(default_factory=dict[str, float])
    moved_by: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])
    off_prior: Mapping[str, float] = field(default_factory=dict[str, float])
    is_exact: bool = False

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
                self.shares.get(p.label, {}),
                self.dof.get(p.label),
                moved_by=self.moved_by.get(p.label, {}),
                off_prior=self.off_prior.get(p.label),
            )
            for p in space.parameters
        }


def local_estimator(
    space: SearchSpace, loss: Loss, z: Floats, blocks: Sequence[Block], uncertain: Sequence[UncertainParameter] = ()
) -> Estimator:
    """The minimum near a point as an estimator, with its experiments and its markers compared; see `estimator` and
    `with_markers`.

    Parameters
    ----------
    space
        The search space.
    loss, z, blocks, uncertain
        See `estimator`.
    """
    serves = space.serving(dict.fromkeys(block.experiment for block in blocks if block.experiment))
    slopes = space.jacobian(z)
    found = estimator(loss, z, slopes, blocks, serves, uncertain)
    return with_markers(loss, z, slopes, blocks, found, uncertain)


def local_statistics(
    space: SearchSpace,
    loss: Loss,
    theta: Mapping[str, float],
    blocks: Sequence[Block],
    uncertain: Sequence[UncertainParameter] = (),
    found: Estimator | None = None,
) -> Statistics:
    """Standard errors, intervals and importances.

    A parameter at a bound has an interval, but no standard error; with as many parameters as measurements, none has
    either. The importance of a parameter is its share of the squared change of all channels, over each channel's
    misfit, per range of the parameter: a local measure, unlike fANOVA.

    Parameters
    ----------
    space, theta
        The search space, and the minimum [SI by label].
    loss, blocks, uncertain
        See `estimator`.
    found
        The estimator there, where it is known already.
    """
    z = np.clip(space.to_search(theta), 0.0, 1.0)
    slopes = space.jacobian(z)
    serves = space.serving(dict.fromkeys(block.experiment for block in blocks if block.experiment))
    found = local_estimator(space, loss, z, blocks, uncertain) if found is None else found
    felt = np.zeros(space.size)
    for block in blocks:
        if block.jacobian is not None:
            missed = loss.stated_noise(block)
            if missed is None:
                missed = np.full(len(block.residual), max(rms(block.residual), 1e-12 * rms(block.measured) + 1e-300))
            felt += np.sum((block.jacobian * slopes / missed[:, None]) ** 2, axis=0)
    importance = dict(zip(space.labels, (felt / felt.sum()).tolist(), strict=True)) if felt.sum() > 0 else {}
    errors: dict[str, float | None] = dict.fromkeys(space.labels)
    intervals: dict[str, tuple[float, float] | None] = dict.fromkeys(space.labels)
    mixed = unseen_parameters(found.unseen)
    saturated = sum(len(block.residual) for block in blocks) <= space.size  # a prior is a measurement
    notes = list(_notes(space, found, mixed, saturated=saturated))
    exact = [f"{one.channel} of {one.experiment}" for one in fitted_exactly(loss, blocks)]
    if exact:
        notes.append(
            Remark(_FITTED_EXACTLY.format(" and ".join(exact[:2]) + f" and {len(exact) - 2} more" * (len(exact) > 2)))
        )
    if found.spent or mixed.all() or saturated or exact:
        return Statistics(errors, importance, tuple(notes), intervals, is_exact=bool(exact))
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
    beyond = {space.labels[j]: float(found.beyond[j]) for j in known if at_bound[space.labels[j]]}
    within = {space.labels[j]: float(error * abs(slopes[j])) for j, error in zip(known, stated, strict=True)}
    notes += [*overstated(loss, blocks, space.size), *_together(space, within, found, slopes)]
    if MARKERS in found.variances:
        notes.append(Remark(MARKERS_DIFFER.format(n_markers(blocks)), "warning"))
    notes += [
        Remark(not_included(uncertain, found.variances)),
        *([Remark(ONE_EXPERIMENT)] if len(serves) == 1 else []),
    ]
    summed = np.sum(list(found.variances.values()), axis=0)
    shares = {
        space.labels[j]: {kind: float(part[j] / summed[j]) for kind, part in found.variances.items() if part[j] > 0.0}
        for j in known
        if summed[j] > 0.0
    }
    spreads = {space.labels[one.column]: spread(space, z, one, found, known) for one in found.between}
    predicted = left_out(loss, z, slopes, blocks, serves, found)
    minimum = space.to_model(np.clip(found.minimum, 0.0, 1.0))
    widths, repeats = (one(loss, slopes, blocks, found) for one in (bands, repeat_bands))
    dof = {space.labels[j]: float(found.dof[j]) for j in known if np.isfinite(found.dof[j])}
    free = np.array([not at_bound[label] for label in space.labels])
    moved = moving_errors(loss, np.where(free, slopes, 0.0), blocks, (upper - lower) / 2)
    moved_by = {space.labels[j]: moved[j] for j in known if rig_kind(space.parameters[j].targets[0]) is None}
    return Statistics(
        errors,
        importance,
        tuple(notes),
        intervals,
        beyond,
        shares,
        spreads,
        predicted,
        widths,
        repeats,
        minimum,
        dof,
        moved_by,
        {space.labels[j]: float(found.off_prior[j]) for j in known if space.parameters[j].prior_mean is not None},
    )


def moving_errors(loss: Loss, slopes: Floats, blocks: Sequence[Block], half: Floats) -> list[dict[str, float]]:
    """For each parameter: name of a systematic error on which nothing is stated -> its size [SI] that moves the
    estimate by half its interval; for each instrument the error that is smallest over its largest reading.

    An error moves the minimum by -A^-1 J^T W c for the change c of the residuals, as an uncertain parameter does
    (`problem/uncertain.py`). A parameter at a bound stays there.

    Parameters
    ----------
    loss, blocks
        The loss, and its blocks with jacobians.
    slopes
        d theta / d z (size,), zero of parameters that stay where they are.
    half
        Half the intervals (size,) in the unit box.
    """
    seen = [weighed(loss, one) for one in blocks]
    parts, inverse, _ = linearised(loss, seen, slopes)
    pulls: dict[str, Floats] = {}
    reads: dict[str, float] = {}
    for one, part in zip(seen, parts, strict=True):
        unit = np.ones(len(one.weights)) if one.stated is None else one.stated
        for name, (shape, scale) in one.block.unstated.items():
            changed = curving(loss, one.block, one.weights, shape[:, None])[:, 0]
            pulls[name] = pulls.get(name, 0.0) + (changed / unit) @ part.pull
            reads[name] = max(reads.get(name, 0.0), scale)
    moved = {name: np.abs(pull @ inverse) for name, pull in pulls.items()}
    smallest: list[dict[str, float]] = []
    for j in range(len(slopes)):
        found: dict[str, tuple[float, str, float]] = {}
        for name, shift in moved.items():
            if shift[j] * reads[name] <= half[j]:
                continue  # not even an error as large as what is read
            size = float(half[j]) / float(shift[j])
            best, instrument = (size / reads[name], name, size), name.rpartition("_")[0] or name
            found[instrument] = min(found.get(instrument, best), best)
        smallest.append({name: size for _, name, size in sorted(found.values())})
    return smallest


def overstated(loss: Loss, blocks: Sequence[Block], n_parameters: int) -> list[Remark]:
    """A note for each group of channels whose residuals prove that the stated noise is too large.

    The sum of their squares has a chi-square distribution, here with one degree of freedom for each residual that is
    independent of its neighbours, without those of all parameters; Bonferroni's correction counts the groups.

    Parameters
    ----------
    loss, blocks
        The loss, and its blocks.
    n_parameters
        Number of fitted parameters.
    """
    from scipy.special import chdtr

    groups: dict[str, list[tuple[Floats, Floats]]] = {}
    units: dict[str, str] = {}
    for block in blocks:
        noise = loss.stated_noise(block)
        if block.experiment and noise is not None:
            groups.setdefault(group := loss.noise_group(block), []).append((block.residual / noise, noise))
            units[group] = channel_name(block.channel).kind.unit
    notes: list[Remark] = []
    for group, own in groups.items():
        over, stated = (np.concatenate(each) for each in zip(*own, strict=True))
        records = [residual_record(one) for one, _ in own]
        worth = sum(1.0 if one is None else one.effective for one in records) - n_parameters
        size = float(np.sqrt(over @ over / max(len(over) - n_parameters, 1)))
        if worth > 0.0 and size < 1.0 / _TOO_SMALL and len(groups) * chdtr(worth, worth * size**2) < _BY_CHANCE:
            varies = " on average" if np.ptp(stated) > 0.0 else ""
            seen, said = (format_quantity(one * rms(stated), units[group], digits=2) for one in (size, 1.0))
            text = (
                f"The residuals of {group} show a noise of {seen}, far below the stated {said}{varies}: independent "
                f"noise of that size would leave such residuals with a probability below {_BY_CHANCE}. "
                "The intervals use the stated noise."
            )
            notes.append(Remark(text))
    return notes


def not_included(uncertain: Sequence[UncertainParameter], kinds: Container[str] = ()) -> str:
    """Sentence on the sources of error that the intervals include, and on the others; kinds: kinds of the sources."""
    named = list(dict.fromkeys(p.source for p in uncertain if p != MESH_ERROR and p.source != MISFIT))
    has_mesh = MESH_ERROR in uncertain
    further = {
        "drifts too small to be seen in the noise": DRIFT in kinds,
        "what the model misses in the residuals, or may miss": MISFIT in kinds,
        "the error of the mesh": has_mesh,
    }
    listed = [
        *(words for words, counts in further.items() if counts),
        *(f"the uncertainty of {name}" for name in named),
    ]
    included = f", {', '.join(listed[:-1])}{', ' * (len(listed) > 1)}and {listed[-1]}" if listed else ""
    return NOT_INCLUDED.format(included, "" if has_mesh else "of the mesh, ", "rest of the " if named else "")


def _together(space: SearchSpace, errors: Mapping[str, float], found: Estimator, slopes: Floats) -> Iterable[Remark]:
    """The pair in which one parameter's standard error falls most if the other is known, if it falls to half or less.

    errors: label -> standard error within the bounds [SI], of the parameters that have one.
    """
    covariance = found.root.T @ found.root
    shared = [j for j, p in enumerate(space.parameters) if p.label in errors and not p.experiment]
    of_robot = {j for j in shared if all(rig_kind(target) is None for target in space.parameters[j].targets)}
    pairs: list[tuple[float, int, int]] = []
    for one, other in itertools.combinations(sorted(shared, key=lambda j: j not in of_robot), 2):
        if one in of_robot and covariance[other, other] > 0.0:
            left = max(covariance[one, one] - covariance[one, other] ** 2 / covariance[other, other], 0.0)
            pairs.append((float(np.sqrt(left) * abs(slopes[one])) / errors[space.labels[one]], one, other))
    share, j, k = min(pairs, default=(1.0, 0, 0))
    if share >= _TOGETHER:
        return
    one, other = space.labels[j], space.labels[k]
    yield Remark(
        f"{one} and {other} move together: if {other} were known, the error of {one} would be "
        f"{plain(100 * share, 2)} % of what it is."
    )


def _notes(space: SearchSpace, found: Estimator, mixed: np.ndarray, *, saturated: bool) -> Sequence[Remark]:
    notes: list[Remark] = []
    has_errors = not (found.spent or mixed.all() or saturated)
    if mixed.any():
        *others, last = (label for label, is_mixed in zip(space.labels, mixed, strict=True) if is_mixed)
        text = f"{NO_EFFECT} {last}: its value is arbitrary and no standard error is given."
        if others:
            text = f"{INSEPARABLE} {', '.join(others)} and {last}: only a combination of them is determined."
            text += " Fix one of them, or state a prior of one."
        notes.append(Remark(text))
    differing = next((one.kind for one in found.between if one.effects.differs), None)
    for group, noise in found.noise.items():
        if noise.stated and noise.size > _TOO_LARGE:
            priors = PRIOR in found.noise
            # Differences of that kind are an error of their own, not in the factor.
            lead = f"Apart from the differences between the {WORDS[differing]}, the" if differing else "The"
            small = "that noise is stated too small"
            small = f"{small}, or a prior is wrong" if priors else f"or {small}"
            text = (
                f"{lead} residuals of {group} are {plain(noise.size, 2)} times the noise of the records: the model of "
                f"the robot or of the rig is incomplete, {small}."
            )
            if has_errors:
                share = ", except for the share of the priors" * priors
                text += f" The standard errors are increased accordingly{share}."
            notes.append(Remark(text, "warning"))
    if found.spent and not saturated:
        text = f"There are at least as many parameters as measurements of {' and of '.join(found.spent)}"
        notes.append(Remark(f"{text}: neither the noise nor standard errors can be estimated."))
    return notes


def spread(space: SearchSpace, z: Floats, between: Between, found: Estimator, known: np.ndarray) -> Spread:
    """The comparison of experiments, in SI.

    Parameters
    ----------
    space, z
        The search space, and the joint minimum (size,) in the unit box.
    between, found
        The comparison in the unit box, and the estimator that it is of.
    known
        Numbers of the parameters that have an interval.
    """
    j, effects = between.column, between.effects
    parameter = space.parameters[j]
    ends = None
    if between.has_interval and j in known:
        at = int(np.flatnonzero(known == j)[0])
        # A further experiment differs from the mean by as much as those that were made.
        further = np.zeros((1, len(known)))
        further[0, at] = effects.spread
        root = np.concatenate([found.root[:, known], further])
        mean = np.array([sum(float(part[j]) for part in found.variances.values())])
        own, scatter = further_variance(between, found, np.ones(1), mean)
        of_own = (mean + own) ** 2 / scatter if scatter > 0 else np.inf
        dof = np.where(np.arange(len(known)) == at, of_own, found.dof[known])
        low, high = box_intervals(z[known], found.minimum[known], root, dof)[0][at]
        ends = (parameter.value_at(float(low)), parameter.value_at(float(high)))
    size = effects.spread * abs(float(space.jacobian(z)[j]))
    values = {name: parameter.value_at(float(z[j] + step)) for name, step in between.steps.items()}
    return Spread(values, effects.q, len(values) - 1, effects.chance, size, ends, between.weights, between.kind)
