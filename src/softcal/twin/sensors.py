"""Virtual sensors: the channels and their rates, from a state and a rate of the unknowns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.cable import cables_of
from softcal.mechanics.state import State
from softcal.twin.build import Twin
from softcal.twin.loads import Weights

PLATE_CHANNELS = {"x": "m", "y": "m", "z": "m", "pitch": "rad", "roll": "rad", "yaw": "rad"}


def channel_units(twin: Twin) -> dict[str, str]:
    """Every channel of the robot and its SI unit, in a fixed order."""
    units: dict[str, str] = {}
    for cable in twin.robot.cables:
        units[f"{cable.name}.shortening"] = "m"
        units[f"{cable.name}.tension"] = "N"
    for plate in twin.robot.plates:
        units.update({f"{plate.name}.{key}": unit for key, unit in PLATE_CHANNELS.items()})
    for marker in twin.robot.markers:
        units.update({f"{marker.name}.{axis}": "m" for axis in "xyz"})
    return units


def sense(twin: Twin, state: State) -> Floats:
    """The channels' values at a state, in the order of `channel_units`."""
    cables = cables_of(twin.system)
    lengths = cables.lengths(state.x)
    values: list[float] = []
    for i in range(cables.n_cables):
        values += [cables.rest_length[i] - lengths[i], state.effort[i]]
    for plate in twin.robot.plates:
        k = twin.frame[plate.name]
        values += [*state.position[k], *angles(state.rotation[k])]
    for marker in twin.robot.markers:
        values += sum((w * state.x[p] for p, w in twin.markers[marker.name]), np.zeros(3)).tolist()
    return np.array(values)


def sense_rates(twin: Twin, state: State, dz: Floats) -> Floats:
    """The channels' rates for rates dz (n_unknowns, k) of the unknowns; shape (n_channels, k)."""
    layout, cables = twin.system.layout, cables_of(twin.system)
    tensions = dz[layout.first_effort_unknown :]
    rows: list[Floats] = []
    for i in range(cables.n_cables):
        rate = twin.system.coordinate_gradient(state, i) @ dz[: layout.first_effort_unknown]
        rows += [rate[None, :], tensions[i : i + 1]]
    for plate in twin.robot.plates:
        k = twin.frame[plate.name]
        first = layout.first_frame_unknown + 6 * k
        if k < layout.n_moving_frames:
            rows += [dz[first : first + 3], _angle_rates(state.rotation[k]) @ dz[first + 3 : first + 6]]
        else:
            rows.append(np.zeros((6, dz.shape[1])))
    for marker in twin.robot.markers:
        rows.append(_point_rates(twin, state, twin.markers[marker.name]) @ dz[: layout.first_effort_unknown])
    return np.concatenate(rows) if rows else np.zeros((0, dz.shape[1]))


def sense_by_parameters(twin: Twin, state: State, by_parameter: Floats, names: Sequence[str]) -> Floats:
    """The channels' derivatives by parameters (n_channels, k), of the unknowns' (n_unknowns, k)."""
    rates = sense_rates(twin, state, by_parameter)
    add_own_rates(twin, state, names, rates)
    return rates


def add_own_rates(twin: Twin, state: State, names: Sequence[str], into: Floats) -> None:
    """Add to the channels' derivatives by parameters (n_channels, k) those at fixed unknowns: a routing offset changes
    its cable's length.
    """
    offsets = {f"{cable.name}.routing_offset": i for i, cable in enumerate(twin.robot.cables)}
    changed = [(offsets[name], k) for k, name in enumerate(names) if name in offsets]
    if changed:
        by_offset = cables_of(twin.system).shortening_by_offset(state.x)
        for i, k in changed:
            into[2 * i, k] += by_offset[i]


def _point_rates(twin: Twin, state: State, weights: Weights) -> Floats:
    """d(weighted point)/dz, shape (3, n_unknowns - n_cables)."""
    layout = twin.system.layout
    rows: list[Floats] = []
    for axis in range(3):
        gradient = np.zeros(3 * layout.n_points + layout.n_pressures)
        for point, weight in weights:
            gradient[3 * point + axis] += weight
        rows.append(twin.system.motion.reduce_gradient(state, gradient))
    return np.array(rows)


def angles(R: Floats) -> tuple[float, float, float]:
    """pitch, roll, yaw [rad] of a rotation: pitch = atan2(R02, R22), roll = -asin R12, yaw = atan2(R10, R11).

    Pitch is the inclination towards +x, roll the one about x, yaw the rotation about z; each is the whole rotation
    angle when the others are zero (R = Ry(pitch) Rx(roll) Rz(yaw)).
    """
    return (
        float(np.arctan2(R[0, 2], R[2, 2])),
        float(-np.arcsin(np.clip(R[1, 2], -1.0, 1.0))),
        float(np.arctan2(R[1, 0], R[1, 1])),
    )


# omega x, for omega along each axis
_SPINS = np.cross(np.eye(3)[:, None, :], np.eye(3)[None, :, :]).swapaxes(1, 2)


def _angle_rates(R: Floats) -> Floats:
    """d(pitch, roll, yaw)/d omega for R <- exp(omega) R; shape (3, 3)."""
    rates = np.zeros((3, 3))
    for k in range(3):
        dR = _SPINS[k] @ R  # omega x each column
        rates[0, k] = (R[2, 2] * dR[0, 2] - R[0, 2] * dR[2, 2]) / (R[0, 2] ** 2 + R[2, 2] ** 2)
        rates[1, k] = -dR[1, 2] / np.sqrt(max(1.0 - R[1, 2] ** 2, 1e-300))
        rates[2, k] = (R[1, 1] * dR[1, 0] - R[1, 0] * dR[1, 1]) / (R[1, 0] ** 2 + R[1, 1] ** 2)
    return rates
