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
from collections.abc import Iterable
from dataclasses import dataclass


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
        text = f"{self.where}: {self.what}" if self.where else self.what
        if self.got:
            text += f"; got {self.got}"
        if self.allowed:
            text += f"; allowed: {self.allowed}"
        text = text if text.endswith("?") else text.rstrip(".") + "."
        if self.attempt:
            attempt = self.attempt.rstrip(".")
            text += f" Try: {attempt}" + ("" if attempt.endswith("?") else ".")
        return text


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name most similar to `name`, quoted, for a fault's `attempt`; "" if none is similar."""
    folded = {candidate.casefold(): candidate for candidate in known}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return f"'{folded[match[0]]}'" if match else ""


class SoftcalError(Exception):
    """Base class of all errors that softcal raises deliberately."""


class InputError(SoftcalError):
    """Invalid user input; holds all faults found, not only the first."""

    def __init__(self, faults: Fault | str | Iterable[Fault]) -> None:
        if isinstance(faults, str):
            faults = Fault(faults)
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        Exception.__init__(self, "\n".join(str(fault) for fault in self.faults))

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
