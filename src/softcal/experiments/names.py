"""Names of bench channels, and their SI units."""

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

# Suffix of the channel with another's standard deviation, sample by sample: `m4.x_sd`.
DEVIATION = "_sd"

ANGLES = ("pitch", "roll", "yaw")

QUATERNION = ("qw", "qx", "qy", "qz")


def channel_unit(name: str) -> str | None:
    """SI unit of a channel by its name (`pitch`, `m4.x`, `cable1.tension`, `m4.x_sd`); None for an unknown name."""
    owner, _, kind = name.removesuffix(DEVIATION).rpartition(".")
    if "." in owner or (kind == "time" and (owner or is_deviation(name))) or name.startswith("."):
        return None
    return CHANNEL_UNITS.get(kind)


def is_deviation(channel: str) -> bool:
    """Whether a channel is the standard deviation of another."""
    return channel.endswith(DEVIATION)


def deviation_channel(channel: str) -> str:
    """Name of the channel with the standard deviations of this one."""
    return channel + DEVIATION
