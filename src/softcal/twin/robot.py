"""What the robot is: deformable bodies, rigid plates, cables, loads. Frozen; numbers in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.errors import Fault, InputError
from softcal.geometry.mesh import TetMesh

ElementKind = Literal["P1", "P2", "P2P1"]
Control = Literal["tension", "shortening"]


@dataclass(frozen=True)
class Body:
    """A deformable body.

    mesh [m]: linear or quadratic; P2 and P2P1 elevate a linear mesh with straight edges.
    element: P1 (linear, locks near nu = 0.5; SOFA's), P2 (quadratic), P2P1 (quadratic with continuous
    linear pressure, locking-free; the default).
    law: name in `softcal.materials.LAWS`; parameters: the law's own, SI
    (neo-hooke: youngs_modulus [Pa], poissons_ratio [-]).
    density [kg/m^3]; fixed: node numbers of the mesh that do not move.
    """

    name: str
    mesh: TetMesh
    fixed: Ints
    parameters: Mapping[str, float]
    law: str = "neo-hooke"
    element: ElementKind = "P2P1"
    density: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", frozen_ints(self.fixed, name=f"fixed nodes of {self.name}", shape=(None,)))
        object.__setattr__(self, "parameters", dict(self.parameters))


@dataclass(frozen=True)
class Plate:
    """A rigid plate tied to nodes of one body (or of several).

    nodes: body name -> node numbers of its mesh. reference: point whose position and rotation is the pose [m].
    mass [kg] at centre_of_mass [m] (rest frame).
    """

    name: str
    nodes: Mapping[str, Ints]
    reference: Floats
    mass: float = 0.0
    centre_of_mass: Floats | None = None

    def __post_init__(self) -> None:
        nodes = {body: frozen_ints(n, name=f"nodes of {self.name}", shape=(None,)) for body, n in self.nodes.items()}
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "reference", frozen_floats(self.reference, name=f"{self.name}.reference", shape=(3,)))
        centre = self.reference if self.centre_of_mass is None else self.centre_of_mass
        object.__setattr__(
            self, "centre_of_mass", frozen_floats(centre, name=f"{self.name}.centre_of_mass", shape=(3,))
        )


@dataclass(frozen=True)
class ViaPoint:
    """A point that a cable runs through; at [m] in the rest frame; on: a body's or plate's name, or "" for space."""

    at: Floats
    on: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", frozen_floats(self.at, name="via point", shape=(3,)))


@dataclass(frozen=True)
class Cable:
    """A cable through via points, its fixed end first or last; length L = sum |p_{i+1} - p_i|.

    friction_coefficient [-]: Euler-Eytelwein loss at each inner via point; `pulled_end` says at which end the
    cable's tension is prescribed or measured ("first" or "last" via point).
    """

    name: str
    via_points: tuple[ViaPoint, ...]
    friction_coefficient: float = 0.0
    pulled_end: Literal["first", "last"] = "last"

    def __post_init__(self) -> None:
        object.__setattr__(self, "via_points", tuple(self.via_points))
        if len(self.via_points) < 2:
            raise InputError(
                Fault("a cable needs at least two via points", where=self.name, got=str(len(self.via_points)))
            )


@dataclass(frozen=True)
class PointLoad:
    """A dead force [N] at a point [m] (rest frame) of a body or plate."""

    name: str
    on: str
    at: Floats
    force: Floats

    def __post_init__(self) -> None:
        for key in ("at", "force"):
            object.__setattr__(self, key, frozen_floats(getattr(self, key), name=f"{self.name}.{key}", shape=(3,)))


@dataclass(frozen=True)
class SurfaceLoad:
    """A dead traction [Pa] per undeformed area on triangles (k, 3 or 6) of a body's mesh."""

    name: str
    on: str
    faces: Ints
    traction: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", frozen_ints(self.faces, name=f"{self.name}.faces"))
        object.__setattr__(self, "traction", frozen_floats(self.traction, name=f"{self.name}.traction", shape=(3,)))


@dataclass(frozen=True)
class Robot:
    """Bodies, plates, cables and loads; gravity [m/s^2]."""

    bodies: tuple[Body, ...]
    plates: tuple[Plate, ...] = ()
    cables: tuple[Cable, ...] = ()
    loads: tuple[PointLoad | SurfaceLoad, ...] = ()
    gravity: Floats = field(default_factory=lambda: frozen_floats((0.0, 0.0, 0.0), name="gravity"))

    def __post_init__(self) -> None:
        for key in ("bodies", "plates", "cables", "loads"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        object.__setattr__(self, "gravity", frozen_floats(self.gravity, name="gravity", shape=(3,)))
        names = [part.name for parts in (self.bodies, self.plates, self.cables, self.loads) for part in parts]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(Fault("two parts of the robot share a name", got=", ".join(twice)))
