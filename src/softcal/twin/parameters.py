"""The robot's parameters by dotted name: their units and hard limits, and a robot with changed values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, ParameterError, unknown
from softcal.geometry.shape import LENGTHS
from softcal.materials.catalogue import LAWS, constants_of
from softcal.quantities import GRAVITY, QUANTITIES, Quantity
from softcal.twin.actuated import ACTUATORS
from softcal.twin.lengths import with_lengths
from softcal.twin.material import Material
from softcal.twin.parameter_name import parameter_name
from softcal.twin.robot import Body, Moment, PointLoad, Robot, Rod, SurfaceLoad

Part = TypeVar("Part", Body, Rod, Material)
Whole = TypeVar("Whole", Body, Rod)


@displayed
@dataclass(frozen=True)
class ParameterInfo:
    """A parameter that exists.

    Attributes
    ----------
    name : str
        Dotted, such as `neck.youngs_modulus`.
    quantity : Quantity
        The kind of quantity it is, with unit and range.
    value : float
        The robot's own [SI].
    shapes : bool
        Whether the undeformed robot depends on it, or where it is seen, so that another value needs another twin.
    """

    name: str
    quantity: Quantity
    value: float
    shapes: bool = False

    @property
    def unit(self) -> str:
        return self.quantity.unit

    @property
    def floor(self) -> float:
        """The lower end of its range [unit]."""
        return self.quantity.lower

    @property
    def ceiling(self) -> float:
        """The upper end [unit] where physics sets it, such as 0.5 for Poisson's ratio; else infinite."""
        return self.quantity.upper if self.quantity.ends[1] == ")" else math.inf


MODULUS = "Pa"  # unit of moduli
# By x, y and z.
MARKER_OFFSETS = tuple(f"{axis}_offset" for axis in "xyz")
# Of those of the robot's parts but actuators: see `kinds_of_quantity`.
KINDS: dict[str, Quantity] = {
    **{parameter_name(name).kind: QUANTITIES["acceleration"] for name in GRAVITY},
    "density": QUANTITIES["density"],
    "mass": QUANTITIES["mass"],
    "friction_coefficient": QUANTITIES["friction coefficient"],
    "force": QUANTITIES["force"],
    "moment": QUANTITIES["moment"],
    "routing_offset": QUANTITIES["length"],
    "routing_angle": QUANTITIES["angle"],
    "routing_twist": QUANTITIES["twist"],
    "clamp_depth": QUANTITIES["length"],
    **LENGTHS,
    **dict.fromkeys(MARKER_OFFSETS, QUANTITIES["length"]),
    "stiffness": QUANTITIES["stiffness of a cable"],
    "compliance": QUANTITIES["compliance"],
    "pretension": QUANTITIES["tension"],
    "spring_rate": QUANTITIES["spring rate"],
    "rest_length": QUANTITIES["size"],
    "presliding": QUANTITIES["presliding displacement"],
    "friction_preload": QUANTITIES["tension"],
}


def kind_by_name(name: str) -> Quantity | None:
    """The kind of quantity of a robot parameter by its dotted name alone; None where the name does not determine it."""
    key = parameter_name(name).kind
    constant = constants_of(LAWS).get(key)
    if constant is not None:
        return constant.quantity
    return kinds_of_quantity().get(key)


def kinds_of_quantity() -> Mapping[str, Quantity]:
    """The kind of quantity of every robot parameter that is no constant of a law, by the last part of its dotted name;
    of the actuators too.
    """
    return KINDS | {key: quantity for actuator in ACTUATORS.values() for key, quantity in actuator.quantities.items()}


@checked_arguments
def robot_parameters(robot: Robot) -> Mapping[str, ParameterInfo]:
    """Every parameter of the robot by dotted name, such as `neck.youngs_modulus`."""
    return _parameters(robot)


@lru_cache(maxsize=16)  # the problem, the twin and the loss of one evaluation look these up
def _parameters(robot: Robot) -> Mapping[str, ParameterInfo]:
    infos: dict[str, ParameterInfo] = {}

    def add(owner: str, key: str, value: float, quantity: Quantity | None = None, *, shapes: bool = False) -> None:
        name = f"{owner}.{key}"
        infos[name] = ParameterInfo(name, KINDS[key] if quantity is None else quantity, value, shapes)

    for body in robot.bodies:
        for material in body.materials:
            for constant in body.constants:
                add(material.name, constant.name, material.parameters[constant.name], constant.quantity)
            add(material.name, "density", material.density)
        if body.clamp is not None and body.zone is not None:
            add(body.name, "clamp_depth", body.clamp.depth, body.zone.depths, shapes=True)
        if body.shape is not None:
            for key, value in body.shape.values.items():
                add(body.name, key, value, shapes=True)
    for rod in robot.rods:
        for material in rod.materials:
            for constant in rod.constants:
                add(material.name, constant.name, material.parameters[constant.name], constant.quantity)
            add(material.name, "density", material.density)
    for plate in robot.plates:
        add(plate.name, "mass", plate.mass)
    for cable in robot.cables:
        add(cable.name, "friction_coefficient", cable.friction_coefficient)
        for key, value in cable.properties.items():
            add(cable.name, key, value)
    for part in robot.actuators:
        for key, value in part.values.items():
            add(part.name, key, value, part.actuator.quantities[key])
    for cable in robot.cables:
        for name, value in cable.placing.items():
            named = parameter_name(name)
            is_offset = named.kind == "routing_offset"
            away = replace(KINDS[named.kind], lower=cable.least_offset, ends="(]") if is_offset else None
            add(named.owner, named.kind, value, away, shapes=True)
    for marker in robot.markers:
        for key, offset in zip(MARKER_OFFSETS, marker.offset.tolist(), strict=True):
            add(marker.name, key, offset, shapes=True)
    for load in robot.loads:
        if isinstance(load, PointLoad):
            add(load.name, "force", float(np.dot(load.force, load.direction)))
        elif isinstance(load, Moment):
            add(load.name, "moment", float(np.dot(load.moment, load.direction)))
    for name, value in zip(GRAVITY, robot.gravity.tolist(), strict=True):
        named = parameter_name(name)
        add(named.owner, named.kind, value)
    return MappingProxyType(infos)


def parameter_values(robot: Robot, theta: Mapping[str, float] | None = None) -> dict[str, float]:
    """The value [SI] of every parameter by dotted name: that in theta, or the robot's own. Not checked."""
    return {**{name: info.value for name, info in robot_parameters(robot).items()}, **(theta or {})}


def value_faults(known: Mapping[str, ParameterInfo], theta: Mapping[str, float]) -> list[Fault]:
    """The faults of values by name: an unknown name (with the nearest that exists), a value out of range."""
    return [
        fault
        for name, value in theta.items()
        if (fault := unknown_name(name, known) if name not in known else out_of_range(known[name], value))
    ]


@checked_arguments
def with_parameters(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with some parameters changed; the same object if none differs.

    For storing or exporting a robot. To simulate one robot at many values, give `simulate` theta.

    Raises
    ------
    ParameterError
        For an unknown name (with the nearest known one) or a value outside its interval; all faults at once.
    MeshError
        For lengths of a body that its mesh cannot have.
    """
    known = robot_parameters(robot)
    if faults := value_faults(known, values):
        raise ParameterError(faults)
    if all(value == known[name].value for name, value in values.items()):
        return robot
    robot = with_lengths(robot, values)
    bodies = tuple(
        replace(
            _with_materials(body, values),
            clamp=body.clamp and replace(body.clamp, depth=values.get(f"{body.name}.clamp_depth", body.clamp.depth)),
        )
        for body in robot.bodies
    )
    rods = tuple(_with_materials(rod, values) for rod in robot.rods)
    plates = tuple(replace(p, mass=values.get(f"{p.name}.mass", p.mass)) for p in robot.plates)
    cables = tuple(
        replace(
            c.with_properties(
                {key: values[name] for key in c.properties if (name := f"{c.name}.{key}") in values}
            ).placed_by(values),
            friction_coefficient=values.get(f"{c.name}.friction_coefficient", c.friction_coefficient),
        )
        for c in robot.cables
    )
    loads = list(robot.loads)
    for i, load in enumerate(loads):
        key = "moment" if isinstance(load, Moment) else "force"
        size = values.get(f"{load.name}.{key}")
        if size is not None and not isinstance(load, SurfaceLoad) and load.direction.any():
            loads[i] = replace(load, **{key: size * load.direction})
    markers = tuple(marker.offset_by(values) for marker in robot.markers)
    actuators = tuple(part.with_values(values) for part in robot.actuators)
    return replace(
        robot,
        bodies=bodies,
        rods=rods,
        plates=plates,
        cables=cables,
        actuators=actuators,
        loads=tuple(loads),
        markers=markers,
        gravity=np.array([values.get(name, g) for name, g in zip(GRAVITY, robot.gravity.tolist(), strict=True)]),
    )


def with_shape(robot: Robot, theta: Mapping[str, float]) -> Robot:
    """The robot with those of the values that its undeformed shape depends on; the robot itself where theta changes
    none.

    Raises
    ------
    ParameterError, MeshError
        For a shape that it cannot have.
    """
    if not theta:
        return robot
    known = robot_parameters(robot)
    shape = {name: theta[name] for name, info in known.items() if info.shapes and name in theta}
    return with_parameters(robot, shape) if shape else robot


def _with_materials(part: Whole, values: Mapping[str, float]) -> Whole:
    inclusions = (_with_material(one, values, f"{part.name}.{one.name}") for one in part.inclusions)
    return replace(_with_material(part, values, part.name), inclusions=tuple(inclusions))


def _with_material(part: Part, values: Mapping[str, float], name: str) -> Part:
    return replace(
        part,
        parameters={key: values.get(f"{name}.{key}", old) for key, old in part.parameters.items()},
        density=values.get(f"{name}.density", part.density),
    )


def unknown_name(name: str, known: Mapping[str, object]) -> Fault:
    """The fault of a parameter that does not exist, with the nearest that does."""
    owner, kind = parameter_name(name).owner, parameter_name(name).kind
    of_the_same = [one for one in known if parameter_name(one).owner == owner]
    fault = unknown("there is no such parameter", name, name, sorted(known), among=of_the_same, got="")
    if kind == "compliance" and f"{owner}.friction_coefficient" in of_the_same:
        return replace(fault, attempt=f"`line: {{compliance: 0 mm/N}}` of the cable {owner}, which has none yet")
    return fault


def out_of_range(info: ParameterInfo, value: float) -> Fault | None:
    """The fault of a value that is no number, or outside the parameter's range; or None."""
    return info.quantity.fault(value, info.name)
