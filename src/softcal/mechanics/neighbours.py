"""Derivatives by parameters that the undeformed shape, so every term of the system, depends on.

At fixed unknowns the residual, and what sensors read, differ between the systems at values a small step to either
side: their central difference is the derivative, whatever has been built from the shape. A step is a millionth of the
robot, so that rounding and curvature both leave some eight digits. No equilibrium is solved for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from softcal.checks import Floats
from softcal.mechanics.layout import Layout
from softcal.mechanics.state import State

STEP = 1e-6  # of the robot's extent, or of one


@dataclass(frozen=True)
class Neighbours:
    """Two neighbours of a system or twin: built with a parameter a step less, and a step more.

    Attributes
    ----------
    build : From an offset of the value, something whose `system` is that system
    step : The offset [unit of the parameter]
    """

    build: Callable[[float], Any]
    step: float

    @cached_property
    def pair(self) -> tuple[Any, Any]:
        """Before and after the value."""
        return self.build(-self.step), self.build(self.step)

    def rate(self, of: Callable[[Any, State], Floats], state: State) -> Floats:
        """The derivative of what follows from each of them and its state of the same unknowns."""
        before, after = (of(one, same_unknowns(one.system.layout, state)) for one in self.pair)
        return (after - before) / (2.0 * self.step)


def same_unknowns(layout: Layout, state: State) -> State:
    """The state with the unknowns of another one, of a system with the same numbering and another shape at rest."""
    x, position = layout.X.copy(), state.position.copy()
    x[layout.free_points] = state.x[layout.free_points]
    position[layout.n_moving_frames :] = layout.references[layout.n_moving_frames :]
    layout.links.place(x, position, state.rotation)
    return State(x, position, state.rotation, state.pressure, state.effort, state.memory)
