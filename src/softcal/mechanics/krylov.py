"""GMRES for several right-hand sides at once, preconditioned from the left by the factors of a similar matrix.

Left of the matrix, they make of the residual an estimate of the error: solutions are as accurate as requested, however
the matrix is conditioned. Factors in single precision give double precision too: every cycle starts from the residual
in double (Carson and Higham 2017, https://doi.org/10.1137/17M1122918).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats

PER_CYCLE = 1e-6  # of an error, by one cycle at most: the limit of single precision
FIRST = 3  # iterations before a prediction
SUPERLINEAR = 0.7  # iterations needed over those that the rate so far predicts

Map = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Solution:
    """A solution, and how it was reached.

    Attributes
    ----------
    x
        The unknowns (n, m).
    converged
        Whether all columns are accurate.
    n_iterations
        Number of products with the matrix.
    ritz
        Real parts of eigenvalues of the preconditioned matrix, estimated by the first column.
    """

    x: Floats
    converged: bool
    n_iterations: int
    ritz: Floats


def gmres(
    times: Map, precondition: Map, b: Floats, accuracy: float, most: int, guess: Floats | None = None
) -> Solution:
    """The solution x (n, m) of A x = b, each column by itself.

    Parameters
    ----------
    times
        x (n, m) -> A x.
    precondition
        r (n, m) -> about A^-1 r.
    b
        Right sides (n, m).
    accuracy
        Relative error of each column [-].
    most
        Iterations; the solution ends early, not converged, where the rate so far predicts more.
    guess
        Where the iteration begins (n, m); None: zero.
    """
    x = np.zeros_like(b) if guess is None else guess
    z = precondition(b if guess is None else b - times(guess))
    goal = accuracy * np.linalg.norm(z if guess is None else guess, axis=0)
    first = cycle = _cycle(times, precondition, z, goal, most)
    x, n = x + cycle.x, cycle.n_iterations
    more = bool(np.any(goal < PER_CYCLE * np.linalg.norm(z, axis=0)))
    while cycle.converged and more:
        z = precondition(b - times(x))
        goal = accuracy * np.linalg.norm(x, axis=0)
        more = bool(np.any(np.linalg.norm(z, axis=0) > goal))
        cycle = _cycle(times, precondition, z, goal, max(most - n - 1, 0))
        x, n = x + cycle.x, n + 1 + cycle.n_iterations
    return Solution(x, cycle.converged, n, first.ritz)


def _cycle(times: Map, precondition: Map, z: Floats, goal: Floats, most: int) -> Solution:
    """The error with the preconditioned residual z (n, m), up to residuals of `goal` (m,), or of PER_CYCLE of z."""
    columns = range(z.shape[1])
    beta = np.linalg.norm(z, axis=0)
    goal = np.maximum(goal, PER_CYCLE * beta)
    bases = [_divided(z, beta)]
    H = np.zeros((z.shape[1], most + 1, most))
    y = np.zeros((z.shape[1], 0))
    residual, ends = beta, False
    while np.any(residual > goal) and len(bases) <= most and not ends:
        j = len(bases)
        w = precondition(times(bases[-1]))
        for i, v in [*enumerate(bases)] * 2:  # orthogonal to all, and again: rounding
            h = np.einsum("nm,nm->m", v, w)
            H[:, i, j - 1] += h
            w -= h * v
        H[:, j, j - 1] = np.linalg.norm(w, axis=0)
        bases.append(_divided(w, H[:, j, j - 1]))
        first = np.eye(j + 1)[0]
        own = [np.linalg.lstsq(H[k, : j + 1, :j], beta[k] * first, rcond=None)[0] for k in columns]
        y = np.stack(own)
        residual = np.array([np.linalg.norm(beta[k] * first - H[k, : j + 1, :j] @ y[k]) for k in columns])
        slow = residual > goal
        if j >= FIRST and slow.any():
            needed = j * np.log(goal[slow] / beta[slow]) / np.minimum(np.log(residual[slow] / beta[slow]), -1e-3)
            ends = bool(SUPERLINEAR * needed.max() > most)
    n = y.shape[1]
    x = np.zeros_like(z) if n else z  # small enough, it is about the error
    for v, part in zip(bases, y.T, strict=False):
        x += part * v
    return Solution(x, not np.any(residual > goal), n, np.linalg.eigvals(H[0, :n, :n]).real.astype(np.float64))


def _divided(x: Floats, sizes: Floats) -> Floats:
    return x / np.where(sizes > 0.0, sizes, 1.0)
