"""The response along one control: nodes solved exactly, and in between cubic Hermite pieces of stated error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from softcal.checks import Floats


@dataclass(frozen=True)
class Curve:
    """Channels along the control c. c (n,); values, slopes (n, n_channels); by_parameter (n, n_channels, k).

    is_jump (n - 1,): intervals in which the robot falls from one node to the next: they are straight.
    """

    c: Floats
    values: Floats
    slopes: Floats
    by_parameter: Floats
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
        slopes[at_node] = self.slopes[i[at_node]]  # theirs, not a fall's
        return spline(c), slopes, self._by_parameter_at(c)

    def _by_parameter_at(self, c: Floats) -> Floats:
        """The slopes' own derivatives by the parameters are not known: splines through the nodes, straight for two."""
        ends: list[int] = np.flatnonzero(self.is_jump).tolist()
        out = make_interp_spline(self.c, self.by_parameter, k=1)(c)
        for first, last in zip([0, *(i + 1 for i in ends)], [*ends, len(self.c) - 1], strict=True):
            inside = (self.c[first] <= c) & (c <= self.c[last])
            k = min(3, last - first)
            if k > 1 and inside.any():
                nodes = slice(first, last + 1)
                out[inside] = make_interp_spline(self.c[nodes], self.by_parameter[nodes], k=k)(c[inside])
        return out

    def spline(self) -> CubicHermiteSpline:
        """The channels as piecewise cubics in c."""
        spline = CubicHermiteSpline(self.c, self.values, self.slopes)
        rise = np.diff(self.values, axis=0) / np.diff(self.c)[:, None]
        spline.c[:2, self.is_jump] = 0.0
        spline.c[2, self.is_jump] = rise[self.is_jump]
        return spline

    def error(self) -> Floats:
        """Estimated error of the interpolation in each interval, (n - 1, n_channels); infinite where it is unknown.

        A cubic Hermite piece errs by f'''' h^4 / 384; f'''' is the change of the pieces' third derivative from one to
        the next.
        """
        h = np.diff(self.c)[:, None]
        if len(h) < 2:
            return np.full((len(h), self.values.shape[1]), np.inf)
        third = 6.0 * (self.slopes[1:] + self.slopes[:-1]) / h**2 - 12.0 * np.diff(self.values, axis=0) / h**3
        fourth = np.abs(np.diff(third, axis=0)) / (0.5 * (h[1:] + h[:-1]))
        fourth[self.is_jump[1:] | self.is_jump[:-1]] = np.nan  # nothing goes on across a jump
        none = np.full((1, fourth.shape[1]), np.nan)
        largest = np.fmax(np.concatenate([none, fourth]), np.concatenate([fourth, none]))
        error = np.where(np.isnan(largest), np.inf, largest) * h**4 / 384.0
        error[self.is_jump] = 0.0
        return error

    def first_passage(self, channel: int, targets: Floats) -> Floats:
        """The smallest c at which a channel reaches each target (m,); NaN where it never does.

        What a machine sees that prescribes the channel and lets c go: past a maximum it snaps to the next branch.
        """
        spline = self.spline()
        fine = np.unique(np.concatenate([np.linspace(a, b, 65) for a, b in zip(self.c[:-1], self.c[1:], strict=True)]))
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
