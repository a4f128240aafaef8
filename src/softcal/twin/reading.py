"""Readings of the sensors at a node of a path, with their derivatives by the control and by parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.mixed import neighbours_along
from softcal.mechanics.node import Node
from softcal.mechanics.statics import Statics
from softcal.twin.build import Twin
from softcal.twin.sensors import sense, sense_rates


@dataclass(frozen=True)
class SensorReading:
    """The channels at a node with their exact derivatives.

    values, slopes (n_channels,): the channels, and by the control; by_parameter, mixed (n_channels, k): by parameters
    at a fixed control, and by both.
    """

    values: Floats
    slopes: Floats
    by_parameter: Floats
    mixed: Floats


def read(twin: Twin, statics: Statics, node: Node, names: tuple[str, ...]) -> SensorReading:
    """The reading of the sensors at a node.

    Parameters
    ----------
    twin
        The twin.
    statics
        The system at its parameters, with the factors of its tangent.
    node
        The node.
    names
        Parameters (k,) of the node's derivatives.
    """
    k = len(names)
    by = ("", *[""] * k, *names)
    rates = sense_rates(
        twin, node.state, statics.theta, np.column_stack([node.slope, node.mixed, node.by_parameter]), by
    )
    slopes, mixed, by_parameter = rates[:, 0], rates[:, 1 : 1 + k], rates[:, 1 + k :]
    if names:
        h, *beside = neighbours_along(statics, node.state, node.slope)
        before, after = (sense_rates(twin, state, statics.theta, node.by_parameter, names) for state in beside)
        mixed += (after - before) / (2.0 * h)
    return SensorReading(sense(twin, node.state, statics.theta), slopes, by_parameter, mixed)
