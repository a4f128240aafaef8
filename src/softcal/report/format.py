"""Formatting: names, units and rounded numbers for display; SI in, text out."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from softcal.calibration.results.result import SearchResult
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.statistics.estimate import Estimate
from softcal.materials.catalogue import LAWS, constants_of
from softcal.sensing.channel import channel_name
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.parameter_name import parameter_name
from softcal.units import readable_unit, unit_factor

T = TypeVar("T")

_SYMBOLS = {"friction_coefficient": "μ", "density": "ρ"}


@dataclass(frozen=True)
class Scale:
    """Display scale of an SI quantity: shown = SI / factor, in `unit` ("" if dimensionless)."""

    unit: str
    factor: float

    def axis(self, label: str) -> str:
        """Axis label such as "Pitch [deg]"."""
        return f"{label} [{self.unit.replace('*', ' ')}]" if self.unit else label


def scale_of(si_unit: str, value: float = 1e6) -> Scale:
    """Display scale of a quantity with this SI unit and magnitude."""
    unit = readable_unit(value, si_unit)
    return Scale("" if unit == "1" else unit, unit_factor(unit, si_unit))


def channel_scale(si_unit: str) -> Scale:
    """Display scale of a channel with this SI unit; a pressure is in kPa."""
    return scale_of(si_unit, 1e3 if si_unit == "Pa" else 1e6)


def axis_label(channel: str) -> str:
    """The axis of a channel of an actuator in its display unit, whichever actuator it is: "Pressure [kPa]"; of a
    shortening as testing machines have it, "Displacement [mm]".
    """
    kind = channel_name(channel).kind
    return channel_scale(kind.unit).axis("Displacement" if kind == SHORTENING else kind.label or kind.name)


def estimate_scale(estimate: Estimate) -> Scale:
    """Display scale of an estimate: MPa for a modulus of 2.3e6 Pa."""
    return scale_of(estimate.unit, estimate.value)


def number(value: float, digits: int = 3) -> str:
    """A number to `digits` significant digits, without needless exponents."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else str(value)
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return f"{value:.{max(digits - 1 - exponent, 0)}f}"
    return f"{value:.{digits - 1}e}"


def parameter_label(name: str, others: Iterable[str] = ()) -> str:
    """A short label of a parameter: "E", "ν", "slack (front)", "slack (front, 20mm)".

    The owner is added if the kind has no symbol, or if `others` contains the same kind of another owner.
    """
    parts = parameter_name(name)
    constant = constants_of(LAWS).get(parts.kind)
    symbol = constant.label if constant is not None else _SYMBOLS.get(parts.kind, "")
    text = symbol or parts.kind.replace("_", " ")
    owners = {other.owner for other in map(parameter_name, [*others, name]) if other.kind == parts.kind}
    owner = parts.owner if not symbol or len(owners) > 1 else ""
    details = ", ".join(detail for detail in (owner, parts.experiment) if detail)
    return f"{text} ({details})" if details else text


def material_kinds(results: Iterable[SearchResult]) -> tuple[str, ...]:
    """Calibrated material constants, in the order of their laws; E and nu if there are none."""
    kinds = {parameter_name(name).kind for result in results for name in result.parameters}
    return tuple(kind for kind in constants_of(LAWS) if kind in kinds) or ("youngs_modulus", "poissons_ratio")


def parameters_in_words(names: Iterable[str], experiments: Collection[str]) -> str:
    """Several parameters in words, with those per experiment or set-up listed once: "E and slack (front) per set-up".

    experiments: their names; any other suffix of a parameter is a set-up.
    """
    given = list(names)
    owners: dict[str, set[str]] = {}
    for name in given:
        parts = parameter_name(name)
        owners.setdefault(parts.base, set()).add(parts.experiment)
    labels = (
        f"{parameter_label(base, given)} per {'experiment' if of <= set(experiments) else 'set-up'}"
        if len(of) > 1
        else None
        for base, of in owners.items()
    )
    singles = {parameter_name(name).base: parameter_label(name, given) for name in given}
    return joined(label or singles[base] for base, label in zip(owners, labels, strict=True))


def find_parameter(names: Iterable[str], kind: str) -> str | None:
    """The first name of a parameter of this kind, or None."""
    return next((name for name in names if parameter_name(name).kind == kind), None)


def method_label(method: str) -> str:
    """A calibration method in words."""
    return OPTIMISERS[method].title if method in OPTIMISERS else method


def result_label(label: str) -> str:
    """The label of a calibration, capitalised if it is the joint one."""
    return "All jointly" if label == "joint" else label


def duration(seconds: float) -> str:
    """A time span in words."""
    if seconds < 90:
        return f"{number(seconds)} s"
    if seconds < 5400:
        return f"{seconds / 60:.1f} min"
    return f"{seconds / 3600:.1f} h"


MANY = 10
"""Tests, or parameters of tests, of which each has a line or a clause of its own; of more, the worst have."""


def few(parts: Iterable[str]) -> list[str]:
    """The first parts, and how many more there are."""
    items = list(parts)
    return items if len(items) <= MANY else [*items[:MANY], f"{len(items) - MANY} more"]


def worst(items: Iterable[T], size: Callable[[T], float]) -> tuple[list[T], list[T]]:
    """The items of largest size, as many as have a line of their own, and the others; each in their order."""
    every = list(items)
    first = sorted(range(len(every)), key=lambda k: -size(every[k]))[:MANY]
    return [every[k] for k in sorted(first)], [one for k, one in enumerate(every) if k not in set(first)]


def joined(parts: Iterable[str]) -> str:
    """A list in words: "a, b and c"; with semicolons where a part holds a comma itself."""
    items = list(parts)
    if len(items) < 2:
        return "".join(items)
    comma, last = ("; ", "; ") if any(", " in item and "(" not in item for item in items) else (", ", " and ")
    return comma.join(items[:-1]) + last + items[-1]


def ordered_parameters(results: Mapping[str, SearchResult]) -> list[str]:
    """Every calibrated parameter once: the material's constants first, then in order of appearance."""
    names = list(dict.fromkeys(name for result in results.values() for name in result.parameters))
    rank = {kind: place for place, kind in enumerate(constants_of(LAWS))}
    return sorted(names, key=lambda name: rank.get(parameter_name(name).kind, len(rank)))


def file_stem(text: str) -> str:
    """A label as part of a file name."""
    plain = "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in text.lower())
    return "-".join(part for part in plain.split("-") if part) or "unnamed"
