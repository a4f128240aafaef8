"""The robot: deformable bodies, rods, rigid plates, cables, loads, markers. Frozen; numbers in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.errors import Fault, InputError
from softcal.geometry.centreline import Centreline
from softcal.geometry.mesh import TetMesh
from softcal.geometry.section import CrossSection
from softcal.materials.catalogue import LAWS
from softcal.materials.elastic_constants import LINEAR_ELASTIC
from softcal.materials.parameter import complete
from softcal.mechanics.elements import DEFAULT, ELEMENTS
from softcal.sensing.sensor import NamedSensor
from softcal.twin.barrier import Contact
from softcal.twin.cables import Cable, ViaPoint

Control = Literal["tension", "shortening"]


@dataclass(frozen=True)
class Material:
    """A material of some tets of a mesh.

    Attributes
    ----------
    name : First part of its parameters' names
    tets : Numbers of its tets (n,)
    parameters : Constants of the law [SI] by name
    density : [kg/m^3]
    """

    name: str
    tets: Ints
    parameters: Mapping[str, float]
    density: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "tets", frozen_ints(self.tets, name=f"tets of {self.name}", shape=(None,)))
        object.__setattr__(self, "parameters", dict(self.parameters))


@dataclass(frozen=True)
class Body:
    """A deformable body.

    Attributes
    ----------
    name : First part of its parameters' names
    mesh : Linear or quadratic [m]; converted to the element's order, with straight edges where nodes are added
    fixed : Numbers of the mesh nodes that do not move (n,)
    parameters : The law's constants [SI] by name (neo-hooke: youngs_modulus [Pa], poissons_ratio [-])
    law : Name of one of softcal's laws, or of a registered one
    element : Name of one of softcal's elements (P1, P2, P2P1; see `softcal.mechanics.elements`), or of a registered one
    density : [kg/m^3]
    inclusions : Tets of other materials of the same law, with shared nodes; constants not given are the body's
    """

    name: str
    mesh: TetMesh
    fixed: Ints
    parameters: Mapping[str, float]
    law: str = "neo-hooke"
    element: str = DEFAULT.name
    density: float = 0.0
    inclusions: tuple[Material, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", frozen_ints(self.fixed, name=f"fixed nodes of {self.name}", shape=(None,)))
        ELEMENTS.named(self.element, where=f"{self.name}.element")
        constants = LAWS.named(self.law, where=f"{self.name}.law").parameters
        own = complete(self.parameters, constants, owner=self.name)
        object.__setattr__(self, "parameters", own)
        inclusions = (
            replace(one, parameters=complete({**own, **one.parameters}, constants, owner=f"{self.name}.{one.name}"))
            for one in self.inclusions
        )
        object.__setattr__(self, "inclusions", tuple(inclusions))
        times = np.zeros(self.mesh.n_tets, dtype=np.int64)
        for part in self.inclusions:
            np.add.at(times, part.tets, 1)
        if (times > 1).any():
            names = ", ".join(part.name for part in self.inclusions)
            raise InputError(Fault(f"{int((times > 1).sum())} tets are of two materials", self.name, got=names))
        if self.inclusions and times.all():
            names = ", ".join(part.name for part in self.inclusions)
            attempt = "one of them as the body's own material"
            raise InputError(Fault("the materials leave no tet to the body's own", self.name, names, attempt=attempt))

    @property
    def materials(self) -> tuple[Material, ...]:
        """Every material, named as its parameters are: the body's own, by its name, then `body.inclusion`."""
        rest = np.ones(self.mesh.n_tets, dtype=bool)
        for part in self.inclusions:
            rest[part.tets] = False
        own = Material(self.name, np.flatnonzero(rest), self.parameters, self.density)
        return (own, *(replace(part, name=f"{self.name}.{part.name}") for part in self.inclusions))


@dataclass(frozen=True)
class Rod:
    """A slender elastic part as a geometrically exact rod: a backbone, or the wire of a helical spring.

    Attributes
    ----------
    name : First part of its parameters' names
    centreline, section : Undeformed, stress-free shape [m], and cross-section
    parameters : youngs_modulus [Pa], poissons_ratio [-]
    clamped : Plate name -> numbers of the centreline nodes (n,) that move rigidly with the plate
    fixed : Numbers of the nodes that do not move (n,)
    density : [kg/m^3]
    """

    name: str
    centreline: Centreline
    section: CrossSection
    parameters: Mapping[str, float]
    clamped: Mapping[str, Ints] = field(default_factory=dict)
    fixed: Ints = field(default_factory=lambda: frozen_ints([], name="fixed", shape=(None,)))
    density: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", complete(self.parameters, LINEAR_ELASTIC, owner=self.name))
        object.__setattr__(self, "fixed", frozen_ints(self.fixed, name=f"fixed nodes of {self.name}", shape=(None,)))
        clamped = {key: frozen_ints(n, name=f"nodes of {self.name}", shape=(None,)) for key, n in self.clamped.items()}
        object.__setattr__(self, "clamped", clamped)
        n = len(self.centreline.nodes)
        held = np.concatenate([self.fixed, *clamped.values()])
        if len(held) and not (held.min() >= 0 and held.max() < n):
            raise InputError(
                Fault("the rod has no such node", self.name, got=str(int(held.max())), allowed=f"0 to {n - 1}")
            )
        if len(np.unique(held)) != len(held):
            raise InputError(
                Fault("a node of the rod is fixed or clamped twice", self.name, got=str(np.sort(held).tolist()))
            )


@dataclass(frozen=True)
class Disc:
    """The shape of a plate: a flat cylinder, drawn and kept clear of bodies; the statics do not need it.

    Attributes
    ----------
    centre, axis : Centre (3,) [m] and direction (3,), stored as a unit vector, in the rest frame
    diameter, thickness, hole_diameter : [m]; the last one is that of the plate's guide holes
    """

    centre: Floats
    axis: Floats
    diameter: float
    thickness: float
    hole_diameter: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", frozen_floats(self.centre, name="centre of a disc", shape=(3,)))
        axis = frozen_floats(self.axis, name="axis of a disc", shape=(3,))
        size = float(np.linalg.norm(axis))
        faults = [
            Fault(f"a disc's {name} is out of range", got=f"{value:.6g}", allowed=allowed)
            for name, value, allowed, is_right in (
                ("axis", size, "a direction", size > 0.0),
                ("diameter", self.diameter, "> 0", 0.0 < self.diameter < np.inf),
                ("thickness", self.thickness, "> 0", 0.0 < self.thickness < np.inf),
                ("hole diameter", self.hole_diameter, ">= 0", 0.0 <= self.hole_diameter < np.inf),
            )
            if not is_right
        ]
        if faults:
            raise InputError(faults)
        object.__setattr__(self, "axis", frozen_floats(axis / size, name="axis of a disc"))


@dataclass(frozen=True)
class Plate:
    """A rigid plate tied to nodes of one body (or of several), or clamped to rods.

    Attributes
    ----------
    name : First part of its channels' names
    nodes : Body name -> numbers of its mesh nodes (n,) that move with the plate
    reference : Point (3,) [m], rest frame, whose position and rotation is the pose
    mass, centre_of_mass : [kg], and point (3,) [m] in the rest frame, by default `reference`
    fixed : Whether the plate does not move at all
    holes : Name -> point (3,) [m], rest frame, through which a cable may run
    disc : Its shape, where known
    inertia
        Tensor (3, 3) about the centre of mass [kg m^2], rest frame, used in dynamics alone; None: that of its disc with
        its mass, or of a point mass without a disc.
    """

    name: str
    nodes: Mapping[str, Ints]
    reference: Floats
    mass: float = 0.0
    centre_of_mass: Floats | None = None
    fixed: bool = False
    holes: Mapping[str, Floats] = field(default_factory=dict)
    disc: Disc | None = None
    inertia: Floats | None = None

    def __post_init__(self) -> None:
        nodes = {body: frozen_ints(n, name=f"nodes of {self.name}", shape=(None,)) for body, n in self.nodes.items()}
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "reference", frozen_floats(self.reference, name=f"{self.name}.reference", shape=(3,)))
        centre = self.reference if self.centre_of_mass is None else self.centre_of_mass
        object.__setattr__(
            self, "centre_of_mass", frozen_floats(centre, name=f"{self.name}.centre_of_mass", shape=(3,))
        )
        holes = {name: frozen_floats(at, name=f"{self.name}.{name}", shape=(3,)) for name, at in self.holes.items()}
        object.__setattr__(self, "holes", holes)
        if self.inertia is not None:
            object.__setattr__(self, "inertia", inertia_tensor(self.inertia, f"{self.name}.inertia"))

    def via(self, hole: str) -> ViaPoint:
        """The point of a cable in one of the plate's holes.

        Raises
        ------
        InputError
            Where the plate has no such hole.
        """
        if hole not in self.holes:
            known = ", ".join(self.holes) or "none: the plate has no holes"
            raise InputError(Fault("the plate has no such hole", where=self.name, got=f"'{hole}'", allowed=known))
        return ViaPoint(self.holes[hole], self.name)


def inertia_tensor(values: Floats, name: str) -> Floats:
    """The tensor of a rigid body about its centre of mass [kg m^2], (3, 3).

    Raises
    ------
    InputError
        Where no rigid body has it.
    """
    tensor = frozen_floats(values, name=name, shape=(3, 3))
    moments = np.linalg.eigvalsh(tensor)
    size = float(np.abs(tensor).max())
    # For a non-negative mass distribution, no principal moment exceeds the sum of the other two.
    if np.abs(tensor - tensor.T).max() > 1e-9 * size or not moments[2] <= (1.0 + 1e-9) * (moments[0] + moments[1]):
        raise InputError(
            Fault(
                "no rigid body has this inertia",
                where=name,
                got=np.array2string(tensor, precision=4),
                allowed="a symmetric matrix whose largest principal moment is at most the sum of the others [kg m^2]",
            )
        )
    return tensor


@dataclass(frozen=True)
class Tie:
    """Nodes of a body bonded to another body, whose mesh need not match; tie the finer side to the coarser.

    Attributes
    ----------
    name, body, nodes : Names of the tie and of the tied body, and numbers of its mesh nodes (n,)
    on : Name of the body that they are bonded to
    tolerance : Largest distance [m] of the nodes from it; None: a quarter of an edge of the nearest tet
    """

    name: str
    body: str
    nodes: Ints
    on: str
    tolerance: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", frozen_ints(self.nodes, name=f"nodes of {self.name}", shape=(None,)))


@dataclass(frozen=True)
class Marker:
    """A point whose position is measured.

    A marker outside its body follows the nearest element, whose deformation is extrapolated.

    Attributes
    ----------
    name, on : Names of the marker and of the plate or body that carries it
    at : Position (3,) [m] in the rest frame
    """

    name: str
    on: str
    at: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", frozen_floats(self.at, name=f"{self.name}.at", shape=(3,)))


@dataclass(frozen=True)
class PointLoad:
    """A dead force at a point of a body or plate.

    Attributes
    ----------
    name, on : Names of the load and of the body or plate
    at : Point (3,) [m] in the rest frame
    force : (3,) [N]
    direction : Unit vector (3,) of the force; needed where its magnitude is zero now and another value later
    """

    name: str
    on: str
    at: Floats
    force: Floats
    direction: Floats | None = None

    def __post_init__(self) -> None:
        for key in ("at", "force"):
            object.__setattr__(self, key, frozen_floats(getattr(self, key), name=f"{self.name}.{key}", shape=(3,)))
        direction = self.force if self.direction is None else np.asarray(self.direction)
        length = float(np.linalg.norm(direction))
        unit = direction / length if length > 0.0 else direction
        object.__setattr__(self, "direction", frozen_floats(unit, name=f"{self.name}.direction", shape=(3,)))


@dataclass(frozen=True)
class SurfaceLoad:
    """A dead traction on a part of a body's surface.

    Attributes
    ----------
    name, on : Names of the load and of the body
    faces : Node numbers of triangles (k, 3 or 6) of the body's mesh
    traction : Force per undeformed area (3,) [Pa]
    """

    name: str
    on: str
    faces: Ints
    traction: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", frozen_ints(self.faces, name=f"{self.name}.faces"))
        object.__setattr__(self, "traction", frozen_floats(self.traction, name=f"{self.name}.traction", shape=(3,)))


@dataclass(frozen=True)
class Robot:
    """Bodies, rods, plates, ties, cables, loads, markers and sensors, with gravity and contact.

    Attributes
    ----------
    bodies, plates, cables, loads, rods, ties, markers, sensors : The parts; no two share a name
    gravity : Acceleration (3,) [m/s^2]
    contact : Contact of the parts, its omitted values chosen for them; None: they may overlap
    """

    bodies: tuple[Body, ...] = ()
    plates: tuple[Plate, ...] = ()
    cables: tuple[Cable, ...] = ()
    loads: tuple[PointLoad | SurfaceLoad, ...] = ()
    gravity: Floats = field(default_factory=lambda: frozen_floats((0.0, 0.0, 0.0), name="gravity"))
    rods: tuple[Rod, ...] = ()
    ties: tuple[Tie, ...] = ()
    markers: tuple[Marker, ...] = ()
    contact: Contact | None = None
    sensors: tuple[NamedSensor, ...] = ()

    def __post_init__(self) -> None:
        kinds = ("bodies", "plates", "cables", "loads", "rods", "ties", "markers", "sensors")
        for key in kinds:
            object.__setattr__(self, key, tuple(getattr(self, key)))
        object.__setattr__(self, "gravity", frozen_floats(self.gravity, name="gravity", shape=(3,)))
        names = [part.name for key in kinds for part in getattr(self, key)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(Fault("two parts of the robot share a name", got=", ".join(twice)))
        if not self.bodies and not self.rods:
            raise InputError(Fault("the robot has nothing that bends", got="no body and no rod", allowed="one or more"))
        if self.contact is not None:
            object.__setattr__(self, "contact", self.contact.fitted(self.bodies, self.rods))
