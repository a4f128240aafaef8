"""The response along one control: exactly solved nodes, and between them cubic Hermite pieces with an error
estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from softcal.checks import Floats

FINE = 65  # points of an interval at which its cubic is evaluated


@dataclass(frozen=True)
class Curve:
    """Channels along the control c. c (n,); values, slopes (n, n_channels); by_parameter, and its slopes by c (n,
    n_channels, k).

    is_jump (n - 1,): intervals with a snap-through from one node to the next; they are linear.
    """

    c: Floats
    values: Floats
    slopes: Floats
    by_parameter: Floats
    by_parameter_slopes: Floats
    is_jump: np.ndarray

    def at(self, c: Floats) -> tuple[Floats, Floats, Floats]:
        """Values, slopes (m, n_channels) and derivatives by parameters (m, n_channels, k) at c (m,)."""
        if len(self.c) == 1:
            n = len(c)
            return (
                np.repeat(self.values, n, axis=0),
                np.repeat(self.slopes, n, axis=0),
                np.repeat(self.by_parameter, n, axis=0),
            )
        spline = self.spline()
        slopes = spline(c, 1)
        i = np.searchsorted(self.c, c)
        at_node = self.c[np.minimum(i, len(self.c) - 1)] == c
        slopes[at_node] = self.slopes[i[at_node]]  # of this interval, not of a jump
        return spline(c), slopes, self._cubics(self.by_parameter, self.by_parameter_slopes)(c)

    def spline(self) -> CubicHermiteSpline:
        """The channels as piecewise cubics in c."""
        return self._cubics(self.values, self.slopes)

    def _cubics(self, values: Floats, slopes: Floats) -> CubicHermiteSpline:
        spline = CubicHermiteSpline(self.c, values, slopes)
        rise = np.diff(values, axis=0) / np.diff(self.c).reshape(-1, *[1] * (values.ndim - 1))
        spline.c[:2, self.is_jump] = 0.0
        spline.c[2, self.is_jump] = rise[self.is_jump]
        return spline

    def error(self) -> Floats:
        """Estimated error of the channels in each interval, (n - 1, n_channels); infinite where it cannot be
        estimated.
        """
        return self._error(self.values, self.slopes)

    def error_by_parameter(self) -> Floats:
        """Errors of the channels' derivatives by the parameters (n - 1, n_channels, k), as `error`."""
        n, *shape = self.by_parameter.shape
        return self._error(self.by_parameter.reshape(n, -1), self.by_parameter_slopes.reshape(n, -1)).reshape(
            -1, *shape
        )

    def _error(self, values: Floats, slopes: Floats) -> Floats:
        """A cubic Hermite piece errs by f'''' h^4 / 384, with f'''' from the change of the pieces' third derivative at
        a node. That estimate misses the odd part of f'''' around the node, which the slope there shows: of a x^5 the
        pieces err by 0.156 a h^5, and one cubic over both by a h^4 in that slope.
        """
        h = np.diff(self.c)[:, None]
        if len(h) < 2:
            return np.full((len(h), values.shape[1]), np.inf)
        third = 6.0 * (slopes[1:] + slopes[:-1]) / h**2 - 12.0 * np.diff(values, axis=0) / h**3
        at_nodes = np.abs(np.diff(third, axis=0)) / (0.5 * (h[1:] + h[:-1])) / 384.0
        both = h[:-1] + h[1:]
        t = h[:-1] / both
        slope = 6.0 * t * (1.0 - t) * (values[2:] - values[:-2]) / both
        slope += (1.0 - t) * (1.0 - 3.0 * t) * slopes[:-2] + t * (3.0 * t - 2.0) * slopes[2:]
        at_nodes += 0.156 * np.abs(slope - slopes[1:-1]) * 0.5 * both / (h[:-1] * h[1:]) ** 2
        at_nodes[self.is_jump[1:] | self.is_jump[:-1]] = np.nan  # no derivative is continuous across a jump
        none = np.full((1, at_nodes.shape[1]), np.nan)
        largest = np.fmax(np.concatenate([none, at_nodes]), np.concatenate([at_nodes, none]))
        error = np.where(np.isnan(largest), np.inf, largest) * h**4
        error[self.is_jump] = 0.0
        return error

    def sides(self, channel: int) -> tuple[Curve, Curve]:
        """The curve from the node on where a channel is zero, and that before it, turned: its values rise where they
        fall.
        """
        i = int(np.abs(self.values[:, channel]).argmin())

        def part(rows: slice, sign: float) -> Curve:
            values, by = sign * self.values[rows], sign * self.by_parameter[rows]
            jumps = self.is_jump[i:] if sign > 0.0 else self.is_jump[:i][::-1]
            return Curve(sign * self.c[rows], values, self.slopes[rows], by, self.by_parameter_slopes[rows], jumps)

        return part(slice(i, None), 1.0), part(slice(i, None, -1), -1.0)

    def may_pass(self, channel: int, targets: Floats) -> np.ndarray:
        """Which intervals (n - 1,) may contain the first passage of a channel through one of the targets, given its
        error.
        """
        if len(self.c) == 1:
            return np.zeros(0, dtype=bool)
        fine = self.c[:-1] + np.linspace(0.0, 1.0, FINE)[:, None] * np.diff(self.c)
        top = self.spline()(fine)[:, :, channel].max(axis=0)
        before = np.maximum.accumulate(np.append(self.values[0, channel], top))[:-1]
        return ((before < targets[:, None]) & (targets[:, None] <= top + self.error()[:, channel])).any(axis=0)

    def first_passage(self, channel: int, targets: Floats) -> Floats:
        """The smallest c at which a channel reaches each target (m,); NaN where it never does.

        This is the response of a machine that prescribes the channel, c being free: past a maximum the robot snaps to
        the next branch.
        """
        if len(self.c) == 1:
            return np.where(targets <= self.values[0, channel], self.c[0], np.nan)
        spline = self.spline()
        pieces = zip(self.c[:-1], self.c[1:], strict=True)
        fine = np.unique(np.concatenate([np.linspace(a, b, FINE) for a, b in pieces]))
        values = spline(fine)[:, channel]
        reached = np.maximum.accumulate(values)
        i = np.searchsorted(reached, targets)
        out = np.full(len(targets), np.nan)
        first = i == 0
        out[first] = fine[0]
        inside = ~first & (i < len(fine))
        low, high = fine[i[inside] - 1], fine[i[inside]]
        c = low + (high - low) * (targets[inside] - values[i[inside] - 1]) / (values[i[inside]] - values[i[inside] - 1])
        for _ in range(4):
            slope = spline(c, 1)[:, channel]
            c = np.clip(c - (spline(c)[:, channel] - targets[inside]) / slope, low, high)
        out[inside] = c
        return out
