"""One bench test as the calibration sees it: what drives the twin, what is compared, and the rig between the two.

The rig relates the twin to the instruments:

    shortening on the bench = the cable's shortening + slack, +- half of the drive's backlash
    tension in the dataset  = gain T exp(n theta (mu - mu_nominal)) + tension offset   (loading, see `steps/pulleys`)
    angle of the IMU        = the plate's angle + its offset
    position of a marker    = R(frame) (the twin's position) + t(frame)

The dataset's tension is T_UTM exp(-n theta mu_nominal): the neck's side under the *nominal* friction. It stays so while
mu is free; the twin's tension is converted to that side instead. Were the data corrected by the free mu, a large mu
would shrink both curves and with them the residual, and the search would diverge to large mu.

Channels of a dataset have the twin's names (`cable1.tension`, `S4.pitch`, `m4.x`). With one cable and one plate, the
last part alone will do (`tension`, `pitch`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Literal

import numpy as np

from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.rig import Rig
from softcal.checks import Floats
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset
from softcal.quantities import QUANTITIES, Quantity, noise_in
from softcal.sensing.channel import ChannelName, channel_name, of_actuator, positions, readings
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import SHORTENING, TENSION
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import ParameterInfo

Drive = Literal["shortening", "tension"]
PULLEY_FRICTION = "pulleys.friction_coefficient"
PULLEY_PRESLIDING = "pulleys.presliding"

BACKLASH = "backlash"
_OF_PULLEYS = {
    PULLEY_FRICTION: QUANTITIES["friction coefficient"],
    PULLEY_PRESLIDING: QUANTITIES["presliding displacement"],
}


@displayed
@dataclass(frozen=True)
class Experiment(Checked):
    """A prepared dataset, what drives the twin, what is compared with it, and the rig.

    Attributes
    ----------
    name
        Name in results.
    dataset
        The measurements.
    cable, plate
        Cable and plate whose channels have short names (`tension`, `pitch`).
    drive
        "shortening" or "tension" of `cable`; or channels of the dataset such as ("cable1.tension", "cable6.tension"),
        each row a state of its own; none for a robot under its dead loads alone.
    compared
        Channels of the dataset; when empty, all that the twin has and that do not drive it (of a cable and plate by
        their short names: tension or shortening, and pitch; paper A, Eq. 4).
    rig
        Nominal values of the bench.
    settings
        Parameter of the robot or the rig -> its value [SI] in this experiment.
    set_up
        Name of what it shares with other experiments, such as the place of the cameras; "" where it shares none.

    Raises
    ------
    DatasetError
        Where the dataset lacks a driving or a compared channel, or nothing is left to compare.
    """

    name: str
    dataset: Dataset
    cable: str = ""
    plate: str = ""
    drive: Drive | tuple[str, ...] = "shortening"
    compared: tuple[str, ...] = ()
    rig: Rig = field(default_factory=Rig)
    settings: Mapping[str, float] = field(default_factory=dict[str, float])
    set_up: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.compared:
            names = {c: channel_name(c) for c in self.dataset.channels if c not in self.drives}
            names = {c: name for c, name in names.items() if not name.is_deviation}
            of_cable = [c for c, name in names.items() if not name.carrier and name.kind.compared]
            short = [c for c in of_cable if self.cable or not names[c].kind.drives]
            short.sort(key=lambda c: names[c].kind.compared)
            object.__setattr__(self, "compared", (*short, *(c for c, name in names.items() if name.carrier)))
        object.__setattr__(self, "compared", tuple(dict.fromkeys(self.compared)))
        faults = [
            Fault(f"no channel '{channel}'", self.name, allowed=", ".join(self.dataset.channels))
            for channel in (*self.drives, *self.compared)
            if channel not in self.dataset.channels
        ]
        faults += drive_faults([(channel, self.twin_channel(channel)) for channel in self.drives], self.name)
        faults += [
            Fault("a channel that drives the twin has no value", self.name, f"{channel}, {_rows(~measured)}")
            for channel in self.drives
            if channel in self.dataset.channels and not np.all(measured := np.isfinite(self.dataset.values(channel)))
        ]
        if self.rig.backlash is not None and not any(self.twin_channel(one).kind == SHORTENING for one in self.drives):
            got = ", ".join(self.drives) or "no cable that is driven"
            faults.append(Fault("backlash is lost travel, and no shortening drives this test", self.name, got))
        if not self.compared:
            driving = ", ".join(self.drives)
            faults.append(
                Fault(
                    "there is nothing to compare with the twin",
                    self.name,
                    got=f"{driving}, which drives it" if driving else "no channel of the twin",
                    allowed="positions, angles, or the coordinate or effort that does not drive the twin",
                    attempt="what was measured beside it; to drive the twin without a measurement, simulate --pull",
                )
            )
        faults += [
            Fault("the channel that drives the twin cannot be compared", self.name, got=channel)
            for channel in self.compared
            if channel in self.drives
        ]
        for channel in [c for c in self.compared if c in self.dataset.channels]:
            known, sigma = self.seen(channel), self.sigma(channel)
            if not np.any(known):
                faults.append(Fault("a compared channel has no value at all", self.name, got=channel))
            stated = sigma[known & (sigma > 0)]
            ends = dict.fromkeys((stated.min(), stated.max())) if len(stated) else ()
            kind = noise_in(self.dataset.channels[channel].unit)
            faults += [fault for end in ends if (fault := kind.fault(end, f"{self.name}, {channel}")) is not None]
            if not np.all(sigma[known] >= 0):
                rows = _rows(known & ~(sigma >= 0))
                faults.append(Fault("a standard deviation is missing or negative", self.name, f"{channel}, {rows}"))
        if faults:
            raise DatasetError(faults)

    @property
    def drives(self) -> tuple[str, ...]:
        """The channels of the dataset that drive the twin."""
        if isinstance(self.drive, tuple):
            return self.drive
        return (self.drive,) if self.cable else ()

    @property
    def reach(self) -> float:
        """The largest command [SI], below zero where that is a vacuum; 0 where nothing is driven."""
        return largest_of(self.dataset.values(channel) for channel in self.drives)

    @property
    def actuated(self) -> tuple[str, ...]:
        """The actuators that are driven or measured."""
        return tuple(self._driven)

    @property
    def _driven(self) -> dict[str, tuple[ChannelKind, ChannelKind]]:
        """The actuators that are driven or measured, with the kinds of their coordinates and efforts."""
        seen = [name for name in map(channel_name, self.dataset.channels) if name.carrier and name.kind.drives]
        own = {self.cable: (SHORTENING, TENSION)} if self.cable else {}
        return own | {name.carrier: of_actuator(name.kind) for name in seen}

    @property
    def points(self) -> tuple[str, ...]:
        """The markers and plates whose positions are compared."""
        return tuple(dict.fromkeys(p for c in self.compared if (p := self.point_of(c))))

    def twin_channel(self, channel: str) -> ChannelName:
        """The twin's channel of one of the dataset, such as `front.tension` of `tension`."""
        name = channel_name(channel)
        return name if name.carrier else replace(name, carrier=self.cable if name.kind.drives else self.plate)

    def shortening_of(self, cable: str) -> str:
        """The channel with the shortening of a cable; "" where the dataset has none."""
        of_cable = ((c, self.twin_channel(c)) for c in self.dataset.channels)
        names = (c for c, name in of_cable if name == ChannelName(SHORTENING, cable))
        return next(names, "")

    def point_of(self, channel: str) -> str:
        """The marker or plate whose position a channel is a part of; "" for any other channel."""
        return self.twin_channel(channel).point

    def parts_of(self, point: str) -> tuple[str, ...]:
        """The compared coordinates of a marker or plate, in the order of the axes."""
        names = {self.twin_channel(channel): channel for channel in self.compared}
        return tuple(names[part] for part in positions(point) if part in names)

    def seen(self, channel: str) -> np.ndarray:
        """Mask of the measured samples of a compared channel; of a position, those with all its compared
        coordinates.
        """
        point = self.point_of(channel)
        parts = [c for c in self.parts_of(point) if c in self.dataset.channels] if point else [channel]
        return np.all([np.isfinite(self.dataset.values(part)) for part in parts], axis=0)

    def sigma(self, channel: str) -> Floats:
        """Noise of every sample of a channel, 0 where unknown: the table's `_sd` column, or the channel's sigma."""
        deviation = self.dataset.channels.get(str(channel_name(channel).deviation))
        if deviation is not None:
            return deviation.values
        return np.full(self.dataset.n_samples, self.dataset.channels[channel].sigma)

    @property
    def times(self) -> Floats | None:
        """The times of the samples (n_samples,) [s]; None where any of them is missing."""
        known = self.dataset.values("time") if "time" in self.dataset.channels else np.full(1, np.nan)
        return known if bool(np.all(np.isfinite(known))) else None

    @property
    def elapsed(self) -> Floats:
        """The fraction of the record's duration at each sample (n_samples,) [-]; where times are missing, of the number
        of samples.
        """
        times = np.arange(self.dataset.n_samples, dtype=np.float64) if self.times is None else self.times
        begun = times - times.min()
        return begun / max(float(begun.max()), 1e-300)

    def rig_values(self) -> dict[str, float]:
        """The nominal rig parameters by dotted name."""
        values: dict[str, float] = {}
        nominal = {SHORTENING: self.rig.slack, TENSION: self.rig.tension_offset}
        for part, of in self._driven.items():
            for kind in of:
                name = ChannelName(kind, part)
                own = {name.offset: nominal.get(kind, 0.0), name.gain: 1.0, name.drift: 0.0}
                values |= {key: value for key, value in own.items() if key}
            if self.rig.backlash is not None and SHORTENING in of:
                values[backlash_of(part)] = self.rig.backlash
        for channel in self.dataset.channels:
            name = self.twin_channel(channel)
            if not name.kind.drives and name.offset and not name.is_deviation:
                values[name.offset] = self.rig.angle_offsets.get(channel, 0.0)
                values |= {name.drift: 0.0} if name.drift else {}
        if self.rig.pulleys is not None:
            values[PULLEY_FRICTION] = self.rig.pulleys.friction_coefficient
            if self.rig.pulleys.friction_memory:
                values[PULLEY_PRESLIDING] = self.rig.pulleys.slip
        if self.points:
            values |= {f"frame.{axis}": value for axis, value in asdict(self.rig.frame).items()}
        return {name: self.settings.get(name, value) for name, value in values.items()}


def largest_of(commands: Iterable[Floats]) -> float:
    """The value of the largest magnitude, with its sign; 0 of none."""
    return max((float(one[np.nanargmax(np.abs(one))]) for one in commands), key=abs, default=0.0)


def rig_parameters(experiments: Iterable[Experiment]) -> dict[str, ParameterInfo]:
    """Every rig parameter of the experiments by dotted name, with unit and limits."""
    found: dict[str, ParameterInfo] = {}
    for experiment in experiments:
        for name, value in experiment.rig_values().items():
            kind = rig_kind(name)
            if kind is not None:
                found.setdefault(name, ParameterInfo(name, kind, value))
    return found


def backlash_of(cable: str) -> str:
    """The name of the backlash of a cable's drive."""
    return f"{cable}.{BACKLASH}"


def drive_faults(drives: Sequence[tuple[str, ChannelName]], where: str) -> list[Fault]:
    """The faults of the channels that drive the twin, each by its name in the data and the twin's channel."""
    allowed = "a coordinate or effort of an actuator, such as cable1.tension, cable1.shortening or chamber1.pressure"
    faults = [
        Fault("this channel cannot drive the twin", where, got=channel, allowed=allowed)
        for channel, of_twin in drives
        if not of_twin.kind.drives
    ]
    owners = [of_twin.carrier for _, of_twin in drives]
    twice = sorted({owner for owner in owners if owners.count(owner) > 1})
    return [*faults, *(Fault("an actuator is driven twice", where, got=owner) for owner in twice)]


def rig_kind(name: str) -> Quantity | None:
    """The kind of quantity of a rig parameter by its dotted name; None where the rig has no such parameter."""
    if name in _OF_PULLEYS:
        return _OF_PULLEYS[name]
    parts = parameter_name(name)
    if parts.kind == BACKLASH:
        return QUANTITIES["clearance"]
    return FRAME.get(parts.base) if parts.owner == "frame" else readings().get(parts.kind)


def _rows(missing: np.ndarray) -> str:
    rows = [str(i + 1) for i in np.flatnonzero(missing)]
    return ("row " if len(rows) == 1 else "rows ") + ", ".join(rows[:8]) + (", …" if len(rows) > 8 else "")
