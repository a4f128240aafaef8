"""The exceptions that softcal raises.

SoftcalError
├─ InputError            invalid user input; exit code 2
│  ├─ ProjectFileError   a project file (all its faults at once)
│  ├─ MeshError          a mesh, a region, a cable point
│  ├─ DatasetError       a bench file or its preparation
│  ├─ UnitError          a missing or wrong unit
│  ├─ ParameterError     a parameter name, value or bound
│  └─ StorageError       a folder or file that cannot be read or written
├─ SimulationError       no equilibrium was found; carries the solver's status
└─ CalibrationError      a calibration without a result
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fault:
    """One fault of the input, with the information needed to correct it.

    Attributes
    ----------
    what
        The fault.
    where
        File, line, key or column.
    got
        The value found.
    allowed
        Allowed values.
    attempt
        Suggested correction.
    """

    what: str
    where: str = ""
    got: str = ""
    allowed: str = ""
    attempt: str = ""

    def __str__(self) -> str:
        return self.told()

    def _repr_html_(self) -> str:
        import html

        return f"<div>{html.escape(str(self))}</div>"

    def told(self, *, verbose: bool = False) -> str:
        """The fault as sentences; verbose: with all names that are allowed, however many."""
        text = f"{self.where}: {self.what}" if self.where else self.what
        if self.got:
            text += f"; got {self.got}"
        if self.allowed:
            allowed = self.allowed.full if verbose and isinstance(self.allowed, Names) else self.allowed
            text += f"; allowed: {allowed}"
        text = text if text.endswith("?") else text.rstrip(".") + "."
        if self.attempt:
            attempt = self.attempt.rstrip(".")
            text += f" Try: {attempt}" + ("" if attempt.endswith("?") else ".")
        return text


FEW, NEAREST = 8, 3
"""Names that a message lists; of more it has their number and as many as NEAREST of the most similar."""


class Names(str):
    """Names that are allowed, as a message has them: all of few, else how many there are; `full` has all."""

    full: str

    @classmethod
    def of(cls, known: Sequence[str], more: str = "") -> Names:
        """The text of some names, or of their number; more: what else is allowed."""
        few = len(known) <= FEW
        text = cls((", ".join(known) if few else f"one of {len(known)} names (--verbose lists them)") + more)
        text.full = ", ".join(known) + more
        return text

    def __reduce__(self) -> tuple[object, tuple[str], dict[str, str]]:
        return Names, (str(self),), {"full": self.full}


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name most similar to `name`, quoted, for a fault's `attempt`; "" if none is similar."""
    return "".join(f"'{one}'" for one in _alike(name, known, 1, 0.5))


def unknown_keys(given: Iterable[Any], known: Collection[str]) -> tuple[list[Any], set[str]]:
    """The keys that are not known, and the known ones for which they may be misspelt: such a pair is one mistake."""
    others = [key for key in given if key not in known]
    return others, {nearest(str(key), known).strip("'") for key in others}


# Word of the field -> the name of that key or channel in softcal.
_MEANT = {
    **dict.fromkeys(("e", "modulus", "young", "elastic_modulus", "stiffness"), "youngs_modulus"),
    **dict.fromkeys(("tendons", "wires", "strings"), "cables"),
    **dict.fromkeys(("chambers", "pressure_chambers", "motors", "drives"), "actuators"),
    **dict.fromkeys(("force", "load"), "tension"),
    **dict.fromkeys(("displacement", "travel", "stroke"), "shortening"),
    **dict.fromkeys(("nu", "poisson", "poisson_ratio"), "poissons_ratio"),
    **dict.fromkeys(("clamp", "clamped", "boundary", "bc"), "fixed"),
    **dict.fromkeys(("tests", "measurements", "data"), "experiments"),
    **dict.fromkeys(("sigma", "sd", "std"), "noise"),
    **{"rho": "density", "material": "law", "model": "law", "weight": "mass", "friction": "friction_coefficient"},
    **{"geometry": "mesh", "file": "mesh", "optimiser": "method", "optimizer": "method", "constraints": "ties"},
}


def _meant(name: str) -> str:
    return ".".join(_MEANT.get(word, word) for word in name.casefold().split("."))


def _alike(name: str, known: Iterable[str], n: int, cutoff: float = 0.0) -> list[str]:
    """The n known names most similar to `name`, the most similar first; before them names of which it is a part, or
    which are a part of it: "a.pressure" where it is "a". Of another word for a known name, that name.
    """
    folded, name = {candidate.casefold(): candidate for candidate in known}, name.casefold()
    if (meant := _meant(name)) in folded:
        return [folded[meant]]
    related = [one for one in folded if any(f".{of}." in f".{one}." or f".{one}." in f".{of}." for of in (name, meant))]
    first = difflib.get_close_matches(name, related, n, 0.0)
    return [folded[one] for one in dict.fromkeys([*first, *difflib.get_close_matches(name, folded, n, cutoff)])][:n]


def unknown(
    what: str,
    where: str,
    name: str,
    known: Iterable[str],
    *,
    among: Iterable[str] = (),
    got: str | None = None,
    more: str = "",
    none: str = "none",
) -> Fault:
    """The fault of a name that does not exist, with the names that do: all where they are few, else the nearest three.

    Parameters
    ----------
    what
        What is wrong.
    where
        Where the name is stated.
    name
        The name.
    known
        The names that exist.
    among
        Those of the known names that come first as the one that was meant.
    got
        How the name is shown; None for quoted.
    more
        What is allowed beside the names.
    none
        What is said where there is no name at all.
    """
    names = list(dict.fromkeys(known))
    if len(names) <= FEW or _meant(name) in names:
        attempt = nearest(name, [*among] or names)
    else:
        likely = _alike(name, among, NEAREST)
        others = _alike(name, (one for one in names if one not in likely), NEAREST)
        *first, last = (f"'{one}'" for one in [*likely, *others][:NEAREST])
        attempt = f"{', '.join(first)} or {last}"
    shown = f"'{name}'" if got is None else got
    return Fault(what, where, shown, Names.of(names, more) if names else none, attempt)


class SoftcalError(Exception):
    """Base class of all errors that softcal raises deliberately."""


class InputError(SoftcalError):
    """Invalid user input; holds all faults found, not only the first."""

    def __init__(self, faults: Fault | str | Iterable[Fault]) -> None:
        if isinstance(faults, str):
            faults = Fault(faults)
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        Exception.__init__(self, self.told())

    def told(self, *, verbose: bool = False) -> str:
        """All faults, one a line; verbose: with all names that are allowed, however many."""
        return "\n".join(fault.told(verbose=verbose) for fault in self.faults)

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[Fault, ...]]]:
        return type(self), (self.faults,)


class ProjectFileError(InputError):
    """An invalid project file."""


class MeshError(InputError):
    """An invalid mesh, region, or point relative to a mesh."""


class DatasetError(InputError):
    """An invalid bench file, or a preparation step that the data do not allow."""


class UnitError(InputError):
    """A quantity whose unit is missing, unknown or of another dimension."""


class ParameterError(InputError):
    """An unknown parameter, or a value or bound out of range."""


class StorageError(InputError):
    """A folder or file that cannot be read, written, or must not be overwritten."""


class SimulationError(SoftcalError):
    """No equilibrium was found; the message is the status sentence of the solver."""


class CalibrationError(SoftcalError):
    """A calibration without a result, for instance because all trials failed."""
