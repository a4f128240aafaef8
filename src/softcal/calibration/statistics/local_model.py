"""A model of all residuals around one simulated point, from its exact derivatives and the scaling of forces with
moduli.

By dimensional analysis, at prescribed displacements the force of an elastic robot is proportional to its moduli, and
under prescribed loads its displacements depend on load over modulus. So, with s = E / E_0 for each modulus,

    force:           y = y_0 + sum g (s - 1)     + s D (w - w_0) + L (p - p_0)
    place or angle:  y = y_0 + sum g (1 - 1 / s) +   D (w - w_0) + L (p - p_0) / s

with g = d y / d ln E, p the loads (forces, masses, densities), w all other parameters (lengths, angles, ratios), and D
and L the derivatives by them. Where there are several moduli, the s that multiplies is the product of their powers, the
exponents being their shares in g. Poisson's ratio enters as itself or, where elements lock, as 1 / (ceiling - nu),
which is proportional to the bulk modulus over E near the ceiling.

A second simulated point bends it: the model's error there is subtracted along the line to it, growing with the square
of the distance (`bend`; compare tensor methods, Schnabel and Frank, SIAM J. Numer. Anal. 21, 1984).

Value and first derivative at the point are the twin's, whatever the formulas predict away from it (`reproduces`): only
the number of trajectories depends on them. The plain model omits the formulas; it is Gauss-Newton's, linear in the
search's own variables.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.experiment import rig_kind
from softcal.calibration.problem.loss import Block, Loss, rms
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.statistics.correlation import triangle
from softcal.checks import Floats, Ints
from softcal.twin.parameters import MODULUS

_LOADS = ("N", "kg", "kg/m^3")  # units of loads
_LARGEST_LOG = 500.0  # exp(700) is near the largest double; a model that far off is refused by the trust region
_BEND_REACH = 1.5  # of the distance to the other point, on both sides: beyond, a bend is continued linearly
_REPRODUCED = 1e-9  # of a block's root mean square, and of its largest derivative


@dataclass(frozen=True)
class Point:
    """A simulated point: its place z in the unit box and its blocks, with jacobians."""

    z: Floats
    blocks: Sequence[Block]


class LocalModel:
    """The residuals of all blocks as functions of x in the unit box, around the simulated point `here`.

    plain: Gauss-Newton's model. reciprocal: parameters below a ceiling enter as 1 / (ceiling - theta).
    """

    def __init__(
        self, space: SearchSpace, loss: Loss, here: Point, *, plain: bool = False, reciprocal: bool = False
    ) -> None:
        self._space, self._loss, self._here, self._plain = space, loss, here, plain
        self._share = loss.share(here.blocks)
        # No offset of a pressure gauge, which has the unit of a modulus.
        of_rig = [any(rig_kind(target) is not None for target in p.targets) for p in space.parameters]
        each = zip(space.parameters, of_rig, strict=True)
        modulus = np.array([not plain and p.unit == MODULUS and p.lower >= 0.0 and not rig for p, rig in each])
        load = np.array([p.unit in _LOADS and not plain for p in space.parameters])
        self._moduli = np.flatnonzero(modulus)
        below = np.array([reciprocal and math.isfinite(p.ceiling) and not plain for p in space.parameters])
        self._below = np.flatnonzero(below)
        self._w, slopes = self._coordinates(here.z)
        factors = space.jacobian(here.z) / slopes
        alike: dict[tuple[str, bool], list[int]] = {}
        for number, block in enumerate(here.blocks):
            alike.setdefault((block.experiment, block.grows_with_moduli), []).append(number)
        self._stacks = [_AlikeBlocks.of(here.blocks, numbers, factors, modulus, load) for numbers in alike.values()]
        self._along, self._bends = np.zeros(space.size), [np.zeros(len(one.residual)) for one in self._stacks]

    def bend(self, to: Point) -> None:
        """Add a curvature along the line to another simulated point, so that the model reproduces its values too.

        Without it, the steps along a valley in which parameters compensate each other overshoot alternately. The
        scaling with moduli is known, so the curvature is by the other parameters.
        """
        w, _ = self._coordinates(to.z)
        way = w - self._w
        felt = np.zeros(self._space.size)
        size, missed = 0.0, []
        for one, (residual, _) in zip(self._stacks, self._residuals(to.z)[0], strict=True):
            weights = 1.0 / one.squares(self._here.blocks)
            felt[one.columns] += weights @ one.derivatives**2
            missed.append(one.residuals(to.blocks) - residual)
            size += float(missed[-1] ** 2 @ (1.0 / one.squares(to.blocks)))
        felt[self._moduli] = 0.0
        length = float(way @ (felt * way))
        # An error above half of the predicted change is not a curvature.
        if 0.0 < size <= 0.25 * length:
            self._along = felt * way / length
            scales = [one.scale(way[one.columns]) if one.is_force else 1.0 for one in self._stacks]
            self._bends = [m / s for m, s in zip(missed, scales, strict=True)]

    def loss(self, x: Floats) -> float:
        """The modelled loss."""
        found = zip(self._stacks, self._residuals(x)[0], strict=True)
        parts = ((self._here.blocks[n], part) for one, (residual, _) in found for n, part in one.of_each(residual))
        summed = self._share * sum(self._loss.block_value(block, residual) for block, residual in parts)
        return math.sqrt(summed) if self._loss.rooted else summed

    def missed(self, at: Point) -> float:
        """The share of the residuals' change to another simulated point that the model does not predict, at most 1."""
        error, change = 0.0, 1e-300
        for one, (residual, _) in zip(self._stacks, self._residuals(at.z)[0], strict=True):
            weights = self._weights(one, one.residual)
            there = one.residuals(at.blocks)
            error += float(weights @ (there - residual) ** 2)
            change += float(weights @ (there - one.residual) ** 2)
        return min(1.0, math.sqrt(error / change))

    def reproduces(self) -> bool:
        """Whether the model has the value and the first derivative of the twin at its own point, to nine digits."""
        slopes = self._space.jacobian(self._here.z)
        found, _ = self._residuals(self._here.z)
        for one, (residuals, jacobian) in zip(self._stacks, found, strict=True):
            for (number, residual), (_, J) in zip(one.of_each(residuals), one.of_each(jacobian()), strict=True):
                block = self._here.blocks[number]
                exact = (jacobian_of(block) * slopes)[:, one.columns]
                size = max(rms(block.measured), rms(block.residual))
                if not float(np.abs(residual - block.residual).max()) <= _REPRODUCED * size:
                    return False
                off = np.abs(J[:, :-1] - exact)
                if not float(off.max(initial=0.0)) <= _REPRODUCED * float(np.abs(exact).max(initial=0.0)):
                    return False
        return True

    def minimise(
        self, lower: Floats, upper: Floats, *, begin: Floats | None = None, max_iterations: int = 60
    ) -> Floats:
        """The minimiser of the modelled loss in a box, searched from the point of the box nearest to `begin`, or to z.

        Each pass solves the bounded linear least squares that touch the loss from above. For the likelihood that is
        Gauss-Newton; for a sum of RMSEs it is iterative reweighting, which ends at the minimiser of the sum itself and
        not of a sum of squares. No pass needs a simulation.

        Parameters
        ----------
        lower, upper
            The box, within the unit box, (size,) each.
        begin
            Where the search begins (size,), moved into the box; by default z.
        max_iterations
            Largest number of passes.
        """
        from scipy.optimize import lsq_linear

        x = np.clip(self._here.z if begin is None else begin, lower, upper)
        value = self.loss(x)
        for _ in range(max_iterations):
            rows: list[Floats] = []
            found, turn = self._residuals(x)
            for one, (residual, jacobian) in zip(self._stacks, found, strict=True):
                root = np.sqrt(self._weights(one, residual))
                own = triangle(root[:, None] * np.column_stack([jacobian(), -residual]))
                whole = np.column_stack([np.outer(own[:, -2], turn), own[:, -1]])
                whole[:, one.columns] += own[:, :-2]
                rows.append(whole)
            every = triangle(np.concatenate(rows))[: self._space.size]
            matrix, right = every[:, :-1], every[:, -1]
            ends = np.minimum(lower - x, -1e-300), np.maximum(upper - x, 1e-300)
            step = lsq_linear(matrix, right, ends, method="bvls", tol=1e-14).x
            factor, candidate, lowered = 1.0, x, value
            while factor > 1e-6 and not lowered < value:
                candidate = np.clip(x + factor * step, lower, upper)
                lowered = self.loss(candidate)
                factor *= 0.5
            if not lowered < value:
                return x
            settled = value - lowered <= 1e-13 * value or float(np.abs(candidate - x).max()) < 1e-12
            x, value = candidate, lowered
            if settled:
                break
        return x

    def rescaled(self) -> Floats:
        """z with the moduli of least modelled loss, all else unchanged: one simulated point determines the residuals at
        any moduli.
        """
        z = self._here.z
        if not len(self._moduli):
            return z
        lower, upper = np.array(z), np.array(z)
        lower[self._moduli], upper[self._moduli] = 0.0, 1.0
        return self.minimise(lower, upper)

    def _coordinates(self, x: Floats) -> tuple[Floats, Floats]:
        """w and d w / d x, each (size,): x itself in the plain model; else ln(modulus), reciprocals and theta."""
        if self._plain:
            return np.array(x, dtype=np.float64), np.ones(self._space.size)
        w = np.array(list(self._space.to_model(x).values()))
        slopes = np.array(self._space.jacobian(x))
        for j in self._moduli:
            w[j], slopes[j] = math.log(w[j]), slopes[j] / w[j]
        for j in self._below:
            distance = self._space.parameters[j].ceiling - w[j]
            w[j], slopes[j] = 1.0 / distance, slopes[j] / distance**2
        return w, slopes

    def _weights(self, one: _AlikeBlocks, residual: Floats) -> Floats:
        """The weights (n,) of the squares of a stack's residual (n,) in the loss."""
        parts = one.of_each(residual)
        return np.concatenate([self._loss.square_weights(self._here.blocks[number], part) for number, part in parts])

    def _residuals(self, x: Floats) -> tuple[list[tuple[Floats, Callable[[], Floats]]], Floats]:
        """Of every stack the residual (n,), and a function that returns its jacobian (n, k + 1): by x in the stack's
        columns, and by the bend in the last column. Then the derivative (size,) of all bends by x.
        """
        w, slopes = self._coordinates(x)
        moved = w - self._w
        t = float(self._along @ moved)
        near = min(max(t, -_BEND_REACH), _BEND_REACH)
        square, turn = near * (2 * t - near), 2 * near * self._along
        stacks = zip(self._stacks, self._bends, strict=True)
        return [one.at(moved[one.columns], slopes[one.columns], bend, square) for one, bend in stacks], turn * slopes


@dataclass(frozen=True)
class _AlikeBlocks:
    """The blocks of an experiment that moduli scale alike, one below the other: their numbers, the ends of their rows,
    their residuals (n,), and derivatives (n, k) by w in the columns (k,) of the parameters that have an effect on them.

    moduli, scaled, fixed: which of them are moduli, which multiply what moduli scale, and which do not (k,). shares (n,
    number of moduli): of the moduli in the factor of what is proportional to them.
    """

    numbers: Sequence[int]
    ends: Ints
    residual: Floats
    is_force: bool
    columns: Ints
    derivatives: Floats
    moduli: np.ndarray
    scaled: np.ndarray
    fixed: np.ndarray
    shares: Floats

    @classmethod
    def of(
        cls, blocks: Sequence[Block], numbers: Sequence[int], factors: Floats, modulus: np.ndarray, load: np.ndarray
    ) -> _AlikeBlocks:
        """factors: d theta / d w (size,); modulus, load: which parameters are such (size,)."""
        members = [blocks[number] for number in numbers]
        jacobian, is_force = np.concatenate([jacobian_of(block) for block in members]), members[0].grows_with_moduli
        columns = np.flatnonzero(np.any(jacobian, axis=0))
        derivatives = jacobian[:, columns] * factors[columns]
        moduli, loads = modulus[columns], load[columns]
        others = ~moduli & ~loads
        lengths = [len(block.residual) for block in members]
        ends = np.cumsum(lengths)
        sizes = np.array([(part**2).sum(axis=0) for part in np.split(derivatives[:, moduli], ends[:-1])])
        shares = sizes / np.maximum(sizes.sum(axis=1, keepdims=True), 1e-300)
        scaled, fixed = (others, loads) if is_force else (loads, others)
        residual = np.concatenate([block.residual for block in members])
        of_rows = np.repeat(shares, lengths, axis=0)
        return cls(numbers, ends, residual, is_force, columns, derivatives, moduli, scaled, fixed, of_rows)

    def of_each(self, rows: Floats) -> list[tuple[int, Floats]]:
        """The number of every block, and its part of (n,) or (n, k)."""
        return list(zip(self.numbers, np.split(rows, self.ends[:-1]), strict=True))

    def residuals(self, blocks: Sequence[Block]) -> Floats:
        """The residuals (n,) at another point, from all blocks there."""
        return np.concatenate([blocks[number].residual for number in self.numbers])

    def squares(self, blocks: Sequence[Block]) -> Floats:
        """The sum of the squares of what was measured in the block of every row (n,)."""
        each = [max(float(blocks[number].measured @ blocks[number].measured), 1e-300) for number in self.numbers]
        return np.repeat(np.array(each), np.diff(self.ends, prepend=0))

    def scale(self, moved: Floats) -> Floats:
        """Factors (n,) by which the moduli multiply what is proportional to them or to one over them."""
        power = (1.0 if self.is_force else -1.0) * self.shares @ moved[self.moduli]
        return np.exp(np.clip(power, -_LARGEST_LOG, _LARGEST_LOG))

    def at(self, moved: Floats, slopes: Floats, bend: Floats, square: float) -> tuple[Floats, Callable[[], Floats]]:
        """The residual after a step of w (k,), with a bend that counts by `square`, and its jacobian by x and the bend;
        slopes: d w / d x (k,).
        """
        sign = 1.0 if self.is_force else -1.0
        scale, g = self.scale(moved), self.derivatives[:, self.moduli]
        scales = np.exp(np.clip(sign * moved[self.moduli], -_LARGEST_LOG, _LARGEST_LOG))
        bent = bend * scale if self.is_force else bend
        changed = scale * (self.derivatives @ (moved * self.scaled)) + (bent * square if self.is_force else 0.0)
        rest = self.derivatives @ (moved * self.fixed) + (0.0 if self.is_force else bent * square)

        def jacobian() -> Floats:
            by_w = self.derivatives * np.where(self.scaled, scale[:, None], 1.0)
            by_w[:, self.moduli] = g * scales + sign * changed[:, None] * self.shares
            return np.column_stack([by_w * slopes, bent])

        return self.residual + sign * g @ (scales - 1.0) + changed + rest, jacobian


def jacobian_of(block: Block) -> Floats:
    """The block's jacobian, which is present in every search by sensitivities."""
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    return block.jacobian


Curve = tuple[tuple[float, float], ...]
"""Pairs of a parameter's value [unit] and the least loss there, from the lowest value to the highest."""

_MOST = 6  # parameters
_POINTS = 8  # on each side of the best value
_BEYOND = 0.5  # of the interval's length, on both sides
_PASSES = 6  # of the minimum over the others, from that of the point before


def loss_profiles(
    space: SearchSpace,
    loss: Loss,
    theta: Mapping[str, float],
    blocks: Sequence[Block],
    intervals: Mapping[str, tuple[float, float] | None],
) -> dict[str, Curve]:
    """Label -> curve, over the interval and beyond it, of the parameters that all experiments share; of the first ones
    without such.

    Nothing is simulated: the residuals follow `LocalModel`, and every parameter stays within its bounds.

    Parameters
    ----------
    space, loss
        The search space, and the loss.
    theta, blocks
        The best parameters [SI by label], and the blocks there with jacobians.
    intervals
        Label -> ends [SI]; None where there is no interval.
    """
    z = np.clip(space.to_search(theta), 0.0, 1.0)
    model = LocalModel(space, loss, Point(z, blocks))
    if not model.reproduces():
        model = LocalModel(space, loss, Point(z, blocks), plain=True)
    known = [j for j, p in enumerate(space.parameters) if intervals.get(p.label) is not None]
    shared = [j for j in known if not space.parameters[j].experiment] or known
    found: dict[str, Curve] = {}
    for j in shared[:_MOST]:
        label = space.labels[j]
        low, high = (float(space.to_search({**theta, label: end})[j]) for end in intervals[label] or ())
        more = _BEYOND * (high - low)
        curve = {theta[label]: model.loss(z)}
        for end in (max(low - more, 0.0), min(high + more, 1.0)):
            x = z
            for value in np.linspace(z[j], end, _POINTS + 1)[1:]:
                lower, upper = np.zeros(space.size), np.ones(space.size)
                lower[j] = upper[j] = value
                x = model.minimise(lower, upper, begin=x, max_iterations=_PASSES)
                curve[space.to_model(x)[label]] = model.loss(x)
        found[label] = tuple(sorted(curve.items()))
    return found
