"""The robot's sensors and channels, and what they read: from a state, and from rates of the unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.mixed import neighbours_along
from softcal.mechanics.node import Node
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Theta
from softcal.sensing.sensor import Posture
from softcal.twin.build import Twin
from softcal.twin.markers import MarkerPlace
from softcal.twin.parameters import MARKER_OFFSETS


def channel_units(twin: Twin) -> dict[str, str]:
    """Every channel of the robot and its SI unit, in a fixed order."""
    return {str(channel): channel.kind.unit for channel in twin.columns}


def angle_columns(twin: Twin) -> list[int]:
    """The columns of angles."""
    return [k for channel, k in twin.columns.items() if channel.kind.is_angle]


def sense(twin: Twin, state: State, theta: Theta, coordinates: Mapping[str, float] | None = None) -> Floats:
    """The channels' values (n_channels,) at a state, in the order of `channel_units`.

    Parameters
    ----------
    twin
        The twin.
    state
        The state.
    theta
        Parameter values by dotted name [SI].
    coordinates
        Of the actuators that are commanded by it, which read as commanded: a cable's shortening, taut or slack.
    """
    return read_all(twin, _StatePosture(twin, state, theta, coordinates or {}))


def read_all(twin: Twin, posture: Posture) -> Floats:
    """The channels' values (n_channels,) of a posture, in the order of `channel_units`."""
    return np.array([value for own in twin.sensors for value in own.sensor.sense(posture)], dtype=np.float64)


def sense_rates(
    twin: Twin,
    state: State,
    theta: Theta,
    dz: Floats,
    names: Sequence[str] = (),
    coordinates: Mapping[str, Floats] | None = None,
) -> Floats:
    """The channels' rates (n_channels, k).

    Parameters
    ----------
    twin
        The twin.
    state
        The state.
    theta
        Parameter values by dotted name [SI].
    dz
        Rates of the unknowns (n_unknowns, k).
    names
        Parameters (k,) by which dz is the derivative, or "": they may change a channel at fixed unknowns too.
    coordinates
        Rates (k,) of the coordinates of the actuators that are commanded by it.
    """
    if dz.shape[1] == 0:
        return np.zeros((len(twin.columns), 0))
    posture = _StatePosture(twin, state, theta, {})
    rates = _StateRates(twin, state, theta, dz, tuple(names) or ("",) * dz.shape[1], coordinates or {})
    rows = [row for own in twin.sensors for row in own.sensor.rates(posture, rates)]
    found = np.array(rows).reshape(len(rows), dz.shape[1])
    # What is read of the same unknowns in another shape; the actuators' part is in their own rates.
    none = dict.fromkeys((actuator.name for actuator in twin.system.actuators), 0.0)
    for k, name in enumerate(names):
        if name in twin.system.neighbours:
            found[:, k] += twin.system.neighbours[name].rate(lambda one, at: sense(one, at, theta, none), state)
    return found


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


@dataclass(frozen=True)
class _StatePosture:
    """A state as sensors see it."""

    twin: Twin
    state: State
    theta: Theta
    commanded: Mapping[str, float]

    def point(self, name: str) -> Floats:
        if name in self.twin.frame:
            return self.state.position[self.twin.frame[name]]
        place = self.twin.markers[name]
        return place.position(self.state.x, _turned(self.twin, self.state, place))

    def rotation(self, plate: str) -> Floats:
        return self.state.rotation[self.twin.frame[plate]]

    def coordinate(self, actuator: str) -> float:
        if actuator in self.commanded:
            return self.commanded[actuator]
        return float(self._coordinates[self.twin.system.number(actuator)])

    def effort(self, actuator: str) -> float:
        return float(self.state.effort[self.twin.system.number(actuator)])

    @cached_property
    def _coordinates(self) -> Floats:
        return self.twin.system.coordinates(self.state, self.theta)


@dataclass(frozen=True)
class _StateRates:
    """Rates of the unknowns dz (n_unknowns, k) as rates of what sensors see; names: the parameters of its columns."""

    twin: Twin
    state: State
    theta: Theta
    dz: Floats
    names: tuple[str, ...]
    commanded: Mapping[str, Floats]

    def point(self, name: str) -> Floats:
        if name in self.twin.frame:
            return self._of_frame(name)[:3]
        place = self.twin.markers[name]
        layout, R = self.twin.system.layout, _turned(self.twin, self.state, place)
        rows: list[Floats] = []  # d(weighted point)/dz, by axis (n_unknowns - n_cables,)
        for axis in range(3):
            gradient = np.zeros(3 * layout.n_points + layout.n_pressures)
            for point, weight in place.points:
                gradient[3 * point + axis] += weight
            rows.append(self.twin.system.motion.reduce_gradient(self.state, gradient))
        rates = np.array(rows) @ self._dq
        if place.turns:
            rates += np.cross(self.rotation(place.marker.on), R @ place.marker.offset, axis=0)
        # An offset moves its marker at fixed unknowns.
        for key, axis in zip(MARKER_OFFSETS, place.axes(self.state.x, R).T, strict=True):
            rates[:, [k for k, one in enumerate(self.names) if one == f"{name}.{key}"]] += axis[:, None]
        return rates

    def rotation(self, plate: str) -> Floats:
        return self._of_frame(plate)[3:]

    def coordinate(self, actuator: str) -> Floats:
        if actuator in self.commanded:
            return self.commanded[actuator]
        return self._coordinates[self.twin.system.number(actuator)]

    @cached_property
    def _coordinates(self) -> Floats:
        return self.twin.system.coordinate_rates(self.state, self.theta, self.dz, self.names)

    def effort(self, actuator: str) -> Floats:
        return self.dz[self.twin.system.layout.first_effort_unknown + self.twin.system.number(actuator)]

    @property
    def _dq(self) -> Floats:
        return self.dz[: self.twin.system.layout.first_effort_unknown]

    def _of_frame(self, plate: str) -> Floats:
        layout, k = self.twin.system.layout, self.twin.frame[plate]
        if k >= layout.n_moving_frames:
            return np.zeros((6, self.dz.shape[1]))
        first = layout.first_frame_unknown + 6 * k
        return self.dz[first : first + 6]


def _turned(twin: Twin, state: State, place: MarkerPlace) -> Floats:
    """The rotation (3, 3) of a marker's plate; none for one on a body."""
    return state.rotation[twin.frame[place.marker.on]] if place.turns else np.eye(3)
