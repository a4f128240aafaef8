"""Validation of input arrays: shape, finite values; the copies are read-only."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softcal.errors import Fault, InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def is_number(text: str) -> bool:
    """Whether text is a non-negative integer such as a marker's number: at most nine decimal digits."""
    return text.isascii() and text.isdecimal() and len(text) <= 9


def as_path(value: object, where: str, allowed: str = "a path") -> Path:
    """The path that a caller gave as text or as a path; allowed: what else the caller takes there.

    Raises
    ------
    InputError
        For anything else.
    """
    if not isinstance(value, str | os.PathLike):
        raise InputError(Fault("this is not a path", where, f"a value of the type {type(value).__name__}", allowed))
    return Path(value)


def frozen_floats(
    values: ArrayLike, *, name: str, shape: tuple[int | None, ...] | None = None, missing: bool = False
) -> Floats:
    """A read-only float64 copy of `values`; None in `shape` allows any length of an axis.

    missing: whether NaN is allowed for missing values.

    Raises
    ------
    InputError
        If the shape differs or a value is not finite.
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
