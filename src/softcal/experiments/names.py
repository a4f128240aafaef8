"""The names that bench channels go by, the unit each is held in, and the nearest name to a mistyped one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

# Channel -> SI unit. `shortening` is the crosshead's; angles are the plate's (see `orientation`).
CHANNEL_UNITS = {
    "time": "s",
    "shortening": "m",
    "tension": "N",
    "pitch": "rad",
    "roll": "rad",
    "yaw": "rad",
    "x": "m",
    "y": "m",
    "z": "m",
}

ANGLES = ("pitch", "roll", "yaw")

QUATERNION = ("qw", "qx", "qy", "qz")


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name most like `name`, quoted for a message; "" where none is alike."""
    folded = {candidate.casefold(): candidate for candidate in known}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return f"'{folded[match[0]]}'" if match else ""
