"""Conversion of SOFA's states at rest to the twin's channels, sample by sample, and to shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation

from softcal.checks import Floats
from softcal.mechanics.cable import cables_of
from softcal.mechanics.chamber import ChamberTerm
from softcal.plugins.sofa.scene import begins_first
from softcal.sensing.channel import kinds
from softcal.sensing.sensors.actuators import TENSION
from softcal.twin.actuators.drive import Drive
from softcal.twin.build import Twin
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Protocol
from softcal.twin.response import Snapshot
from softcal.twin.sensors import angle_columns, channel_units, read_all

SAME = 1e-9  # of a cable's length: difference below which two shortenings are equal
Record = Mapping[str, Any]


@dataclass(frozen=True)
class SofaSamples:
    """Channels at the reached samples (n, n_channels), and their slopes by the driven cable's command.

    error: error of the interpolation over each unit's largest value; 0 if every sample is a state.
    """

    values: Floats
    slopes: Floats | None
    error: float = 0.0


@dataclass(frozen=True)
class RecordPosture:
    """A record as sensors see it.

    Attributes
    ----------
    pumped : Chamber -> what its pump has displaced [m^3]
    drives : Those of the robot, by name
    """

    record: Record
    pumped: Mapping[str, float] = field(default_factory=dict)
    drives: Mapping[str, Drive] = field(default_factory=dict)

    def point(self, name: str) -> Floats:
        """Position (3,) [m] of a marker or plate."""
        if name in self.record["plates"]:
            return _pose(self.record["plates"][name])[0]
        return np.array(self.record["markers"][name], dtype=float)

    def rotation(self, plate: str) -> Floats:
        """Rotation (3, 3) of a plate."""
        return _pose(self.record["plates"][plate])[1]

    def coordinate(self, actuator: str) -> float:
        """Shortening [m] of a cable, volume [m^3] displaced by the pump of a chamber, or zero [rad] of a drive."""
        if actuator in self.record["cables"]:
            return self.record["cables"][actuator]["shortening"]
        if actuator in self.drives:
            return self.drives[actuator].zero or 0.0
        return self.pumped[actuator]

    def effort(self, actuator: str) -> float:
        """Tension [N] of a cable, pressure [Pa] of a chamber, or torque [N m] of a drive."""
        if actuator in self.record["cables"]:
            return self.record["cables"][actuator]["tension"]
        if actuator in self.drives:
            return self.drives[actuator].torque({name: one["tension"] for name, one in self.record["cables"].items()})
        return self.record["chambers"][actuator]["pressure"]


def table(twin: Twin, records: Sequence[Record]) -> Floats:
    """Records as rows, with unwrapped angles."""
    values = np.array([read_all(twin, _posture(twin, record)) for record in records])
    values = values.reshape(len(records), len(twin.columns))
    turns = angle_columns(twin)
    values[:, turns] = np.unwrap(values[:, turns], axis=0)
    return values


def _posture(twin: Twin, record: Record) -> RecordPosture:
    pumped: dict[str, float] = {}
    for term in twin.system.of(ChamberTerm):
        chamber = record["chambers"][term.name]
        swallowed = term.filling(parameter_values(twin.robot)).swallowed(chamber["pressure"])
        pumped[term.name] = chamber["volume"] - term.rest_volume + swallowed
    drives = {part.name: part.actuator for part in twin.robot.actuators if isinstance(part.actuator, Drive)}
    return RecordPosture(record, pumped, drives)


def along_one_cable(
    twin: Twin, protocol: Protocol, cable: str, states: Floats, records: Sequence[Record]
) -> SofaSamples:
    """The samples of the driven cable, interpolated by a cubic spline between states along its control.

    Nothing moves until the cable becomes taut.

    Parameters
    ----------
    twin
        The robot as a system.
    protocol
        Its commands.
    cable
        The driven cable.
    states
        Its control in each state (n_states,) [m] or [N].
    records
        What SOFA reached; first the robot with all cables slack.
    """
    i = [one.name for one in twin.robot.cables].index(cable)
    command = protocol.commands[cable]
    own = twin.column(cable, kinds()[command.control])
    rows = table(twin, records)
    taut_at = rows[0, own] if command.control == "shortening" else 0.0
    rows[0, twin.column(cable, TENSION)] = 0.0
    reached = states[: len(rows) - 1]
    taut = reached > taut_at + SAME * float(cables_of(twin.system).rest_length[i])
    c = np.append(taut_at, reached[taut])
    nodes = np.vstack([rows[:1], rows[1:][taut]])
    given = command.values
    far = given > c[-1] + 1e-12 * abs(c[-1]) if len(reached) < len(states) else np.zeros(len(given), dtype=bool)
    n = int(np.argmax(far)) if far.any() else len(given)
    if len(reached) == 0 and len(states):
        n = 0
    if len(c) == 1:
        values, slopes = np.repeat(nodes, n, axis=0), np.zeros((n, nodes.shape[1]))
    else:
        spline = make_interp_spline(c, nodes, k=min(3, len(c) - 1))
        at = np.clip(given[:n], c[0], c[-1])
        values, slopes = spline(at), spline(at, 1)
        slopes[given[:n] <= taut_at] = 0.0
    values[:, own] = given[:n]
    slopes[:, own] = 1.0
    between = not np.isin(given[:n][given[:n] > taut_at], states).all()
    return SofaSamples(values, slopes, _spline_error(twin, c, nodes) if between else 0.0)


def row_by_row(twin: Twin, protocol: Protocol, records: Sequence[Record]) -> SofaSamples:
    """One record per sample, after that of the slack robot.

    Parameters
    ----------
    twin, protocol
        The robot as a system, and its commands.
    records
        What SOFA reached; first the robot with all cables slack.
    """
    rows = table(twin, records)[1:]
    for cable, command in protocol.commands.items():
        rows[:, twin.column(cable, kinds()[command.control])] = command.values[: len(rows)]
    return SofaSamples(rows, None)


def shapes(
    twin: Twin, protocol: Protocol, records: Sequence[Record], states: Sequence[Mapping[str, float]]
) -> tuple[Snapshot, ...]:
    """The records as shapes; the one at rest first.

    Parameters
    ----------
    twin, protocol, records
        See `row_by_row`.
    states
        Actuator -> shortening [m], tension [N] or pressure [Pa], of each state after the first.
    """
    commanded: list[Mapping[str, float]] = [dict.fromkeys(protocol.commands, 0.0), *states]
    found: list[Snapshot] = []
    for record, controls in zip(records, commanded, strict=False):
        label = "at rest" if record is records[0] else f"state {record['state']}"
        posture, actuators = _posture(twin, record), [part.name for part in twin.robot.actuated]
        found.append(
            Snapshot(
                label=label,
                points={name: np.array(points) for name, points in record["points"].items()},
                # In the robot's order; the scene's order starts at the pull point.
                routes={
                    cable.name: np.array(record["cables"][cable.name]["points"])[:: 1 if begins_first(cable) else -1]
                    for cable in twin.robot.cables
                },
                plates={name: _pose(at) for name, at in record["plates"].items()},
                controls=dict(controls),
                efforts={name: float(posture.effort(name)) for name in actuators},
                coordinates={name: float(posture.coordinate(name)) for name in actuators if name not in posture.drives},
                rods={name: np.array(points) for name, points in record["rods"].items()},
                markers={name: np.array(at) for name, at in record["markers"].items()},
            )
        )
    return tuple(found)


def _pose(at: Sequence[float]) -> tuple[Floats, Floats]:
    """Position and rotation from x, y, z and a quaternion (x, y, z, w)."""
    return np.array(at[:3], dtype=float), Rotation.from_quat(at[3:]).as_matrix()


def _spline_error(twin: Twin, c: Floats, nodes: Floats) -> float:
    """Error estimate of the spline: a sixteenth of the change by omitting every second state."""
    if len(c) < 5:
        return float("nan")
    kept = np.union1d(np.arange(0, len(c), 2), [len(c) - 1])
    coarse: BSpline = make_interp_spline(c[kept], nodes[kept], k=min(3, len(kept) - 1))
    units = np.array(list(channel_units(twin).values()))
    largest = np.abs(nodes).max(axis=0)
    scale = np.array([largest[units == unit].max() for unit in units]) + 1e-300
    return float((np.abs(coarse(c) - nodes) / scale).max() / 16.0)
