"""Planes of symmetry of a robot, and its tangent split by one into an even and an odd half.

Reflected, every unknown is plus or minus its partner, z -> S z. At a state that is its own mirror image the tangent
commutes with S, so in even motions (S z = z) and odd ones (S z = -z) it has two blocks: two factorisations of half the
size cost about a half of one, and the even half alone, as along a load path whose cable lies in the plane, about a
quarter (`benchmarks/mirror.py`). The odd half is factorised where stability is judged or an odd force acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern, Triangle

AT_ONE_PLACE = 1e-9  # of the robot's extent: distance of points that count as mirror images
ALIKE = 1e-9  # of the largest entries in their rows: difference of entries that count as mirror images


@dataclass(frozen=True)
class Half:
    """The even or the odd motions, and the tangent's block for them.

    Attributes
    ----------
    own, other
        The unknowns of each motion: one, and its partner, which may be the same (n_half,).
    other_sign
        The motion of `other` over that of `own`; zero where they are the same (n_half,).
    number, sign
        Of each unknown (n,): the number of its motion, and its own part in it, -1, 1, or 0 where it has none.
    triangle
        Upper triangle of the block.
    place, factor
        Where each pair of mirrored entries goes in the triangle (n_pairs,), and how many times.
    """

    own: Ints
    other: Ints
    other_sign: Floats
    number: Ints
    sign: Floats
    triangle: Triangle
    place: Ints
    factor: Floats

    def reduced(self, b: Floats) -> Floats:
        """The forces b (n, k) on the motions (n_half, k)."""
        return b[self.own] + self.other_sign[:, None] * b[self.other]

    def expanded(self, y: Floats) -> Floats:
        """The unknowns (n, k) by the motions y (n_half, k)."""
        return self.sign[:, None] * y[self.number]

    def forces(self, reduced: Floats) -> Floats:
        """The forces (n, k) of this half alone that are `reduced` (n_half, k) on its motions."""
        return self.expanded(reduced / (1.0 + np.abs(self.other_sign))[:, None])

    def of_touch(self, each: Any) -> Any:
        """The block of a sparse upper triangle that mirrors itself."""
        import scipy.sparse as sp

        rows, columns = each.row.astype(np.int64), each.col.astype(np.int64)
        a, b, factor = _entries(self.number, self.sign, rows, columns)
        part, n = factor != 0.0, len(self.own)
        return sp.csr_matrix(((factor * each.data)[part], (a[part], b[part])), shape=(n, n))


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane by which the unknowns come in pairs, and the halves of a tangent that mirrors itself.

    Attributes
    ----------
    partner, sign
        The mirror image of each unknown but the efforts: its number, and its sign (n,).
    rows, columns
        Of each pair of mirrored entries of the tangent's plan, each the first one of its own pair (n_pairs,).
    entry, mirrored, alike
        The places of the two entries in the tangent, and the sign of one over the other (n_pairs,).
    even, odd
        The halves.
    """

    partner: Ints
    sign: Floats
    rows: Ints
    columns: Ints
    entry: Ints
    mirrored: Ints
    alike: Floats
    even: Half
    odd: Half

    def split(self, data: Floats, touch: Any) -> tuple[tuple[Floats, Any], tuple[Floats, Any]] | None:
        """The entries of both halves, of the tangent's planned ones `data` (nnz,) and of `touch`, a sparse upper
        triangle, or None; None where the tangent does not mirror itself.
        """
        even, odd = (np.zeros(len(half.triangle.indices)) for half in (self.even, self.odd))
        size = np.zeros(len(self.partner))
        first = np.minimum(np.arange(len(size)), self.partner)
        each = None if touch is None else touch.tocoo()
        if each is not None:
            np.maximum.at(size, first[each.row], np.abs(each.data))
            np.maximum.at(size, first[each.col], np.abs(each.data))
        halves = (self.even.place, self.even.factor, even, self.odd.place, self.odd.factor, odd)
        if _split(data, self.rows, self.columns, self.entry, self.mirrored, self.alike, size, *halves) > ALIKE:
            return None
        if each is None:
            return (even, None), (odd, None)
        import scipy.sparse as sp

        row, column = self.partner[each.row], self.partner[each.col]
        places = (np.minimum(row, column), np.maximum(row, column))
        image = sp.csr_matrix((each.data * self.sign[each.row] * self.sign[each.col], places), shape=each.shape)
        unlike = (touch - image).tocoo()
        scale = size[first[unlike.row]] * size[first[unlike.col]]
        if np.any(unlike.data**2 > ALIKE**2 * scale):
            return None
        return (even, self.even.of_touch(each)), (odd, self.odd.of_touch(each))


def mirrors_of(layout: Layout, pattern: Pattern) -> tuple[Mirror, ...]:
    """The planes, normal to an axis, by which free points, frames, pressures and the entries of their tangent come in
    pairs.
    """
    mirrors = (_mirror(layout, pattern, axis) for axis in range(3))
    return tuple(one for one in mirrors if one is not None)


def _mirror(layout: Layout, pattern: Pattern, axis: int) -> Mirror | None:
    n_frames = layout.n_moving_frames
    places = (layout.X[layout.free_points], layout.references[:n_frames], _pressure_places(layout, pattern))
    along = np.concatenate([place[:, axis] for place in places])
    if len(along) == 0:
        return None
    twice_middle, near = along.min() + along.max(), AT_ONE_PLACE * float(np.ptp(layout.X, axis=0).max())
    partners = [_partners(place, axis, twice_middle, near) for place in places]
    if any(one is None for one in partners):
        return None
    points, frames, pressures = (np.zeros(0, dtype=np.int64) if one is None else one for one in partners)
    partner = np.concatenate(
        [
            (3 * points[:, None] + np.arange(3)).ravel(),
            (layout.first_frame_unknown + 6 * frames[:, None] + np.arange(6)).ravel(),
            layout.first_pressure_unknown + pressures,
        ]
    )
    of_point = np.where(np.arange(3) == axis, -1.0, 1.0)
    of_frame = np.concatenate([of_point, -of_point])  # rotations are axial vectors
    sign = np.concatenate([np.tile(of_point, len(points)), np.tile(of_frame, n_frames), np.ones(len(pressures))])
    mirrored = _mirrored(pattern.indptr, pattern.indices, partner)
    if len(mirrored) < pattern.nnz:
        return None
    entry = np.flatnonzero(mirrored >= np.arange(pattern.nnz))
    mirrored, rows, columns = mirrored[entry], pattern.rows[entry], pattern.indices[entry]
    of_half = (_half(partner, sign, parity, rows, columns, mirrored != entry) for parity in (1.0, -1.0))
    alike, first = sign[rows] * sign[columns], np.minimum(np.arange(len(partner)), partner)
    even, odd = of_half
    return Mirror(
        partner=partner,
        sign=sign,
        rows=first[rows],
        columns=first[columns],
        entry=entry,
        mirrored=mirrored,
        alike=alike,
        even=even,
        odd=odd,
    )


def _pressure_places(layout: Layout, pattern: Pattern) -> Floats:
    """The mean place (n_pressures, 3) of the points that each pressure acts on."""
    n, size = layout.n_points, np.int64(pattern.n_entities)
    point, entity = pattern.keys // size, pattern.keys % size
    acts = (point < n) & (entity >= n)
    point, pressure = point[acts], entity[acts] - n
    count = np.maximum(np.bincount(pressure, minlength=layout.n_pressures), 1)
    each = (np.bincount(pressure, layout.X[point, i], layout.n_pressures) / count for i in range(3))
    return np.stack([*each], axis=1)


def _partners(places: Floats, axis: int, twice_middle: float, near: float) -> Ints | None:
    """The place (n,) at the mirror image of each one (n, 3); None where there is none, or more than one."""
    from scipy.spatial import KDTree

    if len(places) == 0:
        return np.zeros(0, dtype=np.int64)
    image = places.copy()
    image[:, axis] = twice_middle - image[:, axis]
    distance, nearest = KDTree(places).query(image, distance_upper_bound=near)
    partner = np.asarray(nearest, dtype=np.int64)
    if not np.all(np.isfinite(distance)) or not np.array_equal(partner[partner], np.arange(len(places))):
        return None
    return partner


def _half(partner: Ints, sign: Floats, parity: float, rows: Ints, columns: Ints, has_two: np.ndarray) -> Half:
    import scipy.sparse as sp

    n = len(partner)
    unknowns = np.arange(n)
    own = np.flatnonzero((unknowns < partner) | ((unknowns == partner) & (sign == parity)))
    number, part = np.zeros(n, dtype=np.int64), np.zeros(n)
    other, is_pair = partner[own], partner[own] != own
    number[other] = number[own] = np.arange(len(own))
    part[other] = parity * sign[own]
    part[own] = 1.0
    a, b, factor = _entries(number, part, rows, columns)
    has_place = factor != 0.0
    block = sp.csr_matrix((has_place[has_place], (a[has_place], b[has_place])), shape=(len(own), len(own)))
    triangle = Triangle(block.indptr.astype(np.int64), block.indices.astype(np.int64))
    place = np.maximum(_places(triangle.indptr, triangle.indices, a, b), 0)
    factor = np.where(has_two, 2.0, 1.0) * factor
    return Half(
        own=own,
        other=other,
        other_sign=np.where(is_pair, parity * sign[own], 0.0),
        number=number,
        sign=part,
        triangle=triangle,
        place=place,
        factor=factor,
    )


@kernel()
def _entries(number: Ints, sign: Floats, rows: Ints, columns: Ints) -> tuple[Ints, Ints, Floats]:
    """Where entries of a symmetric matrix, of its upper triangle, go in that of a half, and how many times."""
    first, last, factor = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64), np.empty(len(rows))
    for k in range(len(rows)):
        a, b = number[rows[k]], number[columns[k]]
        first[k], last[k] = min(a, b), max(a, b)
        twice = 2.0 if a == b and rows[k] != columns[k] else 1.0  # an entry represents its mirror image too
        factor[k] = twice * sign[rows[k]] * sign[columns[k]]
    return first, last, factor


@kernel()
def _mirrored(indptr: Ints, indices: Ints, partner: Ints) -> Ints:
    """The place (nnz,) of each entry's mirror image in an upper triangle; none, (0,), where one has no image."""
    out = np.empty(len(indices), dtype=np.int64)
    for row in range(len(indptr) - 1):
        for k in range(indptr[row], indptr[row + 1]):
            a, b = partner[row], partner[indices[k]]
            out[k] = _place(indptr, indices, min(a, b), max(a, b))
            if out[k] < 0:
                return out[:0]
    return out


@kernel()
def _places(indptr: Ints, indices: Ints, rows: Ints, columns: Ints) -> Ints:
    """The places of entries (k,) in an upper triangle; -1 where it has none."""
    out = np.empty(len(rows), dtype=np.int64)
    for k in range(len(rows)):
        out[k] = _place(indptr, indices, rows[k], columns[k])
    return out


@kernel()
def _place(indptr: Ints, indices: Ints, row: int, column: int) -> int:
    low, end = indptr[row], indptr[row + 1]
    high = end
    while low < high:
        middle = (low + high) // 2
        if indices[middle] < column:
            low = middle + 1
        else:
            high = middle
    return low if low < end and indices[low] == column else -1


@kernel(error_model="numpy")
def _split(  # noqa: PLR0913 (a kernel takes arrays)
    data: Floats,
    rows: Ints,
    columns: Ints,
    entry: Ints,
    mirrored: Ints,
    alike: Floats,
    size: Floats,
    even_place: Ints,
    even_factor: Floats,
    even: Floats,
    odd_place: Ints,
    odd_factor: Floats,
    odd: Floats,
) -> float:
    """Add the entries to the halves; the largest difference of mirrored ones, over the largest entries of their rows.

    size (n,): the largest entries outside the plan, on return of all.
    """
    for k in range(len(entry)):
        value = abs(data[entry[k]])
        size[rows[k]] = max(size[rows[k]], value)
        size[columns[k]] = max(size[columns[k]], value)
    worst = 0.0
    for k in range(len(entry)):
        value, image = data[entry[k]], alike[k] * data[mirrored[k]]
        scale = size[rows[k]] * size[columns[k]]
        if (value - image) ** 2 > worst * scale:
            worst = (value - image) ** 2 / scale
        mean = 0.5 * (value + image)
        even[even_place[k]] += even_factor[k] * mean
        odd[odd_place[k]] += odd_factor[k] * mean
    return np.sqrt(worst)
