"""Snap-through: the jump to another equilibrium, from a limit point or a loss of stability."""

from __future__ import annotations

from dataclasses import replace

from softcal.errors import SimulationError
from softcal.mechanics.node import Line, Node, node_at, pushing
from softcal.mechanics.stability import overdamped_equilibrium
from softcal.mechanics.state import State, difference
from softcal.mechanics.statics import FREE, Statics

NO_SNAP = 1e-4  # of the robot's extent: a smaller displacement (a tenth of the nudge) is no snap-through


def stable_node_at(statics: Statics, line: Line, c: float, state: State, names: tuple[str, ...]) -> Node:
    """The node of an equilibrium, or of the stable one that the robot reaches from it by snap-through.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    line
        The controls by c.
    c
        Parameter of the line of controls.
    state
        The equilibrium.
    names
        Parameters (k,) of the node's derivatives.

    Raises
    ------
    SimulationError
        Where the tangent is singular, the robot reaches no other equilibrium, or no robot would lose its stability.
    """
    node = node_at(statics, line, c, state, names, mixed=False)
    if not node.is_stable and (why := why_unlike(statics, state)):
        raise SimulationError(why)
    return node if node.is_stable else snapped(statics, line, c, state, names)


def is_nearly_free(node: Node) -> bool:
    """Whether the robot has several free modes after buckling: it then moves along several modes almost
    without force.
    """
    return (node.has_snapped or node.is_snapped) and node.free.shape[1] > 1


def settled(
    statics: Statics, line: Line, last: Node, c: float, begin: State, guess: State, names: tuple[str, ...]
) -> Node | None:
    """The stable node at c reached by overdamped motion, where Newton's method fails because of nearly free modes.

    None where there is no such node, or where it is far from the prediction and reached with more than a negligible
    force.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    line
        The controls by c.
    last
        The last node of the path.
    c
        Parameter of the line of controls.
    begin, guess
        The state from which the motion begins, and the predicted one.
    names
        Parameters (k,) of the node's derivatives.
    """
    if not is_nearly_free(last) or pushing(statics.system, last.state).any():
        return None
    ended = overdamped_equilibrium(statics, begin, line.at(c))
    if not ended.converged:
        return None
    way = statics.reach(difference(statics.system.layout, ended.state, last.state))
    at = statics.system.linearise(ended.state, line.at(c), statics.theta, tangent=False)
    is_driven = ended.work >= FREE * statics.force_scale(at) * way
    if is_driven and not is_no_snap(statics, last.state, guess, ended.state):
        return None
    return node_at(statics, line, c, ended.state, names)


def is_no_snap(statics: Statics, before: State, guess: State, found: State) -> bool:
    """Whether an alleged snap-through ends near its start, or about as near as a regular step would.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    before
        The equilibrium before.
    guess
        The predicted state.
    found
        The equilibrium at the end.
    """
    layout = statics.system.layout
    ahead, way = (statics.reach(difference(layout, state, before)) for state in (guess, found))
    return way <= NO_SNAP * statics.length + 2.0 * ahead


def why_unlike(statics: Statics, state: State) -> str:
    """Why a loss of stability at a state is the discrete model's alone, as part of a sentence; "" where it may be the
    robot's.
    """
    return next(filter(None, (term.why_unlike(state) for term in statics.system.terms)), "")


def snapped(statics: Statics, line: Line, c: float, state: State, names: tuple[str, ...]) -> Node:
    """The stable node at c that the robot snaps through to.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    line
        The controls by c.
    c
        Parameter of the line of controls.
    state
        The state from which it does.
    names
        Parameters (k,) of the node's derivatives.

    Raises
    ------
    SimulationError
        Where it reaches none.
    """
    ended = overdamped_equilibrium(statics, state, line.at(c))
    if not ended.converged:
        raise SimulationError(f"the robot is not stable there, and snaps to no other equilibrium: {ended.status}")
    statics.seeks_free_modes = True
    return replace(node_at(statics, line, c, ended.state, names), is_snapped=True)
