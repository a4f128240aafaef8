"""The names that bench channels go by, the unit each is held in."""

from __future__ import annotations

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

# Ends the name of the channel that holds another's standard deviation, sample by sample: `m4.x_sd`.
DEVIATION = "_sd"

ANGLES = ("pitch", "roll", "yaw")

QUATERNION = ("qw", "qx", "qy", "qz")


def channel_unit(name: str) -> str | None:
    """The SI unit of a channel by its name (`pitch`, `m4.x`, `cable1.tension`, `m4.x_sd`), None where it is no name."""
    owner, _, kind = name.removesuffix(DEVIATION).rpartition(".")
    if "." in owner or (kind == "time" and (owner or is_deviation(name))) or name.startswith("."):
        return None
    return CHANNEL_UNITS.get(kind)


def is_deviation(channel: str) -> bool:
    """Whether a channel holds the standard deviations of another."""
    return channel.endswith(DEVIATION)


def deviation_channel(channel: str) -> str:
    """The name of the channel that holds the standard deviations of this one."""
    return channel + DEVIATION
