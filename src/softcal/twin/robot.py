"""The robot: deformable bodies, rods, rigid plates, cables, loads, markers. Frozen; numbers in SI."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from softcal.arrays import (
    ArrayOf,
    Gravity,
    Numbers,
    Position,
    UnitVector,
)
from softcal.checks import Floats, Ints, frozen_floats, require_below
from softcal.declare import ByShape, Check, Checked, Declared
from softcal.display import displayed, plotted
from softcal.errors import Fault, InputError, unknown
from softcal.geometry.centreline import Centreline
from softcal.geometry.mesh import TetMesh
from softcal.geometry.section import CrossSection
from softcal.geometry.shape import BodyShape
from softcal.materials.catalogue import LAWS, LawName
from softcal.materials.components import NO_DIRECTIONS
from softcal.materials.elastic_constants import LINEAR_ELASTIC
from softcal.materials.histories import history_of
from softcal.materials.inelastic import History
from softcal.materials.law import Law, with_least_shift
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.materials.parameter import Parameter
from softcal.mechanics.elements import DEFAULT, ElementName
from softcal.mechanics.path_limits import PathLimits
from softcal.quantities import Clearance, Density, Direction, Mass, MomentOfInertia, Size
from softcal.sensing.channel import kinds
from softcal.sensing.sensor import NamedSensor
from softcal.twin.actuated import ActuatedPart, NamedActuator, limited_channels, limits_faults
from softcal.twin.barrier import Contact, require_wires
from softcal.twin.cables import Cable, ViaPoint, require_changing_length
from softcal.twin.clamp import Clamp, Zone, clamp_zone
from softcal.twin.dead_loads import Moment, PointLoad, SurfaceLoad
from softcal.twin.material import Material, Winding, complete_materials, materials_of
from softcal.twin.part import NamedPart

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def _drives(control: str, where: str) -> str:
    if control not in (known := [name for name, kind in kinds().items() if kind.drives]):
        raise InputError(unknown("no actuator is commanded by this quantity", where, control, known))
    return control


Control = Annotated[str, Check(_drives)]
"""What a command prescribes: tension or shortening of a cable, pressure or volume of a chamber, torque or angle."""


# What another part chooses where it is omitted: a plate for its disc, a force for its direction.
CHOSEN: Any = None


@displayed
@dataclass(frozen=True)
class Body(NamedPart):
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
    clamp : What fixes it at a plane face, whose depth is then a parameter; None: it is fixed exactly at its fixed nodes
    build_direction : Direction (3,) of a law that has one, in the robot at rest; None: the z axis
    winding : Of the fibres of a law that has directions, instead; a law of two directions needs it
    history : What its materials do beyond the law: names of `softcal.materials.histories`, such as relaxation-2
    shape : The lengths of its mesh that are parameters; None: none
    """

    mesh: TetMesh
    fixed: Numbers
    parameters: Mapping[str, float]
    law: LawName = "neo-hooke"
    element: ElementName = DEFAULT.name
    density: Density = 0.0
    inclusions: tuple[Material, ...] = ()
    clamp: Clamp | None = None
    build_direction: Direction | None = None
    winding: Winding | None = None
    history: tuple[str, ...] = ()
    shape: BodyShape | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_below(self.mesh.n_points, self.fixed, f"{self.name}.fixed")
        if self.shape is not None:
            self.shape.require_fit(self.mesh, f"{self.name}.shape")
        n_directions = LAWS[self.law].n_directions
        given = [key for key in ("build_direction", "winding") if getattr(self, key) is not None]
        if given and not n_directions:
            directed = ", ".join(name for name, law in LAWS.items() if law.is_directed)
            raise InputError(Fault("its law has no direction", f"{self.name}.{given[0]}", f"law {self.law}", directed))
        if n_directions > 1 and given != ["winding"]:
            got, allowed = " and ".join(given) or "none", "winding, which has both"
            raise InputError(Fault("its law has two directions", self.name, got, allowed))
        if len(given) > 1:
            raise InputError(Fault("its directions are specified twice", self.name, " and ".join(given), "one of them"))
        if self.clamp is not None:
            self.zone  # noqa: B018  refuses a clamp that cannot be
        complete_materials(self, self.mesh.n_tets, "tets")

    @property
    def materials(self) -> tuple[Material, ...]:
        """Every material, named as its parameters are: the body's own, by its name, then `body.inclusion`."""
        return materials_of(self, self.mesh.n_tets)

    @property
    def past(self) -> History:
        """The history of its materials, beyond the law."""
        return history_of(self.history, f"{self.name}.history")

    @property
    def elasticity(self) -> Law:
        """The law of the body in the form that its elements need."""
        return with_least_shift(LAWS[self.law]) if self.history else LAWS[self.law]

    @property
    def constants(self) -> tuple[Parameter, ...]:
        """The constants of its materials: those of the law, then those of the history."""
        return (*LAWS[self.law].parameters, *self.past.parameters)

    def directions(self, at: Floats) -> Floats:
        """The directions of its law, as `stress_at.Points` has them, at points (n, 3) [m] of the robot at rest.

        Raises
        ------
        InputError
            Where a point is on the axis of its winding.
        """
        if self.winding is not None:
            return self.winding.directions(at)
        if not LAWS[self.law].is_directed:
            return NO_DIRECTIONS
        given = np.asarray(self.build_direction or (0.0, 0.0, 1.0), dtype=np.float64)
        return (given / np.linalg.norm(given))[None, None]

    @cached_property
    def zone(self) -> Zone | None:
        """The zone in which the depth of its clamp moves the mesh; None without a clamp."""
        return clamp_zone(self.mesh, self.fixed, self.clamp, where=f"{self.name}.clamp") if self.clamp else None

    def clamped(self, mesh: TetMesh) -> TetMesh:
        """Its mesh, or that of its element, as the depth of its clamp moves it; the mesh itself where none does."""
        if self.clamp is None or self.zone is None or self.clamp.depth == 0.0:
            return mesh
        return replace(
            mesh, points=mesh.points + self.clamp.depth * np.outer(self.zone.shares(mesh), self.zone.direction)
        )

    @property
    def as_clamped(self) -> Body:
        """The same body whose mesh ends where the clamp does: for programs that know no depth of it."""
        return self if self.clamp is None else replace(self, mesh=self.clamped(self.mesh), clamp=None)


@displayed
@dataclass(frozen=True)
class Rod(NamedPart):
    """A slender elastic part as a geometrically exact rod: a backbone, or the wire of a helical spring.

    Attributes
    ----------
    name : First part of its parameters' names
    centreline, section : Undeformed, stress-free shape [m], and cross-section
    parameters : youngs_modulus [Pa], poissons_ratio [-]
    clamped : Plate name -> numbers of the centreline nodes (n,) that move rigidly with the plate
    fixed : Numbers of the nodes that do not move (n,)
    density : [kg/m^3]
    inclusions : Elements of other materials; constants not given are the rod's
    history : What its materials do beyond their elasticity: names of `softcal.materials.histories`, such as flow
    law : The law whose moduli at small strain its own are (`law.at_small_strain`), for those who read of it; or ""
    """

    centreline: Centreline
    section: CrossSection
    parameters: Mapping[str, float]
    clamped: Mapping[str, Numbers] = field(default_factory=dict)
    fixed: Numbers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    density: Density = 0.0
    inclusions: tuple[Material, ...] = ()
    history: tuple[str, ...] = ()
    law: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        n = len(self.centreline.nodes)
        complete_materials(self, n - 1, "elements")
        for where, numbers in {"fixed": self.fixed, **{f"clamped.{k}": v for k, v in self.clamped.items()}}.items():
            require_below(n, numbers, f"{self.name}.{where}")
        held = np.concatenate([self.fixed, *self.clamped.values()])
        if len(np.unique(held)) != len(held):
            raise InputError(
                Fault("a node of the rod is fixed or clamped twice", self.name, got=str(np.sort(held).tolist()))
            )

    @property
    def materials(self) -> tuple[Material, ...]:
        """Every material, named as its parameters are: the rod's own, by its name, then `rod.inclusion`."""
        return materials_of(self, len(self.centreline.lengths))

    @property
    def elasticity(self) -> Law:
        """A law with its constants, of the same moduli at small strain."""
        return NEO_HOOKE

    @property
    def past(self) -> History:
        """The history of its materials, beyond their elasticity."""
        return history_of(self.history, f"{self.name}.history", of_rod=True)

    @property
    def constants(self) -> tuple[Parameter, ...]:
        """The constants of its materials: the elastic ones, then those of the history."""
        return (*LINEAR_ELASTIC, *self.past.parameters)

    @cached_property
    def volumes(self) -> Floats:
        """Volumes that the two ends of each element carry (n, 2) [m^3]."""
        stations = self.centreline.stations / self.centreline.stations[-1]
        at = np.array([self.section.at(float(share)).area for share in stations])
        middle = np.array([self.section.at(float(share)).area for share in 0.5 * (stations[1:] + stations[:-1])])
        ends = np.stack([at[:-1] + 2.0 * middle, 2.0 * middle + at[1:]], axis=1)
        return self.centreline.lengths[:, None] * ends / 6.0


@displayed
@dataclass(frozen=True)
class Disc(Declared):
    """The shape of a plate: a flat cylinder, drawn and kept clear of bodies; the statics do not need it.

    Attributes
    ----------
    diameter, thickness : [m]
    axis, centre : Unit vector (3,) and point (3,) [m] in the rest frame, by default the plate's reference
    hole_diameter : Diameter of the plate's guide holes [m]
    """

    diameter: Size
    thickness: Size
    axis: UnitVector = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    centre: Position = CHOSEN
    hole_diameter: Clearance = 0.0


def _of_a_rigid_body(value: Floats, where: str) -> Floats:
    tensor = frozen_floats(np.diag(value) if value.ndim == 1 else value, name=where)
    moments = np.linalg.eigvalsh(tensor)
    size = float(np.abs(tensor).max())
    # For a non-negative mass distribution, no principal moment exceeds the sum of the other two.
    if np.abs(tensor - tensor.T).max() > 1e-9 * size or not moments[2] <= (1.0 + 1e-9) * (moments[0] + moments[1]):
        raise InputError(
            Fault(
                "no rigid body has this inertia",
                where=where,
                got=np.array2string(tensor, precision=4),
                allowed="a symmetric matrix whose largest principal moment is at most the sum of the others [kg m^2]",
            )
        )
    return tensor


_Moments = tuple[MomentOfInertia, MomentOfInertia, MomentOfInertia]
# A tensor (3, 3) about the centre of mass; the three moments about the axes stand for it.
Inertia = Annotated[
    Floats, ArrayOf(Annotated[_Moments | tuple[_Moments, _Moments, _Moments], ByShape()]), Check(_of_a_rigid_body)
]


@displayed
@dataclass(frozen=True)
class Plate(NamedPart):
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
        Tensor (3, 3), or moments (3,) about the axes, about the centre of mass [kg m^2], rest frame, used in dynamics
        alone; None: that of its disc with its mass, or of a point mass without a disc.
    """

    nodes: Mapping[str, Numbers]
    reference: Position
    mass: Mass = 0.0
    centre_of_mass: Position = CHOSEN
    fixed: bool = False
    holes: Mapping[str, Position] = field(default_factory=dict)
    disc: Disc | None = None
    inertia: Inertia | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.centre_of_mass is CHOSEN:
            object.__setattr__(self, "centre_of_mass", self.reference)
        if self.disc is not None and self.disc.centre is CHOSEN:
            object.__setattr__(self, "disc", replace(self.disc, centre=self.reference))

    def via(self, hole: str) -> ViaPoint:
        """The point of a cable in one of the plate's holes.

        Raises
        ------
        InputError
            Where the plate has no such hole.
        """
        if hole not in self.holes:
            none = "none: the plate has no holes"
            raise InputError(unknown("the plate has no such hole", self.name, hole, self.holes, none=none))
        return ViaPoint(self.holes[hole], self.name)


@displayed
@dataclass(frozen=True)
class Tie(NamedPart):
    """Nodes of a body bonded to another body, whose mesh need not match; tie the finer side to the coarser.

    Attributes
    ----------
    name, body, nodes : Names of the tie and of the tied body, and numbers of its mesh nodes (n,)
    on : Name of the body that they are bonded to
    tolerance : Largest distance [m] of the nodes from it; None: a quarter of an edge of the nearest tet
    """

    body: str
    nodes: Numbers
    on: str
    tolerance: Size | None = None


@displayed
@dataclass(frozen=True)
class Marker(NamedPart):
    """A point whose position is measured.

    A marker outside its body follows the nearest element, whose deformation is extrapolated.

    Attributes
    ----------
    name, on : Names of the marker and of the plate, body or rod that carries it
    at : Position (3,) [m] in the rest frame
    offset : How far from there it is attached (3,) [m], along the axes of the rest frame
    """

    on: str
    at: Position
    offset: Position = field(default_factory=lambda: np.zeros(3))

    @property
    def place(self) -> Floats:
        """Place of attachment (3,) [m], in the rest frame."""
        return self.at + self.offset

    def offset_by(self, values: Mapping[str, float]) -> Marker:
        """The marker with the offsets among values [SI] of parameters by name; the same if none differs."""
        axes = zip("xyz", self.offset.tolist(), strict=True)
        offset = np.array([values.get(f"{self.name}.{axis}_offset", own) for axis, own in axes])
        return self if np.array_equal(offset, self.offset) else replace(self, offset=offset)


@displayed
@dataclass(frozen=True, eq=False)  # by identity, as a key of what is computed once for a robot
class Robot(Checked):
    """Bodies, rods, plates, ties, cables, actuators, loads, markers and sensors, with gravity and contact.

    Attributes
    ----------
    bodies, plates, cables, loads, rods, ties, markers, sensors : The parts; no two share a name
    actuators : What drives it beside cables, such as chambers and drives; its name is no other part's either
    gravity : Acceleration (3,) [m/s^2]
    contact : Contact of the parts; None: they may overlap
    limits : Limits of the work on each of its load paths
    actuator_limits : Channel of an actuator, such as `main.pressure`, or kind of channel, such as `tension` -> lowest
        and highest value [SI] that its machine gives, which `reach` and `workspace` keep and `check` compares
    """

    bodies: tuple[Body, ...] = ()
    plates: tuple[Plate, ...] = ()
    cables: tuple[Cable, ...] = ()
    loads: tuple[PointLoad | Moment | SurfaceLoad, ...] = ()
    gravity: Gravity = field(default_factory=lambda: np.zeros(3))
    rods: tuple[Rod, ...] = ()
    ties: tuple[Tie, ...] = ()
    markers: tuple[Marker, ...] = ()
    contact: Contact | None = None
    sensors: tuple[NamedSensor, ...] = ()
    limits: PathLimits = field(default_factory=PathLimits)
    actuators: tuple[NamedActuator, ...] = ()
    actuator_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])

    def __post_init__(self) -> None:
        super().__post_init__()
        parts = ("bodies", "plates", "cables", "actuators", "loads", "rods", "ties", "markers", "sensors")
        names = [part.name for key in parts for part in getattr(self, key)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(Fault("two parts of the robot share a name", got=", ".join(twice)))
        if not self.bodies and not self.rods:
            raise InputError(Fault("the robot has nothing that bends", got="no body and no rod", allowed="one or more"))
        n_points = {body.name: body.mesh.n_points for body in self.bodies}
        for plate in self.plates:
            if others := [body for body in plate.nodes if body not in n_points]:
                raise InputError(unknown("there is no such body", f"{plate.name}.nodes", others[0], n_points))
        for body, numbers, where in self._numbered:
            require_below(n_points.get(body, np.inf), numbers, where)
        for cable in self.cables:
            require_changing_length(cable, self.plates)
        for part in self.actuators:
            for cable in part.actuator.driven:
                if cable not in (names := [one.name for one in self.cables]):
                    raise InputError(unknown("there is no such cable", f"{part.name}.cables", cable, names))
                if self.led[cable] != part.name:
                    got = f"{self.led[cable]} and {part.name}"
                    raise InputError(Fault("two actuators drive one cable", cable, got, "one of them"))
        if faults := [
            f for key, ends in self.actuator_limits.items() for f in limits_faults(self.actuated, key, *ends)
        ]:
            raise InputError(faults)
        if self.contact is not None:
            require_wires(self.rods)

    def plot_shape(self, *, ax: Axes | None = None) -> Axes:
        """The robot at rest, with its regions, actuators and loads.

        Parameters
        ----------
        ax
            Axes to draw into; by default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes
            The axes; nothing is shown or saved.

        Raises
        ------
        ParameterError
            Where `ax` are no axes.
        """
        return plotted("plot_shape", self, ax)

    @property
    def _numbered(self) -> Iterator[tuple[str, Ints, str]]:
        """Every set of node numbers: its body, the numbers, and their place for messages."""
        for plate in self.plates:
            yield from ((body, nodes, f"{plate.name}.nodes.{body}") for body, nodes in plate.nodes.items())
        yield from ((tie.body, tie.nodes, f"{tie.name}.nodes") for tie in self.ties)
        yield from ((one.on, one.faces, f"{one.name}.faces") for one in self.loads if isinstance(one, SurfaceLoad))

    @property
    def actuated(self) -> tuple[ActuatedPart, ...]:
        """All actuators of the robot: its cables, then the others, in the order of their efforts."""
        return (*self.cables, *self.actuators)

    @property
    def led(self) -> dict[str, str]:
        """Cable -> the drive that moves it; such a cable has no commands of its own."""
        return {cable: part.name for part in self.actuators[::-1] for cable in part.actuator.driven}

    @property
    def commandable(self) -> tuple[ActuatedPart, ...]:
        """Actuators with commands of their own: all but the cables of drives."""
        return tuple(part for part in self.actuated if part.name not in self.led)

    @property
    def limited(self) -> dict[str, tuple[float, float]]:
        """Channel of an actuator -> its limits [SI]; the limits of a channel override those of its kind."""
        of_kinds_first = sorted(self.actuator_limits.items(), key=lambda one: "." in one[0])
        return {name: ends for key, ends in of_kinds_first for name in limited_channels(self.actuated, key)}

    @property
    def pretensioned(self) -> tuple[ActuatedPart, ...]:
        """Actuators that stay at zero without a command: by their pretension, or that of the cables that they drive."""
        tense = {cable.name for cable in self.cables if cable.pretension is not None}
        tense |= {part.name for part in self.actuators if part.actuator.has_pretension}
        tense |= {self.led[cable] for cable in tense if cable in self.led}
        return tuple(part for part in self.commandable if part.name in tense)

    @property
    def actuator_word(self) -> str:
        """The noun for actuators in messages: "cable" where all are cables."""
        return "actuator" if self.actuators else "cable"

    @property
    def fitted_contact(self) -> Contact | None:
        """The contact with the lengths that are omitted chosen for the parts; None: they may overlap."""
        return None if self.contact is None else self.contact.fitted(self.bodies, self.rods, self.plates)

    @property
    def deformable(self) -> tuple[Body | Rod, ...]:
        """The parts with a material."""
        return (*self.bodies, *self.rods)

    @property
    def as_clamped(self) -> Robot:
        """The robot with every body's mesh changed to the depth of its clamp."""
        if all(body.clamp is None for body in self.bodies):
            return self
        return replace(self, bodies=tuple(body.as_clamped for body in self.bodies))

    @property
    def remembers(self) -> bool:
        """Whether a state depends on the previous states: the samples of a test are then a load path in their order."""
        return any(cable.line.friction_memory for cable in self.cables) or any(part.history for part in self.deformable)

    @property
    def needs_time(self) -> bool:
        """Whether a state depends on the time between the previous states."""
        return any(one.needs_time for part in self.deformable for one in part.past.parts)
