"""Friction of the pulleys between the machine and the neck (capstan equation), by the direction of sliding.

    T_UTM = T exp(+n mu theta)    loading
    T_UTM = T exp(-n mu theta)    unloading
    T_UTM = T cosh(n mu theta)    mean of both at one shortening

n pulleys with friction coefficient mu [-] and wrap angle theta [rad] each; T is the tension at the neck.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.branches import BRANCH, PULLEY_STEP, Branch, branch_of, pulley_exponent, require_branch
from softcal.quantities import QUANTITIES
from softcal.sensing.channel import channel_name
from softcal.sensing.sensors.actuators import TENSION


def pulley_gain(branch: Branch, exponent: float) -> tuple[float, float]:
    """Ratio of the machine's tension to the neck's on a branch, and its derivative by the exponent n mu theta [-]."""
    match branch:
        case "loading":
            return math.exp(exponent), math.exp(exponent)
        case "unloading":
            return math.exp(-exponent), -math.exp(-exponent)
        case "mean":
            return math.cosh(exponent), math.sinh(exponent)


@register_step(
    keeps_gaps=True,
    n_pulleys=Setting("count", of="pulleys"),
    friction_coefficient=Setting("friction coefficient"),
    wrap_angle=Setting("angle"),
    branch=BRANCH,
)
def correct_pulley_friction(
    dataset: Dataset,
    n_pulleys: int,
    friction_coefficient: float,
    wrap_angle: float = np.pi,
    branch: Branch | None = None,
) -> Dataset:
    """Correct every cable's tension from the machine to the neck for pulley friction on one branch.

    Parameters
    ----------
    branch
        The branch that is used in the end; by default the one selected by `take_branch`, or loading. On another branch
        the tension would be wrong, so that `take_branch` refuses it afterwards.

    Raises
    ------
    DatasetError
        If the dataset has no tension, a setting is negative, the friction consumes the tension, or the branch is not
        that of the data.

    References
    ----------
    "FEM-Based Optimization of the Mechanical Properties of a Soft Robotic Neck", eq. (1), for loading.
    """
    if n_pulleys < 0 or friction_coefficient < 0.0 or wrap_angle < 0.0:
        raise DatasetError(
            Fault(
                "the pulleys' friction cannot be negative",
                where=dataset.name,
                got=f"{n_pulleys} pulleys, coefficient {friction_coefficient:g}, wrap angle {wrap_angle:g} rad",
                allowed="numbers >= 0",
            )
        )
    tensions = [name for name in dataset.channels if channel_name(name).kind == TENSION]
    if not tensions:
        dataset.values("tension")
    read_on = branch_of(dataset) or branch or "loading"
    own = n_pulleys * friction_coefficient * wrap_angle
    if fault := QUANTITIES["friction over all pulleys"].fault(own, dataset.name):
        raise DatasetError(fault)
    step = Step(
        PULLEY_STEP,
        {
            "n_pulleys": n_pulleys,
            "friction_coefficient": friction_coefficient,
            "wrap_angle": wrap_angle,
            "branch": branch or read_on,
            "exponent": own,
        },
    )
    require_branch(replace(dataset, provenance=(*dataset.provenance, step)), read_on)
    # Pulleys may be corrected in several steps; the hyperbolic cosines of the mean do not multiply.
    before = pulley_exponent(dataset)
    factor = pulley_gain(read_on, before)[0] / pulley_gain(read_on, before + own)[0]
    where = {"loading": "during loading", "unloading": "during unloading", "mean": "in the mean of both branches"}
    step = replace(step, outcome=f"tension at the neck is {factor:.4f} of that at the machine, {where[read_on]}")
    at_neck = {
        name: replace(measured, values=measured.values * factor, sigma=measured.sigma * factor)
        for name in tensions
        for measured in [dataset.channels[name]]
    }
    return replace(dataset, channels={**dataset.channels, **at_neck}, provenance=(*dataset.provenance, step))
