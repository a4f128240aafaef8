"""The estimator of a calibration with one more test, before the test is made.

The minimum's response to noise (`estimator.py`) depends on the jacobians and on the size of the
noise, not on the measured values, so that a test's effect on the intervals is known from its jacobian alone:

    A_new = A + sum J_c^T W_c J_c,    covariance = A_new^-1 (sum J^T W S W J, the test's own included) A_new^-1

with the test's own parameters (its slack, its offsets) among the columns. The noise S_c of a channel is that of the
same channel in the calibration: its size, and its correlation along the record, which has the same length as a share of
the record, so that more samples of a correlated record add little. A better sensor reduces the white noise only. Where
the experiments differ, the test is one more of them, with the same spread between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.loss import Block, Loss, rms
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.between_experiments import (
    Alone,
    Between,
    own_step,
    parts_alone,
    parts_by_set_up,
    serves_by_set_up,
)
from softcal.calibration.statistics.correlation import BINS, ErrorRecord, Process, record
from softcal.calibration.statistics.estimator import Estimator, Linear, Weighed, linearised, weighed
from softcal.calibration.statistics.noise import (
    DRIFT,
    PRIOR,
    ScaledBlock,
    Source,
    drift_sources,
    misfit_sources,
    systematic_sources,
)
from softcal.checks import Floats


@dataclass(frozen=True)
class AddedChannel:
    """A channel that the test would measure.

    Attributes
    ----------
    name
        Name of the channel.
    answer, own
        d channel / dz (n, size) of the calibration's parameters, and (n, q) of the test's own [SI].
    like
        Experiment and channel of the calibration whose noise it has; None where that is not known.
    sigma
        Standard deviation of its noise [SI], where it is not that of `like`.
    better
        Factor by which its noise is smaller [-].
    counted
        Whether the loss has a weight for it; else it gets that of the other channels at equal variance.
    systematic
        Its change (n, k) [SI] by one standard deviation of each uncertain parameter of the calibration, or None.
    own_systematic
        The same (n, m) of the test's own uncertain parameters, or None.
    drift
        As of a `Block`.
    """

    name: str
    answer: Floats
    own: Floats
    like: tuple[str, str] | None = None
    sigma: float | None = None
    better: float = 1.0
    counted: bool = True
    systematic: Floats | None = None
    own_systematic: Floats | None = None
    drift: Floats | None = None


@dataclass(frozen=True)
class AddedTest:
    """A test that is not made yet.

    Attributes
    ----------
    name
        Name of the test.
    channels
        What it would measure.
    serves
        Whether each of the calibration's parameters has an effect on it (size,).
    priors
        Priors of its own parameters over their standard deviations, as rows (k, q).
    repeats
        How many times it is made, each with its own parameters, free and uncertain.
    uncertain
        Its own uncertain parameters: as uncertain as those of the calibration, with another error.
    """

    name: str
    channels: tuple[AddedChannel, ...]
    serves: np.ndarray
    priors: Floats
    repeats: int = 1
    uncertain: tuple[UncertainParameter, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each time that it is made."""
        return (self.name, *(f"{self.name} {k + 1}" for k in range(1, self.repeats)))


@dataclass(frozen=True)
class ExpectedEstimates:
    """The expected estimates of the calibration's parameters; fields as in `Estimator`, (size,) and (size, size).

    step: from the calibration's minimum to that of the unbounded model (size,). The test is expected to agree with that
    minimum, also where a bound is what determines it.
    """

    root: Floats
    step: Floats
    dof: Floats
    unseen: Floats


@dataclass(frozen=True)
class _Noise:
    """The noise that a channel is expected to have.

    unit: the stated standard deviation [SI]; 1 where the loss states none. white, correlated: variances of one sample
    [SI^2]. length: of the correlation, as a share of the record. scatter: of the process, see `Process`.
    """

    unit: float
    stated: bool
    dof: float
    white: float
    correlated: float = 0.0
    length: float = 0.0
    scatter: Floats | None = None

    @property
    def variance(self) -> float:
        return self.white + self.correlated

    def process(self, n: int) -> Process | None:
        """The process in n samples; None where the noise is white."""
        if self.scatter is None:
            return None
        values = min(n, BINS)
        white = self.white * values / n  # a value of the record is the mean of several samples
        variance = self.correlated + white
        return Process(variance / self.unit**2, self.correlated / variance, self.length * values, self.scatter)


def with_added_test(
    loss: Loss,
    blocks: Sequence[Block],
    slopes: Floats,
    serves: Mapping[str, np.ndarray],
    found: Estimator,
    added: AddedTest,
    uncertain: Sequence[UncertainParameter] = (),
) -> ExpectedEstimates:
    """The expected estimates after a test is added to a calibration.

    Parameters
    ----------
    loss, blocks, slopes, serves, uncertain
        See `estimator`.
    found
        The estimator from these arguments.
    added
        The test.
    """
    size, q, k, m = len(slopes), added.priors.shape[1], len(uncertain), len(added.uncertain)
    # The first column of each test's own parameters, and the columns of its own errors.
    places = {name: (size + i * q, range(k + i * m, k + (i + 1) * m)) for i, name in enumerate(added.names)}
    wide = size + q * added.repeats
    errs = (*uncertain, *(added.uncertain * added.repeats))
    # Jacobians in the unit box, with zeros for the added parameters, free and uncertain.
    seen: list[Weighed] = []
    for block in blocks:
        if block.jacobian is None:
            raise ValueError(f"the block '{block.channel}' has no jacobian")
        moved = block.systematic
        if moved is not None:
            moved = np.pad(moved, ((0, 0), (0, len(errs) - moved.shape[1])))
        jacobian = np.pad(block.jacobian * slopes, ((0, 0), (0, wide - len(slopes))))
        seen.append(weighed(loss, replace(block, jacobian=jacobian, systematic=moved)))
    noises = {channel.name: _noise(loss, blocks, found, channel) for channel in added.channels}
    # The loss's weight times the noise's variance, the mean over the calibration's samples.
    products: list[Floats] = []
    for one in seen:
        if one.block.experiment:
            noise = (1.0 if one.stated is None else one.stated) * found.noise[loss.noise_group(one.block)].size
            products.append(one.weights * np.broadcast_to(noise, len(one.weights)) ** 2)
    precision = float(np.concatenate(products).mean())
    for name, (start, own_errs) in places.items():
        for channel in added.channels:
            jacobian = np.zeros((len(channel.answer), wide))
            jacobian[:, :size], jacobian[:, start : start + q] = channel.answer, channel.own
            moved = np.zeros((len(channel.answer), len(errs)))
            if channel.systematic is not None:
                moved[:, :k] = channel.systematic
            if channel.own_systematic is not None:
                moved[:, own_errs] = channel.own_systematic
            seen.append(_expected(loss, name, channel, noises[channel.name], jacobian, moved, precision))
        for row in added.priors:
            jacobian = np.zeros((1, wide))
            jacobian[0, start : start + q] = row
            seen.append(Weighed(Block("", "prior", np.zeros(1), np.zeros(1), 1.0, jacobian), np.ones(1), np.ones(1)))
    parts, inverse, unseen = linearised(loss, seen, np.ones(wide), len(errs), found.missed)
    parts, serves = parts_by_set_up(parts, found.set_ups), serves_by_set_up(serves, found.set_ups)
    # The calibration's sources, with the priors of the added parameters, in the parts of all parameters.
    sources: list[Source] = []
    for source in (one for one in found.sources if one.kind != DRIFT):
        own = [p for p in parts if p.group == source.name and p.experiment not in places and p.group != PRIOR]
        sources.append(replace(source, records=tuple(_record(part, source.process) for part in own)))
    priors = tuple(_record(part, None) for part in parts if part.group == PRIOR)
    sources = [one for one in sources if one.name != PRIOR]
    if priors:
        sources.append(Source("prior", PRIOR, priors, 1.0, np.inf))
    new = [part for part in parts if part.experiment in places]
    total = sum(len(one.answer) for one in added.channels)
    for part, channel in zip(new, list(added.channels) * added.repeats, strict=True):
        dof = len(channel.answer) * max(1.0 - added.priors.shape[1] / total, 1.0 / total)
        _add_source(sources, part, noises[channel.name], dof)
    labelled = {i: (p.source, p.label) for i, p in enumerate(errs)}
    averaged = [_with_steps(one, i, found, parts, sources, places, serves, added) for i, one in _differing(found)]
    linear = Linear(parts, inverse, [one for one in averaged if one.has_interval])
    drifts = drift_sources(parts, [one for one in sources if one.kind == "noise"])
    budget = linear.budget([*sources, *systematic_sources(parts, labelled)], averaged, drifts)
    budget = budget.joined(linear.of(misfit_sources(parts)))
    left = sum(part.pull.T @ part.residual for part in parts if part.experiment not in places)
    step = linear.step(-inverse @ left)
    return ExpectedEstimates(np.linalg.qr(budget.root[:, :size])[1], step[:size], budget.dof[:size], unseen[:, :size])


def _noise(loss: Loss, blocks: Sequence[Block], found: Estimator, channel: AddedChannel) -> _Noise:
    """The noise that a channel is expected to have."""
    states = any(loss.stated_noise(block) is not None for block in blocks if block.experiment)
    like = next((block for block in blocks if (block.experiment, block.channel) == channel.like), None)
    if like is None:
        if channel.sigma is None:
            raise ValueError(f"the noise of '{channel.name}' is not known")
        sigma = channel.sigma / channel.better
        return _Noise(sigma if states else 1.0, states, np.inf, sigma**2)
    source = next(one for one in found.sources if one.name == loss.noise_group(like))
    stated = loss.stated_noise(like)
    unit, n = 1.0 if stated is None else rms(stated), len(like.residual)
    values, process = min(n, BINS), source.process
    white = source.size**2 if process is None else process.variance * (1.0 - process.share) * n / values
    white *= unit**2
    correlated = 0.0 if process is None else process.variance * process.share * unit**2
    if channel.sigma is not None:  # another sensor: its noise is white, and the misfit of the twin remains
        white *= (channel.sigma / unit) ** 2 if states else channel.sigma**2 / white
        unit = channel.sigma if states else unit
    white /= channel.better**2
    unit /= channel.better if states else 1.0
    if process is None:
        return _Noise(unit, states, source.dof, white)
    return _Noise(unit, states, source.dof, white, correlated, process.length / values, process.scatter)


def _expected(
    loss: Loss, test: str, channel: AddedChannel, noise: _Noise, jacobian: Floats, moved: Floats, precision: float
) -> Weighed:
    n = len(jacobian)
    # Of the expected size; what matters of them is no more than that. Alternating, they are of no smooth direction.
    residual = np.sqrt(noise.variance) * (-1.0) ** np.arange(n)
    block = Block(
        test, channel.name, np.zeros(n), residual, noise.unit, jacobian, systematic=moved, drift=channel.drift
    )
    if noise.stated:
        return Weighed(block, np.full(n, 1.0 / noise.unit**2), np.full(n, noise.unit))
    if channel.counted:
        return Weighed(block, loss.square_weights(block, residual), None)
    return Weighed(block, np.full(n, precision / noise.variance), None)


def _record(part: ScaledBlock, process: Process | None) -> ErrorRecord:
    if process is None:
        return ErrorRecord(part.residual, part.answer, part.pull, part.experiment)
    return record(part.residual, part.answer, part.pull, part.experiment)


def _add_source(sources: list[Source], part: ScaledBlock, noise: _Noise, dof: float) -> None:
    """Add the errors of an added channel to the source of the same kind and size, or else as a new source."""
    size, process = float(np.sqrt(noise.white)) / noise.unit, noise.process(len(part.residual))
    added = _record(part, process)
    for i, source in enumerate(sources):
        if source.process is None or process is None:
            is_alike = source.process is process and bool(np.isclose(source.size, size))
        else:
            ours, theirs = ([p.variance, p.share, p.length] for p in (source.process, process))
            is_alike = bool(np.allclose(ours, theirs))
        if source.name == part.group and is_alike:
            sources[i] = replace(source, records=(*source.records, added), dof=source.dof + dof)
            return
    known = np.inf if np.isinf(noise.dof) else dof
    sources.append(Source("noise", part.group, (added,), size, known, process))


def _differing(found: Estimator) -> list[tuple[int, Between]]:
    """The parameters in which the experiments differ, with their indices in `between`."""
    return [(i, one) for i, one in enumerate(found.between) if one.effects.differs]


def _with_steps(
    between: Between,
    place: int,
    found: Estimator,
    parts: Sequence[ScaledBlock],
    sources: Sequence[Source],
    places: Mapping[str, tuple[int, range]],
    serves: Mapping[str, np.ndarray],
    added: AddedTest,
) -> Between:
    """The comparison of experiments with the added ones among them: the same spread, the variances by their noise."""
    size, wide = len(added.serves), parts[0].pull.shape[1]
    own = np.ones(wide, dtype=bool)
    own[:size] = np.sum(list(serves.values()), axis=0) == 1
    own[[one.column for _, one in _differing(found)[:place]]] = True
    variances = dict(between.variances)
    responses = {name: np.pad(one, (0, wide - size)) for name, one in between.responses.items()}
    for name, (start, own_errs) in places.items():
        on = np.zeros(wide, dtype=bool)
        on[:size], on[start : start + added.priors.shape[1]] = added.serves, True
        alone = parts_alone(name, parts, on & own)
        within: list[Source] = []
        for one in sources:
            records = [record for record in one.records if record.experiment == name]
            if one.name == PRIOR:
                records = [_record(part, None) for part in alone if part.group == PRIOR]
            if records:
                within.append(replace(one, records=tuple(records)))
        within += systematic_sources(
            alone, {i: (p.source, p.label) for i, p in zip(own_errs, added.uncertain, strict=True)}
        )
        step = own_step(Alone(name, alone, on, within), own, between.column)
        if step is not None:
            variances[name], responses[name] = step.variance, step.response
    steps = {name: between.steps.get(name, 0.0) for name in variances}
    return replace(
        between,
        steps=steps,
        effects=replace(between.effects, dof=len(steps) - 1),
        variances=variances,
        responses=responses,
    )
