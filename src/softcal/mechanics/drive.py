"""A drive: a motor turns a pulley through a gear, and the pulley pulls cables in and pays others out.

The pulley's angle a is a motion of the robot. It takes up the length r_i a of cable i, r_i < 0 of one that it pays out,
through a spring of rate k with the pretension T0 at a = 0. The motor's angle and torque are

    phi = N (a + b/2 s(N M)) + phi_0,    N M = sum_i r_i T_i,    s(K) = K / sqrt(K^2 + m^2)

with the gear ratio N, the zero phi_0, and the backlash b between gear and pulley: forward the motor leads by half of
it, backward it lags. So the tensions T_i of the cables, each with its friction, stretch and limit (slack), stay the
unknowns that they are; beside them a is one, and the torque where the angle is commanded:

    Pi_d = sum_i (T_i r_i a - (T_i - T0)^2 / 2k) - M (N a + phi_0 - phi*) - b/2 (sqrt((N M)^2 + m^2) - m)

whose derivatives by T_i complete the cables' own, q_i = r_i a - (T_i - T0) / k, while that by a is the balance of the
torques. s is a step with rounded edges: within the play the pulley's torque K = N M is of the size of m, and beyond it
the pulley's angle is off by b/4 (m/K)^2.

In motion a rotor of inertia J turns with the motor, by N a: it is a spring of stiffness J N^2 k on the pulley's angle,
as all mass is in a step (`time_step.py`), and M is the motor's torque, with what accelerates the rotor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.actuator import ActuatorLimits, ActuatorTerm
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.term import Controls, Given, Sum, Term, Theta

PLAY_TORQUE = 1e-5  # m, over which the play is passed [N m]
UNIT_FORCE = 1.0  # [N], for the scale of torques


@dataclass(frozen=True)
class DriveTerm(ActuatorTerm):
    """One drive: its motor and, second, its pulley.

    Attributes
    ----------
    name
        First part of its parameters' names.
    cables
        Numbers of its cables among the actuators (n,).
    shares
        Their radii over that of the pulley (n,), negative of a cable that a positive angle pays out.
    gear_ratio
        Turns of the motor for one of the pulley [-], negative where they turn against each other.
    stated
        Its parameters that are there, by the last parts of their names.
    swing
        In a time step k [1/s^2], and the angle [rad] at which the rotor has no acceleration; (0, 0) at rest.
    """

    name: str
    cables: Ints
    shares: Floats
    gear_ratio: float
    stated: tuple[str, ...]
    swing: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def parameters(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return tuple(f"{self.name}.{key}" for key in self.stated)

    @property
    def actuators(self) -> Sequence[ActuatorLimits]:
        pulley = ActuatorLimits(f"the pulley of {self.name}", "torque", "angle", is_motion=True)
        return (ActuatorLimits(self.name, "angle", "torque"), pulley)

    @property
    def followers(self) -> Mapping[str, Ints]:
        return {self.name: np.append(self.cables, self.first + 1)}

    @property
    def swings(self) -> bool:
        return "rotor_inertia" in self.stated

    def engaged(self, is_held: np.ndarray, target: Controls) -> np.ndarray:
        """Its motor and pulley as commanded; by a torque, driven with one of the cables that this pulls.

        Raises
        ------
        SimulationError
            Where it pulls none.
        """
        if target.is_held[self.first + 1]:
            return is_held
        driven = is_held.copy()
        driven[self.own] = target.is_held[self.own]
        if target.is_held[self.first] and driven[self.cables].all():
            torque = float(self.gear_ratio * target.effort[self.first])
            pulled = self.cables[self.shares < 0.0 if torque < 0.0 else self.shares > 0.0]
            if len(pulled):
                driven[pulled[0]] = False
            elif torque:
                raise SimulationError(f"a torque of {target.effort[self.first]:.4g} N m of {self.name} pulls no cable.")
            else:
                driven[self.cables[0]] = False
        return driven

    def shape_coordinates(self, x: Floats) -> Floats:
        return np.zeros(2)

    def shape_gradient(self, x: Floats, i: int, size: int) -> Floats:
        return np.zeros(size)

    def add_forces(self, given: Given, effort: Floats, into: Sum, transmission: Any) -> None:
        """Nothing: its cables act on the robot."""

    def coordinates(self, given: Given, transmission: Any) -> Floats:
        """The motor's angle [rad], and the torque that the cables do not balance [N m]."""
        torque, angle = given.state.effort[self.own].tolist()
        play = 0.5 * self._value(given.theta, "gear_backlash") * _sign(self.gear_ratio * torque)
        balance = self.gear_ratio * torque - float(self._radii(given.theta) @ self._tensions(given))
        balance -= self._spring_of_rotor(given.theta) * (angle - self.swing[1])
        return np.array([self.gear_ratio * (angle + play) + self._value(given.theta, "zero"), balance])

    def taken_up(self, given: Given) -> Floats:
        out = np.zeros(len(given.state.effort))
        stretch = self._softness(given.theta) * (self._tensions(given) - self._value(given.theta, "pretension"))
        out[self.cables] = self._radii(given.theta) * given.state.effort[self.first + 1] - stretch
        return out

    def couplings(self, given: Given) -> list[tuple[int, int, float]]:
        motor, pulley = self.first, self.first + 1
        softness, torque = self._softness(given.theta), self.gear_ratio * float(given.state.effort[motor])
        slope = PLAY_TORQUE**2 / float(np.hypot(torque, PLAY_TORQUE)) ** 3  # s'(K)
        play = 0.5 * self.gear_ratio**2 * self._value(given.theta, "gear_backlash") * slope
        each = zip(self.cables.tolist(), self._radii(given.theta).tolist(), strict=True)
        return [
            (motor, pulley, -self.gear_ratio),
            (motor, motor, -play),
            (pulley, pulley, self._spring_of_rotor(given.theta)),
            *(entry for i, r in each for entry in ((i, pulley, r), (i, i, -softness))),
        ]

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        own = {key: one for key in self.stated if (one := into.get(f"{self.name}.{key}")) is not None}
        if not own:
            return
        (torque, angle), tensions = given.state.effort[self.own].tolist(), self._tensions(given)
        softness, pretension = self._softness(given.theta), self._value(given.theta, "pretension")
        for key, one in own.items():
            rates = np.zeros(len(given.state.effort))
            if key == "radius":
                rates[self.cables] = self.shares * angle
                rates[self.first + 1] = self.shares @ tensions
            elif key == "spring_rate":
                rates[self.cables] = softness**2 * (tensions - pretension)
            elif key == "pretension":
                rates[self.cables] = softness
            elif key == "gear_backlash":
                rates[self.first] = -0.5 * self.gear_ratio * _sign(self.gear_ratio * torque)
            elif key == "zero":
                rates[self.first] = -1.0
            else:
                rates[self.first + 1] = self.gear_ratio**2 * self.swing[0] * (angle - self.swing[1])
            one.efforts += np.where(given.controls.is_held, 0.0, rates)

    def coordinate_scales(self, extent: float) -> Floats:
        """Scales of the angle, one radian, and of the torque."""
        return np.array([1.0, UNIT_FORCE * extent])

    def energy(self, given: Given) -> float:
        torque, angle = given.state.effort[self.own].tolist()
        tensions, theta, is_held = self._tensions(given), given.theta, given.controls.is_held
        stretched = np.where(is_held[self.cables], 0.0, (tensions - self._value(theta, "pretension")) ** 2)
        stored = float(self._radii(theta) @ tensions) * angle - 0.5 * self._softness(theta) * float(stretched.sum())
        stored += 0.5 * self._spring_of_rotor(theta) * (angle - self.swing[1]) ** 2
        stored += 0.0 if is_held[self.first + 1] else given.controls.coordinate[self.first + 1] * angle
        if is_held[self.first]:
            return stored - torque * self.gear_ratio * angle
        most = np.hypot(self.gear_ratio * torque, PLAY_TORQUE)
        play = 0.5 * self._value(theta, "gear_backlash") * (most - PLAY_TORQUE)
        lag = self.gear_ratio * angle + self._value(theta, "zero") - given.controls.coordinate[self.first]
        return float(stored - torque * lag - play)

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """The term in time, with the inertia of its rotor."""
        pulley, k = self.first + 1, step.mass_rate
        if not self.swings:
            return (self,)
        still = float(before.state.effort[pulley] + step.effort_rates[pulley] / (k * step.length))
        return (replace(self, swing=(k, still)),)

    def _spring_of_rotor(self, theta: Theta) -> float:
        """J N^2 k [N m]."""
        return self._value(theta, "rotor_inertia") * self.gear_ratio**2 * self.swing[0]

    def _tensions(self, given: Given) -> Floats:
        return given.state.effort[self.cables]

    def _radii(self, theta: Theta) -> Floats:
        return self.shares * theta[f"{self.name}.radius"]

    def _softness(self, theta: Theta) -> float:
        """1 / k [m/N]."""
        return 1.0 / self._value(theta, "spring_rate") if "spring_rate" in self.stated else 0.0

    def _value(self, theta: Theta, key: str) -> float:
        """A parameter's value [SI]; zero where it is not stated."""
        return theta[f"{self.name}.{key}"] if key in self.stated else 0.0


def _sign(torque: float) -> float:
    """s(K)."""
    return torque / float(np.hypot(torque, PLAY_TORQUE))
