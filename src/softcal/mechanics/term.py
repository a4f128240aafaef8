"""A term of the potential, and the sum that terms add to.

    Pi(z) = sum of terms,    gradient and tangent likewise

Each body, each rod, the actuators, the dead loads, contact, and in a time step inertia and viscosity are terms. The
assembly (`system.py`) is the same for all of them: a term states its connectivity, looks up its places in the tangent
once, and then adds to a `Sum` at every state. A new term is one file; `tests/contracts/test_term_contract.py` tests its
interface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Self, TypeVar

import numpy as np

from softcal.checks import Floats, Ints
from softcal.declare import Checked
from softcal.display import displayed
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.scales import Sizes
from softcal.mechanics.state import State

if TYPE_CHECKING:
    from softcal.mechanics.actuator import Drives

Theta = Mapping[str, float]
NOTHING: Floats = np.zeros(0)


@dataclass(frozen=True)
class Controls:
    """The prescribed efforts, coordinates and loads.

    Attributes
    ----------
    is_held
        Per actuator, whether its effort is prescribed, or else its coordinate (n_actuators,).
    effort, coordinate
        The prescribed values (n_actuators,), each in its own unit; of each actuator one of the two counts.
    load
        Factor on all dead loads [-], below one only while they are applied.
    elapsed
        Time since the last converged sample [s]; infinity where it is so long that nothing changes any more.
    """

    is_held: np.ndarray
    effort: Floats
    coordinate: Floats
    load: float = 1.0
    elapsed: float = np.inf


class Given(NamedTuple):
    """The arguments of a term's part of a sum.

    Attributes
    ----------
    state, controls, theta
        The configuration, the controls, and the parameters' values [SI] by name.
    known
        The result of the term's own `kinematics` at the state.
    memory
        What the last converged sample left to this term (n,); empty for one that does not remember.
    """

    state: State
    controls: Controls
    theta: Theta
    known: Any = None
    memory: Floats = NOTHING


@displayed
@dataclass(frozen=True)
class Connectivity(Checked):
    """The connectivity of a term's tangent.

    Attributes
    ----------
    entities
        Groups of entities, arrays (n, k) with ascending rows.
    frames
        Pairs, or larger groups, of frames: arrays (n, k).
    """

    entities: Sequence[Ints] = ()
    frames: Sequence[Ints] = ()


class BlockColumns(NamedTuple):
    """Columns on all entities, as combinations of a sparse basis in blocks.

    Attributes
    ----------
    rows, basis, values
        Component, basis column and value of each nonzero of the basis (n_entries,); those at one place add up.
    weights
        Weights of the basis columns (n_basis, k) in the k columns of their block, the first k_block of which count.
    first, end
        Per basis column, the range of its block among all columns (n_basis,): k_block = end - first.
    """

    rows: Ints
    basis: Ints
    values: Floats
    weights: Floats
    first: Ints
    end: Ints


class LowRank(NamedTuple):
    """A product columns rows^T that is added to the tangent, block by block.

    Attributes
    ----------
    columns
        Its columns.
    ptr
        The columns of block i are ptr[i]:ptr[i+1] (n_blocks + 1,).
    rows
        The rows for given combinations of the columns of each block: mixed (n_columns, m) and the blocks' ends among
        all combinations (n_blocks + 1,) -> BlockColumns.
    """

    columns: BlockColumns
    ptr: Ints
    rows: Callable[[Floats, Ints], BlockColumns]


class Failing(NamedTuple):
    """The element of a body that fails first at a state.

    Attributes
    ----------
    part
        Name of its material.
    J
        Its least volume ratio [-].
    at, size
        Its centre at rest (3,), and its extent [m].
    """

    part: str
    J: float
    at: Floats
    size: float


class Sum:
    """Accumulator of the terms' gradients and tangents, zero at first.

    Attributes
    ----------
    full, points
        Gradient on all entities (n_components,), and its part on the points (n_points, 3) [N], a view.
    own, efforts
        Gradient on the unknowns (n_unknowns,), for terms on frames and actuators, and its part on the efforts
        (n_actuators,), a view.
    data
        The tangent's long array (see `Pattern`), or None where none is requested.
    squares
        Squares of forces [N^2] that count in the scale of the residual, besides those in `full`.
    driven
        (actuators, their `Drives` on all entities) that border the tangent for unknown efforts.
    couplings
        (i, j, rate): symmetric entries of the tangent between the efforts of actuators i and j.
    low_rank
        Unsymmetric products that are added to the tangent.
    rank_one_own
        (column, row), on the unknowns but the efforts, whose product is added to the tangent.
    outside
        (blocks, rows, columns) of tangents outside the pattern: blocks (n, 3, 3) of pairs of points, row <= column.
    near
        Functions of no argument that give such entries of all that may touch soon, with blocks of zeros.
    in_motion
        Gradients on all entities of forces in motion, which do not count in the scale of the residual.
    convex
        Whether points on ridges of a surface that they touch count without their negative stiffness across.
    """

    def __init__(self, layout: Layout, size: int | None = None, *, convex: bool = False) -> None:
        self.convex = convex
        self.full: Floats = np.zeros(layout.n_components)
        self.own: Floats = np.zeros(layout.n_unknowns)
        self.data: Floats | None = None if size is None else np.zeros(size)
        self.squares = 0.0
        self.driven: list[tuple[Ints, Drives]] = []
        self.couplings: list[tuple[int, int, float]] = []
        self.low_rank: list[LowRank] = []
        self.rank_one_own: list[tuple[Floats, Floats]] = []
        self.outside: list[tuple[Floats, Ints, Ints]] = []
        self.near: list[Callable[[], tuple[Floats, Ints, Ints]]] = []
        self.in_motion: list[Floats] = []
        self.points: Floats = self.full[: 3 * layout.n_points].reshape(-1, 3)  # of `full`
        self.efforts: Floats = self.own[layout.first_effort_unknown :]  # of `own`

    @property
    def gradient(self) -> Floats:
        """The whole gradient on all entities."""
        return sum(self.in_motion, start=self.full)


class Term(ABC):
    """One summand of the potential. Frozen: parameters theta [SI] and the state are arguments of each call.

    Only `add` and `energy` are required; the other methods have defaults.
    """

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names in theta of the parameters that its gradient has derivatives by."""
        return ()

    def connectivity(self, layout: Layout) -> Connectivity:
        """The connectivity of its tangent: at least every block that `add` writes to."""
        return Connectivity()

    def plan(self, layout: Layout, pattern: Pattern) -> Self:
        """The term with the places of its blocks in the tangent, looked up once; `add` is called only on
        planned terms.
        """
        return self

    def kinematics(self, state: State) -> Any:
        """Quantities that gradient and derivatives share at a state; passed to them as `Given.known`."""
        return None

    def why_not(self, known: Any) -> str:
        """Why the state is inadmissible, as part of a sentence; "" where it is admissible."""
        return ""

    def failing(self, known: Any, X: Floats) -> Failing | None:
        """The element that fails first, of points at rest at X (n_points, 3); None where none is near to it."""
        return None

    @abstractmethod
    def add(self, into: Sum, given: Given) -> None:
        """Add the gradient and, where `into` has `data`, the exact symmetric tangent.

        Raises
        ------
        SimulationError
            Where the state is inadmissible for a reason that only its forces show; the message is a part of a sentence.
        """

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:  # noqa: B027
        """Add d gradient / d parameter to into[parameter], for those of its parameters that are in there."""

    def add_by_load(self, into: Sum, given: Given) -> None:  # noqa: B027
        """Add d gradient / d `Controls.load`, the factor on all dead loads."""

    @abstractmethod
    def energy(self, given: Given) -> float:
        """The potential [J] whose derivative the gradient is; without what has none, as friction."""

    # A term with a memory (see `memory.py`) has these four methods, too.

    def first_memory(self) -> Floats:
        """The memory (n,) of the term before the first sample, in units of its own; empty for a term without memory."""
        return NOTHING

    def advance(self, given: Given) -> Floats:
        """The memory (n,) of the term after the converged sample `given`. At that sample's state it leaves the gradient
        unchanged.
        """
        return given.memory

    def add_by_memory(self, into: Sum, given: Given, rate: Floats) -> None:  # noqa: B027
        """Add d gradient / d memory times a rate of the memory.

        Parameters
        ----------
        into
            The sum.
        given
            The arguments of the term.
        rate
            The rate (n,).
        """

    def advance_rate(self, given: Given, parameter: str, rate: State, memory_rate: Floats) -> Floats:
        """The derivative (n,) of `advance` by a parameter.

        Parameters
        ----------
        given
            The arguments of the term.
        parameter
            Dotted name of the parameter.
        rate
            Derivatives of the state's arrays, such as dx/dtheta in `rate.x`.
        memory_rate
            Derivatives of the memory (n,).
        """
        return memory_rate

    def measure(self, sizes: Sizes, theta: Theta) -> None:  # noqa: B027
        """Add its contribution to the sizes by which the robot's equations are scaled."""

    def remark(self, state: State, theta: Theta) -> str:
        """Remark on a solution for the user, as a sentence with a blank before it; "" without a remark."""
        return ""

    def why_unlike(self, state: State) -> str:
        """Why a loss of stability at a state is the discrete model's alone and no robot's, as part of a sentence; ""
        where it may be the robot's.
        """
        return ""

    def free_way(self, x: Floats, to: Floats) -> float:
        """Fraction of the straight line between positions (n_points, 3) that the term admits; one where it admits all
        of it.
        """
        return 1.0

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """The term within a time step from a state on: itself, plus its damping, or its friction relative to that
        state.
        """
        return (self,)


Of = TypeVar("Of")


class ByTheta(Generic[Of]):
    """A function of the parameters' values alone, evaluated once for as long as these are the same."""

    def __init__(self, of: Callable[[Theta], Of]) -> None:
        self._of = of
        self._theta: Theta | None = None

    def __call__(self, theta: Theta) -> Of:
        """For these values; a mapping that was given before is not looked into again."""
        if theta is not self._theta:
            self._found, self._theta = self._of(theta), theta
        return self._found


def part_theta(theta: Mapping[str, Of], name: str) -> dict[str, Of]:
    """The parameters of one body or rod, without the prefix of its name."""
    prefix = f"{name}."
    return {key.removeprefix(prefix): value for key, value in theta.items() if key.startswith(prefix)}
