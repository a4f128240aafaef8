"""What a stored search is a search of: another problem or other settings are refused, naming what differs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from softcal.calibration.problem import SOFTCAL
from softcal.errors import Fault


def identity_faults(what: str, where: str, held: Mapping[str, str], given: Mapping[str, str]) -> list[Fault]:
    """A fault for each part of the problem that differs; of another engine one, since its settings then differ all
    together. what: that which is stored, as in "the run".
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
    """A fault for each name whose values differ."""
    return [
        Fault(f"{what}: {name}", where, got=_short(given.get(name)), allowed=_short(held.get(name)))
        for name in dict.fromkeys([*held, *given])
        if name not in ignored and held.get(name) != given.get(name)
    ]


def _short(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return f"{text[:12]}…" if len(text) > 24 else text
