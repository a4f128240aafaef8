"""Twins read off tables of softcal's own answers, so cheap that hundreds of studies take minutes.

The neck's tension is E t(d, nu) and its pitch p(d, nu), with d the cable's shortening: no weight acts on it. Both are
Chebyshev series in d and nu through softcal's own equilibria, and so are their derivatives. The manipulator's markers
move in a straight line in the springs' compliances 1/E, from the equilibria at the true moduli by softcal's derivatives
there: in a study of noise the moduli stay within some per cent of them. Of any other robot the response to some
protocols is a Chebyshev series in two parameters (`ParameterTable`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from benchmarks.neck_case import PITCH, TENSION, pull
from softcal.checks import Floats
from softcal.twin.parameters import parameter_values, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

E, NU = "neck.youngs_modulus", "neck.poissons_ratio"
REFERENCE = 2e6  # [Pa]: the modulus that the table was made with
SOLVED = "Read off a table."


@dataclass(frozen=True)
class NeckTable:
    """Chebyshev coefficients (d, nu) of tension over modulus [m^2] and pitch [rad], both over d [m]; reach: its ranges.

    Divided by d they are smooth and have no root in the range, and at d = 0 both are exactly zero. Where the elements
    lock, the series runs in ln(0.5 - nu): linear tets are stiffer by a constant over 0.5 - nu.
    """

    tension: Floats
    pitch: Floats
    shortenings: tuple[float, float]
    ratios: tuple[float, float]
    locks: bool = False

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        """As `softcal.twin.simulate.simulate`, for the neck whose front cable is driven by its shortening."""
        values = parameter_values(robot, theta)
        modulus, ratio = values[E], values[NU]
        d = protocol.commands["front"].values
        if not self.ratios[0] <= ratio <= self.ratios[1] or d.max() > self.shortenings[1]:
            return Response({}, {}, "The table does not reach that far.", succeeded=False, n_factorisations=0)
        tension, pitch = (self._read(table, d, ratio) for table in (self.tension, self.pitch))
        by = {
            TENSION: {E: tension[0], NU: modulus * tension[2]},
            PITCH: {E: np.zeros_like(d), NU: pitch[2]},
        }
        return Response(
            {"front.shortening": d, TENSION: modulus * tension[0], PITCH: pitch[0]},
            {"front.shortening": "m", TENSION: "N", PITCH: "rad"},
            SOLVED,
            succeeded=True,
            n_factorisations=0,
            sensitivities={channel: {name: held[name] for name in sensitivities} for channel, held in by.items()},
            slopes={"front.shortening": np.ones_like(d), TENSION: modulus * tension[1], PITCH: pitch[1]},
        )

    def _read(self, table: Floats, d: Floats, ratio: float) -> tuple[Floats, Floats, Floats]:
        """A channel and its derivatives by d and by nu; zero where the cable is slack."""
        taut = d > 0
        ends = _place(self.ratios, locks=self.locks)
        x = _scaled(d, self.shortenings)
        y = _scaled(_place(np.float64(ratio), locks=self.locks), (float(ends[0]), float(ends[1])))
        at_ratio = chebyshev.chebval(y, table.T)
        over_d = chebyshev.chebval(x, at_ratio)
        slope = chebyshev.chebval(x, chebyshev.chebder(at_ratio)) * 2 / (self.shortenings[1] - self.shortenings[0])
        by_ratio = chebyshev.chebval(x, chebyshev.chebval(y, chebyshev.chebder(table.T)))
        by_ratio = by_ratio * 2 / (ends[1] - ends[0]) * (-1 / (0.5 - ratio) if self.locks else 1.0)
        return (
            np.where(taut, d * over_d, 0.0),
            np.where(taut, over_d + d * slope, 0.0),
            np.where(taut, d * by_ratio, 0.0),
        )


def neck_table(
    robot: Robot,
    reach: float,
    ratios: tuple[float, float] = (0.29, 0.4999),
    shape: tuple[int, int] = (14, 9),
    *,
    locks: bool = False,
) -> NeckTable:
    """The table of a neck up to a shortening [m], through `shape` equilibria by shortening and ratio."""
    shortenings = (0.0, reach)
    places = [chebyshev.chebpts1(n) for n in shape]
    d, nu = (
        0.5 * (ends[0] + ends[1]) + 0.5 * (ends[1] - ends[0]) * x
        for ends, x in zip((shortenings, _place(ratios, locks=locks)), places, strict=True)
    )
    nu = 0.5 - np.exp(nu) if locks else nu
    solved = [_solved(with_parameters(robot, {E: REFERENCE, NU: float(value)}), pull(d)) for value in nu]
    tension = np.column_stack([one.channels[TENSION] / REFERENCE / d for one in solved])
    pitch = np.column_stack([one.channels[PITCH] / d for one in solved])
    return NeckTable(*(_coefficients(values, places) for values in (tension, pitch)), shortenings, ratios, locks)


@dataclass(frozen=True)
class ComplianceTable:
    """Positions (n_forces,) [m] by cable and channel at the true moduli, and their derivatives by the moduli.

    forces [N]; moduli: the true ones [Pa] by name; slopes: cable -> channel -> modulus -> d channel / d modulus.
    """

    forces: tuple[float, ...]
    moduli: Mapping[str, float]
    places: Mapping[str, Mapping[str, Floats]]
    slopes: Mapping[str, Mapping[str, Mapping[str, Floats]]]

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        """As `softcal.twin.simulate.simulate`, for one cable that is driven by the table's forces."""
        ((cable, command),) = protocol.commands.items()
        if tuple(command.values) != self.forces:
            raise ValueError("the table was made for other forces")
        values = parameter_values(robot, theta)
        now = {name: values[name] for name in self.moduli}
        channels, by = {}, {}
        for channel, places in self.places[cable].items():
            rates = {name: -(true**2) * self.slopes[cable][channel][name] for name, true in self.moduli.items()}
            channels[channel] = places + sum(
                rate * (1 / now[name] - 1 / self.moduli[name]) for name, rate in rates.items()
            )
            by[channel] = {name: -rates[name] / now[name] ** 2 for name in sensitivities if name in now}
        units = dict.fromkeys(channels, "m")
        return Response(channels, units, SOLVED, succeeded=True, n_factorisations=0, sensitivities=by)


def compliance_table(
    robot: Robot, moduli: Mapping[str, float], cables: Sequence[str], markers: Sequence[str], forces: tuple[float, ...]
) -> ComplianceTable:
    """The table of a manipulator with these spring moduli [Pa by name], each cable pulled by the forces [N]."""
    true = with_parameters(robot, moduli)
    names = [f"{marker}.{axis}" for marker in markers for axis in "xyz"]
    places, slopes = {}, {}
    for cable in cables:
        seen = _solved(true, Protocol({cable: Command("tension", np.array(forces))}), list(moduli))
        places[cable] = {name: seen.channels[name] for name in names}
        slopes[cable] = {name: dict(seen.sensitivities[name]) for name in names}
    return ComplianceTable(forces, dict(moduli), places, slopes)


@dataclass(frozen=True)
class ParameterTable:
    """Channels (n_samples,) over two parameters: Chebyshev coefficients (n, m, n_samples) by protocol and channel.

    ranges: parameter -> ends of its range [SI], the first one in its logarithm.
    """

    ranges: Mapping[str, tuple[float, float]]
    coefficients: Mapping[tuple[float, ...], Mapping[str, Floats]]
    units: Mapping[str, str]

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        """As `softcal.twin.simulate.simulate`, for the table's protocols."""
        values = parameter_values(robot, theta)
        (first, along), (second, across) = self.ranges.items()
        at = _scaled(np.log(values[first]), _logs(along)), _scaled(values[second], across)
        if max(map(abs, at)) > 1.0:
            return Response({}, {}, "The table does not reach that far.", succeeded=False, n_factorisations=0)
        channels, by = {}, {}
        for channel, table in self.coefficients[_key(protocol)].items():
            channels[channel] = chebyshev.chebval2d(*at, table)
            slopes = (chebyshev.chebval2d(*at, chebyshev.chebder(table, axis=axis)) for axis in (0, 1))
            steps = 2.0 / np.ptp(_logs(along)) / values[first], 2.0 / np.ptp(across)
            rates = {name: slope * step for name, slope, step in zip((first, second), slopes, steps, strict=True)}
            by[channel] = {name: rates[name] for name in sensitivities}
        return Response(channels, self.units, SOLVED, succeeded=True, n_factorisations=0, sensitivities=by)


def parameter_table(
    robot: Robot,
    protocols: Sequence[Protocol],
    ranges: Mapping[str, tuple[float, float]],
    nodes: tuple[int, int],
) -> ParameterTable:
    """The table of a robot's responses.

    Parameters
    ----------
    robot
        The robot.
    protocols
        Those that are tabulated.
    ranges
        Two parameters -> ends of their ranges [SI].
    nodes
        Number of Chebyshev's points over each.
    """
    (first, along), (second, across) = ranges.items()
    places = [chebyshev.chebpts1(n) for n in nodes]
    inverse = [np.linalg.inv(chebyshev.chebvander(at, len(at) - 1)) for at in places]
    values = np.exp(_unscaled(places[0], _logs(along))), _unscaled(places[1], across)
    coefficients, units = dict[tuple[float, ...], Mapping[str, Floats]](), dict[str, str]()
    for protocol in protocols:
        seen = [
            [_solved(with_parameters(robot, {first: float(a), second: float(b)}), protocol) for b in values[1]]
            for a in values[0]
        ]
        units = dict(seen[0][0].units)
        coefficients[_key(protocol)] = {
            name: np.einsum("ai,bj,ijn->abn", *inverse, [[one.channels[name] for one in row] for row in seen])
            for name in units
        }
    return ParameterTable(dict(ranges), coefficients, units)


def _key(protocol: Protocol) -> tuple[float, ...]:
    """The commands of a protocol, one after the other."""
    return tuple(value for command in protocol.commands.values() for value in command.values.tolist())


def _logs(ends: tuple[float, float]) -> tuple[float, float]:
    return float(np.log(ends[0])), float(np.log(ends[1]))


def _unscaled(places: Floats, ends: tuple[float, float]) -> Floats:
    return 0.5 * (ends[0] + ends[1]) + 0.5 * (ends[1] - ends[0]) * places


def _solved(robot: Robot, protocol: Protocol, names: Sequence[str] = ()) -> Response:
    seen = simulate(robot, protocol, sensitivities=names, curve_tolerance=0.0)
    if not seen.succeeded:
        raise RuntimeError(seen.status)
    return seen


def _place(ratios: Floats | tuple[float, float], *, locks: bool) -> Floats:
    """Where ratios are in the variable of the series."""
    return np.log(0.5 - np.asarray(ratios)) if locks else np.asarray(ratios)


def _scaled(values: Floats | float, ends: tuple[float, float]) -> Floats | float:
    return (2 * values - ends[0] - ends[1]) / (ends[1] - ends[0])


def _coefficients(values: Floats, places: Sequence[Floats]) -> Floats:
    rows = np.linalg.solve(chebyshev.chebvander(places[0], len(places[0]) - 1), values)
    return np.linalg.solve(chebyshev.chebvander(places[1], len(places[1]) - 1), rows.T).T
