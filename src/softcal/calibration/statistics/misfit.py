"""Usual causes that would explain the residuals of an experiment, each by its shape along the record of a channel.

Residuals r and shapes c are divided by the noise of their channel with its correlation along the record (REML), which
is estimated beside all shapes, and are without what the fitted parameters can do in the experiment, by the jacobians. A
cause is then worth c . r / |c| standard errors: it would reduce the sum of squares by the square of that, in all
channels of the experiment together, since the parameters follow. Its share is that by which the channel's own squares
fall. These shares compare causes; they do not sum to one, since shapes are alike. What the parameters can all but do,
such as a gain beside a modulus, would have to be larger than the record to leave what it leaves: it is no cause. Of
causes that are about as clear, each may be the true one, with the probability that their likelihoods give it.

An error of the robot's description, such as a via point beside its place, has one size in all channels and experiments,
and its shapes are the twin's own derivatives. It counts where it alone explains most of what the parameters leave.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.loss import Block
from softcal.calibration.statistics.correlation import process, record, span, triangle
from softcal.calibration.statistics.residuals import FEWEST_OF_CURVE
from softcal.checks import Floats

OFFSET, DRIFT, GAIN = "an offset", "a drift or relaxation", "a gain"
SLACK, DELAY, FRICTION = "a slack", "a delay", "friction that reverses"
LAW = "another material law or friction in bends"  # of one shape along a record without reversal
CONTACT = "contact of surfaces"
_ABSORBED = 1e-3  # of its size: with less left, the parameters can do what a cause would
_RELAXES = (1.0, 3.0)  # over the time of a record: rates at which a force may relax
_BEGINS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)  # of the range of a force: where contact may begin
COUNTS = 3.5  # standard errors of the clearest shape from which what the model may miss counts, from one more in whole
_ROUGHLY = 0.02  # of the decrease of the squares by the clearest cause
_MOST = 0.5  # of the squares: an error of the robot's description that explains less is no explanation
_BRANCH = 0.1  # of the samples: a branch of a cycle; along one branch, a delay is like a slack
_FEWEST = 8  # values more than parameters and shapes together
_ROUNDING = 1e-9  # of what is measured: smaller residuals are those of an exact fit


@dataclass(frozen=True)
class Misfit:
    """Of a channel: cause no larger than the record -> the share [-] of its squared residuals that it explains, the
    clearest first; how many standard errors the clearest shape of a cause of any size is worth; the changes (n, k)
    of the residual by the shapes of these causes but contact, each times the root of its likelihood over that of the
    clearest, None without one;
    and how many of these standard errors are in the channel's own residuals.

    The last is at most what the shape and the parameters together take off the squares of these residuals. It is less
    where the loss is no likelihood: what one channel misses, the parameters could move to another, but have not.
    """

    explained: Mapping[str, float]
    significance: float
    changes: Floats | None = None
    in_residuals: float = 0.0


def likelihoods(worth: Sequence[float]) -> list[float]:
    """Likelihood of each cause over that of the clearest, by how many standard errors they are worth.

    A cause has its shape only roughly: by some per cent its decrease of the squares may be another.
    """
    most = max(worth, default=0.0)
    return [math.exp((one**2 - most**2) / (2.0 * max(1.0, _ROUGHLY * most**2))) for one in worth]


@dataclass(frozen=True)
class RobotError:
    """An error of the robot's description that would explain what the twin misses in all experiments.

    Attributes
    ----------
    size
        By how much the parameter of the robot would be off [SI], by the derivatives.
    share
        The share [-] that it explains of the squared residuals beyond those of the noise, without what the parameters
        can do.
    worth
        How many standard errors it is worth [-].
    moved
        Changes (size,) of the fitted parameters with it [SI].
    """

    size: float
    share: float
    worth: float
    moved: Floats


def robot_errors(
    blocks: Sequence[Block], changes: Sequence[Floats], steps: tuple[Floats, Floats]
) -> list[RobotError | None]:
    """Of each error of the robot's description its size; None where it does not explain most of the residuals.

    Parameters
    ----------
    blocks
        Those of all experiments, and priors, with jacobians.
    changes
        Changes (n, k) of each block's residual by a unit of each of the k errors.
    steps
        The least and the largest change (size,) of each fitted parameter, within its bounds [SI].
    """
    from scipy.optimize import lsq_linear

    jacobians = [block.jacobian for block in blocks if block.jacobian is not None]
    scales = np.linalg.norm(np.concatenate(jacobians), axis=0)
    scales = np.where(scales > 0.0, scales, 1.0)
    triples = zip(blocks, jacobians, changes, strict=True)
    records = [_whitened(block, J / scales, change) for block, J, change in triples]
    size = len(scales)
    # Sums of squares and products stay the same in a triangle.
    columns = np.concatenate([np.column_stack([one.answer, one.residual, one.changes]) for one in records])
    answer, residual, shapes = np.split(triangle(columns), [size, size + 1], axis=1)
    basis = span(answer)
    low, high = (np.minimum(steps[0] * scales, -_ROUNDING), np.maximum(steps[1] * scales, _ROUNDING))

    def squares(more: Floats) -> tuple[float, Floats]:
        """The squares that the parameters within their bounds, and changes of any size, leave; and all steps."""
        free = np.full(more.shape[1], np.inf)
        A = np.column_stack([answer, more])
        found = lsq_linear(A, -residual[:, 0], (np.append(low, -free), np.append(high, free)), method="bvls")
        return 2.0 * float(found.cost), found.x

    alone, _ = squares(shapes[:, :0])
    beyond = alone - max(sum(len(one.residual) for one in records if one.shapes) - basis.shape[1], 0)
    found: list[RobotError | None] = []
    for shape in shapes.T[:, :, None]:
        left = _without(basis, shape)
        if np.linalg.norm(left) <= _ABSORBED * np.linalg.norm(shape):
            found.append(None)
            continue
        unit = float(np.linalg.norm(left))
        with_error, moved = squares(shape / unit)
        worth = math.sqrt(max(alone - with_error, 0.0))
        share = min(worth**2 / max(beyond, 1e-300), 1.0)
        error = RobotError(moved[-1] / unit, share, worth, moved[:-1] / scales)
        found.append(error if share >= _MOST and worth > COUNTS else None)
    return found


def misfits(blocks: Sequence[Block]) -> list[Misfit]:
    """The misfit of each block of one experiment; without jacobians, or of few samples, nothing explains it."""
    jacobians = [block.jacobian for block in blocks if block.jacobian is not None]
    if not jacobians or len(jacobians) < len(blocks):
        return [Misfit({}, 0.0)] * len(blocks)
    sizes = np.linalg.norm(np.concatenate(jacobians), axis=0)  # a modulus and a ratio have other units
    scales = np.where(sizes > 0.0, sizes, 1.0)
    records = [_whitened(block, J / scales) for block, J in zip(blocks, jacobians, strict=True)]
    basis = span(np.concatenate([one.answer for one in records]))
    whole_residual = np.concatenate([one.residual for one in records])
    residual = _without(basis, whole_residual)
    found: list[Misfit] = []
    start = 0
    for one in records:
        rows = slice(start, start + len(one.residual))
        start = rows.stop
        square = max(float(residual[rows] @ residual[rows]), 1e-300)
        significance = in_residuals = 0.0
        worth: dict[str, tuple[float, float]] = {}
        changes: list[tuple[float, Floats]] = []
        for cause, shape, plain in one.shapes:
            whole = np.zeros(len(residual))
            whole[rows] = shape
            left = _without(basis, whole)
            size, along = float(left @ left), float(left @ residual)
            # Predicted less measured: contact is missing from the prediction where that is too small.
            if size <= _ABSORBED**2 * float(shape @ shape) or (cause == CONTACT and along > 0.0):
                continue
            after = residual[rows] - along / size * left[rows]
            pair = abs(along) / math.sqrt(size), max(1.0 - float(after @ after) / square, 0.0)
            if cause != CONTACT:
                significance = max(significance, pair[0])
                own = span(np.column_stack([one.answer, shape])).T @ whole_residual[rows]
                in_residuals = max(in_residuals, min(pair[0], float(np.linalg.norm(own))))
            if float(np.abs(change := along / size * plain).max()) <= one.largest:
                worth[cause] = max(worth.get(cause, pair), pair)
                if cause != CONTACT:
                    changes.append((pair[0], change))
        # Contact may begin anywhere, and so follow noise: it is no clearer than the clearest shape without a choice.
        first = max((cause for cause in worth if cause != CONTACT), key=lambda cause: worth[cause][0], default="")
        clearest = worth[first][0] if first else 0.0
        ordered = sorted(worth.items(), key=lambda pair: (-min(pair[1][0], clearest), pair[0] == CONTACT))
        weights = likelihoods([clear for clear, _ in changes])
        likely = [np.sqrt(p / sum(weights)) * change for p, (_, change) in zip(weights, changes, strict=True)]
        explained = {cause: share for cause, (_, share) in ordered}
        found.append(Misfit(explained, significance, np.column_stack(likely) if likely else None, in_residuals))
    return found


@dataclass(frozen=True)
class _Whitened:
    """A channel's residuals (m,), their derivatives (m, size), the shapes (m,) of causes and the changes (m, k) by
    errors of the robot, divided by the noise, with the shapes (n,) along the record; largest: the range of what was
    measured, or of the predictions.
    """

    residual: Floats
    answer: Floats
    shapes: Sequence[tuple[str, Floats, Floats]]
    changes: Floats
    largest: float


def _whitened(block: Block, jacobian: Floats, changes: Floats | None = None) -> _Whitened:
    n, rms = len(block.residual), float(np.sqrt(np.mean(block.residual**2)))
    largest = float(max(np.ptp(block.measured), np.ptp(block.measured + block.residual)))
    changes = np.zeros((n, 0)) if changes is None else changes
    unit = np.maximum(rms if block.experiment else block.sigma, 1e-300)
    plain = _Whitened(block.residual / unit, jacobian / unit, (), changes / unit, largest)
    if n < FEWEST_OF_CURVE or rms <= _ROUNDING * float(np.abs(block.measured).max()):
        return plain
    shapes = [(cause, shape / np.linalg.norm(shape)) for cause, shape in _shapes(block)]
    columns = np.column_stack([jacobian, *(shape for _, shape in shapes), changes])
    averaged = record(block.residual, columns, columns)
    # One shape of each cause: all of them, or contact from several places on, would leave too little noise.
    causes = [cause for cause, _ in shapes]
    first = [cause != CONTACT and cause not in causes[:k] for k, cause in enumerate(causes)]
    beside = [True] * jacobian.shape[1] + first + [False] * changes.shape[1]
    noise = replace(averaged, answer=averaged.answer[:, beside])
    X = span(noise.answer)
    left = _without(X, averaged.residual)
    m, k = X.shape
    if m - k < _FEWEST:
        return plain
    correlated = process([noise])
    white = max(float(left @ left) / (m - k), (_ROUNDING * rms) ** 2)
    lower = np.linalg.cholesky(white * np.eye(m) if correlated is None else correlated.covariance(m))
    columns = np.column_stack([averaged.residual, averaged.answer])
    divided = np.asarray(np.linalg.solve(lower, columns), dtype=np.float64)
    residual, answer, of_causes, of_robot = np.split(divided, np.cumsum([1, jacobian.shape[1], len(shapes)]), axis=1)
    ends = [(cause, end, shape) for (cause, shape), end in zip(shapes, of_causes.T, strict=True)]
    return _Whitened(residual[:, 0], answer, ends, of_robot, largest)


def _shapes(block: Block) -> list[tuple[str, Floats]]:
    """The shapes (n,) of causes in a channel, by its predictions; contact has one for each place where it may begin."""
    y = block.residual + block.measured
    n = len(y)
    time = np.linspace(0.0, 1.0, n) if block.drift is None else block.drift
    change, largest = np.gradient(y), max(float(np.abs(y).max()), 1e-300)
    onwards = np.sign(change if block.command is None else np.gradient(block.command))
    shapes = [
        (OFFSET, np.ones(n)),
        (DRIFT, time - time[0]),
        (GAIN, y),
        (SLACK, change if block.command is None else onwards * change),
        (LAW, y * (y / largest) ** 2),
        (LAW, y * np.abs(y / largest)),
    ]
    if _BRANCH < float(np.mean(onwards > 0.0)) < 1.0 - _BRANCH:
        shapes += [(FRICTION, onwards * y), (DELAY, change)]
    if block.grows_with_moduli:
        shapes += [(DRIFT, y * np.expm1(-rate * (time - time[0]))) for rate in _RELAXES]
        low, high = float(y.min()), float(y.max())
        shapes += [(CONTACT, np.maximum(y - low - share * (high - low), 0.0)) for share in _BEGINS]
    return [(cause, shape) for cause, shape in shapes if np.any(shape != 0.0)]


def _without(basis: Floats, x: Floats) -> Floats:
    return x - basis @ (basis.T @ x)
