"""Interface of another program that solves a robot, to be compared with softcal or to take its place; and what softcal
exports to no other program, contact: parts may pass through each other there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from softcal.calibration.problem.problem import SOFTCAL, Simulate
from softcal.catalogue import Catalogue
from softcal.checks import Floats
from softcal.declare import Checked, Declared
from softcal.display import displayed
from softcal.errors import Fault, SimulationError
from softcal.sensing.channel import channel_name
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot

_INSTEAD = "parts may pass through each other. Compare small bending only, or set contact: false."


@dataclass(frozen=True)
class EngineState:
    """An equilibrium computed by an engine.

    Attributes
    ----------
    efforts, coordinates : mapping of str to float
        Actuator -> effort and coordinate [SI], of a cable tension and shortening, unless prescribed.
    plates : mapping of str to (position, rotation)
        Plate -> position (3,) [m] and rotation (3, 3).
    points : mapping of str to array
        Body or rod -> positions of the nodes (n, 3) [m].
    needed : mapping of str to float
        For an engine with prescribed efforts: actuator -> effort [SI] that it needs for softcal's coordinate, to first
        order by softcal's exact stiffness.
    """

    efforts: Mapping[str, float]
    coordinates: Mapping[str, float]
    plates: Mapping[str, tuple[Floats, Floats]]
    points: Mapping[str, Floats]
    needed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Running:
    """Settings of an engine's runs: timeout of each process [s], None for its default; its settings, if any."""

    timeout: float | None = None
    settings: Declared | None = None


@displayed
@dataclass(frozen=True)
class Engine(Checked):
    """Another program that solves a robot's statics.

    Attributes
    ----------
    name : str
        By which options and project files know it.
    own : callable
        Converts the robot to the engine's law and elements, without contact where the engine leaves it out.
    missing : callable
        Why the engine cannot run here and how to install it, or "".
    solve : callable
        Solves a robot for a protocol of one sample, given softcal's shape and the settings.
    lacks : callable
        Faults of a robot's features that the engine does not support.
    leaves_out : callable
        Relative difference at a shape explained by the engine's model, and the neglected effect; 0 and "" if none.
    simulator : callable or None
        From the engine's settings (None where it has none) and a robot to what takes the place of `simulate` for it,
        checked to be possible; None for an engine that is only compared with.
    settings : class or None
        The frozen dataclass, with defaults, into which `engines: NAME:` of a project file is read; None where there
        is nothing to state.
    """

    name: str
    own: Callable[[Robot], Robot]
    missing: Callable[[], str]
    solve: Callable[[Robot, Protocol, Snapshot, Running], EngineState]
    lacks: Callable[[Robot], list[Fault]] = lambda robot: []
    leaves_out: Callable[[Snapshot], tuple[float, str]] = lambda shape: (0.0, "")
    simulator: Callable[[Any, Robot], Simulate] | None = None
    settings: type[Declared] | None = None

    def leaves_out_contact(self, robot: Robot) -> bool:
        """True if the robot has contact that the engine omits."""
        return robot.contact is not None and self.own(robot).contact is None

    @property
    def module(self) -> str:
        """Module that defines the engine."""
        return self.solve.__module__ or ""


def _faults(engine: Engine, known: Mapping[str, Engine]) -> list[Fault]:
    """Faults of an engine to be registered."""
    if not isinstance(engine, Engine):  # pyright: ignore[reportUnnecessaryIsInstance] (an entry point may be anything)
        return [Fault("this is not an engine", "engine", repr(engine)[:60], "a softcal.Engine")]
    if engine.name == SOFTCAL:
        what = "softcal is the engine that others are compared with"
        return [Fault(what, "engine", engine.name, attempt="another name")]
    return []


ENGINES: Catalogue[Engine] = Catalogue("engine", "softcal.engines", _faults)

register_engine = ENGINES.registrar(
    "register_engine", "Add an engine: `crosscheck --engines` then accepts its name, and `--engine` if it can simulate."
)


def engine_settings(name: str, stated: Mapping[str, Declared]) -> Any:
    """The settings of an engine among those that a project states, else its defaults; None where it has none."""
    kind = ENGINES[name].settings
    return stated.get(name) or (None if kind is None else kind())


def state_of(response: Response) -> EngineState:
    """The last state of a response with snapshots.

    Raises
    ------
    SimulationError
        Where the response did not get there.
    """
    if not response.succeeded:
        raise SimulationError(response.status)
    shape = response.snapshots[-1]
    last: dict[str, dict[str, float]] = {"effort": {}, "coordinate": {}, "": {}}
    for channel, values in response.channels.items():
        name = channel_name(channel)
        last[name.kind.drives][name.carrier] = float(values[-1])
    return EngineState(last["effort"], last["coordinate"], shape.plates, {**shape.points, **shape.rods})


def cable_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of friction along cables, their stretch and pretension; program: such as "SOFA".

    Without a friction coefficient the preload and the speed of friction have no effect, and are no fault.
    """
    faults: list[Fault] = []
    for cable in robot.cables:
        if (mu := cable.friction_coefficient) > 0.0:
            parts = [name for name in ("friction_preload", "friction_speed") if getattr(cable.line, name) is not None]
            faults.append(
                Fault(f"a cable in {program} has no friction", cable.name, ", ".join([f"{mu:g}", *parts]), "0")
            )
        if cable.line.friction_memory:
            where, got, allowed = f"{cable.name}.line", "friction_memory: true", "friction_memory: false"
            faults.append(Fault(f"friction of a cable in {program} has no memory", where, got, allowed))
        elastic = [name for name in cable.properties if name not in ("presliding", "friction_preload")]
        if elastic:
            got, allowed = ", ".join(elastic), "a cable without stretch"
            faults.append(Fault(f"a cable in {program} does not stretch", f"{cable.name}.line", got, allowed))
    return faults


def actuator_faults(robot: Robot, program: str, *kinds: str) -> list[Fault]:
    """Faults of actuators other than cables and those kinds; program: such as "SOFA"."""
    what, allowed = f"this actuator is not exported to {program}", ", ".join(("cable", *kinds))
    own = (part for part in robot.actuators if part.actuator.name not in kinds)
    return [Fault(what, part.name, part.actuator.name, allowed) for part in own]


def history_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of materials that relax, soften or flow; program: such as "SOFA"."""
    return [
        Fault(
            f"the history of a material is not exported to {program}",
            f"{part.name}.history",
            ", ".join(part.history),
            "an elastic material",
            "a project without history, with the moduli after a long time",
        )
        for part in robot.deformable
        if part.history
    ]


def not_exported(robot: Robot, place: str) -> tuple[str, ...]:
    """The sentence on contact that an export leaves out; none for a robot without. place: such as "the scene"."""
    return () if robot.contact is None else (f"Contact is not exported: in {place} {_INSTEAD}",)


def left_out_by(program: str) -> str:
    """The sentence on contact that another program leaves out where it takes softcal's place."""
    return f"Contact is left out by {program}: {_INSTEAD}"


def contact_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of bodies that lie loose without contact; program: such as "SOFA"."""
    if robot.contact is None:
        return []
    attached = {body.name for body in robot.bodies if len(body.fixed)}
    attached |= {name for plate in robot.plates for name in plate.nodes}
    attached |= {name for tie in robot.ties for name in (tie.body, tie.on)}
    return [
        Fault(
            f"contact is not exported to {program}, and the body is not attached otherwise",
            where=body.name,
            attempt="a body that is fixed, or tied to a plate or another body",
        )
        for body in robot.bodies
        if body.name not in attached
    ]
