"""The bordered tangent of an equilibrium: solved with its own factors, or by GMRES with those of an earlier one.

The tangent of all unknowns but the efforts is sparse and symmetric, K; efforts and friction border it:

    [ K   C ] [dz]   [b]
    [ R^T D ] [dw] = [c]    =>  dw = (R^T K^-1 C - D)^-1 (R^T K^-1 b - c),  dz = K^-1 (b - C dw)

so the factorisation has no zeros on the diagonal. Along a load path K changes slowly: with K factorised at an earlier
state and the border as it is now, the same substitution is a preconditioner.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg.lapack import dgesv  # pyright: ignore[reportAttributeAccessIssue]

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.dense import Dense, dense_tangent
from softcal.mechanics.krylov import FIRST, gmres
from softcal.mechanics.linear_solve import Factors
from softcal.mechanics.linearisation import NO_BORDER, Linearisation
from softcal.mechanics.mirrored_factors import Halves, MirroredPattern
from softcal.mechanics.redundancy import require_independent
from softcal.mechanics.system import System

AS_MANY = 0.3  # of the unknowns: as many products of low rank make the tangent a dense matrix
# Unknowns from which factors are kept and in single precision. Below, a factorisation is cheaper than the iterations
# that it saves: neck, P2P1, one core: 7k unknowns 12 ms, and 1 ms an iteration; 28k 180 (single 110) and 10; 75k 1,310
# (750) and 35.
LARGE = 20_000
SMALL = 8.0  # iterations as expensive as a factorisation, at least: small matrices have fewer by their entries
ANALYSED = 2.0  # times as long: a factorisation with an analysis, as of what touches anew
EXACT = 1e-11  # relative error of solutions for slopes and derivatives
CERTAIN = 1e-5  # relative error of a random solution: a random vector's share in a mode is above that
SIGN = 0.01  # of an eigenvalue of the tangent over its factors: below, its sign is found by factorisation
OWN = 1e-2  # factor on the error by an iteration with the tangent's own factors in single precision
NEGLIGIBLE = 1e-30
MOST = 60  # iterations with the tangent's own factors in single precision


class BorderedTangent:
    """The tangent taken last, its border, and the factors that are kept."""

    def __init__(self, system: System, unit: Floats) -> None:
        self.system, self.unit = system, unit
        self.n_factorisations = self.n_tangents = self.n_iterations = 0
        self._patterns: dict[bool, MirroredPattern] = {}  # by whether in single precision, from their first use on
        self._factors: Factors | None = None
        self._border = NO_BORDER
        self._columns_solved: Floats | None = None
        self._at: Linearisation | None = None  # the tangent of solves by GMRES; None: that of the factors
        self._is_own = False  # whether the factors are the tangent's own, in single precision
        self._spent = 0.0  # iterations with the factors, in those of one column
        self._unstable: int | None = None  # directions, where they are known
        # Efforts follow from the other unknowns, and have no share in norms.
        self._scale = np.concatenate([unit, np.full(len(system.actuators), 1.0 / NEGLIGIBLE)])[:, None]

    def factorise(self, at: Linearisation, drag: Floats | None = None) -> None:
        """Factorise a tangent in double precision; drag: added to the diagonal of points and frames.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        self._take(at, None)
        data, border = at.data, at.border
        if data is None:
            raise SimulationError("There is no tangent to factorise.")
        if drag is not None:
            data = data.copy()
            data[self.system.pattern.indptr[: len(drag)]] += drag
        if len(border.corner) - len(border.driven) > AS_MANY * len(self.unit):
            whole, self._border = dense_tangent(self.system.pattern, data, at.touch, border)
            self._factors = Dense(self.unit[:, None] * whole * self.unit)
        else:
            self._factors = self._factorised(at, data, single=False)
        self._spent = 0.0
        self.n_factorisations += 1

    @property
    def is_factorised(self) -> bool:
        """Whether the tangent taken last was factorised, in double precision."""
        return self._at is None and self._factors is not None

    @property
    def has_own_factors(self) -> bool:
        """Whether the factors are those of the tangent taken last, not of an earlier one."""
        return self.is_factorised or self._is_own

    def take(self, at: Linearisation) -> None:
        """Solve with a tangent from now on, by the factors of an earlier one where that costs less.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        few = len(at.border.corner) - len(at.border.driven) <= AS_MANY * len(self.unit)
        if len(self.unit) < LARGE or not few:
            self.factorise(at)
        else:
            self._take(at, at)
            if self._factors is None or isinstance(self._factors, Dense):
                self._renew(at)

    def follow(self, at: Linearisation) -> None:
        """Solve with a tangent near that of the factors from now on, by these and their border while that costs less
        than new ones.
        """
        border, solved = self._border, self._columns_solved
        self._take(at, at)
        self._border, self._columns_solved = border, solved

    def forget(self) -> None:
        """Forget the factors, so that the next tangent is factorised."""
        self._factors, self._is_own = None, False

    def _take(self, at: Linearisation, solved: Linearisation | None) -> None:
        self._at, self._border, self._columns_solved, self._is_own = solved, at.border, None, False
        self._unstable = None
        self.n_tangents += 1

    def _renew(self, at: Linearisation) -> None:
        """Factorise the tangent in single precision."""
        if at.data is None:
            raise SimulationError("There is no tangent to factorise.")
        self._factors = self._factorised(at, at.data, single=True)
        self._columns_solved, self._is_own, self._spent = None, True, 0.0
        self.n_factorisations += 1

    def _factorised(self, at: Linearisation, data: Floats, *, single: bool) -> Factors:
        if single not in self._patterns:
            self._patterns[single] = MirroredPattern(self.system.pattern, self.system.mirrors, self.unit, single=single)
        return self._patterns[single].factorise(data, at.touch, at.near)

    def exclude(self, modes: Floats) -> None:
        """Exclude modes, see `Statics.exclude`, from solutions of the tangent that was factorised last."""
        border = self._border
        solved = self._sparse_solve(border.columns.reshape(len(modes), -1), modes)
        k = len(border.corner)
        require_independent(self.system, border, self.unit, solved)
        # A free mode would give entries of the multipliers' matrix that are too large beside the others.
        size = np.sqrt(np.abs(np.einsum("nk,nk->k", modes, solved[:, k:])))
        solved[:, k:] /= size
        self._border = replace(
            border,
            columns=np.concatenate([border.columns.reshape(len(modes), -1), modes / size], axis=1),
            rows=np.concatenate([border.rows.reshape(len(modes), -1), modes / size], axis=1),
            corner=np.pad(border.corner, (0, modes.shape[1])),
        )
        self._columns_solved = solved

    def solve(self, b: Floats, accuracy: float = EXACT, guess: Floats | None = None) -> Floats:
        """The unknowns' response with the tangent taken last.

        Parameters
        ----------
        b
            Right sides (n_unknowns,) or (n_unknowns, k).
        accuracy
            Relative error where it is solved by iteration, and of an even force's odd part, or the reverse, where the
            tangent mirrors itself.
        guess
            Where the iteration begins, as b.

        Raises
        ------
        SimulationError
            Where the bordered tangent is singular, or actuators are driven to coordinates that depend on each other.
        """
        columns = b.reshape(len(b), -1)
        if isinstance(self._factors, Halves) and accuracy > EXACT:
            n = len(self.unit)
            columns = np.concatenate([self._factors.without_small_parts(columns[:n], accuracy), columns[n:]])
        if self._at is None or columns.shape[1] == 0:
            return self._substituted(columns).reshape(b.shape)
        begin = None if guess is None else guess.reshape(columns.shape)
        return self._iterated(columns, accuracy, begin)[0].reshape(b.shape)

    def substitute(self, b: Floats) -> Floats:
        """About the response to b (n_unknowns,) with the tangent taken last: by the factors as they are."""
        return self._substituted(b[:, None])[:, 0]

    def n_unstable(self) -> int:
        """Number of unstable directions of the state whose tangent was taken last; zero where it is stable.

        The potential has a minimum among the states with these coordinates where the bordered tangent has as many
        negative eigenvalues as it has multipliers: pressures, efforts of driven actuators. Friction makes the border
        unsymmetric; its sign changes where the tangent becomes singular, as without friction. Dead moments have no
        potential, and the symmetric part of the tangent depends on how rotations are parametrised: there statics show
        only whether the determinant has the sign of a stable state (divergence), so that the number is 0 or 1.

        With factors of an earlier tangent, their sign is that of this tangent unless an eigenvalue of the one over the
        other is negative. A solution for a random vector cannot be accurate before such an eigenvalue is among its
        Ritz values.
        """
        if self._unstable is None:
            is_certain = True
            if self._at is not None:
                random = np.zeros((self.system.layout.n_unknowns, 1))
                random[: len(self.unit), 0] = np.random.default_rng(3).standard_normal(len(self.unit)) / self.unit
                is_certain = bool(self._iterated(random, CERTAIN)[1].min(initial=1.0) > SIGN)
            self._unstable = self._n_unstable() if is_certain else -1
            if self._unstable != 0 and self._at is not None:
                self.factorise(self._at)
                self._unstable = self._n_unstable()
        return self._unstable

    def release(self) -> None:
        """Release the factors' memory."""
        for pattern in self._patterns.values():
            pattern.release()
        self._factors = None

    def _n_unstable(self) -> int:
        """The number of unstable directions by the factors and the border."""
        border = self._border
        n_negative = self._own_factors.n_negative
        if len(border.corner):
            columns_solved, _ = self._with_border_solved(np.zeros((len(self.unit), 0)))
            schur = border.rows.T @ columns_solved - border.corner
            n_negative += int(np.count_nonzero(np.linalg.eigvals(schur).real > 0.0))
        n_motions = sum(self.system.actuators[i].is_motion for i in border.driven.tolist())
        n_unstable = n_negative - self.system.layout.n_pressures - (len(border.corner) - n_motions)
        return n_unstable % 2 if border.has_moments else n_unstable

    def _iterated(self, b: Floats, accuracy: float, guess: Floats | None = None) -> tuple[Floats, Floats]:
        """The response to b (n_unknowns, k) by GMRES from a guess, and Ritz values: with the factors as they are while
        that costs less than new ones, else with new ones; in double precision where these do not serve either.
        """
        at, own = self._at, self._own_factors
        if at is None:
            return self._substituted(b), np.ones(1)
        cost = 0.5 * (1 + b.shape[1])  # of an iteration, over that of one column
        # Iterations, also with the tangent's own factors; from a guess perhaps one.
        at_least = np.log(accuracy) / np.log(OWN) if guess is None else 1.0
        affordable = max(own.solves_per_factorisation, SMALL) * (ANALYSED if at.touch is not None else 1.0)
        if cost * at_least > affordable:  # such as for many derivatives
            self.factorise(at)
            return self._iterated(b, accuracy)
        left = affordable - self._spent
        most = MOST if self._is_own else int(at_least + left / cost)
        if most >= FIRST and (left > 0.0 or self._is_own):
            solution = gmres(
                lambda x: self.system.tangent_times(at, self._scale * x),
                lambda r: self._substituted(r) / self._scale,
                b,
                accuracy,
                most,
                None if guess is None else guess / self._scale,
            )
            self.n_iterations += solution.n_iterations
            self._spent += cost * max(solution.n_iterations - at_least, 0.0)
            if solution.converged:
                return self._scale * solution.x, solution.ritz
        if self._is_own or len(self.unit) < LARGE:
            self.factorise(at)
        else:
            self._renew(at)
        return self._iterated(b, accuracy)

    @property
    def _own_factors(self) -> Factors:
        if self._factors is None:
            raise SimulationError("No tangent was factorised.")
        return self._factors

    def _substituted(self, b: Floats) -> Floats:
        """The response to b (n_unknowns, k) with the factors and the border."""
        n = self.system.layout.first_effort_unknown
        out = np.zeros_like(b)
        border = self._border
        columns_solved, y = self._with_border_solved(b[:n])
        if len(border.corner):
            rows_y = border.rows.T @ y
            rows_y[: len(border.driven)] -= b[n + border.driven]
            # Of a few rows, NumPy's own function spends more on its checks than on the solution.
            w, info = dgesv(border.rows.T @ columns_solved - border.corner, rows_y)[2:]
            if info != 0:
                raise SimulationError("The tangent is singular.")
            y -= columns_solved @ w
            out[n + border.driven] = w[: len(border.driven)]
        out[:n] = y
        return out

    def _with_border_solved(self, b: Floats) -> tuple[Floats, Floats]:
        """K^-1 of the border's columns, and of b (n, m): of the first one in one pass over the factors, not two."""
        k = len(self._border.corner)
        if k == 0 or self._columns_solved is not None:
            columns = self._border.columns if self._columns_solved is None else self._columns_solved
            return columns, self._sparse_solve(b) if b.shape[1] else b
        both = self._sparse_solve(self._border.columns, b)
        require_independent(self.system, self._border, self.unit, both)
        self._columns_solved = both[:, :k]
        return self._columns_solved, both[:, k:]

    def _sparse_solve(self, *blocks: Floats) -> Floats:
        """K^-1 of the blocks' columns, side by side, in column order as the factors require."""
        scaled = np.empty((len(self.unit), sum(block.shape[1] for block in blocks)), order="F")
        first = 0
        for block in blocks:
            np.multiply(block, self.unit[:, None], out=scaled[:, first : first + block.shape[1]])
            first += block.shape[1]
        solved = self._own_factors.solve(scaled)
        solved *= self.unit[:, None]
        return solved
