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
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.loss import Block, Loss, rms
from softcal.calibration.parameters import SearchSpace
from softcal.checks import Floats
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
        modulus = np.array([p.unit == MODULUS and not plain for p in space.parameters])
        load = np.array([p.unit in _LOADS and not plain for p in space.parameters])
        self._moduli, self._loads = np.flatnonzero(modulus), np.flatnonzero(load)
        self._others = np.flatnonzero(~modulus & ~load)
        below = np.array([reciprocal and math.isfinite(p.ceiling) and not plain for p in space.parameters])
        self._below = np.flatnonzero(below)
        self._w, slopes = self._coordinates(here.z)
        self._derivatives = [jacobian_of(block) * (space.jacobian(here.z) / slopes) for block in here.blocks]
        self._along, self._bends = np.zeros(space.size), [np.zeros(1)] * len(here.blocks)

    def bend(self, to: Point) -> None:
        """Add a curvature along the line to another simulated point, so that the model reproduces its values too.

        Without it, the steps along a valley in which parameters compensate each other overshoot alternately. The
        scaling with moduli is known, so the curvature is by the other parameters.
        """
        w, _ = self._coordinates(to.z)
        way = w - self._w
        felt = np.zeros(self._space.size)
        for block, derivatives in zip(self._here.blocks, self._derivatives, strict=True):
            felt += (derivatives**2).sum(axis=0) / max(float(block.measured @ block.measured), 1e-300)
        felt[self._moduli] = 0.0
        length = float(way @ (felt * way))
        missed = [b.residual - r for b, (r, _) in zip(to.blocks, self._residuals(to.z), strict=True)]
        size = sum(
            float(m @ m) / max(float(b.measured @ b.measured), 1e-300) for m, b in zip(missed, to.blocks, strict=True)
        )
        # An error above half of the predicted change is not a curvature.
        if 0.0 < size <= 0.25 * length:
            self._along = felt * way / length
            scales = [self._scale(b, d, way)[0] for b, d in zip(to.blocks, self._derivatives, strict=True)]
            forces = [block.grows_with_moduli for block in to.blocks]
            self._bends = [m / s if f else m for m, s, f in zip(missed, scales, forces, strict=True)]

    def loss(self, x: Floats) -> float:
        """The modelled loss."""
        blocks = zip(self._here.blocks, self._residuals(x), strict=True)
        summed = self._share * sum(self._loss.block_value(block, residual) for block, (residual, _) in blocks)
        return math.sqrt(summed) if self._loss.rooted else summed

    def missed(self, at: Point) -> float:
        """The share of the residuals' change to another simulated point that the model does not predict, at most 1."""
        error, change = 0.0, 1e-300
        for here, there, (residual, _) in zip(self._here.blocks, at.blocks, self._residuals(at.z), strict=True):
            weights = self._loss.square_weights(here, here.residual)
            error += float(weights @ (there.residual - residual) ** 2)
            change += float(weights @ (there.residual - here.residual) ** 2)
        return min(1.0, math.sqrt(error / change))

    def reproduces(self) -> bool:
        """Whether it has the value and the first derivative of the twin at its own point, to nine digits."""
        slopes = self._space.jacobian(self._here.z)
        for block, (residual, jacobian) in zip(self._here.blocks, self._residuals(self._here.z), strict=True):
            exact = jacobian_of(block) * slopes
            size = max(rms(block.measured), rms(block.residual))
            if not float(np.abs(residual - block.residual).max()) <= _REPRODUCED * size:
                return False
            if not float(np.abs(jacobian - exact).max()) <= _REPRODUCED * float(np.abs(exact).max()):
                return False
        return True

    def minimise(
        self, lower: Floats, upper: Floats, *, begin: Floats | None = None, max_iterations: int = 60
    ) -> Floats:
        """The minimiser of the modelled loss in a box, searched from the point of the box nearest to `begin`, or to z.

        Each pass solves the bounded linear least squares that touch the loss from above. For the likelihood that is
        Gauss-Newton; for a sum of RMSEs it is iterative reweighting, which ends at the minimiser of the sum itself and
        not of a sum of squares. No pass needs a simulation.
        """
        from scipy.optimize import lsq_linear

        x = np.clip(self._here.z if begin is None else begin, lower, upper)
        value = self.loss(x)
        for _ in range(max_iterations):
            matrix, right = self._squares(x)
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

    def _residuals(self, x: Floats) -> list[tuple[Floats, Floats]]:
        """Residual (n,) and jacobian by x (n, size) of every block."""
        w, slopes = self._coordinates(x)
        moved = w - self._w
        t = float(self._along @ moved)
        near = min(max(t, -_BEND_REACH), _BEND_REACH)
        square, turn = near * (2 * t - near), 2 * near * self._along
        found: list[tuple[Floats, Floats]] = []
        for block, derivatives, bend in zip(self._here.blocks, self._derivatives, self._bends, strict=True):
            is_force = block.grows_with_moduli
            sign, scaled = (1.0, self._others) if is_force else (-1.0, self._loads)
            as_they_are = self._loads if is_force else self._others
            scale, shares = self._scale(block, derivatives, moved)
            scales = np.exp(np.clip(sign * moved[self._moduli], -_LARGEST_LOG, _LARGEST_LOG))
            bent = bend * scale if is_force else bend
            g = derivatives[:, self._moduli]
            changed = scale * (derivatives[:, scaled] @ moved[scaled]) + (bent * square if is_force else 0.0)
            rest = derivatives[:, as_they_are] @ moved[as_they_are] + (0.0 if is_force else bent * square)
            by_w = derivatives + np.outer(bent, turn)
            by_w[:, scaled] += (scale - 1.0) * derivatives[:, scaled]
            by_w[:, self._moduli] = g * scales + sign * np.outer(changed, shares)
            found.append((block.residual + sign * g @ (scales - 1.0) + changed + rest, by_w * slopes))
        return found

    def _scale(self, block: Block, derivatives: Floats, moved: Floats) -> tuple[float, Floats]:
        """Factor by which the moduli multiply what is proportional to them or to one over them, and their
        shares in it.
        """
        size = (derivatives[:, self._moduli] ** 2).sum(axis=0)
        shares = size / size.sum() if size.sum() > 0 else np.zeros(len(self._moduli))
        sign = 1.0 if block.grows_with_moduli else -1.0
        power = sign * float(shares @ moved[self._moduli])
        return math.exp(min(max(power, -_LARGEST_LOG), _LARGEST_LOG)), shares

    def _squares(self, x: Floats) -> tuple[Floats, Floats]:
        """The touching least squares at x, compressed by QR to as many rows as there are parameters."""
        rows: list[Floats] = []
        right: list[Floats] = []
        for block, (residual, jacobian) in zip(self._here.blocks, self._residuals(x), strict=True):
            root = np.sqrt(self._loss.square_weights(block, residual))
            rows.append(root[:, None] * jacobian)
            right.append(-root * residual)
        q, r = np.linalg.qr(np.concatenate(rows))
        return r, q.T @ np.concatenate(right)


def jacobian_of(block: Block) -> Floats:
    """The jacobian, which every block of a search by sensitivities has."""
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    return block.jacobian
