"""Rules for names of experiments, of parts, and of all else that names a file, a column or a parameter."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping

from softcal.errors import Fault
from softcal.limits import LIMITS
from softcal.project.document import Findings, KeyPath

# The label of the calibration of all experiments together, which is kept beside those of each.
JOINT = "joint"
# Names that a file system, a run folder or the rig's own parameters take.
_DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(1, 10)))
RESERVED_OF_TESTS = frozenset((JOINT, *_DEVICES))
RESERVED_OF_PARTS = frozenset(("frame", "pulleys", "rig", *_DEVICES))
_NAME = re.compile(r"\w([\w .+()-]*[\w+()-])?")
ALLOWED = "letters, digits, and _ - + . ( ) or blanks between them"


def name_fault(name: str, reserved: Iterable[str] = ()) -> Fault | None:
    """Fault of a name that is to name a file or to be typed on the command line; None if it is allowed."""
    if fault := LIMITS["characters in a name"].fault(len(name)):
        return fault
    if _NAME.fullmatch(name) is None or not name.isprintable():
        return Fault("this cannot be a name", got=repr(name), allowed=ALLOWED)
    if folded(name) in reserved:
        return Fault("the name is reserved by softcal", got=repr(name), attempt=f"{name}_1")
    return None


def check_names(names: Mapping[str, KeyPath], findings: Findings, reserved: Iterable[str] = ()) -> None:
    """Record names that are not allowed, and names that differ only in capitals, which a file system may not
    distinguish.

    Parameters
    ----------
    names
        Key path by name.
    findings
        Collects the faults and warnings.
    reserved
        Names that softcal uses for its own files and columns.
    """
    seen: dict[str, str] = {}
    for name, path in names.items():
        if (fault := name_fault(name, reserved)) is not None:
            findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
        elif (other := seen.setdefault(folded(name), name)) != name:
            findings.add(path, "two names differ only in capitals", got=f"'{other}' and '{name}'")


def folded(name: str) -> str:
    """The name as stored by a file system that ignores case."""
    return unicodedata.normalize("NFC", name).casefold()
