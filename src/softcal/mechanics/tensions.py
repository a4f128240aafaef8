"""The tension along a cable: friction at its via points, with or without a memory, and the stretch of its line.

From the pulled end on, with T the tension there, segment k has

    T_k = T exp(sum_j<=k r_j),    r_j = mu phi_j sigma_j,    -1 <= sigma_j <= 1

phi_j is the turning angle at via point j, before segment j. A cable that is only pulled slides everywhere towards its
pulled end: sigma = -1 (Euler-Eytelwein). Friction *with a memory* opposes the sliding that takes place. The slip

    s_j = sum_k>=j (l_k - l0_k - c_k (T_k - T0)),    c_k = l0_k / EA

is how much more line is beyond via point j than at rest, its stretch set aside. There the friction is an elastic and
then plastic spring, sigma_j = clip((s_j - p_j) / delta, -1, 1), with the presliding displacement delta and the plastic
slip p_j, its memory. A constant part of the friction: `friction_level.py`.

*Return mapping.* The trial is that a via point sticks: its plastic slip stays, and sigma = (s_j - p_j) / delta. Within
-1 <= sigma <= 1 that holds, and friction is elastic, d sigma / d s_j = 1 / delta. Beyond, the trial is returned to the
limit: the via point slides, sigma = +-1, d sigma / d s_j = 0, and the plastic slip follows. In both cases the state
leaves

    p_j -> s_j - delta sigma_j

which is p_j where it sticks. In a time step, friction that grows with the speed of the slip adds drag (s_j - s_j at the
step's start) to sigma, beyond its limits too.

*Equations.* With stretch the slips depend on the tensions, those on the slips. The unknowns of a cable are the
stretches beyond its via points, S_j = sum_k>=j c_k T_k, so that T_k = (S_k - S_(k+1)) / c_k; Newton's method for them
is in `tension_kernels.solve`. Without a memory and drag, or without stretch, sigma does not depend on T: one pass from
the pulled end suffices.

*Tangent.* By rho_k = ln(T_k / T), its equations are rho_k = rho_(k-1) + r_k and, with f_j = d r_j / d s_j,

    d r_j = own_j - f_j sum_k>=j c_k T_k d rho_k,    sum_k>=j c_k T_k d rho_k = a_j + b_j d rho_(j-1)

where own_j is the rate at fixed rho. With m_j = c_j T_j + b_(j+1), a pass to the pulled end and one back solve them:

    b_j = m_j / (1 + f_j m_j) >= 0,    a_j = m_j (own_j - f_j a_(j+1)) / (1 + f_j m_j) + a_(j+1)
    d rho_j = (d rho_(j-1) + own_j - f_j a_(j+1)) / (1 + f_j m_j)

(`respond`), and `pull_back` is the transpose, for gradients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.friction_level import along, by_preload
from softcal.mechanics.tension_kernels import HELD, beyond, changing, pull_back, respond, solve, turn

# The parameters of a line, and their values where they are not stated.
KINDS = {
    "friction_coefficient": 0.0,
    "stiffness": np.inf,
    "compliance": 0.0,
    "pretension": 0.0,
    "presliding": 0.0,
    "friction_preload": 0.0,
}
# Those that state the stiffness and the pretension by the length of the cable at rest.
BY_LENGTH = {"spring_rate": np.nan, "rest_length": np.nan}


@dataclass(frozen=True)
class Lines:
    """The properties of the lines of all cables, each (n_cables,).

    Attributes
    ----------
    names
        Names of the cables.
    mu
        Friction coefficient at via points [-].
    softness
        1 / EA [1/N]; zero without stretch.
    compliance
        Compliance of the machine that pulls [m/N].
    pretension
        Tension at zero shortening of the robot at rest [N].
    presliding
        Presliding displacement [m]; zero where friction has no memory.
    preload
        The tension whose friction acts beside that of the cable's own tension, a constant [N]: see `friction_level.py`.
    remembers
        Whether the friction of a cable has a memory.
    """

    names: Sequence[str]
    mu: Floats
    softness: Floats
    compliance: Floats
    pretension: Floats
    presliding: Floats
    preload: Floats
    remembers: np.ndarray

    @cached_property
    def are_ideal(self) -> bool:
        """Whether no line has friction or stretch, and no machine gives way."""
        return not (self.mu.any() or self.softness.any() or self.compliance.any())

    def rates(self, i: int, key: str, length: float, longer: float, by_length: Sequence[str]) -> dict[str, float]:
        """Rates of the properties of a line, by the names of `KINDS`: of that itself which varies, and of those that
        follow from it and from the length of the cable.

        Parameters
        ----------
        i
            Number of the cable.
        key
            Last part of the parameter's name.
        length, longer
            Length of the cable at rest [m], and its rate by the parameter.
        by_length
            Those of `BY_LENGTH` that are stated of it.
        """
        rates = {key: 1.0} if key in KINDS else {}
        softness, compliance, pretension = float(self.softness[i]), self.compliance[i], self.pretension[i]
        if "spring_rate" in by_length:
            rates["stiffness"] = length if key == "spring_rate" else longer / (softness * length)
        if "rest_length" in by_length:  # T0 = (length - rest_length) / soft
            soft, stiffer = length * softness + compliance, rates.get("stiffness", 0.0)
            softer = (longer - length * softness * stiffer) * softness + rates.get("compliance", 0.0)
            rates["pretension"] = float(longer - (key == "rest_length") - pretension * softer) / soft
        return rates


@dataclass(frozen=True)
class Turns:
    """Turning angles at the via points, each with the segment beyond it; zero at the first segment of a cable.

    Attributes
    ----------
    phi
        Angles (n_segments,) [rad].
    by_near, by_far
        d phi / d vectors of the segment before, and of the own one (n_segments, 3) [1/m].
    """

    phi: Floats
    by_near: Floats
    by_far: Floats

    def rates(self, v_rates: Floats) -> Floats:
        """Rates of the angles (n_segments,) for rates (n_segments, 3) of the segments' vectors."""
        before = np.concatenate([v_rates[:1], v_rates[:-1]])
        return (self.by_near * before + self.by_far * v_rates).sum(axis=1)


def turns(v: Floats, ptr: Ints) -> Turns:
    """The angles between each segment's vector v (n_segments, 3) and the one before; ptr: of the cables' segments.

    Rounded off at zero: phi^2 / sqrt(phi^2 + s^2) in the place of phi; far above s it is phi, without an offset.
    """
    phi, by_near, by_far = np.zeros(len(v)), np.zeros_like(v), np.zeros_like(v)
    turn(ptr, np.ascontiguousarray(v), phi, by_near, by_far)
    return Turns(phi, by_near, by_far)


class Course(NamedTuple):
    """The courses of the cables: segments of one cable after the other, each cable's from its pulled end on.

    Attributes
    ----------
    ptr
        The segments of cable c are ptr[c]:ptr[c+1] (n_cables + 1,).
    rest, longer
        Length of each segment at rest, and what it is longer now (n_segments,) [m].
    slopes
        d length / d vector of each segment (n_segments, 3).
    moves
        Whether a segment can move (n_segments,).
    turns
        The turning angles.
    """

    ptr: Ints
    rest: Floats
    longer: Floats
    slopes: Floats
    moves: np.ndarray
    turns: Turns


class Viscous(NamedTuple):
    """The part of the friction that increases with the speed of the slip, in a time step of length h.

    Attributes
    ----------
    drag
        1 / (h v) of each cable (n_cables,) [1/m], with the speed v at which friction is twice as large; else zero.
    begun
        Slip at the step's start (n_segments,) [m].
    """

    drag: Floats
    begun: Floats


@dataclass(frozen=True)
class Tensions:
    """The tensions along all cables at a state, by segments in the order of their course.

    Attributes
    ----------
    lines, course
        Their properties, and where they run.
    pull
        Tensions at the pulled ends (n_cables,) [N].
    softness
        Stretch of each segment by its tension, c_k (n_segments,) [m/N].
    slip
        Slip at the via point before each segment (n_segments,) [m].
    sigma
        Share of the friction that acts, with its sign, but for what the speed adds (n_segments,) [-].
    viscous
        What the speed of the slip adds.
    rho
        ln(T_k / T) (n_segments,), of their levels where friction has a preload.
    segments
        T_k (n_segments,) [N].
    factor, by_rho
        dT_k / dT at fixed rho [-], and dT_k / d rho [N] (n_segments,).
    """

    lines: Lines
    course: Course
    pull: Floats
    softness: Floats
    slip: Floats
    sigma: Floats
    viscous: Viscous
    rho: Floats
    segments: Floats
    factor: Floats
    by_rho: Floats

    @cached_property
    def cable(self) -> Ints:
        """The cable of each segment (n_segments,)."""
        return np.repeat(np.arange(len(self.pull)), np.diff(self.course.ptr))

    @cached_property
    def by_slip(self) -> Floats:
        """d r / d slip at the via point before each segment (n_segments,) [1/m]: zero where it slides, at any speed."""
        most, delta = (self.lines.mu[self.cable] * self.course.turns.phi, self.lines.presliding[self.cable])
        sticks = self.lines.remembers[self.cable] & (np.abs(self.sigma) < HELD)
        by_slip = np.where(sticks, most / np.where(sticks, delta, 1.0), 0.0)
        return by_slip + most * self.viscous.drag[self.cable]

    @property
    def share(self) -> Floats:
        """Sigma, with what the speed adds (n_segments,)."""
        return self.sigma + self.viscous.drag[self.cable] * (self.slip - self.viscous.begun)

    @property
    def by_angle(self) -> Floats:
        """d r / d turning angle (n_segments,)."""
        return self.lines.mu[self.cable] * self.share

    @cached_property
    def stretched(self) -> Floats:
        """d (c_k T_k) / d rho (n_segments,) [m]; a cable in compression, which is at most an intermediate state, has no
        friction of its stretch.
        """
        return self.softness * np.maximum(self.by_rho, 0.0)

    def beyond(self, values: Floats) -> Floats:
        """Sums of values (n_segments,) over each segment and those of its cable beyond it."""
        return beyond(self.course.ptr, values)

    def respond(self, own: Floats) -> Floats:
        """Rates of rho (n_segments, k) where each r_j has rates `own` (n_segments, k) at fixed rho."""
        return respond(self.course.ptr, self.by_slip, self.stretched, np.ascontiguousarray(own))

    @cached_property
    def changing(self) -> Ints:
        """The segments that can move and whose tension changes with the shape."""
        course = self.course
        changes = changing(course.ptr, self.by_slip, self.stretched, self.by_angle, course.moves)
        return np.flatnonzero(changes & (self.segments != 0.0))

    def by_shape(self, weights: Floats) -> Floats:
        """Sums of rates of rho, with weights (n_segments, k) of the segments: by the segments' vectors
        (n_segments, 3, k) [1/m].
        """
        course, turns = self.course, self.course.turns
        of_lengths, of_angles = pull_back(course.ptr, self.by_slip, self.stretched, weights)
        of_angles *= self.by_angle[:, None]
        out = course.slopes[:, :, None] * of_lengths[:, None, :] + turns.by_far[:, :, None] * of_angles[:, None, :]
        out[:-1] += turns.by_near[1:, :, None] * of_angles[1:, None, :]
        return out

    @cached_property
    def by_pull(self) -> Floats:
        """d rho / d T of the own cable (n_segments,) [1/N]."""
        pulled = np.where(self.pull[self.cable] > 0.0, self.softness * self.factor, 0.0)
        return self.respond(-(self.by_slip * self.beyond(pulled))[:, None])[:, 0]

    @property
    def stretch(self) -> Floats:
        """Stretch of each line, and of its machine, beyond that by the pretension (n_cables,) [m]."""
        return self.per_cable(self.softness * (self.segments - self._pretension)) + self.lines.compliance * (
            self.pull - self.lines.pretension
        )

    def stretch_rates(self, rho: Floats, pull: Floats) -> Floats:
        """Rates of the stretch (n_cables,) at rates of rho (n_segments,) and of T (n_cables,)."""
        of_line = self.softness * (self.factor * pull[self.cable] + self.by_rho * rho)
        return self.per_cable(of_line) + self.lines.compliance * pull

    def per_cable(self, values: Floats) -> Floats:
        """Sums (n_cables,) of values (n_segments,)."""
        return np.bincount(self.cable, weights=values, minlength=len(self.pull)).astype(np.float64)

    @property
    def _pretension(self) -> Floats:
        return self.lines.pretension[self.cable]

    def by_property(self, kind: str, cable: int) -> tuple[Floats, Floats, float]:
        """Derivatives at fixed rho by one property of a cable's line: of r_j and of the slips (n_segments,), and of
        the cable's stretch.
        """
        own, n = self.cable == cable, len(self.cable)
        lines = self.lines
        r, slip = np.zeros(n), np.zeros(n)
        if kind == "friction_coefficient":
            return np.where(own, self.course.turns.phi * self.share, 0.0), slip, 0.0
        if kind == "stiffness":
            slip, stretch = self.by_softness(np.where(own, -self.softness * lines.softness[cable], 0.0))
            return self.by_slip * slip, slip, stretch
        if kind == "pretension":
            slip = self.beyond(np.where(own, self.softness, 0.0))
            return self.by_slip * slip, slip, -float(self.softness @ own + lines.compliance[cable])
        if kind == "compliance":
            return r, slip, float(self.pull[cable] - lines.pretension[cable])
        if kind == "friction_preload":
            stretch = self.softness * self.by_preload(cable)
            slip = -self.beyond(stretch)
            return self.by_slip * slip, slip, float(stretch.sum())
        by_presliding = np.where(own, -self.by_slip * self.sigma, 0.0)
        return by_presliding, slip, 0.0

    def by_preload(self, cable: int) -> Floats:
        """dT_k / d preload of the friction of a cable (n_segments,) at fixed rho."""
        of_segment = self.lines.preload[self.cable]
        rates = by_preload(self.pull[self.cable], of_segment, self.rho, self.segments)
        return np.where(self.cable == cable, rates, 0.0)

    def by_softness(self, rates: Floats) -> tuple[Floats, float]:
        """Rates of the slips (n_segments,) and of a cable's stretch at fixed rho, by those of its c_k (n_segments,)."""
        slip = -self.beyond(rates * (np.maximum(self.segments, 0.0) - self._pretension))
        return slip, float(rates @ (self.segments - self._pretension))

    @property
    def plastic_slip(self) -> Floats:
        """The memory that the state leaves (n_segments,) [m]."""
        remembers = self.lines.remembers[self.cable]
        return np.where(remembers, self.slip - self.lines.presliding[self.cable] * self.sigma, 0.0)

    def plastic_slip_rates(self, slip: Floats, memory: Floats, presliding: Floats) -> Floats:
        """Rates of `plastic_slip` (n_segments,).

        Parameters
        ----------
        slip
            Rates of the slips (n_segments,).
        memory
            Rates of the plastic slips before (n_segments,).
        presliding
            Rates of the cables' presliding displacements (n_cables,).
        """
        remembers = self.lines.remembers[self.cable]
        slides = slip - self.sigma * presliding[self.cable]
        return np.where(remembers, np.where(np.abs(self.sigma) < HELD, memory, slides), 0.0)


def tensions(lines: Lines, course: Course, pull: Floats, memory: Floats, viscous: Viscous) -> Tensions:
    """The tensions along all cables.

    Parameters
    ----------
    lines, course
        The properties of their lines, and where they run.
    pull
        Tensions at the pulled ends (n_cables,) [N].
    memory
        Plastic slips (n_segments,) [m], by the step before.
    viscous
        The part of the friction that increases with the speed.

    Raises
    ------
    SimulationError
        Where Newton's method does not converge.
    """
    of_segment = np.repeat(np.arange(len(pull)), np.diff(course.ptr))
    softness = course.rest * lines.softness[of_segment]
    loose = course.longer + softness * lines.pretension[of_segment]  # what the slips would sum without stretch
    rho, sigma, slip = (np.zeros(len(softness)) for _ in range(3))
    delta = np.where(lines.remembers, lines.presliding, 0.0)
    most = lines.mu[of_segment] * course.turns.phi
    if unsolved := solve(
        course.ptr, pull, lines.preload, most, softness, loose, memory, delta, *viscous, rho, sigma, slip
    ):
        c = unsolved - 1
        turned = float(most[course.ptr[c] : course.ptr[c + 1]].sum())
        raise SimulationError(
            f"the tensions along {lines.names[c]} were not found at a pull of {pull[c]:.4g} N and a friction "
            f"coefficient times turning angle of {turned:.4g}"
        )
    segments, factor, by_rho = (np.zeros(len(softness)) for _ in range(3))
    along(pull[of_segment], lines.preload[of_segment], rho, segments, factor, by_rho)
    return Tensions(
        lines=lines,
        course=course,
        pull=pull,
        softness=softness,
        slip=slip,
        sigma=sigma,
        viscous=viscous,
        rho=rho,
        segments=segments,
        factor=factor,
        by_rho=by_rho,
    )
