"""One bench test as the calibration sees it: what drives the twin, what is compared, and how the rig reads it.

The rig stands between the twin and the instruments:

    shortening on the bench = the cable's shortening + slack
    tension in the dataset  = T exp(n theta (mu - mu_nominal)) + tension offset
    angle of the IMU        = the plate's angle + its offset

The dataset's tension is T_UTM exp(-n theta mu_nominal): the neck's side under the *nominal* friction. It stays so while
mu is free; the twin's tension is brought to that side instead. Were the data corrected by the free mu, a large mu
would shrink both curves and the residual with them, and the search would run off to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault, ParameterError
from softcal.experiments.dataset import Dataset
from softcal.twin.parameters import ParameterInfo
from softcal.twin.protocol import Command
from softcal.twin.response import Response

Drive = Literal["shortening", "tension"]
PULLEY_FRICTION = "pulleys.friction_coefficient"
CABLE_CHANNELS = ("shortening", "tension")
ANGLES = ("pitch", "roll", "yaw")


@dataclass(frozen=True)
class Pulleys:
    """Pulleys between the machine and the neck: how many, wrap_angle [rad] of each, and the friction coefficient [-]
    with which the dataset's tension was brought to the neck's side.
    """

    count: int
    wrap_angle: float
    friction_coefficient: float

    @property
    def turning(self) -> float:
        """The angle [rad] through which the cable turns in all."""
        return self.count * self.wrap_angle


@dataclass(frozen=True)
class Rig:
    """Nominal values of the bench: slack [m], tension_offset [N], angle_offsets [rad] by channel, and the pulleys."""

    slack: float = 0.0
    tension_offset: float = 0.0
    angle_offsets: Mapping[str, float] = field(default_factory=dict)
    pulleys: Pulleys | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "angle_offsets", dict(self.angle_offsets))


@dataclass(frozen=True)
class Experiment:
    """A prepared dataset, the cable that was pulled, the plate that was watched, and what is compared.

    drive: "shortening" (tension and pitch are compared: paper A, Eq. 4) or "tension" (shortening and pitch are).
    compared: channels of the dataset; when empty, those two of them that the dataset has.

    Raises
    ------
    DatasetError
        Where the dataset lacks the driving or a compared channel, or nothing is left to compare.
    """

    name: str
    dataset: Dataset
    cable: str
    plate: str
    drive: Drive = "shortening"
    compared: tuple[str, ...] = ()
    rig: Rig = field(default_factory=Rig)

    def __post_init__(self) -> None:
        other = "tension" if self.drive == "shortening" else "shortening"
        default = tuple(channel for channel in (other, "pitch") if channel in self.dataset.channels)
        object.__setattr__(self, "compared", tuple(self.compared) or default)
        faults = [
            Fault(f"no channel '{channel}'", self.name, allowed=", ".join(self.dataset.channels))
            for channel in (self.drive, *self.compared)
            if channel not in self.dataset.channels
        ]
        if not self.compared:
            faults.append(Fault("there is nothing to compare", self.name, allowed=f"a dataset with {other} or pitch"))
        if self.drive in self.compared:
            faults.append(Fault("the channel that drives the twin cannot be compared", self.name, got=self.drive))
        if faults:
            raise DatasetError(faults)

    def twin_channel(self, channel: str) -> str:
        """The name under which the twin answers a channel of the dataset, such as `front.tension`."""
        return f"{self.cable}.{channel}" if channel in CABLE_CHANNELS else f"{self.plate}.{channel}"

    def rig_values(self) -> dict[str, float]:
        """The nominal rig parameters by dotted name."""
        values = {f"{self.cable}.slack": self.rig.slack, f"{self.cable}.tension_offset": self.rig.tension_offset}
        for angle in ANGLES:
            if angle in self.dataset.channels:
                values[f"{self.plate}.{angle}_offset"] = self.rig.angle_offsets.get(angle, 0.0)
        if self.rig.pulleys is not None:
            values[PULLEY_FRICTION] = self.rig.pulleys.friction_coefficient
        return values


@dataclass(frozen=True)
class Observation:
    """What the bench would have read, had the twin stood on it.

    predicted: channel of the dataset -> values [SI], shape (n_samples,).
    derivatives: channel -> parameter -> d predicted / d parameter, shape (n_samples,).
    response: the twin's own channels by dotted name, [SI]; units: theirs.
    """

    predicted: Mapping[str, Floats]
    derivatives: Mapping[str, Mapping[str, Floats]]
    response: Mapping[str, Floats]
    units: Mapping[str, str]


def rig_parameters(experiments: Iterable[Experiment]) -> dict[str, ParameterInfo]:
    """Every rig parameter of the experiments by dotted name, with unit and limits."""
    found: dict[str, ParameterInfo] = {}
    for experiment in experiments:
        for name, value in experiment.rig_values().items():
            kind = name.rsplit(".", 1)[1]
            unit = {"slack": "m", "tension_offset": "N", "friction_coefficient": "1"}.get(kind, "rad")
            lower = -1e-300 if name == PULLEY_FRICTION else -math.inf
            found.setdefault(name, ParameterInfo(name, unit, value, lower, math.inf))
    return found


def command(experiment: Experiment, rig: Mapping[str, float]) -> Command:
    """What the twin's cable is told to do, sample by sample, under the given rig values."""
    return Command(experiment.drive, _controls(experiment, rig)[0])


def observe(
    experiment: Experiment, rig: Mapping[str, float], response: Response, samples: slice, names: Iterable[str] = ()
) -> Observation:
    """Read the twin's response through the rig, with exact derivatives by `names` (robot and rig parameters).

    `samples` are the experiment's own in a response that may hold those of others too.

    Raises
    ------
    ParameterError
        Where the twin has no channel that is to be compared.
    """
    missing = [c for c in experiment.compared if experiment.twin_channel(c) not in response.channels]
    if missing:
        raise ParameterError(
            [
                Fault(f"the twin does not answer '{experiment.twin_channel(c)}'", experiment.name,
                      allowed=", ".join(response.channels))
                for c in missing
            ]
        )  # fmt: skip
    _, control_derivatives = _controls(experiment, rig)
    wanted = tuple(names)
    predicted: dict[str, Floats] = {}
    derivatives: dict[str, dict[str, Floats]] = {}
    for channel in experiment.compared:
        twin_name = experiment.twin_channel(channel)
        raw = response.channels[twin_name][samples]
        gain, gain_derivatives, offset, offset_name = _reading(experiment, rig, channel)
        predicted[channel] = gain * raw + offset
        derivatives[channel] = {}
        for name in wanted:
            if name in response.sensitivities.get(twin_name, {}):
                slope = gain * response.sensitivities[twin_name][name][samples]
            else:
                slope = np.zeros(len(raw))
            if name in control_derivatives:
                slope = slope + gain * response.slopes[twin_name][samples] * control_derivatives[name]
            if name in gain_derivatives:
                slope = slope + gain_derivatives[name] * raw
            if name == offset_name:
                slope = slope + 1.0
            derivatives[channel][name] = slope
    return Observation(
        predicted,
        derivatives,
        {name: values[samples] for name, values in response.channels.items()},
        dict(response.units),
    )


def _controls(experiment: Experiment, rig: Mapping[str, float]) -> tuple[Floats, dict[str, Floats]]:
    """The twin's control per sample and its derivatives by the rig parameters it depends on."""
    cable = experiment.cable
    measured = experiment.dataset.values(experiment.drive)
    if experiment.drive == "shortening":
        free = measured - rig[f"{cable}.slack"]
        pulled = (free > 0).astype(float)
        return np.maximum(free, 0.0), {f"{cable}.slack": -pulled}
    gain, by_friction = _pulley_gain(experiment, rig)
    free = (measured - rig[f"{cable}.tension_offset"]) / gain
    pulled = (free > 0).astype(float)
    controls = np.maximum(free, 0.0)
    return controls, {
        f"{cable}.tension_offset": -pulled / gain,
        PULLEY_FRICTION: -controls * by_friction / gain,
    }


def _reading(
    experiment: Experiment, rig: Mapping[str, float], channel: str
) -> tuple[float, dict[str, float], float, str]:
    """How the rig reads a channel: gain, the gain's derivatives, offset, and the name of the offset parameter."""
    if channel == "tension":
        gain, by_friction = _pulley_gain(experiment, rig)
        name = f"{experiment.cable}.tension_offset"
        return gain, {PULLEY_FRICTION: by_friction}, rig[name], name
    name = f"{experiment.cable}.slack" if channel == "shortening" else f"{experiment.plate}.{channel}_offset"
    return 1.0, {}, rig.get(name, 0.0), name


def _pulley_gain(experiment: Experiment, rig: Mapping[str, float]) -> tuple[float, float]:
    """Tension under the nominal friction over the true one, and its derivative by the friction coefficient."""
    pulleys = experiment.rig.pulleys
    if pulleys is None:
        return 1.0, 0.0
    gain = math.exp(pulleys.turning * (rig[PULLEY_FRICTION] - pulleys.friction_coefficient))
    return gain, pulleys.turning * gain
