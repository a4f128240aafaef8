"""Everything softcal raises.

SoftcalError
├─ InputError            something the user gave is wrong; exit code 2
│  ├─ ProjectFileError   a project file (all its faults at once)
│  ├─ MeshError          a mesh, a region, a cable point
│  ├─ DatasetError       a bench file or what is asked of it
│  ├─ UnitError          a missing or wrong unit
│  ├─ ParameterError     a parameter name, value or bound
│  └─ StorageError       a folder or file that cannot be read or written
├─ SimulationError       the twin has no equilibrium that could be found; carries its status
└─ CalibrationError      a calibration that cannot give a result
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong, told so that it can be mended.

    what: what is wrong; where: file, line, key or column; got: what was found;
    allowed: what may stand there; attempt: what to try next.
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
    """The known name most like `name`, quoted, for a fault's `attempt`; "" where none is alike."""
    folded = {candidate.casefold(): candidate for candidate in known}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return f"'{folded[match[0]]}'" if match else ""


class SoftcalError(Exception):
    """The root of every error that softcal raises on purpose."""


class InputError(SoftcalError):
    """Something the user gave is wrong. Holds every fault found, not only the first."""

    def __init__(self, faults: Fault | str | Iterable[Fault]) -> None:
        if isinstance(faults, str):
            faults = Fault(faults)
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        Exception.__init__(self, "\n".join(str(fault) for fault in self.faults))

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[Fault, ...]]]:
        return type(self), (self.faults,)


class ProjectFileError(InputError):
    """A project file that does not describe a project."""


class MeshError(InputError):
    """A mesh, a region of it, or a point that should lie in it."""


class DatasetError(InputError):
    """A bench file, or a preparation step that the data does not allow."""


class UnitError(InputError):
    """A quantity whose unit is missing, unknown or of another dimension."""


class ParameterError(InputError):
    """A parameter that does not exist, or a value or bound outside what is allowed."""


class StorageError(InputError):
    """A folder or file that cannot be read, written, or must not be overwritten."""


class SimulationError(SoftcalError):
    """No equilibrium was found; the message is the status sentence of the solver."""


class CalibrationError(SoftcalError):
    """A calibration that cannot give a result, for instance because every trial failed."""
