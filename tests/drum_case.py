"""Blocks on springs, each pulled along x by a cable that runs round a drum to its machine: all that is known in closed
form of friction with a memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from mechanics_cases import column_robot, elastic
from slider_foundation import SliderFoundation

from softcal.mechanics.cable import cables_of
from softcal.mechanics.cable_routes import build_cables
from softcal.mechanics.layout import FIXED, FREE, Layout
from softcal.mechanics.march import Reached, Target, reach
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System, build_system
from softcal.mechanics.term import Controls
from softcal.twin.robot import Cable, ViaPoint

K, MU, RADIUS, LEAD = 400.0, 0.15, 0.02, 0.1
WRAP = 0.5 * np.pi


@dataclass(frozen=True)
class Spring(SliderFoundation):
    """With no body beside it: the equations are scaled by its own stiffness."""

    def measure(self, sizes, theta):
        sizes.shear_modulus, sizes.volume = theta[self.parameters[0]] / sizes.extent, sizes.extent**3


def drum(n: int) -> np.ndarray:
    """Via points of a quarter turn about (0, -RADIUS), entered along x and left along -y, and the machine's grip."""
    if n == 0:
        return np.array([[LEAD, 0.0, 0.0]])
    angle = np.linspace(0.0, WRAP, n)
    arc = RADIUS * np.column_stack([np.sin(angle), np.cos(angle) - 1.0, 0.0 * angle])
    return np.vstack([arc, arc[-1] + [0.0, -LEAD, 0.0]])


def blocks(n_via: int, n_cables: int = 1, stated: Sequence[str] = ()) -> System:
    """Blocks 0, 1, ... with cables a, b, ... that are pulled at their last ends."""
    points, rider, cables = [], [], {}
    for c in range(n_cables):
        first = len(points)
        own = np.vstack([[-LEAD, 0.0, 0.0], drum(n_via)]) + [0.0, 0.0, 0.05 * c]
        points.extend(own)
        rider.extend([FREE] + [FIXED] * (len(own) - 1))
        cables["abc"[c]] = [[(first + i, 1.0)] for i in range(len(own))]
    X, rider = np.array(points), np.array(rider)
    layout = Layout(X, rider, np.zeros((0, 3)), 0, n_cables)
    names = tuple(f"{name}.{kind}" for name in cables for kind in stated)
    term = build_cables(X, cables, np.ones(n_cables, dtype=bool), stated=names)
    return build_system(layout, (Spring(np.flatnonzero(rider == FREE), X, "spring"), term))


def theta_of(system: System, **line: float) -> dict[str, float]:
    cables = cables_of(system).names
    own = {f"{name}.{kind}": value for name in cables for kind, value in {"friction_coefficient": MU, **line}.items()}
    return {"spring.stiffness": K, "spring.yield_force": 1e9, **own}


@dataclass(frozen=True)
class Walk:
    """Tensions and shortenings at the machine, and the blocks' ways, of each sample (n, n_cables), and its states."""

    tension: np.ndarray
    shortening: np.ndarray
    way: np.ndarray
    reached: Sequence[Reached]


def walk(system: System, theta: Mapping[str, float], commands: np.ndarray, *, by_tension: bool = False) -> Walk:
    """Through samples of commands (n, n_cables) in their order."""
    n = len(system.actuators)
    commands = np.reshape(commands, (-1, n))
    statics, none = Statics(system, theta), np.zeros(n)
    rest = rest_state(system.layout)
    last = Reached(rest, Controls(none == 0.0, none, system.coordinates(rest, theta)), np.zeros((0, 0)))
    reached = []
    for row in commands:
        target = Controls(np.full(n, by_tension), row if by_tension else none, none if by_tension else row)
        last = reach(statics, last, Target(target))
        reached.append(last)
    free = np.flatnonzero(system.layout.rider == FREE)
    return Walk(
        np.array([one.state.effort for one in reached]),
        np.array([system.coordinates(one.state, theta) for one in reached]),
        np.array([one.state.x[free, 0] - system.layout.X[free, 0] for one in reached]),
        reached,
    )


def with_slip(reached: Reached, theta: Mapping[str, float], system: System):
    """The tensions along the cables at a sample."""
    cables = cables_of(system)
    given = system.given(replace(reached.state), reached.controls, theta)[system.terms.index(cables)]
    return cables.tensions(given)


def robot_over_a_drum(mu: float, n: int = 12, *, law: dict | None = None):
    """The cable runs down from the plate and round a quarter drum, as n points fixed in space, to its pulled end."""
    angle = np.linspace(0.0, 0.5 * np.pi, n)
    drum = np.array([0.07, 0.0, 0.0]) + 0.02 * np.column_stack([-np.cos(angle), 0.0 * angle, -np.sin(angle)])
    points = (
        ViaPoint(np.array([0.05, 0.0, 0.1]), "plate"),
        *(ViaPoint(at) for at in drum),
        ViaPoint(drum[-1] + [0.04, 0.0, 0.0]),
    )
    return column_robot("P1", parameters=law or elastic(0.5e6, 0.4), cables=(Cable("front", points, mu),))
