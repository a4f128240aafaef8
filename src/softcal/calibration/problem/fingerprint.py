"""A hash of frozen data: two problems with one fingerprint have the same answer, those of another one are refused."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Protocol

import numpy as np

from softcal.calibration.problem.problem import SOFTCAL, Problem
from softcal.errors import Fault


class _Digest(Protocol):
    def update(self, data: bytes, /) -> None: ...


def fingerprints(problem: Problem) -> dict[str, str]:
    """SHA-256 of each part of a problem, by a readable name."""
    return {
        "robot": fingerprint(problem.robot),
        "free parameters": fingerprint(problem.space),
        "loss": fingerprint(problem.loss),
        **({"uncertain parameters": fingerprint(problem.uncertain)} if problem.uncertain else {}),
        **{f"experiment {experiment.name}": fingerprint(experiment) for experiment in problem.experiments},
    }


def fingerprint(data: object) -> str:
    """SHA-256 of nested dataclasses, mappings, sequences, arrays, numbers and text; the order of a mapping is ignored.

    Raises
    ------
    TypeError
        For any other type, whose content could change without changing the hash.
    """
    digest = hashlib.sha256()
    _feed(digest, data)
    return digest.hexdigest()


def _feed(digest: _Digest, data: object) -> None:
    digest.update(type(data).__name__.encode() if is_dataclass(data) else b"|")
    if is_dataclass(data) and not isinstance(data, type):
        for entry in fields(data):
            digest.update(entry.name.encode())
            _feed(digest, getattr(data, entry.name))
    elif isinstance(data, np.ndarray):
        digest.update(f"{data.dtype.str}{data.shape}".encode() + np.ascontiguousarray(data).tobytes())
    elif isinstance(data, Mapping):
        for key in sorted(data, key=str):
            digest.update(f"{key}=".encode())
            _feed(digest, data[key])
    elif isinstance(data, str | int | float | bool | np.generic) or data is None:
        digest.update(repr(data).encode())
    elif isinstance(data, Sequence):
        digest.update(f"[{len(data)}]".encode())
        for item in data:
            _feed(digest, item)
    else:
        raise TypeError(f"a fingerprint cannot be taken of {type(data).__name__}")


def identity_faults(what: str, where: str, held: Mapping[str, str], given: Mapping[str, str]) -> list[Fault]:
    """A fault for each part of the problem that differs; of another engine one, since its settings then differ all
    together.

    Parameters
    ----------
    what, where
        That which is stored, as in "the run", and its place.
    held, given
        Part -> hash, as stored and at present.
    """
    other, engines = f"{what} calibrates something else", (held.get("engine", SOFTCAL), given.get("engine", SOFTCAL))
    if engines[0] == engines[1]:
        return differences(other, where, held, given)
    held, given = (
        {key: value for key, value in one.items() if key != "engine" and not key.startswith("engines.")}
        for one in (held, given)
    )
    engine = Fault(
        f"{what} was made with another engine",
        where,
        got=engines[1],
        allowed=engines[0],
        attempt=f"--engine {engines[0]}",
    )
    return [engine, *differences(other, where, held, given)]


def differences(
    what: str, where: str, held: Mapping[str, Any], given: Mapping[str, Any], *, ignored: Collection[str] = ()
) -> list[Fault]:
    """A fault for each name whose values differ.

    Parameters
    ----------
    what, where
        The fault, and where it is.
    held, given
        Name -> value, as stored and at present.
    ignored
        Names that may differ.
    """
    return [
        Fault(f"{what}: {name}", where, got=_short(given.get(name)), allowed=_short(held.get(name)))
        for name in dict.fromkeys([*held, *given])
        if name not in ignored and held.get(name) != given.get(name)
    ]


def _short(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return f"{text[:12]}…" if len(text) > 24 else text
