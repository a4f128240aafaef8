"""The twin on a finer mesh, by the change of its channels along a load path.

Along the path of one actuator the change from mesh to mesh is far smoother than the channels: a polynomial through two
equilibria of the finer twin, with their slopes, represents it within some tenths of a per cent of itself. Contact
begins and ends elsewhere on every mesh; where surfaces touch, the change is a curve through the values of three to
eight, without their slopes. Each of them is solved from the equilibrium on the coarse mesh, not by following the path
on the finer one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import KroghInterpolator, PchipInterpolator, make_interp_spline

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.node import Node, node_at
from softcal.mechanics.path import Path, strays
from softcal.mechanics.state import State, difference, moved, rest_state
from softcal.twin.build import twin_of
from softcal.twin.curve import FINE
from softcal.twin.drives import by_coordinate
from softcal.twin.equilibrium_path import CURVE_TOLERANCE, EquilibriumPath, guide_of, statics_of
from softcal.twin.parameters import robot_parameters, with_shape
from softcal.twin.prolongation import Prolongation, prolongation
from softcal.twin.proportional import at_moduli, at_own_moduli
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response, Shown, by_column
from softcal.twin.robot import Robot
from softcal.twin.sensors import angle_columns
from softcal.twin.simulate import simulate

# Of equilibria on the finer mesh, over the path's length: two, or more of them, or more about the place that the curve
# represents worst. At the first one, the end, stability is judged: the robot's own path is stable up to there.
PLACES, MOST_PLACES = (1.0, 0.5, 0.75, 0.25), 8
CHANGE_TOLERANCE = 0.03  # estimated error over the largest change of all channels of one unit
# What touches differs from mesh to mesh, so where surfaces do the change is rough: so many times that, and the curve's
# tolerance, are allowed.
ROUGH, ROUGH_CURVE = 4.0, 20.0
ACCURACY = 1e-6  # of equilibria on the finer mesh and their slopes: a change is some thousandths of a channel or more
ROUGH_ACCURACY = 3e-2  # where surfaces touch: of the neck, 1.5 % of the change of its tension


@dataclass(frozen=True)
class FinerTwin:
    """The engine that simulates a robot on a finer mesh, with one of the robot's own load paths to begin from.

    Attributes
    ----------
    robot
        The robot on the finer mesh.
    corners
        Body -> barycentric coordinates of the corners of its finer tets, as in `prolongation`.
    """

    robot: Robot
    corners: Mapping[str, Floats]

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: Shown = False,
    ) -> Response:
        """The response on the finer mesh: by its change along the path of one actuator that is driven, else as
        `simulate`.
        """
        changed = None if sensitivities or snapshots else self._changed(robot, protocol, theta or {})
        if changed is not None:
            return changed
        return simulate(self.robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots, crossings=False)

    def _changed(self, robot: Robot, protocol: Protocol, theta: Mapping[str, float]) -> Response | None:
        """The own response plus its change to the finer mesh; None where the change may be no smooth curve."""
        driven = protocol.completed(robot).driven
        if len(driven) != 1 or protocol.commands[driven[0]].control != "shortening":
            return None
        own, finer = twin_of(robot, theta), twin_of(self.robot, theta)
        values = {**{name: info.value for name, info in robot_parameters(robot).items()}, **theta}
        system = own.system
        if robot.rods or system.remembers or system.is_loaded(values):
            return None
        at, s, _ = at_own_moduli(own, values)
        (actuator,) = driven
        with (
            statics_of(own, at, own.kept.at(at)) as statics,
            statics_of(finer, at) as finer_statics,
            guide_of(own, at, actuator if with_shape(robot, theta) is robot else None) as guide,
        ):
            along = EquilibriumPath(own, statics, (), actuator, CURVE_TOLERANCE, is_shared=True, guide=guide)
            further = EquilibriumPath(finer, finer_statics, (), actuator, CURVE_TOLERANCE)
            try:
                samples = by_coordinate(along, along.start(), protocol.commands[actuator].values)
                if not samples.succeeded or any(node.is_snapped for node in samples.path.nodes):
                    return None
                end = float(samples.c.max())
                change = _change(along, samples.path, end, further, prolongation(own, finer, self.corners))
            except SimulationError:
                return None
            if change is None:
                return None
            response = Response(
                by_column(along.units, samples.values + change.at(samples.c)),
                along.units,
                samples.status,
                succeeded=True,
                n_factorisations=statics.n_factorisations + finer_statics.n_factorisations,
            )
            return at_moduli(own, response, s)


@dataclass(frozen=True)
class _Change:
    """The change of the channels at some places c (n,) [m] of a path from `start` on, where it is zero.

    values, slopes (n, n_channels): the change, and by c. is_rough: whether slopes say nothing of the change beside
    their place, as where contacts come and go.
    """

    start: float
    c: Floats
    values: Floats
    slopes: Floats
    is_rough: bool

    def at(self, c: Floats, *, without: int | None = None) -> Floats:
        """The change (m, n_channels) at c (m,); without: the number of a place whose slope, or all of it where it is
        rough, is left out.
        """
        length, places = self.c.max() - self.start, [(0.0, np.zeros(self.values.shape[1]))]
        for k, place in enumerate((self.c - self.start) / length):
            if not (self.is_rough and k == without):
                places.append((place, self.values[k]))
            if not self.is_rough and k != without:
                places.append((place, length * self.slopes[k]))
        places.sort(key=lambda each: each[0])  # values stay before slopes
        x, y = (np.array(part) for part in zip(*places, strict=True))
        curve = PchipInterpolator(x, y) if self.is_rough else KroghInterpolator(x, y)
        return curve((c - self.start) / length)

    def errors(self) -> Floats:
        """Estimated errors (n - 1, n_channels) of the curve by leaving out each place but the first: its slope,
        or where the change is rough half of what the place itself makes of it: without it the places there are twice as
        far apart, and at a kink the error as well.
        """
        c, part = np.linspace(self.start, self.c.max(), FINE), 0.5 if self.is_rough else 1.0
        return part * np.array([np.abs(self.at(c) - self.at(c, without=k)).max(axis=0) for k in range(1, len(self.c))])

    def beside(self, k: int) -> tuple[float, float]:
        """The midpoints between a place (not the last) and its two neighbours, as fractions of the length [-]."""
        places = np.sort(np.append(self.c, self.start))
        j = int(np.searchsorted(places, self.c[k]))
        before, after = 0.5 * (places[j - 1 : j + 1] + places[j : j + 2]) - self.start
        return before / (places[-1] - self.start), after / (places[-1] - self.start)


def _change(
    along: EquilibriumPath, path: Path, end: float, finer: EquilibriumPath, prolong: Prolongation
) -> _Change | None:
    """The change of the channels from a path that begins at rest, up to `end`, to the same on a finer mesh; None where
    no stable equilibrium was found near its own, or the change is no smooth curve.
    """
    start = path.nodes[0].c
    if end <= start:
        return None
    system = finer.twin.system
    scale = along.scale(along.curve(path.nodes).values)
    x = prolong(along.at(path, end).state).x
    touches = any(contact.overlap(x) > 0.0 for contact in system.of(ContactTerm))
    rough, of_curve = (ROUGH, ROUGH_CURVE) if touches else (1.0, 1.0)
    places = PLACES[:3] if touches else PLACES[:2]
    none = np.zeros(system.layout.n_unknowns)
    movements = {0.0: none, 1.0: none}  # place -> what the finer mesh moves there, as far as it is known
    c: list[float] = []
    values: list[Floats] = []
    slopes: list[Floats] = []
    while True:
        for place in places:
            own = along.at(path, start + place * (end - start))
            prolonged = prolong(own.state)
            expected = make_interp_spline(sorted(movements), [movements[k] for k in sorted(movements)], k=1)(place)
            guess = moved(system.layout, prolonged, expected)
            node = _on_finer(finer, own.c, guess, judged=place == 1.0, is_rough=touches)
            if node is None:
                return None
            movements[place] = difference(system.layout, node.state, prolonged)
            here, there = along.curve((own,)), finer.curve((node,))
            c.append(own.c)
            angles, by_mesh = angle_columns(along.twin), there.values[0] - here.values[0]
            by_mesh[angles] -= 2.0 * np.pi * np.round(by_mesh[angles] / (2.0 * np.pi))
            values.append(by_mesh)
            slopes.append(there.slopes[0] - here.slopes[0])
        change = _Change(start, np.array(c), np.array(values), np.array(slopes), is_rough=touches)
        allowed = np.maximum(
            rough * CHANGE_TOLERANCE * along.largest(change.values), of_curve * along.tolerance * scale
        )
        excess = (change.errors() / allowed).max(axis=1)
        if excess.max() <= 1.0:
            return change
        if len(c) >= MOST_PLACES or (len(c) >= len(PLACES) and not touches):
            return None
        places = PLACES[len(c) : len(c) + 1] or change.beside(1 + int(excess.argmax()))


def _on_finer(finer: EquilibriumPath, c: float, guess: State, *, judged: bool, is_rough: bool) -> Node | None:
    """The equilibrium on a finer mesh at c, near a guess; None where there is none, or where its stability is judged
    and it is not stable. is_rough: whether surfaces touch; then its slope is zero, since it says nothing.
    """
    statics, line = finer.statics, finer.line
    layout = statics.system.layout
    statics.forget()
    solved = statics.equilibrium(guess, line.at(c), ROUGH_ACCURACY if is_rough else ACCURACY, flat_ridges=True)
    if not solved.converged or strays(statics, rest_state(layout), guess, solved.state):
        return None
    if not is_rough:
        node = node_at(statics, line, c, solved.state, (), judged=judged, accuracy=ACCURACY)
        return node if node.is_stable else None
    if judged:
        statics.forget()  # what touches has changed too much for earlier factors to show whether it is stable
        statics.tangent_at(solved.state, line.at(c))
        if statics.n_unstable() > 0:
            return None
    none = np.zeros((layout.n_unknowns, 0))
    return Node(c, solved.state, np.zeros(layout.n_unknowns), none, none)
