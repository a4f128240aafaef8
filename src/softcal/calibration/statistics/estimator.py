"""The minimum of a loss as an estimator: its covariance under noise, for any loss (an M-estimator).

Near the minimum the residuals are linear in z, the point of the unit box: r = e + J (z - truth). The loss's own weights
W and Hessian A then give

    z - truth = -A^-1 sum J^T W e,    covariance = A^-1 (sum J^T W Var(e) W J) A^-1

(the sandwich: Huber 1967, White 1980). For a likelihood with the right noise it is the inverse of A; for a sum of
RMSEs, whose weights are not one over the variances, it is not. A includes the curvature of the root in each RMSE.

The errors e come from independent sources (`noise.py`): the noise of each group of channels, white or correlated along
the records; the priors and the uncertain parameters, which misfit does not widen; and, where the experiments of a joint
fit differ by more than their noise explains, the difference of each experiment from their mean. The interval of such a
parameter is that of the mean over the experiments as random effects give it, and no longer that of the loss's own
weights.

An instrument may drift by what its own noise conceals (`noise.drift_sources`), unless something is stated on it: a free
or uncertain parameter, or a setting. The residuals do not show such a drift, since the parameters follow most of it.
These drifts make no standard error longer than by half.

What the model misses is an error too: in each channel whose residuals may be more than noise one of the usual causes
(`misfit.py`), as large as it is in the residuals or less, moves the minimum by what the parameters follow of it. The
causes count with their probabilities, in part from 3.5 standard errors of the clearest shape and in whole from 4.5:
what is too small to be said beyond chance still moves the estimate by more than its noise.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.between_experiments import (
    Apart,
    Between,
    between_experiments,
    serves_by_set_up,
    set_up_members,
    set_ups_of,
    white_noise_within,
)
from softcal.calibration.statistics.budget import Budget
from softcal.calibration.statistics.correlation import ErrorRecord, triangle
from softcal.calibration.statistics.intervals import beyond_bounds, contradiction, prior_distances
from softcal.calibration.statistics.misfit import COUNTS, misfits
from softcal.calibration.statistics.noise import (
    DRIFT,
    PRIOR,
    Noise,
    ScaledBlock,
    Source,
    by_experiment,
    drift_sources,
    misfit_sources,
    sources,
    systematic_sources,
    white_noise,
)
from softcal.checks import Floats

# Singular value over the largest, in units of the search range, below which a direction counts as unidentifiable.
_BLIND = 1e-7
_LONGER = 1.5  # times as long as without is the most that drifts without a statement make an interval
_CHANNELS = 2  # of an experiment, for which that holds
_MIXED = 0.01  # share of an unidentifiable direction from which a parameter cannot be distinguished from others in it


@dataclass(frozen=True)
class Estimator:
    """Linear response of the minimum to noise, in the unit box.

    Attributes
    ----------
    root
        `root.T @ root` is the covariance of z, shape (size, size); zero in unidentifiable directions.
    minimum
        Minimum of the unbounded quadratic model, shape (size,).
    unseen
        Unidentifiable directions, to which no residual is sensitive, rows.
    beyond
        Distance of the best fit from each parameter's active bounds, in standard errors, shape (size,).
    off_prior
        Distance of each parameter from the mean of its prior, in standard errors, shape (size,).
    dof
        Of each parameter's variance (Satterthwaite), shape (size,), infinite where all noise is known.
    noise
        Noise by group of channels.
    spent
        Groups whose noise cannot be estimated, since the parameters fit them exactly whatever it is.
    between
        How the experiments differ in the parameters that they share.
    variances
        Kind of source ("noise", "drift", "misfit", "prior", "experiments", "set-ups", an uncertain parameter, "bounds")
        -> its part of each variance, shape (size,); see `Budget`.
    sources
        The errors of the measurements and priors, with drifts that nothing is stated on.
    within_bounds
        Covariance (size, size) where every parameter lies within its bounds.
    by_noise
        The same by the noise and the priors alone.
    set_ups
        Experiment -> its set-up, where it is set-ups that are compared; else empty.
    missed
        The changes (n, k) of each block's residual by what the model may miss; None where it is noise (`missed`).
    """

    root: Floats
    minimum: Floats
    unseen: Floats
    beyond: Floats
    off_prior: Floats
    dof: Floats
    noise: Mapping[str, Noise]
    spent: tuple[str, ...]
    between: tuple[Between, ...]
    variances: Mapping[str, Floats]
    sources: tuple[Source, ...]
    within_bounds: Floats
    by_noise: Floats
    set_ups: Mapping[str, str]
    missed: tuple[Floats | None, ...]

    @property
    def contradiction(self) -> float:
        """By how much model and bounds, or a prior, contradict the data (`intervals.py`), at least one: the factor
        on all errors that is in `root`, `variances`, `dof` and `within_bounds`.
        """
        return contradiction(self.beyond, self.off_prior)


@dataclass(frozen=True)
class Weighed:
    """A block as the loss sees it: weights (n,) of its squares, and the noise (n,) that is stated, None without."""

    block: Block
    weights: Floats
    stated: Floats | None


def weighed(loss: Loss, block: Block) -> Weighed:
    """A block as the loss sees it at the block's residual."""
    return Weighed(block, loss.square_weights(block, block.residual), loss.stated_noise(block))


def estimator(
    loss: Loss,
    z: Floats,
    slopes: Floats,
    blocks: Sequence[Block],
    serves: Mapping[str, np.ndarray] | None = None,
    uncertain: Sequence[UncertainParameter] = (),
) -> Estimator:
    """Linearise the minimum near a point.

    Parameters
    ----------
    loss, blocks
        The loss, and its blocks with jacobians.
    z, slopes
        The point (size,) in the unit box, and d theta / d z (size,).
    serves
        Experiment -> whether each parameter (size,) has an effect on it; None where experiments are not compared.
    uncertain
        The parameters of the blocks' `systematic`.
    """
    return Estimators(loss, z, slopes, blocks, uncertain).of(range(len(blocks)), serves).estimator


@dataclass(frozen=True)
class Minimum:
    """The fields of an `Estimator`, with its budget in two parts: that without the factor of a contradiction,
    and that of what the model misses, which this factor does not multiply.
    """

    minimum: Floats
    unseen: Floats
    beyond: Floats
    off_prior: Floats
    noise: Mapping[str, Noise]
    spent: tuple[str, ...]
    between: tuple[Between, ...]
    sources: tuple[Source, ...]
    set_ups: Mapping[str, str]
    without_contradiction: Budget
    misfits: Budget
    missed: tuple[Floats | None, ...]

    @cached_property
    def budget(self) -> Budget:
        """The budget of all errors, those but the misfits multiplied by the `contradiction`."""
        factor = contradiction(self.beyond, self.off_prior)
        own = self.without_contradiction.times(factor) if factor > 1.0 else self.without_contradiction
        return own.joined(self.misfits)

    @property
    def estimator(self) -> Estimator:
        return Estimator(
            self.budget.root,
            self.minimum,
            self.unseen,
            self.beyond,
            self.off_prior,
            self.budget.dof,
            self.noise,
            self.spent,
            self.between,
            self.budget.variances,
            self.sources,
            self.budget.within_bounds,
            self.without_contradiction.part("noise", "prior").within_bounds,
            self.set_ups,
            self.missed,
        )


class Estimators:
    """The estimators of some of the blocks near one minimum. What is of a block or of an experiment by itself is
    computed once, not again beside each choice of others.
    """

    def __init__(
        self,
        loss: Loss,
        z: Floats,
        slopes: Floats,
        blocks: Sequence[Block],
        uncertain: Sequence[UncertainParameter] = (),
    ) -> None:
        self._loss, self._z, self._uncertain = loss, z, uncertain
        self._blocks = [
            _linear(loss, weighed(loss, one), slopes, len(uncertain), change)
            for one, change in zip(blocks, missed(blocks), strict=True)
        ]
        self._apart = Apart()
        self._named = cache(_named)

    def of(self, chosen: Iterable[int], serves: Mapping[str, np.ndarray] | None = None) -> Minimum:
        """chosen: places of the blocks; the other arguments, and what is made of them, as for `estimator`."""
        blocks = [self._blocks[k] for k in chosen]
        parts = [one.part for one in blocks]
        inverse, unseen = _inverse_hessian(self._loss, blocks)
        noise, spent = white_noise(parts, inverse)
        compared: tuple[Between, ...] = ()
        set_ups: dict[str, str] = {}
        if serves and len(serves) > 1 and not spent:
            compared = between_experiments(parts, serves, self._z, self._uncertain, apart=self._apart)
            if of := set_ups_of(one.seen.block for one in blocks):
                joined = [self._named(part, of.get(part.experiment, part.experiment)) for part in parts]
                by_set_up = between_experiments(
                    joined, serves_by_set_up(serves, of), self._z, self._uncertain, set_up_members(of), self._apart
                )
                if any(one.effects.differs for one in by_set_up):
                    parts, compared, set_ups = joined, by_set_up, of
        differing = [one for one in compared if one.effects.differs]
        if differing:
            noise, spent = white_noise_within(parts, differing)
        linear = Linear(parts, inverse, [one for one in differing if one.has_interval])
        minimum = self._z + linear.step(-inverse @ sum(part.pulled for part in parts))
        held = tuple(sources(parts, noise))
        errs = {k: (p.source, p.label) for k, p in enumerate(self._uncertain)}
        budget = linear.budget([*held, *systematic_sources(parts, errs)], differing, drift_sources(parts, held))
        held = (*held, *(one for one in budget.sources if one.kind == DRIFT))
        known = ~unseen_parameters(unseen)
        beyond = np.zeros(len(self._z))
        if not spent:
            beyond[known] = beyond_bounds(minimum[known], budget.root[:, known])
        misfits, changes = linear.of(misfit_sources(parts)), tuple(one.missed for one in blocks)
        off, step = np.zeros(len(self._z)), minimum - self._z
        priors = [
            (p.answer[0], p.pull[0], float(p.residual[0] + p.answer[0] @ step)) for p in parts if not p.experiment
        ]
        if priors and not spent:
            off = np.where(known, prior_distances(priors, inverse, budget.joined(misfits).root), 0.0)
        return Minimum(minimum, unseen, beyond, off, noise, spent, compared, held, set_ups, budget, misfits, changes)


def _named(part: ScaledBlock, experiment: str) -> ScaledBlock:
    return replace(part, experiment=experiment)


def unseen_parameters(unseen: Floats) -> np.ndarray:
    """Mask (size,) of parameters that unidentifiable directions (m, size) make indistinguishable from others."""
    return np.abs(unseen).max(axis=0, initial=0.0) > _MIXED


def spent_groups(loss: Loss, slopes: Floats, blocks: Sequence[Block]) -> tuple[str, ...]:
    """The groups of channels whose noise cannot be estimated near a minimum, since the parameters fit them exactly
    whatever it is.

    Parameters
    ----------
    loss, slopes, blocks
        See `estimator`.
    """
    seen = [weighed(loss, one) for one in blocks]
    parts, inverse, _ = linearised(loss, seen, slopes)
    return white_noise(parts, inverse)[1]


def linearised(
    loss: Loss, seen: Sequence[Weighed], slopes: Floats, n_uncertain: int = 0, changes: Sequence[Floats | None] = ()
) -> tuple[list[ScaledBlock], Floats, Floats]:
    """The parts of blocks with jacobians, the inverse of half the loss's Hessian in the unit box where it has one, and
    its unidentifiable directions as rows.

    Parameters
    ----------
    loss, seen
        The loss, and its weighed blocks.
    slopes
        d theta / d z (size,).
    n_uncertain
        The number of uncertain parameters of the blocks.
    changes
        Those of the first blocks by what the model may miss, as of `missed`.
    """
    every = itertools.chain(changes, itertools.repeat(None))
    blocks = [_linear(loss, one, slopes, n_uncertain, change) for one, change in zip(seen, every, strict=False)]
    return [one.part for one in blocks], *_inverse_hessian(loss, blocks)


@dataclass(frozen=True, eq=False)
class _LinearBlock:
    """A block, its derivative by the point of the unit box (n, size), the block in units of its noise, and the changes
    of its residual (n, k) by what the model may miss.
    """

    seen: Weighed
    jacobian: Floats
    part: ScaledBlock
    missed: Floats | None = None

    @cached_property
    def rows(self) -> Floats:
        """Triangular factor R of the weighted derivatives J, R^T R = J^T J, for the parameters with an effect."""
        columns = self.part.sums.columns
        own = triangle(np.sqrt(self.seen.weights)[:, None] * self.jacobian[:, columns])
        rows = np.zeros((len(own), self.jacobian.shape[1]))
        rows[:, columns] = own
        return rows


def missed(blocks: Sequence[Block]) -> list[Floats | None]:
    """The changes (n, k) of each block's residual by what the model may miss, one of the usual causes (`misfit.py`);
    None where the clearest shape may be noise.

    Of many channels one has a clear shape by chance. A curve alone does not count: it may be how experiments differ,
    which is a source of its own.
    """
    places: dict[str, list[int]] = {}
    for k, block in enumerate(blocks):
        places.setdefault(block.experiment, []).append(k)
    found: list[Floats | None] = [None] * len(blocks)
    for own in (own for experiment, own in places.items() if experiment):
        by_chance = 2.0 * math.log(max(len(own) / _CHANNELS, 1.0))  # more of the square, the more channels there are
        for k, misfit in zip(own, misfits([blocks[k] for k in own]), strict=True):
            clear = math.sqrt(max(misfit.significance**2 - by_chance, 0.0))
            counts = min(max(clear - COUNTS, 0.0), 1.0)
            found[k] = None if misfit.changes is None or counts == 0.0 else math.sqrt(counts) * misfit.changes
    return found


def _linear(loss: Loss, seen: Weighed, slopes: Floats, n_uncertain: int, missing: Floats | None = None) -> _LinearBlock:
    block, w = seen.block, seen.weights
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    J = block.jacobian * slopes
    unit = np.ones(len(w)) if seen.stated is None else seen.stated
    group = loss.noise_group(block) if block.experiment else PRIOR
    over = block.residual / unit
    moved = np.zeros((len(w), n_uncertain)) if block.systematic is None else block.systematic
    changes, curved = (changed / unit[:, None] for changed in (moved, curving(loss, block, w, moved)))
    answer, pull = J / unit[:, None], (w * unit)[:, None] * J
    drift = None if block.drift is None else block.drift / unit
    known = seen.stated is not None
    misfit = None
    if missing is not None:
        misfit = missing / unit[:, None], curving(loss, block, w, missing) / unit[:, None]
    part = ScaledBlock(block.experiment, group, known, answer, pull, over, changes, curved, drift, misfit)
    return _LinearBlock(seen, J, part, missing)


@dataclass(frozen=True)
class Linear:
    """The minimum's linear response to errors of the measurements.

    inverse: of the Hessian. averaged: parameters in which the experiments differ; they are estimated by the mean of the
    experiments' own values, each with the weight that its variance and the spread between them give it.
    """

    parts: Sequence[ScaledBlock]
    inverse: Floats
    averaged: Sequence[Between]

    def budget(self, sources: Sequence[Source], differing: Sequence[Between], drifts: Sequence[Source] = ()) -> Budget:
        """The budget of errors.

        Parameters
        ----------
        sources
            Of the measurements' errors.
        differing
            How experiments differ.
        drifts
            Without a statement on them, as large as they are or smaller.
        """
        known = self.of([*sources, *(self.differences(one) for one in differing)])
        drifting = self.of(drifts)
        added, before = (np.sum(one.root**2, axis=0) for one in (drifting, known))
        least = np.max(added / before, initial=0.0) / (_LONGER**2 - 1.0)
        limited = drifting.times(1.0 / np.sqrt(max(least, 1.0)))
        return known.joined(limited)

    def of(self, sources: Sequence[Source]) -> Budget:
        """The budget of some sources."""
        return Budget(sources, [self.responses(source) for source in sources], len(self.inverse))

    def responses(self, source: Source) -> list[Floats]:
        """The responses (m, size) to the records of a source of error."""
        found = [one.pull[:, one.columns] @ self.inverse[one.columns] for one in source.records]
        for between, by_others in zip(self.averaged, self._by_others, strict=True):
            for record, response in zip(source.records, found, strict=True):
                direct = 0.0
                if record.experiment in between.weights:
                    own = between.responses[record.experiment]
                    pull = record.pull if record.alone is None else record.alone
                    direct = between.weights[record.experiment] * (pull @ own)
                response[:, between.column] = direct + response @ by_others
        return found

    def step(self, joint: Floats) -> Floats:
        """The step to the minimum of the quadratic model, where `joint` is that of the loss alone."""
        step = joint.copy()
        for between, by_others in zip(self.averaged, self._by_others, strict=True):
            step[between.column] = between.effects.mean + by_others @ joint
        return step

    def differences(self, between: Between) -> Source:
        """The source of error by the differences between experiments in a parameter, whose value is another in each."""
        moved = np.zeros(len(self.inverse))
        moved[between.column] = 1.0
        records = [
            ErrorRecord(np.zeros(1), np.zeros((1, len(moved))), self._pulled(name, moved)[None, :], name)
            for name in between.steps
        ]
        return Source(between.kind, str(between.column), tuple(records), between.effects.spread, between.effects.dof)

    @cached_property
    def _by_others(self) -> list[Floats]:
        """Derivative (size,) of each averaged parameter, the mean over the experiments, by the joint values of the
        other shared parameters.
        """
        found: list[Floats] = []
        for between in self.averaged:
            out = np.zeros(len(self.inverse))
            for name, own in between.responses.items():
                out -= between.weights[name] * np.where(own == 0.0, self._pulled(name, own), 0.0)
            found.append(out)
        return found

    def _pulled(self, name: str, moved: Floats) -> Floats:
        """The pull (size,) of an experiment's residuals by a change (size,) of the parameters."""
        pull = np.zeros(len(moved))
        for part in self._of.get(name, []):
            pull[part.sums.columns] += part.sums.normal @ moved[part.sums.columns]
        return pull

    @cached_property
    def _of(self) -> dict[str, list[ScaledBlock]]:
        return by_experiment(self.parts)


def curving(loss: Loss, block: Block, weights: Floats, changes: Floats) -> Floats:
    """Changes of a block's residual without the direction in which the loss is straight: a change in that leaves the
    pull of the block as it is.

    Parameters
    ----------
    loss, block
        The loss, and a block.
    weights
        The loss's, of the samples (n,).
    changes
        Of the residual (n, k) [SI].
    """
    along = loss.straight_along(block, block.residual)
    if along is None:
        return changes
    root = np.sqrt(weights)
    return changes - np.outer(along / root, along @ (root[:, None] * changes))


def _inverse_hessian(loss: Loss, blocks: Sequence[_LinearBlock]) -> tuple[Floats, Floats]:
    """The inverse of half the loss's Hessian in the identifiable directions, and the unidentifiable ones."""
    size = blocks[0].jacobian.shape[1]
    _, sizes, directions = np.linalg.svd(
        np.concatenate([*(one.rows for one in blocks), np.zeros((size, size))]), full_matrices=False
    )
    identified = sizes > _BLIND * max(float(sizes[0]), 1e-300)
    root = directions[identified] / sizes[identified, None]
    # The curvature of the roots is that at the minimum: of the residuals only the part that no step removes is left.
    step = root.T @ (root @ sum(one.part.pulled for one in blocks))
    hessian = np.eye(int(identified.sum()))
    for one in blocks:
        block = one.seen.block
        along = loss.straight_along(block, block.residual - one.jacobian @ step)
        if along is not None:
            flat = root @ ((np.sqrt(one.seen.weights) * along) @ one.jacobian)
            hessian -= np.outer(flat, flat)
    curvatures, axes = np.linalg.eigh(hessian)
    root = (axes / np.sqrt(np.maximum(curvatures, _BLIND))).T @ root
    return root.T @ root, directions[~identified]
