"""The minimum of the loss where groups of measurements count more or less, from the jacobians at the joint minimum.

With residuals r_g + J_g (z' - z) in group g, linear in z', and weights w_g of the groups, the minimum is that of

    sum w_g (r_g + J_g (z' - z))^T W (r_g + J_g (z' - z)),    W = W(z') where a block's RMSE counts and not its square

It solves linear equations, again after every change of W. A weight of zero leaves a group out: the jackknife. Random
weights are a bootstrap. Nothing is simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.estimator import Estimator, linearised, weighed
from softcal.calibration.statistics.noise import DRIFT, ScaledBlock, Source, systematic_sources
from softcal.checks import Floats, Ints

NONE = ""
"""The group of the samples that are in none."""
FEWEST = 3
"""Groups: of two, one is left when the other is taken away, and that says nothing of their scatter."""
_NULL = 1e-9  # eigenvalue over the largest, of the scaled Hessian, below which a direction is not determined
_RIDGE = 1e-11  # of the scaled Hessian's diagonal: what is not determined stays where it is
_MIXED = 0.01  # share of such a direction from which a parameter is not determined
_PASSES = 300
_ENDED = 1e-9  # of the search range: a smaller step ends the passes
_CHUNK = 250  # sets of weights at a time
_TINY = 1e-12  # of its square: a block that is fitted exactly has a very large weight, not an infinite one


@dataclass(frozen=True)
class Squares:
    """A sum of squares by group: of one block whose weight follows its size (`rooted`), or of all others.

    Attributes
    ----------
    groups
        Places of the groups, shape (g,).
    hessians, pulls, values
        J^T W J (g, size, size), J^T W r (g, size) and r^T W r (g,) of each group.
    counts
        Number of samples of each group, shape (g,).
    rooted
        Whether the loss counts the root of the mean square, as often as there are samples.
    """

    groups: Ints
    hessians: Floats
    pulls: Floats
    values: Floats
    counts: Floats
    rooted: bool

    def weighted(self, weights: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """The sums for weights (m, k + 1) of all groups; in place of the counts, the share that remains of them."""
        own = weights[:, self.groups]
        shares = own @ self.counts / self.counts.sum()
        return np.tensordot(own, self.hessians, axes=1), own @ self.pulls, own @ self.values, shares


@dataclass(frozen=True)
class Reweighted:
    """The contribution of each group to the minimum, in the unit box of the search.

    Attributes
    ----------
    names
        The groups, k of them.
    z
        The simulated point, shape (size,).
    squares
        The sums of squares by group; squares in no group, such as those of a prior, have the index k.
    noises
        Covariances of the groups' pulls by white noise, shape (k, size, size).
    own
        Whether a parameter has an effect on fewer than three groups, shape (size,): too few for its scatter.
    known
        Errors of the priors, drifts and uncertain parameters, which the scatter of the groups does not show.
    responses
        The responses (m, size) of the minimum to the records of each of the `known` sources.
    """

    names: tuple[str, ...]
    z: Floats
    squares: tuple[Squares, ...]
    noises: Floats
    own: np.ndarray
    known: tuple[Source, ...]
    responses: tuple[tuple[Floats, ...], ...]

    def minima(self, weights: Floats) -> Floats:
        """The minima without bounds (m, size) for weights (m, k) of the groups."""
        chunks = np.split(weights, range(_CHUNK, len(weights), _CHUNK))
        return np.concatenate([self._minima(np.pad(one, ((0, 0), (0, 1)), constant_values=1.0)) for one in chunks])

    @cached_property
    def minimum(self) -> Floats:
        """The joint minimum, shape (size,)."""
        return self.minima(np.ones((1, len(self.names))))[0]

    @cached_property
    def hessians(self) -> Floats:
        """Hessian of the squares of each group, of those in no group last, shape (k + 1, size, size)."""
        size = len(self.z)
        found = np.zeros((len(self.names) + 1, size, size))
        for one in self.squares:
            found[one.groups] += one.hessians
        return found

    @cached_property
    def inverse(self) -> Floats:
        """Inverse of the Hessian of all squares."""
        return self._inverses(self.hessians.sum(axis=0)[None])[0][0]

    @cached_property
    def without(self) -> tuple[Floats, np.ndarray]:
        """The inverse Hessian without each group, (k, size, size), and whether each parameter is determined without
        each group, (k, size).
        """
        return self._inverses(self.hessians.sum(axis=0) - self.hessians[:-1])

    @cached_property
    def _scale(self) -> Floats:
        scale = np.sqrt(np.diag(self.hessians.sum(axis=0)))
        return np.where(scale > 0.0, scale, 1.0)

    def _inverses(self, hessians: Floats) -> tuple[Floats, np.ndarray]:
        """The pseudoinverses of Hessians (m, size, size), and whether each determines each parameter, (m, size)."""
        scale = np.outer(self._scale, self._scale)
        sizes, axes = np.linalg.eigh(hessians / scale)
        seen = sizes > _NULL * sizes[:, -1:]
        over = np.where(seen, 1.0 / np.where(seen, sizes, 1.0), 0.0)
        mixed = np.max(np.abs(axes) * ~seen[:, None, :], axis=2) > _MIXED
        return np.einsum("mik,mk,mjk->mij", axes, over, axes) / scale, ~mixed

    def _minima(self, weights: Floats) -> Floats:
        sums = [(one, *one.weighted(weights)) for one in self.squares]
        steps = np.zeros((len(weights), len(self.z)))
        left = np.arange(len(weights))
        for _ in range(_PASSES):
            hessians, pulls = np.zeros((len(left), *self._scale.shape * 2)), np.zeros((len(left), len(self.z)))
            for one, H, g, v, n in sums:
                factor, step = np.ones(len(left)), steps[left]
                if one.rooted:  # its weight, over that at z, is one over the root of its squares at the step
                    squares = v[left] + 2 * np.einsum("mi,mi->m", g[left], step)
                    squares += np.einsum("mi,mij,mj->m", step, H[left], step)
                    whole = float(one.values.sum())
                    factor = np.sqrt(n[left] * whole / np.maximum(squares, _TINY * whole))
                hessians += factor[:, None, None] * H[left]
                pulls += factor[:, None] * g[left]
            scaled = hessians / np.outer(self._scale, self._scale) + _RIDGE * np.eye(len(self.z))
            found = -np.linalg.solve(scaled, (pulls / self._scale)[:, :, None])[:, :, 0] / self._scale
            moved = np.abs(found - steps[left]).max(axis=1) > _ENDED
            steps[left] = found
            left = left[moved]
            if not len(left) or not any(one.rooted for one in self.squares):
                break
        return self.z + steps


def reweighted(
    loss: Loss,
    z: Floats,
    slopes: Floats,
    blocks: Sequence[Block],
    groups: Sequence[np.ndarray],
    found: Estimator,
    uncertain: Sequence[UncertainParameter] = (),
) -> Reweighted:
    """The groups of a calibration's measurements.

    Parameters
    ----------
    loss, z, slopes, blocks, uncertain
        See `estimator`.
    groups
        Of each block's samples (n,), `NONE` in the place of none.
    found
        The estimator of these blocks.
    """
    seen = [weighed(loss, one) for one in blocks]
    parts, inverse, _ = linearised(loss, seen, slopes, len(uncertain))
    names = [name for name in dict.fromkeys(str(one) for held in groups for one in held) if name != NONE]
    places = {name: k for k, name in enumerate([*names, NONE])}
    k, size = len(names), len(z)
    noises, felt = np.zeros((k + 1, size, size)), np.zeros((k + 1, size), dtype=bool)
    squares: list[Squares] = []
    plain: list[_Grouped] = []
    for one, part, held in zip(seen, parts, groups, strict=True):
        at = np.array([places[name] for name in held])
        for place in np.unique(at):
            pull = part.pull[at == place]
            noises[place] += found.noise[part.group].size ** 2 * pull.T @ pull
            felt[place] |= np.any(part.answer[at == place] != 0.0, axis=0)
        grouped = _Grouped(part, one.weights * one.block.residual**2, at)
        if loss.straight_along(one.block, one.block.residual) is None:
            plain.append(grouped)
        else:
            squares.append(_squares([grouped], rooted=True))
    if plain:
        squares.append(_squares(plain, rooted=False))
    errs = {i: (p.source, p.label) for i, p in enumerate(uncertain)}
    known = (*(one for one in found.sources if one.kind in ("prior", DRIFT)), *systematic_sources(parts, errs))
    responses = tuple(tuple(one.pull @ inverse for one in source.records) for source in known)
    own = felt[:k].sum(axis=0) < FEWEST
    return Reweighted(tuple(names), z, tuple(squares), noises[:k], own, known, responses)


@dataclass(frozen=True)
class _Grouped:
    """A block, its weighted squares (n,), and the place of each sample's group (n,)."""

    part: ScaledBlock
    squares: Floats
    at: Ints


def _squares(held: Sequence[_Grouped], *, rooted: bool) -> Squares:
    """The squares of blocks by the group of each sample."""
    groups = np.unique(np.concatenate([one.at for one in held]))
    size = held[0].part.pull.shape[1]
    hessians, pulls = np.zeros((len(groups), size, size)), np.zeros((len(groups), size))
    values, counts = np.zeros(len(groups)), np.zeros(len(groups))
    for one in held:
        for i in np.searchsorted(groups, np.unique(one.at)):
            rows = one.at == groups[i]
            hessians[i] += one.part.answer[rows].T @ one.part.pull[rows]
            pulls[i] += one.part.pull[rows].T @ one.part.residual[rows]
            values[i] += one.squares[rows].sum()
            counts[i] += rows.sum()
    return Squares(groups, hessians, pulls, values, counts, rooted)
