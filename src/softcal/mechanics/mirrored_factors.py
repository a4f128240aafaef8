"""Factors of a tangent: of its even and its odd half where it is its own mirror image, else of the whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.linear_solve import Factors
from softcal.mechanics.mirror import Half, Mirror
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.touched_pattern import TouchedPattern

NOISE = 1e-9  # of a force: its even or odd part below that is rounding error


class MirroredPattern:
    """The planned pattern of a tangent, and its halves by each plane. Which one serves depends on the tangent alone,
    not on those before, so that results do not either.

    unit (n,): of the unknowns, in which the matrix is factorised; single: whether in single precision.
    """

    def __init__(self, pattern: Pattern, mirrors: tuple[Mirror, ...], unit: Floats, *, single: bool = False) -> None:
        self._pattern, self._unit, self._single = pattern, unit, single
        self._mirrors = [one for one in mirrors if np.array_equal(unit[one.partner], unit)]
        self._halves: dict[Mirror, list[TouchedPattern]] = {}
        self._whole: TouchedPattern | None = None

    def factorise(self, data: Floats, touch: Any, near: Callable[[], Any]) -> Factors:
        """The factors of a tangent with contact.

        Parameters
        ----------
        data, touch, near
            See `TouchedPattern.factorise`.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        for mirror in self._mirrors:
            entries = mirror.split(data, touch)
            if entries is not None:
                halves = (mirror.even, mirror.odd)
                if mirror not in self._halves:
                    self._halves[mirror] = [
                        TouchedPattern(half.triangle, self._unit[half.own], single=self._single) for half in halves
                    ]
                patterns = self._halves[mirror]
                even, odd = (HalfFactors(*each, near) for each in zip(halves, patterns, entries, strict=True))
                even.factors  # noqa: B018 (where it is singular, so is the whole tangent)
                return Halves(even, odd)
            for pattern in self._halves.pop(mirror, []):
                pattern.release()
        if self._whole is None:
            self._whole = TouchedPattern(self._pattern, self._unit, single=self._single)
        return self._whole.factorise(data, touch, near)

    def release(self) -> None:
        """Release the factors' memory."""
        halves = chain.from_iterable(self._halves.values())
        for pattern in (*halves, *([] if self._whole is None else [self._whole])):
            pattern.release()


@dataclass(frozen=True, eq=False)
class HalfFactors:
    """One half of a tangent by its `entries`, planned ones and those of contact, factorised where it is asked for."""

    half: Half
    pattern: TouchedPattern
    entries: tuple[Floats, Any]
    near: Callable[[], Any]

    @cached_property
    def factors(self) -> Factors:
        """The factors of this half."""
        return self.pattern.factorise(*self.entries, lambda: self.half.of_touch(self.near().tocoo()))


class Halves:
    """The factors of a tangent that mirrors itself."""

    def __init__(self, even: HalfFactors, odd: HalfFactors) -> None:
        self._even, self._odd = even, odd

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        columns = b.reshape(len(b), -1)
        x = np.zeros_like(columns)
        for each, part, acts in self._parts(columns, NOISE):
            if acts.any():
                x[:, acts] += each.half.expanded(each.factors.solve(part[:, acts]))
        return x.reshape(b.shape)

    def without_small_parts(self, b: Floats, accuracy: float) -> Floats:
        """The forces b (n, k), each without its even or its odd part where that is below `accuracy` of the other."""
        out = np.zeros_like(b)
        for each, part, acts in self._parts(b, accuracy):
            out[:, acts] += each.half.forces(part[:, acts])
        return out

    @property
    def n_negative(self) -> int:
        """The number of negative eigenvalues of the matrix."""
        return self._even.factors.n_negative + self._odd.factors.n_negative

    @property
    def solves_per_factorisation(self) -> float:
        """The number of solutions by iteration that cost about as much as a factorisation."""
        return self._even.factors.solves_per_factorisation

    def _parts(self, b: Floats, accuracy: float) -> Iterator[tuple[HalfFactors, Floats, np.ndarray]]:
        """Each half with its part of the forces b (n, k), and whether columns are above `accuracy` of the other's."""
        both = (self._even, self._odd)
        parts = [each.half.reduced(b) for each in both]
        sizes = [np.abs(part).max(axis=0, initial=0.0) for part in parts]
        for each, part, size in zip(both, parts, sizes, strict=True):
            yield each, part, size > accuracy * np.maximum(*sizes)
