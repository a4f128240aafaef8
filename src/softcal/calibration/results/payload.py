"""Observations as bytes and back, bit by bit: the record from which a search is resumed."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softcal.calibration.problem.observation import Observation
from softcal.calibration.results.stored import contradiction
from softcal.checks import Floats
from softcal.errors import ParameterError
from softcal.twin.response import Derivatives

# Between the parts of a key; a character that no name holds.
_SEPARATOR = "\x1f"
_LARGEST = 2**28  # bytes of the arrays of a trial, unpacked
# What NumPy and zipfile raise for bytes of another format, or incomplete ones.
_BROKEN = (
    ValueError, KeyError, IndexError, TypeError, EOFError, OSError, MemoryError, NotImplementedError, RuntimeError,
    AttributeError, zipfile.BadZipFile, zlib.error, struct.error, ParameterError,
)  # fmt: skip


def encode(observations: Mapping[str, Observation]) -> bytes:
    """Every array of the observations, by experiment, in NumPy's own format (no pickles)."""
    arrays: dict[str, Floats] = {}
    for name, seen in observations.items():
        for channel, values in seen.predicted.items():
            arrays[_SEPARATOR.join(("predicted", name, channel))] = values
        for channel, columns in seen.derivatives.items():
            for parameter, values in columns.items():
                arrays[_SEPARATOR.join(("derivative", name, channel, parameter))] = values
        for channel, values in seen.response.items():
            arrays[_SEPARATOR.join(("response", name, channel, seen.units.get(channel, "1")))] = values
    keys = np.array(list(arrays), dtype=np.str_)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, keys=keys, **{str(i): values for i, values in enumerate(arrays.values())})  # pyright: ignore[reportArgumentType]
    return buffer.getvalue()


def decode(payload: bytes, path: Path, what: str) -> dict[str, Observation]:
    """The observations that were passed to `encode`.

    Parameters
    ----------
    payload
        The bytes.
    path, what
        Where they were stored, and to what they belong, for messages.

    Raises
    ------
    StorageError
        Where the bytes are damaged.
    """
    try:
        predicted: dict[str, dict[str, Floats]] = {}
        derivatives: dict[str, dict[str, dict[str, Floats]]] = {}
        response: dict[str, dict[str, Floats]] = {}
        units: dict[str, dict[str, str]] = {}
        with np.load(io.BytesIO(payload), allow_pickle=False) as held:
            if sum(one.file_size for one in held.zip.infolist()) > _LARGEST:  # to which zipfile keeps as it unpacks
                raise ValueError(f"the unpacked arrays have more than {_LARGEST} bytes")
            for i, key in enumerate(held["keys"].tolist()):
                kind, name, channel, *last = key.split(_SEPARATOR)
                values = held[str(i)]
                if values.dtype != np.float64:
                    raise ValueError(f"{key} is of the type {values.dtype}")
                if kind == "predicted":
                    predicted.setdefault(name, {})[channel] = values
                elif kind == "derivative":
                    derivatives.setdefault(name, {}).setdefault(channel, {})[last[0]] = values
                else:
                    response.setdefault(name, {})[channel] = values
                    units.setdefault(name, {})[channel] = last[0]
        return {
            name: Observation(
                channels, Derivatives.of(derivatives.get(name, {})), response.get(name, {}), units.get(name, {})
            )
            for name, channels in predicted.items()
        }
    except _BROKEN as error:
        raise contradiction(path, what, f"its arrays are damaged ({error or type(error).__name__})") from error
