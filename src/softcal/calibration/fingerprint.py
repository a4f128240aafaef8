"""A hash of frozen data: two problems with one fingerprint have the same answer."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Protocol

import numpy as np

from softcal.calibration.problem import Problem


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
