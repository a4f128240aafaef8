"""Checks at the door: arrays of the right shape, finite, in range; frozen once they are in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softcal.errors import Fault, InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def is_number(text: str) -> bool:
    """Whether text is a whole number such as a marker's: decimal digits alone, nine at most."""
    return text.isascii() and text.isdecimal() and len(text) <= 9


def frozen_floats(
    values: ArrayLike, *, name: str, shape: tuple[int | None, ...] | None = None, missing: bool = False
) -> Floats:
    """A read-only float64 copy of `values`; None in `shape` lets an axis be of any length.

    missing: whether NaN may stand for a value that is not there.

    Raises
    ------
    InputError
        Where the shape differs or a value is not finite.
    """
    array = np.array(values, dtype=np.float64)
    _check_shape(array.shape, shape, name)
    bad = np.flatnonzero(np.isinf(array.ravel()) if missing else ~np.isfinite(array.ravel()))
    if bad.size:
        raise InputError(
            Fault(f"{name} holds {bad.size} value(s) that are not finite", where=f"{name}, flat index {bad[0]}")
        )
    array.setflags(write=False)
    return array


def frozen_ints(values: ArrayLike, *, name: str, shape: tuple[int | None, ...] | None = None) -> Ints:
    """A read-only int64 copy of `values`, checked as in `frozen_floats`."""
    array = np.array(values, dtype=np.int64)
    _check_shape(array.shape, shape, name)
    array.setflags(write=False)
    return array


def _check_shape(got: tuple[int, ...], shape: tuple[int | None, ...] | None, name: str) -> None:
    if shape is None:
        return
    if len(got) != len(shape) or any(want is not None and want != have for want, have in zip(shape, got, strict=True)):
        wanted = "(" + ", ".join("n" if want is None else str(want) for want in shape) + ")"
        raise InputError(Fault(f"{name} has the wrong shape", got=str(got), allowed=wanted))
