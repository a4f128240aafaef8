"""Validation of input arrays: kind of numbers, masks, shape, finite values, range; the copies are read-only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import length_hint
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softcal.errors import Fault, InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Of = TypeVar("Of")


def is_number(text: str) -> bool:
    """Whether text is a non-negative integer such as a marker's number: at most nine decimal digits."""
    return text.isascii() and text.isdecimal() and len(text) <= 9


def frozen_floats(
    values: ArrayLike, *, name: str, shape: tuple[int | None, ...] | None = None, missing: bool = False
) -> Floats:
    """A read-only float64 copy of numbers.

    Parameters
    ----------
    values
        Numbers in an array or nested lists.
    name
        Name of the argument, for errors.
    shape
        Lengths of the axes; None as a length allows any.
    missing
        NaN is allowed, for missing values.

    Raises
    ------
    InputError
        If these are not real numbers, values are masked, the shape differs, or a value is not finite.
    """
    with np.errstate(over="ignore"):  # a longer float than these becomes infinite
        array = _numbers(values, name, "iuf", "real numbers", missing=missing).astype(np.float64)
    _check_shape(array.shape, shape, name)
    bad = np.flatnonzero(np.isinf(array.ravel()) if missing else ~np.isfinite(array.ravel()))
    if bad.size:
        first = ", ".join(map(str, np.unravel_index(bad[0], array.shape)))
        got = f"{array.ravel()[bad[0]]} at [{first}]"
        raise InputError(Fault(f"{bad.size} of these numbers are not finite", name, got))
    return read_only(array)


def frozen_ints(
    values: ArrayLike, *, name: str, shape: tuple[int | None, ...] | None = None, below: float | None = None
) -> Ints:
    """A read-only int64 copy of numbers.

    Parameters
    ----------
    values, name, shape
        See `frozen_floats`.
    below
        Number of the things that are counted from 0, such as the points of a mesh, or infinity; None allows any number.

    Raises
    ------
    InputError
        As `frozen_floats`; for floats, whole ones too, and for a number out of range.
    """
    array = _numbers(values, name, "iu", "whole numbers")
    if below is not None:
        require_below(below, array, name)
    _check_shape(array.shape, shape, name)
    return read_only(array.astype(np.int64))


def require_below(n: float, numbers: Ints, name: str) -> None:
    """Check that numbers count some of n things from 0.

    Parameters
    ----------
    n
        How many things there are.
    numbers
        The numbers, of any shape.
    name
        Name of the argument, for errors.

    Raises
    ------
    InputError
        For a number out of range.
    """
    if numbers.size and not (numbers.min() >= 0 and numbers.max() < n):
        wrong = numbers[(numbers < 0) | (numbers >= n)]
        allowed = "0 or more" if n == np.inf else f"0 to {n - 1:.0f}"
        got = f"{wrong[0]}" + (f" and {wrong.size - 1} more" if wrong.size > 1 else "")
        raise InputError(Fault("these indices do not exist", name, got, allowed))


def _numbers(
    values: ArrayLike, name: str, kinds: str, of: str, *, missing: bool = False
) -> np.ndarray[tuple[int, ...], np.dtype[Any]]:
    """Values as an array of one of the kinds of NumPy's types."""
    if n_masked := _n_masked(values):
        attempt = "drop these rows, or .filled(value)" + (", NaN for a missing one" if missing else "")
        raise InputError(Fault("masked values are no numbers", name, f"{n_masked} masked", of, attempt))
    if unit := _unit_of(values):
        raise InputError(Fault("these have a unit of their own", name, unit, f"{of} in SI", "their magnitude in SI"))
    if isinstance(values, bytearray | memoryview) and memoryview(values).format in ("B", "c"):
        values = bytes(values)  # which NumPy takes for no numbers
    try:
        n = length_hint(values)  # before it is made, such as of a range
        array = np.asarray(values if n <= _MOST else np.broadcast_to(0, n))
    except (ValueError, TypeError, OverflowError):
        raise InputError(Fault("this is no array", name, "rows of different lengths", of)) from None
    except Exception as error:  # noqa: BLE001 (whatever an object does that NumPy asks for an array)
        raise InputError(Fault("this is no array", name, f"a {type(error).__name__}", of)) from None
    if array.size > _MOST:
        raise InputError(Fault("there are too many numbers", name, str(array.size), f"at most {_MOST}"))
    if array.size and array.dtype.kind not in kinds:
        kind, attempt = _OTHERS.get(array.dtype.kind, (f"values of the type {array.dtype}", ""))
        raise InputError(Fault(f"these are not {of}", name, kind, attempt=attempt))
    return array


_MOST = 50_000_000  # numbers in an array, of which the largest mesh has a fifth


# Kind of NumPy's types -> what it is, and what makes numbers of it.
_OTHERS = {
    "b": ("True and False", "numpy.flatnonzero of the mask"),
    "c": ("complex numbers", ".real, if the imaginary parts mean nothing"),
    "f": ("floats", ".astype(int)"),
    "O": ("objects", ".astype(float)"),
    "U": ("text", ".astype(float)"),
    "S": ("bytes", ".astype(float)"),
}


def _n_masked(values: object, levels: int = 64) -> int:
    """Number of masked values; NumPy drops the masks of the entries of a list in silence. levels: of lists in lists,
    of which NumPy takes no more.
    """
    if isinstance(values, np.ma.MaskedArray):
        return int(np.ma.count_masked(values))
    if isinstance(values, list | tuple) and levels:
        entries: Sequence[object] = values
        return sum(_n_masked(one, levels - 1) for one in entries)
    return 0


def _unit_of(values: object, levels: int = 64) -> str:
    """The unit that an array of a library of quantities has, or an entry of a list; NumPy drops it. "" without one."""
    if isinstance(values, list | tuple) and levels:
        entries: Sequence[object] = values
        return next((unit for one in entries if (unit := _unit_of(one, levels - 1))), "")
    unit = None if isinstance(values, float | int) else getattr(values, "units", getattr(values, "unit", None))
    return "" if unit is None else f"{unit}" or "no dimension"


def read_only(values: Of) -> Of:
    """An array, or all those in mappings and tuples, that can no longer be written."""
    if isinstance(values, np.ndarray):
        values.setflags(write=False)
    elif isinstance(values, Mapping):
        mapping: Mapping[object, object] = values
        for one in mapping.values():
            read_only(one)
    elif isinstance(values, tuple):
        entries: tuple[object, ...] = values
        for one in entries:
            read_only(one)
    return values


class ReadOnly:
    """Base of the frozen dataclasses of results: what is in their arrays can no longer be changed either."""

    def __post_init__(self) -> None:
        for value in vars(self).values():
            read_only(value)


def _check_shape(got: tuple[int, ...], shape: tuple[int | None, ...] | None, name: str) -> None:
    if shape is None:
        return
    if len(got) != len(shape) or any(want is not None and want != have for want, have in zip(shape, got, strict=True)):
        wanted = "(" + ", ".join("n" if want is None else str(want) for want in shape) + ")"
        raise InputError(Fault("this array has the wrong shape", name, str(got), wanted))
