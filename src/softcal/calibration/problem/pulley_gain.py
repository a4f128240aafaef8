"""Tension at the machine over that at the robot, by the friction of the pulleys between them.

Of data on one branch, which were corrected under the nominal friction, it is the gain between that friction and the
true one (see `steps/pulleys`). Friction with a memory reverses with the cable: for a slip d, which is the shortening,

    T_machine = T exp(n mu theta w),   w = clip((d - p) / delta, -1, 1),   p -> d - delta w

with the presliding displacement delta; the cable is pulled from zero shortening to the first sample. The slip p is a
play: it follows d within a clearance, as a drive with backlash follows its motor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softcal.calibration.problem.experiment import PULLEY_FRICTION, PULLEY_PRESLIDING, Experiment
from softcal.checks import Floats
from softcal.experiments.steps.branches import branch_of
from softcal.experiments.steps.pulleys import pulley_gain


class Play(NamedTuple):
    """What follows a driver within a clearance, sample by sample (n,), its derivatives by half of the clearance, and by
    a shift of all samples.
    """

    values: Floats
    by_half: Floats
    by_shift: Floats


def play(driver: Floats, half: float) -> Play:
    """What follows a driver (n,) and is pushed along by it at a distance of `half` to either side, from zero on."""
    values, by_half, by_shift = (np.zeros(len(driver)) for _ in range(3))
    at, at_half, at_shift = 0.0, 0.0, 0.0
    for i, d in enumerate(driver.tolist()):
        if abs(d - at) >= half:
            sign = 1.0 if d >= at else -1.0
            at, at_half, at_shift = d - half * sign, -sign, 1.0
        values[i], by_half[i], by_shift[i] = at, at_half, at_shift
    return Play(values, by_half, by_shift)


@dataclass(frozen=True)
class PulleyGain:
    """Ratio of tensions of each sample, (n_samples,) or one for all, and its derivatives by rig parameters."""

    value: Floats | float
    by: Mapping[str, Floats | float]


def gain_of(experiment: Experiment, rig: Mapping[str, float], cable: str) -> PulleyGain:
    """The gain of a cable's tension in the dataset over the twin's.

    Parameters
    ----------
    experiment, rig
        The experiment, and the rig's parameters in it [SI by name].
    cable
        Name of the cable.
    """
    pulleys = experiment.rig.pulleys
    if pulleys is None:
        return PulleyGain(1.0, {})
    exponent = pulleys.turning * rig[PULLEY_FRICTION]
    if pulleys.friction_memory:
        slip = experiment.dataset.values(experiment.shortening_of(cable))
        share, by_presliding = reversals(slip, rig[PULLEY_PRESLIDING])
        gain = np.exp(exponent * share)
        by = {PULLEY_FRICTION: pulleys.turning * share * gain, PULLEY_PRESLIDING: exponent * by_presliding * gain}
        return PulleyGain(gain, by)
    branch = branch_of(experiment.dataset) or "loading"
    nominal, _ = pulley_gain(branch, pulleys.turning * pulleys.friction_coefficient)
    gain, rate = pulley_gain(branch, exponent)
    return PulleyGain(gain / nominal, {PULLEY_FRICTION: pulleys.turning * rate / nominal})


def reversals(slip: Floats, presliding: float) -> tuple[Floats, Floats]:
    """The share w of the friction that acts at each slip (n,), in their order, and dw / d presliding (n,)."""
    plastic = play(slip, presliding)
    share = np.clip((slip - plastic.values) / presliding, -1.0, 1.0)
    return share, np.where(np.abs(share) < 1.0, -(share + plastic.by_half) / presliding, 0.0)
