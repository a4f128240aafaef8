"""A model of all residuals around one simulated point, good enough to jump across the whole box.

A plain linearisation would need many trajectories from the corners of the bounds. The tension is proportional to E,
so at 40 MPa its derivative by nu is seventeen times what it is at 2.3 MPa; and with elements that lock, the stiffness
grows like a power of 0.5 - nu, so that E and nu trade off along a curved valley. Both are read off the exact
sensitivities:

- every parameter has a coordinate w: ln(theta) where its bounds are positive; e^q / q (ln e for q = 0) with
  e = ceiling - theta where it has a ceiling, q from the sensitivities at two points; else its place in the box.
- where d y / d w_j = m_j (y - c) for all samples of a channel, y - c is exponential in w_j (a power of E, with m = 1
  for tension over E at prescribed shortening, and c the load cell's offset); such factors are taken out, the rest is
  linear:

    y(x) = c + exp(m . (w(x) - w(z))) (y - c + D (w(x) - w(z)) + bend)

- the bend makes the model meet the value and the slope of a second simulated point on the line to it (cubic Hermite),
  as in tensor methods (Schnabel & Frank, SIAM J. Numer. Anal. 21, 1984). Without it the search would creep along the
  narrow valley in which E makes up for what nu does.

The value and the first derivative at z are exact whatever w, m, c and the bend are, so nothing but speed hangs on them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.loss import Block, Loss
from softcal.calibration.parameters import FreeParameter, SearchSpace
from softcal.checks import Floats

# Relative misfit of d y / d w = m (y - c) up to which a channel counts as exponential in w.
_EXPONENTIAL = 0.1
# Larger powers of a parameter are no scaling law of elasticity.
_LARGEST_POWER = 4.0
# exp(700) is near the largest double; a model that far off is refused by the trust region in any case.
_LARGEST_LOG = 500.0
# A power nearer to 1 is the smooth change of a slope that knows of no ceiling: its coordinate would bend only near it.
_FELT = 0.5
# A channel that would change by this factor's logarithm over the range, if its slope held, lies in a layer.
_STEEP = 3.0


# Beyond this multiple of the way to the second point, before and behind, the bend goes on as a straight line.
_BEND_REACH = (-1.0, 2.0)


@dataclass(frozen=True)
class Point:
    """A simulated point: its place z in the unit box and its blocks, with jacobians."""

    z: Floats
    blocks: Sequence[Block]


@dataclass(frozen=True)
class _Channel:
    """One block's model: offset c, exponents m (size,), linear part D (n, size), all by the coordinates w.

    The bend is square t^2 + cube t^3 with t = direction . (w(x) - w(z)), 1 at the second point.
    """

    block: Block
    offset: float
    exponents: Floats
    linear: Floats
    direction: Floats
    square: Floats
    cube: Floats

    def bend(self, moved: Floats) -> tuple[Floats | float, Floats | float]:
        """The bend and its derivative by t."""
        t = float(self.direction @ moved)
        inside = min(max(t, _BEND_REACH[0]), _BEND_REACH[1])
        slope = 2 * inside * self.square + 3 * inside**2 * self.cube
        return inside**2 * self.square + inside**3 * self.cube + (t - inside) * slope, slope


class LocalModel:
    """The residuals of all blocks as functions of x in the unit box, around the simulated point `here`.

    powers: q by parameter, NaN where none is known (see `ceiling_powers`); other: a second simulated point, or None.
    """

    def __init__(
        self, space: SearchSpace, loss: Loss, here: Point, other: Point | None = None, powers: Floats | None = None
    ) -> None:
        self._space, self._loss, self._z = space, loss, here.z
        self._powers = np.full(space.size, np.nan) if powers is None else powers
        self._w, slopes = self._coordinates(here.z)
        by_w = space.jacobian(here.z) / slopes
        channels = [_channel(space, self._powers, by_w, block) for block in here.blocks]
        self._way = np.zeros(space.size)
        if other is not None:
            w, slopes = self._coordinates(other.z)
            self._way, by_w = w - self._w, space.jacobian(other.z) / slopes
            channels = [_bent(c, self._way, by_w, block) for c, block in zip(channels, other.blocks, strict=True)]
        self._channels = tuple(channels)
        self._share = loss.share(here.blocks)

    def loss(self, x: Floats) -> float:
        """The modelled loss."""
        residuals = self._residuals(x)
        summed = self._share * sum(
            self._loss.block_value(c.block, residual)
            for c, (residual, _) in zip(self._channels, residuals, strict=True)
        )
        return math.sqrt(summed) if self._loss.rooted else summed

    def beyond(self, x: Floats) -> float:
        """How far x is from the line between the two points, over its length: there a bend is measured, here guessed.

        Lengths are those of what changes the channels, each over its size, once the factors are taken out.
        """
        moved, _ = self._coordinates(x)
        metric = sum(c.linear.T @ c.linear / _size(c.block) for c in self._channels)
        moved, length = moved - self._w, float(self._way @ metric @ self._way)
        if length <= 0:
            return math.inf
        aside = moved - min(max(float(self._way @ metric @ moved) / length, 0.0), 1.0) * self._way
        return math.sqrt(float(aside @ metric @ aside) / length)

    def minimise(self, lower: Floats, upper: Floats, *, max_iterations: int = 60) -> Floats:
        """The minimiser of the modelled loss in a box, sought from the box's point nearest to z.

        Each pass solves the bounded linear least squares that touches the loss from above. For the likelihood that is
        Gauss-Newton; for a sum of RMSEs it is reweighting, which ends at the minimiser of the sum itself and not of
        a sum of squares. No pass costs a simulation.
        """
        from scipy.optimize import lsq_linear

        x = np.clip(self._z, lower, upper)
        value = self.loss(x)
        for _ in range(max_iterations):
            matrix, right = self._squares(x)
            room = np.minimum(lower - x, -1e-300), np.maximum(upper - x, 1e-300)
            step = lsq_linear(matrix, right, room, method="bvls", tol=1e-14).x
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

    def _coordinates(self, x: Floats) -> tuple[Floats, Floats]:
        """w and d w / d x, each (size,)."""
        theta = np.array(list(self._space.to_model(x).values()))
        slopes = self._space.jacobian(x)
        w, dw = np.array(x, dtype=np.float64), np.ones(self._space.size)
        for j, p in enumerate(self._space.parameters):
            if not math.isnan(self._powers[j]):
                q, e = self._powers[j], p.ceiling - theta[j]
                w[j] = math.log(e) if q == 0 else e**q / q
                dw[j] = -(e ** (q - 1)) * slopes[j]
            elif _is_scale(p):
                w[j], dw[j] = math.log(theta[j]), slopes[j] / theta[j]
        return w, dw

    def _residuals(self, x: Floats) -> list[tuple[Floats, Floats]]:
        """Residual (n,) and jacobian by x (n, size) of every block."""
        w, slopes = self._coordinates(x)
        moved = w - self._w
        found: list[tuple[Floats, Floats]] = []
        for c in self._channels:
            factor = math.exp(min(max(float(c.exponents @ moved), -_LARGEST_LOG), _LARGEST_LOG))
            bend, bend_slope = c.bend(moved)
            centred = factor * (c.block.measured + c.block.residual - c.offset + c.linear @ moved + bend)
            by_w = factor * (c.linear + np.outer(bend_slope, c.direction)) + np.outer(centred, c.exponents)
            found.append((c.offset + centred - c.block.measured, by_w * slopes))
        return found

    def _squares(self, x: Floats) -> tuple[Floats, Floats]:
        """The touching least squares at x, compressed by QR to as many rows as there are parameters."""
        rows: list[Floats] = []
        right: list[Floats] = []
        for c, (residual, jacobian) in zip(self._channels, self._residuals(x), strict=True):
            root = np.sqrt(self._loss.square_weights(c.block, residual))
            rows.append(root[:, None] * jacobian)
            right.append(-root * residual)
        q, r = np.linalg.qr(np.concatenate(rows))
        return r, q.T @ np.concatenate(right)


def ceiling_powers(space: SearchSpace, one: Point, other: Point) -> Floats:
    """q by parameter such that d ln y / d theta goes like (ceiling - theta)^(q - 1) between two simulated points.

    1 where the ceiling is not felt (elements that do not lock), near 0 or below where it is (those that do); NaN for a
    parameter without a ceiling, or where the two points do not tell.
    """
    powers = np.full(space.size, np.nan)
    thetas = [np.array(list(space.to_model(z).values())) for z in (one.z, other.z)]
    for j, p in enumerate(space.parameters):
        if not math.isfinite(p.ceiling):
            continue
        e_one, e_other = (p.ceiling - theta[j] for theta in thetas)
        if abs(math.log(e_one / e_other)) < 0.01:
            continue
        slopes = [
            (_relative_slope(a, j), _relative_slope(b, j))
            for a, b in zip(one.blocks, other.blocks, strict=True)
            if a.experiment
        ]
        felt = max(slopes, key=lambda pair: min(abs(pair[0]), abs(pair[1])), default=(0.0, 0.0))
        if felt[0] * felt[1] > 0:
            power = 1 + math.log(felt[0] / felt[1]) / math.log(e_one / e_other)
            powers[j] = max(power, -1.0) if power < _FELT else 1.0
    return powers


def layer_powers(space: SearchSpace, here: Point) -> Floats:
    """0 (a power law of ceiling - theta) where a channel's slope cannot hold over a parameter's range, else NaN."""
    powers = np.full(space.size, np.nan)
    for j, p in enumerate(space.parameters):
        slopes = [abs(_relative_slope(block, j)) for block in here.blocks if block.experiment]
        if math.isfinite(p.ceiling) and max(slopes, default=0.0) * (p.upper - p.lower) > _STEEP:
            powers[j] = 0.0
    return powers


def _relative_slope(block: Block, j: int) -> float:
    """d ln y / d theta_j, the mean over a block."""
    if block.jacobian is None:
        return 0.0
    predicted = block.measured + block.residual
    size = float(predicted @ predicted)
    return float(predicted @ block.jacobian[:, j]) / size if size > 0 else 0.0


def _size(block: Block) -> float:
    return max(float(block.measured @ block.measured), 1e-300)


def _channel(space: SearchSpace, powers: Floats, by_theta: Floats, block: Block) -> _Channel:
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    linear = block.jacobian * by_theta
    exponents = np.zeros(space.size)
    predicted = block.measured + block.residual
    scales = [j for j, p in enumerate(space.parameters) if _is_scale(p) or not math.isnan(powers[j])]
    fits = {j: _exponential(predicted, linear[:, j]) for j in scales}
    best = min(fits, key=lambda j: fits[j][2], default=None)
    straight = np.zeros(space.size), np.zeros(len(predicted)), np.zeros(len(predicted))
    if best is None or fits[best][2] > _EXPONENTIAL:
        return _Channel(block, 0.0, exponents, linear, *straight)
    offset = fits[best][1]
    centred = predicted - offset
    for j in scales:
        exponent = float(centred @ linear[:, j]) / float(centred @ centred)
        misfit = np.linalg.norm(linear[:, j] - exponent * centred)
        if misfit <= _EXPONENTIAL * np.linalg.norm(linear[:, j]):
            if _is_scale(space.parameters[j]) and abs(exponent) > _LARGEST_POWER:
                continue
            exponents[j] = exponent
            linear[:, j] -= exponent * centred
    return _Channel(block, offset, exponents, linear, *straight)


def _bent(channel: _Channel, way: Floats, by_w: Floats, block: Block) -> _Channel:
    """The channel with the bend that meets the block of the second point, `way` = w(other) - w(z) off."""
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    # Only what still changes the channel once the factors are taken out counts for how far along the way a point is.
    felt = (channel.linear**2).sum(axis=0)
    length = float(way @ (felt * way))
    if length <= 0:
        return channel
    factor = math.exp(min(max(-float(channel.exponents @ way), -_LARGEST_LOG), _LARGEST_LOG))
    there = factor * (block.measured + block.residual - channel.offset)
    slope = factor * (block.jacobian * by_w) @ way - float(channel.exponents @ way) * there
    straight = channel.linear @ way
    here = channel.block.measured + channel.block.residual - channel.offset
    rise, turn = there - here - straight, slope - straight
    return replace(channel, direction=felt * way / length, square=3 * rise - turn, cube=turn - 2 * rise)


def _exponential(y: Floats, slope: Floats) -> tuple[float, float, float]:
    """m, c and relative misfit of slope = m (y - c); the misfit is infinite where y hardly moves."""
    size = float(np.linalg.norm(slope))
    if len(y) < 3 or size <= 1e-6 * float(np.linalg.norm(y)) or float(np.ptp(y)) <= 1e-9 * float(np.abs(y).max()):
        return 0.0, 0.0, math.inf
    (m, b), *_ = np.linalg.lstsq(np.column_stack([y, np.ones_like(y)]), slope, rcond=None)
    if m == 0:
        return 0.0, 0.0, math.inf
    return float(m), float(-b / m), float(np.linalg.norm(slope - m * y - b)) / size


def _is_scale(parameter: FreeParameter) -> bool:
    return parameter.lower > 0 and not math.isfinite(parameter.ceiling)
