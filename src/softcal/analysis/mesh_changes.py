"""How a discretisation of the twin changes what the bench would read, beside noise and residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.loss import Block, rms
from softcal.calibration.problem import Problem
from softcal.checks import Floats


@dataclass(frozen=True)
class Change:
    """How a discretisation changes one channel of one experiment, or the place of one marker or plate.

    rms: root mean square of the change [unit]; share: of the channel itself, with sign (None for places); noise: the
    stated standard deviation, None where there is none; residual: how well the calibrated twin meets it (RMSE);
    magnitude: root mean square of the channel; n: samples; order: at which it converges, of the limit alone.
    experiment is "" where several are taken together.
    """

    experiment: str
    name: str
    unit: str
    rms: float
    share: float | None
    noise: float | None
    residual: float
    magnitude: float
    n: int
    order: float | None = None


def grouped(blocks: Sequence[Block]) -> dict[tuple[str, str], list[int]]:
    """(experiment, channel or marker) -> numbers of its blocks; those of a place belong together."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, block in enumerate(blocks):
        if block.experiment:
            groups.setdefault((block.experiment, block.point or block.channel), []).append(i)
    return groups


def changes_between(
    problem: Problem, old: Sequence[Block], new: Sequence[Block], orders: Mapping[tuple[str, str], float]
) -> tuple[Change, ...]:
    """What another discretisation's blocks change; orders: of convergence, by experiment and channel."""
    units = {(e.name, channel): e.dataset.channels[channel].unit for e in problem.experiments for channel in e.compared}
    found: list[Change] = []
    for (experiment, name), members in grouped(old).items():
        change = np.stack([new[i].residual - old[i].residual for i in members])
        before = np.stack([old[i].measured + old[i].residual for i in members])
        noise = np.stack([np.broadcast_to(old[i].sigma, len(old[i].residual)) for i in members])
        residual = np.stack([old[i].residual for i in members])
        is_place = bool(old[members[0]].point)
        size_squared = float(np.sum(before**2))
        found.append(
            Change(
                experiment,
                name,
                units[experiment, old[members[0]].channel],
                _distance(change),
                None if is_place or size_squared == 0.0 else float(np.sum(change * before)) / size_squared,
                _distance(noise) if np.all(np.isfinite(noise)) and np.any(noise > 0.0) else None,
                _distance(residual),
                _distance(before),
                change.shape[1],
                orders.get((experiment, name)),
            )
        )
    return tuple(found)


def pooled(changes: Sequence[Change]) -> dict[str, Change]:
    """The changes of each channel or place over all experiments, by its name."""
    groups: dict[str, list[Change]] = {}
    for change in changes:
        groups.setdefault(change.name, []).append(change)
    return {name: held[0] if len(held) == 1 else _together(held) for name, held in groups.items()}


def _together(held: Sequence[Change]) -> Change:
    n = sum(c.n for c in held)
    size = sum(c.n * c.magnitude**2 for c in held)

    def mean(values: Sequence[float]) -> float:
        return math.sqrt(sum(c.n * value**2 for c, value in zip(held, values, strict=True)) / n)

    shares, noises, orders = [c.share for c in held], [c.noise for c in held], [c.order for c in held]
    share = sum(c.n * c.magnitude**2 * (c.share or 0.0) for c in held) / size if size > 0.0 else None
    return replace(
        held[0],
        experiment="",
        rms=mean([c.rms for c in held]),
        share=None if None in shares else share,
        noise=None if None in noises else mean([noise or 0.0 for noise in noises]),
        residual=mean([c.residual for c in held]),
        magnitude=math.sqrt(size / n),
        n=n,
        order=None if None in orders else sum(order or 0.0 for order in orders) / len(orders),
    )


def _distance(parts: Floats) -> float:
    """The root mean square over the samples of parts (k, n), taken together as those of a vector."""
    return rms(np.sqrt(np.sum(parts**2, axis=0)))
