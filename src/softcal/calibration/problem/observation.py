"""Predicted measurements: the twin's response seen through the rig (slack, offsets, friction, frame), with exact
derivatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.experiment import Experiment, backlash_of
from softcal.calibration.problem.frame import FRAME, rotation, rotation_rates
from softcal.calibration.problem.pulley_gain import PulleyGain, gain_of, play
from softcal.checks import Floats
from softcal.errors import Fault, ParameterError, unknown
from softcal.sensing.channel import ChannelName, positions
from softcal.sensing.sensors.cable import SHORTENING, TENSION
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.units import format_quantity

Samples = slice | np.ndarray
Derivatives = dict[str, Floats]


@dataclass(frozen=True)
class Observation:
    """Predicted measurements.

    Attributes
    ----------
    predicted
        Channel of the dataset -> values (n_samples,) [SI].
    derivatives
        Channel -> parameter -> d predicted / d parameter (n_samples,) [SI].
    response
        The twin's own channels by dotted name, without the rig -> values (n_samples,) [SI].
    units
        Channel of `response` -> its SI unit.
    """

    predicted: Mapping[str, Floats]
    derivatives: Mapping[str, Mapping[str, Floats]]
    response: Mapping[str, Floats]
    units: Mapping[str, str]


def commands(experiment: Experiment, rig: Mapping[str, float]) -> dict[str, Command]:
    """The commands to the twin's cables, sample by sample, under the given rig values."""
    told: dict[str, Command] = {}
    for channel in experiment.drives:
        driven = experiment.twin_channel(channel)
        control = "tension" if driven.kind == TENSION else "shortening"
        told[driven.carrier] = Command(control, *_controls(experiment, rig, channel))
    return told


def protocol_told(robot: Robot, experiment: Experiment, rig: Mapping[str, float]) -> Protocol:
    """The commands to the twin's cables, with the times of the samples where its materials need them.

    Parameters
    ----------
    robot, experiment
        The robot, and one of its experiments.
    rig
        The rig's parameters in that experiment [SI by name].
    """
    return Protocol(commands(experiment, rig), experiment.times if robot.needs_time else None)


def control_parameters(experiment: Experiment) -> set[str]:
    """The rig parameters on which the commands to the twin's cables depend."""
    rig = experiment.rig_values()
    return {name for channel in experiment.drives for name in _controls(experiment, rig, channel)[1]}


def slack_faults(experiment: Experiment) -> list[Fault]:
    """Cables whose slack is never taken up: they would never be taut, and the test would identify nothing."""
    rig = experiment.rig_values()
    longest: dict[str, float] = {}
    read: dict[str, str] = {}
    for channel in experiment.dataset.channels:
        name = experiment.twin_channel(channel)
        if name.kind == SHORTENING and not name.is_deviation and name.offset in rig:
            longest[name.carrier] = float(np.nanmax(experiment.dataset.values(channel)))
            read[name.carrier] = channel
    slack = {cable: rig[ChannelName(SHORTENING, cable).offset] for cable in longest}
    if not longest or any(slack[cable] <= 0.0 or slack[cable] < most for cable, most in longest.items()):
        return []
    cable = max(longest, key=lambda name: longest[name])
    return [
        Fault(
            "the cable would be slack at every sample",
            experiment.name,
            format_quantity(slack[cable], "m"),
            f"below the largest shortening, {format_quantity(longest[cable], 'm')}",
            f"check {experiment.dataset.unit_read([read[cable]])}, and the slack",
        )
    ]


def observe(
    experiment: Experiment, rig: Mapping[str, float], response: Response, samples: Samples, names: Iterable[str] = ()
) -> Observation:
    """Read the twin's response through the rig, with exact derivatives.

    Parameters
    ----------
    experiment, rig
        The experiment, and the rig's parameters in it [SI by name].
    response
        The twin's. With several driven cables it must have derivatives by each command (`cable1.tension`) that a rig
        parameter among `names` changes.
    samples
        The experiment's own in a response that may have those of others too.
    names
        Parameters of the robot and the rig by which derivatives are wanted.

    Raises
    ------
    ParameterError
        Where the twin has no channel that is to be compared.
    """
    points = [part for point in experiment.points for part in positions(point)]
    wanted_channels = dict.fromkeys(map(str, [*map(experiment.twin_channel, experiment.compared), *points]))
    missing = [name for name in wanted_channels if name not in response.channels]
    if missing:
        there = response.channels
        raise ParameterError(
            [unknown(f"the twin has no channel '{name}'", experiment.name, name, there, got="") for name in missing]
        )
    wanted = tuple(names)
    by_control = {channel: _controls(experiment, rig, channel)[1] for channel in experiment.drives}
    raw = {name: response.channels[name][samples] for name in wanted_channels}
    slopes = {
        name: {p: _slope(experiment, response, samples, by_control, name, p) for p in wanted}
        for name in wanted_channels
    }
    placed = {point: _placed(point, rig, raw, slopes, wanted) for point in experiment.points}
    predicted: dict[str, Floats] = {}
    derivatives: dict[str, dict[str, Floats]] = {}
    for channel in experiment.compared:
        name = experiment.twin_channel(channel)
        if name.point:
            place, by = placed[name.point]
            predicted[channel] = place[:, name.kind.axis]
            derivatives[channel] = {p: values[:, name.kind.axis] for p, values in by.items()}
        else:
            seen = raw[str(name)], slopes[str(name)]
            predicted[channel], derivatives[channel] = _read(experiment, rig, name, *seen)
    return Observation(
        predicted,
        derivatives,
        {name: values[samples] for name, values in response.channels.items()},
        dict(response.units),
    )


def _slope(
    experiment: Experiment,
    response: Response,
    samples: Samples,
    by_control: Mapping[str, Mapping[str, Floats]],
    name: str,
    parameter: str,
) -> Floats:
    """d (a channel of the twin) / d parameter: directly, and by way of the commands."""
    own = response.sensitivities.get(name, {})
    if parameter in own:  # by way of the commands, too, where the robot remembers those before
        return own[parameter][samples]
    slope = np.zeros(len(response.channels[name][samples]))
    for channel, changed in by_control.items():
        if parameter not in changed:
            continue
        if name in response.slopes:  # one cable alone is driven or held
            along = response.slopes[name][samples]
        else:
            along = own[str(experiment.twin_channel(channel))][samples]
        slope = slope + along * changed[parameter]
    return slope


def _placed(
    point: str,
    rig: Mapping[str, float],
    raw: Mapping[str, Floats],
    slopes: Mapping[str, Mapping[str, Floats]],
    names: tuple[str, ...],
) -> tuple[Floats, Derivatives]:
    """A point of the twin as seen in the rig's frame, (n, 3), and its derivatives."""
    frame = np.array([rig.get(name, 0.0) for name in FRAME])
    R = rotation(frame[3:])
    parts = [str(part) for part in positions(point)]
    p = np.column_stack([raw[part] for part in parts])
    rates = rotation_rates(frame[3:])
    derivatives: Derivatives = {}
    for name in names:
        if name in FRAME:
            k = list(FRAME).index(name)
            derivatives[name] = np.tile(np.eye(3)[k], (len(p), 1)) if k < 3 else p @ rates[k - 3].T
        else:
            derivatives[name] = np.column_stack([slopes[part][name] for part in parts]) @ R.T
    return p @ R.T + frame[:3], derivatives


def _read(
    experiment: Experiment,
    rig: Mapping[str, float],
    name: ChannelName,
    raw: Floats,
    slopes: Mapping[str, Floats],
) -> tuple[Floats, Derivatives]:
    """A channel of the twin as measured by its instrument: gain and offset, and the derivatives."""
    own = rig.get(name.gain, 1.0)
    pulleys = gain_of(experiment, rig, name.carrier) if name.kind == TENSION else PulleyGain(1.0, {})
    gain = own * pulleys.value
    derivatives = {p: gain * slope for p, slope in slopes.items()}
    for friction in derivatives.keys() & pulleys.by.keys():
        derivatives[friction] = derivatives[friction] + own * pulleys.by[friction] * raw
    if name.gain in derivatives:
        derivatives[name.gain] = derivatives[name.gain] + pulleys.value * raw
    if name.offset in derivatives:
        derivatives[name.offset] = derivatives[name.offset] + 1.0
    if name.drift in derivatives:
        derivatives[name.drift] = derivatives[name.drift] + experiment.elapsed
    return gain * raw + rig.get(name.offset, 0.0) + _drifted(experiment, rig, name), derivatives


def _drifted(experiment: Experiment, rig: Mapping[str, float], name: ChannelName) -> Floats | float:
    """By how much a channel's reading has drifted at each sample."""
    drift = rig.get(name.drift, 0.0)
    return drift * experiment.elapsed if drift else 0.0


def _controls(experiment: Experiment, rig: Mapping[str, float], channel: str) -> tuple[Floats, Derivatives]:
    """A cable's control per sample, and its derivatives by the rig parameters that it depends on."""
    driven = experiment.twin_channel(channel)
    measured = experiment.dataset.values(channel)
    if driven.kind == SHORTENING:
        # Negative values too: a cable drawn out by the sagging robot is slack there, and taut at zero.
        free, backlash = measured - rig[driven.offset], backlash_of(driven.carrier)
        if backlash not in rig:
            return free, {driven.offset: -np.ones_like(measured)}
        followed = play(free, 0.5 * rig[backlash])
        return followed.values, {driven.offset: -followed.by_shift, backlash: 0.5 * followed.by_half}
    pulleys = gain_of(experiment, rig, driven.carrier)
    gain = rig[driven.gain] * pulleys.value
    free = (measured - rig[driven.offset] - _drifted(experiment, rig, driven)) / gain
    pulled = (free > 0).astype(float)
    controls = np.maximum(free, 0.0)
    derivatives = {
        driven.offset: -pulled / gain,
        driven.gain: -controls / rig[driven.gain],
        driven.drift: -pulled * experiment.elapsed / gain,
    }
    for friction, by in pulleys.by.items():
        derivatives[friction] = -controls * by / pulleys.value
    return controls, derivatives
