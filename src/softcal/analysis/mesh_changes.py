"""Changes of the predicted measurements by another discretisation, compared with noise and residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.loss import Block, rms
from softcal.calibration.problem.problem import Problem
from softcal.checks import Floats


@dataclass(frozen=True)
class Change:
    """Change of one channel, or of one marker's or plate's position, by a discretisation.

    Attributes
    ----------
    experiment
        Name of the experiment; "" for several pooled ones.
    name
        Channel, marker or plate.
    unit
        SI unit of the values below.
    rms
        Root mean square of the change [unit].
    share
        Change over the channel's magnitude, signed; None for positions.
    noise
        Stated standard deviation [unit]; None if not stated.
    residual
        RMSE of the calibrated twin [unit].
    magnitude
        Root mean square of the channel [unit].
    n
        Number of samples.
    order
        Order of convergence; only for the extrapolated limit.
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
    """(experiment, channel or marker) -> numbers of its blocks; the coordinates of a position are grouped."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, block in enumerate(blocks):
        if block.experiment:
            groups.setdefault((block.experiment, block.point or block.channel), []).append(i)
    return groups


def changes_between(
    problem: Problem, old: Sequence[Block], new: Sequence[Block], orders: Mapping[tuple[str, str], float]
) -> tuple[Change, ...]:
    """Changes of all channels by another discretisation.

    Parameters
    ----------
    problem
        The calibration's problem.
    old
        Blocks of the original discretisation.
    new
        Blocks of the other one.
    orders
        Orders of convergence by experiment and channel.
    """
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
                experiment=experiment,
                name=name,
                unit=units[experiment, old[members[0]].channel],
                rms=_distance(change),
                share=None if is_place or size_squared == 0.0 else float(np.sum(change * before)) / size_squared,
                noise=_distance(noise) if np.all(np.isfinite(noise)) and np.any(noise > 0.0) else None,
                residual=_distance(residual),
                magnitude=_distance(before),
                n=change.shape[1],
                order=orders.get((experiment, name)),
            )
        )
    return tuple(found)


def pooled(changes: Sequence[Change]) -> dict[str, Change]:
    """Channel or position -> change pooled over all experiments."""
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
    """Root mean square over the samples of a vector with components (k, n)."""
    return rms(np.sqrt(np.sum(parts**2, axis=0)))
