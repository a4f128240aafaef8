"""Rules for names of experiments, of parts, and of all else that names a file, a column or a parameter."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from softcal.declare import shown
from softcal.errors import Fault
from softcal.limits import LIMITS

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


def part_name_fault(name: str) -> Fault | None:
    """Fault of a name of a robot's part, after which parameters and channels are named; None if it is allowed."""
    if not name.isidentifier():
        return Fault("this cannot be a name", got=shown(name), allowed="letters, digits and _, no digit first")
    return name_fault(name, RESERVED_OF_PARTS)


def folded(name: str) -> str:
    """The name as stored by a file system that ignores case."""
    return unicodedata.normalize("NFC", name).casefold()
