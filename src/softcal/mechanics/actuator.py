"""The actuators that drive the robot, each with a coordinate of the shape and an effort conjugate to it.

    Pi_a = -e (q(x) - q*)

The effort e does the work e dq: a cable's tension on its shortening, a chamber's pressure on its volume. One of the two
is prescribed. Where it is the effort, the actuator is *held* at it. Where it is the coordinate, q = q*, the effort is
an unknown: the multiplier of that condition, which borders the tangent.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.declare import Checked, OrInfinite
from softcal.display import displayed
from softcal.mechanics.layout import Layout
from softcal.mechanics.term import BlockColumns, Controls, Given, Sum, Term

NO_GAP = 1e-9  # of a coordinate's scale: a smaller error counts as zero
NO_EFFORT = 1e-7  # of the largest effort of its kind: a smaller one counts as zero

SWITCHING = "actuators keep switching between driven and at a limit of their effort (cables: taut and slack)"


@displayed
@dataclass(frozen=True)
class ActuatorLimits(Checked):
    """Names of an actuator's coordinate and effort, and the limits of the effort.

    is_motion: whether its unknown is no effort but a motion, and its equation a balance of efforts, as of a pulley.
    """

    name: str
    coordinate: str
    effort: str
    least_effort: OrInfinite = -np.inf
    most_effort: OrInfinite = np.inf
    is_motion: bool = False


class Drives(NamedTuple):
    """The border of the tangent by actuators whose coordinate is prescribed.

    Attributes
    ----------
    columns
        d gradient / d effort of each (n, k), or as `BlockColumns`.
    rows
        Less d coordinate / d the unknowns; the same object as `columns` where the transmission is ideal.
    corner
        Less d coordinate / d effort (k,).
    """

    columns: Floats | BlockColumns
    rows: Floats | BlockColumns
    corner: Floats


@displayed
@dataclass(frozen=True)
class ActuatorTerm(Term):
    """Actuators of one kind. first: the number of its first one among the system's, set by `build_system`."""

    first: int = field(default=0, kw_only=True)

    @property
    @abstractmethod
    def actuators(self) -> Sequence[ActuatorLimits]:
        """The actuators of the term, in the order of their efforts."""

    @abstractmethod
    def shape_coordinates(self, x: Floats) -> Floats:
        """q (n,) at positions of the points (n_points, 3)."""

    @abstractmethod
    def shape_gradient(self, x: Floats, i: int, size: int) -> Floats:
        """dq/dx of one actuator on all entities (size,).

        Parameters
        ----------
        x
            Positions of the points (n_points, 3) [m].
        i
            Number of the actuator in this term.
        size
            Number of the entities' components.
        """

    @abstractmethod
    def add_forces(self, given: Given, effort: Floats, into: Sum, transmission: Any) -> None:
        """Add -e dq/dx to the gradient and, where `into` has `data`, -e d2q/dx2.

        Parameters
        ----------
        given
            The arguments of the term.
        effort
            Efforts e (n,) of the actuators, each in its own unit.
        into
            The sum.
        transmission
            The result of `transmission` at the same state.
        """

    def transmission(self, given: Given) -> Any:
        """The transmission between the machine and the shape, such as friction and stretch; None without one."""
        return None

    def coordinates(self, given: Given, transmission: Any) -> Floats:
        """The coordinates (n,) that its machines measure and prescribe: q(x), apart from the transmission."""
        return self.shape_coordinates(given.state.x)

    def drives(self, given: Given, which: Ints, size: int, transmission: Any) -> Drives:
        """The borders of some of its actuators on all entities (size,).

        Parameters
        ----------
        given
            The arguments of the term.
        which
            Numbers of the actuators in this term (k,).
        size
            Number of the entities' components.
        transmission
            The result of `transmission` at the same state.
        """
        columns = np.stack([-self.shape_gradient(given.state.x, i, size) for i in which.tolist()], axis=1)
        return Drives(columns, columns, np.zeros(len(which)))

    def add_transmission(self, into: Sum, given: Given, transmission: Any) -> None:
        """Add the transmission's own contribution to the tangent.

        Parameters
        ----------
        into
            The sum.
        given
            The arguments of the term.
        transmission
            The result of `transmission` at the same state.
        """

    @property
    def followers(self) -> Mapping[str, Ints]:
        """Actuator of this term -> numbers in the system of the actuators that follow it: cables and pulley of a drive.
        Their command is zero for their coordinate less the part that `taken_up` returns.
        """
        return {}

    def taken_up(self, given: Given) -> Floats | float:
        """The part of its followers' coordinates that it takes up, among all coordinates (n_actuators,)."""
        return 0.0

    @property
    def swings(self) -> bool:
        """Whether the actuators have inertia of their own."""
        return False

    def couplings(self, given: Given) -> Sequence[tuple[int, int, float]]:
        """Entries (i, j, rate) of the tangent, and (j, i, rate) where these differ, between efforts of the system."""
        return ()

    def engaged(self, is_held: np.ndarray, target: Controls) -> np.ndarray:
        """Which actuators (n_actuators,) are at prescribed efforts, less those that must be driven for its equations to
        determine its motion.

        Parameters
        ----------
        is_held
            The actuators (n_actuators,) at prescribed efforts by the commands.
        target
            The commands.

        Raises
        ------
        SimulationError
            Where none can be driven.
        """
        return is_held

    def coordinate_scales(self, extent: float) -> Floats:
        """Scales of the errors of its coordinates (n,), of a robot of this extent [m]."""
        return np.full(len(self.actuators), extent)

    def coordinate_spans(self, extent: float, theta: Mapping[str, float], effort: Floats) -> Floats:
        """Spans of its coordinates (n,) that are long on a load path.

        Parameters
        ----------
        extent
            Extent of the robot [m].
        theta
            Values of the parameters by dotted name [SI].
        effort
            Efforts e (n,) to which the path goes, each in its own unit; zero where a coordinate is prescribed.
        """
        return self.coordinate_scales(extent)

    def coordinate_tolerances(self, extent: float) -> Floats:
        """Errors of its coordinates (n,) below which they count as reached, of a robot of this extent [m]."""
        return NO_GAP * self.coordinate_scales(extent)

    def at_limit(self, x: Floats) -> str:
        """The obstacle to further motion at these positions, as part of a sentence; "" without one."""
        return ""

    def is_reversed(self, before: Floats, x: Floats) -> bool:
        """Whether an actuator acts in the opposite direction at x than before (both (n_points, 3)), after a jump."""
        return False

    @cached_property
    def own(self) -> slice:
        """Numbers of its actuators among the system's."""
        return slice(self.first, self.first + len(self.actuators))

    def add(self, into: Sum, given: Given) -> None:
        """Add the forces of the efforts, the errors of the prescribed coordinates, and a border for these."""
        state, own, size = given.state, self.own, len(into.full)
        is_held, transmission = given.controls.is_held[own], self.transmission(given)
        self.add_forces(given, state.effort[own], into, transmission)
        coordinates = self.coordinates(given, transmission)
        into.efforts[own] += np.where(is_held, 0.0, given.controls.coordinate[own] - coordinates)
        if self.followers:
            into.efforts += np.where(given.controls.is_held, 0.0, self.taken_up(given))
        if into.data is None:
            return
        into.couplings.extend(self.couplings(given))
        if len(driven := np.flatnonzero(~is_held)):
            into.driven.append((self.first + driven, self.drives(given, driven, size, transmission)))
        if transmission is not None:
            self.add_transmission(into, given, transmission)

    def energy(self, given: Given) -> float:
        """Without losses; of the prescribed efforts, up to a constant."""
        own = self.own
        wanted = np.where(given.controls.is_held[own], 0.0, given.controls.coordinate[own])
        return float(given.state.effort[own] @ (wanted - self.shape_coordinates(given.state.x)))


def numbered(terms: Sequence[Term], layout: Layout) -> tuple[Term, ...]:
    """The terms with their actuators numbered one after the other.

    Raises
    ------
    ValueError
        Where they have more actuators than the layout has efforts.
    """
    first, out = 0, list[Term]()
    for term in terms:
        if isinstance(term, ActuatorTerm):
            term = replace(term, first=first)
            first += len(term.actuators)
        out.append(term)
    if first > layout.n_actuators:
        raise ValueError(f"{first} actuators, and {layout.n_actuators} efforts in the layout")
    return tuple(out)
