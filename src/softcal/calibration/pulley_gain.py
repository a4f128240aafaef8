"""Tension at the machine over that at the robot, by the friction of the pulleys between them.

Of data on one branch, which were corrected under the nominal friction, it is the gain between that friction and the
true one (see `steps/pulleys`). Friction with a memory reverses with the cable: for a slip d, which is the shortening,

    T_machine = T exp(n mu theta w),   w = clip((d - p) / delta, -1, 1),   p -> d - delta w

with the presliding displacement delta; the cable is pulled from zero shortening to the first sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.calibration.experiment import PULLEY_FRICTION, PULLEY_PRESLIDING, Experiment
from softcal.calibration.play import play
from softcal.checks import Floats
from softcal.experiments.steps.branches import branch_of
from softcal.experiments.steps.pulleys import pulley_gain


@dataclass(frozen=True)
class PulleyGain:
    """Ratio of tensions of each sample, (n_samples,) or one for all, and its derivatives by rig parameters."""

    value: Floats | float
    by: Mapping[str, Floats | float]


def gain_of(experiment: Experiment, rig: Mapping[str, float], cable: str) -> PulleyGain:
    """The gain of a cable's tension in the dataset over the twin's."""
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
