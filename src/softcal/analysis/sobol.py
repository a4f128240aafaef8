"""Sobol indices by SALib: the shares of the variance of an output over a box that parameters explain.

First order: the share that a parameter explains alone. Total: the share that is gone when it is known only after all
others, so its own one and everything in which it acts together with others. A pair: the share in which the two act
together. An output may have many values, such as a force at every sample: its index is then the sum of the variances
that are explained over the sum of the variances (Gamboa and others, Electron. J. Stat. 8, 2014), which does not depend
on how the values are turned into each other; SALib sees their principal components one by one.

The error is that between independent randomisations of Sobol's sequence. SALib's own, by resampling the points, counts
them as independent, and is ten times as long here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats

REPEATS = 8
"""Independent randomisations."""
_ROWS = 2**13  # points of each, at most; the number of base points is a power of two, as Sobol's sequence wants
_FEWEST = 2**7  # base points of each
_LEFT = 1e-5  # of the variance, in the components that are left out
_DRAFT = 400  # points that tell the principal directions
_RESAMPLES = 2  # of SALib's own error, which is not used


@dataclass(frozen=True)
class Index:
    """A Sobol index and its error: half the length of its 95 % interval, plus the most that a surrogate moves it."""

    value: float
    error: float

    @property
    def is_known(self) -> bool:
        """True if the index can be distinguished from zero."""
        return self.value > self.error

    @property
    def most(self) -> float:
        """Upper end of its interval."""
        return min(max(self.value, 0.0) + self.error, 1.0)


@dataclass(frozen=True)
class Indices:
    """The indices of one output.

    Attributes
    ----------
    first, total
        A parameter's, in their order.
    pairs
        Both parameters and their index, every pair once.
    """

    first: tuple[Index, ...]
    total: tuple[Index, ...]
    pairs: tuple[tuple[int, int, Index], ...]


def box_points(size: int, seed: int) -> Floats:
    """Saltelli's points (n, size) in the unit box, in SALib's order, one randomisation after the other.

    size: 2 or more.
    """
    from SALib.sample.sobol import sample

    base = max(_FEWEST, 2 ** int(np.log2(_ROWS / (2 * size + 2))))
    chance = np.random.default_rng(seed)
    return np.concatenate([sample(_box(size), base, seed=chance) for _ in range(REPEATS)])


def sobol_indices(values: Floats, size: int, error: float = 0.0) -> Indices:
    """The indices of an output from its values (n, k) at `box_points`.

    Parameters
    ----------
    values
        At the points, shape (n, k); they must vary.
    size
        Number of parameters.
    error
        Root mean square of a surrogate's error over the standard deviation of the output.
    """
    from SALib.analyze.sobol import analyze
    from scipy.special import stdtrit

    components = values - values.mean(axis=0)
    if components.shape[1] > 1:  # principal components, without those of negligible variance
        some = components[np.linspace(0, len(components) - 1, min(_DRAFT, len(components))).astype(int)]
        _, sizes, axes = np.linalg.svd(some, full_matrices=False)
        left = 1 - np.cumsum(sizes**2) / np.sum(sizes**2)
        components = np.asarray(components @ axes[: int(np.argmax(left <= _LEFT)) + 1].T, dtype=np.float64)
    found = np.zeros((REPEATS, 2 * size + len(_pairs(size))))  # a row by randomisation: first order, total, pairs
    for row, part in zip(found, np.split(components, REPEATS), strict=True):
        variances = part.var(axis=0)
        for share, component in zip(variances / variances.sum(), part.T, strict=True):
            if share > 0.0:
                one = analyze(_box(size), component, num_resamples=_RESAMPLES, seed=np.random.default_rng(0))
                row += share * np.array([*one["S1"], *one["ST"], *(one["S2"][pair] for pair in _pairs(size))])
    sampling = float(stdtrit(REPEATS - 1, 0.975)) * found.std(axis=0, ddof=1) / np.sqrt(REPEATS)
    # An index is the squared cosine of the angle between the output and its part by some parameters; the surrogate's
    # error turns the output by an angle of that sine at most.
    mean = found.mean(axis=0)
    inside = np.minimum(np.maximum(mean, 0.0), 1.0)
    errors = sampling + error * (2 * np.sqrt(inside * (1 - inside)) + error)
    all_of = [Index(*one) for one in zip(mean.tolist(), errors.tolist(), strict=True)]
    pairs = [(i, j, index) for (i, j), index in zip(_pairs(size), all_of[2 * size :], strict=True)]
    return Indices(tuple(all_of[:size]), tuple(all_of[size : 2 * size]), tuple(pairs))


def _pairs(size: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(size) for j in range(i + 1, size)]


def _box(size: int) -> dict[str, object]:
    names = [str(k) for k in range(size)]
    return {"num_vars": size, "names": names, "bounds": [[0.0, 1.0]] * size}
