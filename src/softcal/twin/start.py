"""The start of every protocol: the robot under its dead loads, all cables slack; in time, with its pretensions."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.march import Reached, Target, reach
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.path import follow
from softcal.mechanics.rod import RodTerm
from softcal.mechanics.stability import is_stable
from softcal.mechanics.state import State, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Theta
from softcal.twin.build import Twin
from softcal.twin.loads import Weights
from softcal.twin.protocol import Command, Protocol, controls_at
from softcal.twin.response import Snapshot
from softcal.units import format_quantity

UNDER_LOADS = "under its loads"


def instability(where: str) -> str:
    """The sentence, with a blank before it, on a robot that snaps or buckles there."""
    return f" Not stable {where}, the robot buckles or snaps to another equilibrium."


def slack_line(twin: Twin) -> Line:
    """Controls with every actuator at prescribed effort zero: all cables slack."""
    n = twin.system.layout.n_actuators
    return Line(np.ones(n, dtype=bool), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))


@dataclass(frozen=True)
class Start:
    """The robot under its dead loads, with the memory that this leaves to the first sample. snaps: whether it buckles
    or snaps through as they are applied.
    """

    state: State
    snaps: bool = False


def loaded(twin: Twin, statics: Statics, names: tuple[str, ...] = ()) -> Start:
    """The stable equilibrium under the dead loads, applied in adaptive steps.

    Parameters
    ----------
    twin
        The twin.
    statics
        The system at its parameters, with the factors of its tangent.
    names
        Parameters (k,) by which its memory has derivatives.

    Raises
    ------
    SimulationError
        Where there is none.
    """
    rest, line = rest_state(twin.system.layout), slack_line(twin)
    if not twin.system.is_loaded(statics.theta):
        start = Start(rest)
    elif (direct := statics.equilibrium(rest, line.at(0.0))).converged and is_stable(
        statics, statics.tangent_at(direct.state, line.at(0.0))
    ):
        start = Start(direct.state)
    else:
        ramp = replace(line, load=0.0, load_rate=1.0)
        path = follow(statics, ramp, node_at(statics, ramp, 0.0, rest, ()), 1.0, first_step=0.2)
        if not path.reached:
            reached = 100.0 * path.nodes[-1].c
            raise SimulationError(f"Under the dead loads {path.ended} {reached:.3g} % of them: {path.status}.")
        start = Start(path.nodes[-1].state, any(node.is_snapped for node in path.nodes))
    if not twin.system.remembers:
        return start
    node = node_at(statics, line, 0.0, start.state, names, mixed=False)
    state = twin.system.advanced(node.state, line.at(0.0), statics.theta, node.by_parameter, names)
    return replace(start, state=state)


def pretensioned(twin: Twin, statics: Statics, slack: Collection[str]) -> Start:
    """The stable equilibrium under the dead loads with all cables that have a pretension at zero shortening, but for
    some that are slack.

    Parameters
    ----------
    twin
        The twin.
    statics
        The system at its parameters, with the factors of its tangent.
    slack
        Names of these.

    Raises
    ------
    SimulationError
        Where there is none.
    """
    start, system = loaded(twin, statics), twin.system
    zero = {name: one for name, one in Protocol({}).completed(twin.robot, 1).commands.items() if name not in slack}
    # The cables of a drive stay tense where a torque turns it.
    turned = [part for part in twin.robot.pretensioned if part.name in system.followers and part.name in slack]
    zero |= {part.name: Command(part.channels[1].name, np.zeros(1)) for part in turned}
    if not zero:
        return start
    here = system.commanded(start.state, statics.theta)
    target = controls_at(system, zero, dict.fromkeys(zero, 0.0), here)
    begun = Reached(start.state, replace(slack_line(twin).at(0.0), coordinate=here), np.zeros((0, 0)))
    reached = reach(statics, begun, Target(target))
    return Start(reached.state, start.snaps or reached.snaps)


def snapshot(twin: Twin, state: State, theta: Theta, controls: dict[str, float], drive: float, unit: str) -> Snapshot:
    """The shape of a state, to draw.

    Parameters
    ----------
    twin
        The twin.
    state
        The state.
    theta
        Parameter values [SI] by dotted name.
    controls
        Actuator -> its command [SI].
    drive
        Place in an animation, see `Snapshot`.
    unit
        Unit of the drive.
    """
    robot = twin.robot
    points = {
        name: state.x[first : first + twin.meshes[name].n_points].copy()
        for name, first in twin.first_point.items()
        if name in twin.meshes
    }
    rods = {rod.name: state.x[twin.first_point[rod.name] :][: len(rod.centreline.nodes)].copy() for rod in robot.rods}

    def place(weights: Weights) -> Floats:
        return sum((w * state.x[p] for p, w in weights), np.zeros(3))

    routes = {name: np.array([place(weights) for weights in via]) for name, via in twin.routes.items()}
    plates = {name: (state.position[i].copy(), state.rotation[i].copy()) for name, i in twin.frame.items()}
    still = np.zeros(3), np.eye(3)
    markers = {
        name: marker.position(state.x, plates.get(marker.marker.on, still)[1]) for name, marker in twin.markers.items()
    }
    numbers = {part.name: twin.system.number(part.name) for part in robot.actuated}
    coordinates = twin.system.coordinates(state, theta)
    pressures: dict[str, Floats] = {}
    for name, (first, body, nodes) in twin.pressure_nodes.items():
        pressures[name] = np.zeros(twin.meshes[body].n_points)
        pressures[name][nodes] = state.pressure[first : first + len(nodes)]
    strains = {term.name: term.strains(state.position, state.rotation)[:, :3] for term in twin.system.of(RodTerm)}
    rod_strains: dict[str, float] = {}
    for rod in robot.rods:
        whole = np.concatenate([strains[material.name] for material in rod.materials])
        rod_strains[rod.name] = float(np.sqrt(np.mean(np.sum(whole**2, axis=1))))
    sample = f"sample {drive:.0f}" if drive else "at rest"
    return Snapshot(
        label=format_quantity(drive, unit, digits=6 if unit == "s" else 4) if unit else sample,
        points=points,
        routes=routes,
        plates=plates,
        controls=controls,
        efforts={name: float(state.effort[i]) for name, i in numbers.items()},
        coordinates={name: float(coordinates[i]) for name, i in numbers.items()},
        rods=rods,
        pressures=pressures,
        markers=markers,
        drive=drive,
        drive_unit=unit,
        rod_strains=rod_strains,
    )
