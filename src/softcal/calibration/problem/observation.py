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
from softcal.sensing.sensors.actuators import SHORTENING, TENSION
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Derivatives, Response
from softcal.twin.robot import Robot
from softcal.units import format_quantity

Samples = slice | np.ndarray


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
    derivatives: Derivatives
    response: Mapping[str, Floats]
    units: Mapping[str, str]

    def instrument_errors(self, experiment: Experiment, channel: str) -> dict[str, tuple[Floats, float]]:
        """Systematic error that changes a channel -> its entry of `Block.unstated`: the offset, gain and drift of the
        instrument, and the compliance of a machine that pulls a cable.

        A machine that yields by c under the tension T pulls by c T less, as a slack of that size does: the effect is
        known where the slack is among the parameters.

        Parameters
        ----------
        experiment
            The experiment of these predictions, which have derivatives.
        channel
            The channel of the dataset.
        """
        reading, predicted, rates = experiment.twin_channel(channel), self.predicted[channel], self.derivatives
        largest = float(np.nanmax(np.abs(experiment.dataset.values(channel))))
        errors = {
            reading.offset: (np.ones_like(predicted), largest),
            reading.gain: (predicted, 1.0),
            reading.drift: (experiment.elapsed, largest),
        }
        tensions = {
            name.carrier: one for one in self.predicted if (name := experiment.twin_channel(one)).kind == TENSION
        }
        for driving in experiment.drives:
            pulled = experiment.twin_channel(driving)
            if pulled.kind == SHORTENING and pulled.carrier in tensions and pulled.offset in rates.parameters:
                tension, travel = self.predicted[tensions[pulled.carrier]], np.ptp(experiment.dataset.values(driving))
                by_slack = rates.rates[:, rates.channels.index(channel), rates.parameters.index(pulled.offset)]
                scale = float(travel / max(np.nanmax(np.abs(tension)), 1e-300))
                errors[f"{pulled.carrier}.compliance"] = by_slack * tension, scale
        return {name: error for name, error in errors.items() if name}


def commands(experiment: Experiment, rig: Mapping[str, float]) -> dict[str, Command]:
    """The commands to the twin's actuators, sample by sample, under the given rig values."""
    told: dict[str, Command] = {}
    for channel in experiment.drives:
        driven = experiment.twin_channel(channel)
        told[driven.carrier] = Command(driven.kind.name, *_controls(experiment, rig, channel))
    return told


def protocol_told(robot: Robot, experiment: Experiment, rig: Mapping[str, float]) -> Protocol:
    """The commands to the twin's actuators, with the times of the samples where its materials need them.

    Parameters
    ----------
    robot, experiment
        The robot, and one of its experiments.
    rig
        The rig's parameters in that experiment [SI by name].
    """
    return Protocol(commands(experiment, rig), experiment.times if robot.needs_time else None)


def control_parameters(experiment: Experiment) -> set[str]:
    """The rig parameters on which the commands to the twin's actuators depend."""
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
        The twin's. With several driven actuators it must have derivatives by each command (`cable1.tension`) that a rig
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
    wanted, channels = tuple(names), tuple(wanted_channels)
    raw = {name: response.channels[name][samples] for name in channels}
    table = _slopes(experiment, rig, response, samples, channels, wanted)
    slopes = {name: table[:, k] for k, name in enumerate(channels)}
    placed = {point: _placed(point, rig, raw, slopes, wanted) for point in experiment.points}
    seen: dict[str, tuple[Floats, Floats]] = {}
    for channel in experiment.compared:
        name = experiment.twin_channel(channel)
        if name.point:
            place, rates = placed[name.point]
            seen[channel] = place[:, name.kind.axis], rates[:, name.kind.axis]
        else:
            # As measured by its instrument, of a gain and an offset.
            own, values = rig.get(name.gain, 1.0), raw[str(name)]
            pulleys = gain_of(experiment, rig, name.carrier) if name.kind == TENSION else PulleyGain(1.0, {})
            gain = own * pulleys.value
            rates = (gain * slopes[str(name)].T).T
            by_instrument = {
                **{friction: own * by * values for friction, by in pulleys.by.items()},
                name.gain: pulleys.value * values,
                name.offset: 1.0,
                name.drift: experiment.elapsed,
            }
            for k, parameter in enumerate(wanted):
                rates[:, k] += by_instrument.get(parameter, 0.0)
            seen[channel] = gain * values + rig.get(name.offset, 0.0) + _drifted(experiment, rig, name), rates
    return Observation(
        {channel: values for channel, (values, _) in seen.items()},
        Derivatives(tuple(seen), wanted, np.stack([rates for _, rates in seen.values()], axis=1)),
        {name: values[samples] for name, values in response.channels.items()},
        dict(response.units),
    )


def _slopes(
    experiment: Experiment,
    rig: Mapping[str, float],
    response: Response,
    samples: Samples,
    channels: tuple[str, ...],
    names: tuple[str, ...],
) -> Floats:
    """d (the twin's channels) / d names, (n_samples, n_channels, n_names): directly, and by way of the commands."""
    known = response.sensitivities
    by_control = {str(experiment.twin_channel(c)): _controls(experiment, rig, c)[1] for c in experiment.drives}
    slopes = np.zeros((len(response.channels[channels[0]][samples]), len(channels), len(names)))
    # Where one actuator alone is driven, its response has the slopes along the path in the place of derivatives by it.
    along = np.column_stack([response.slopes[channel] for channel in channels])[samples] if response.slopes else None
    for k, name in enumerate(names):
        if name in known.parameters:  # by way of the commands, too, where the robot remembers those before
            slopes[:, :, k] = known.by(name, channels)[samples]
            continue
        for control, changed in by_control.items():
            if name in changed:
                by = known.by(control, channels)[samples] if along is None else along
                slopes[:, :, k] += by * changed[name][:, None]
    return slopes


def _placed(
    point: str,
    rig: Mapping[str, float],
    raw: Mapping[str, Floats],
    slopes: Mapping[str, Floats],
    names: tuple[str, ...],
) -> tuple[Floats, Floats]:
    """A point of the twin as seen in the rig's frame, (n, 3), and its derivatives (n, 3, n_names)."""
    frame = np.array([rig.get(name, 0.0) for name in FRAME])
    R = rotation(frame[3:])
    parts = [str(part) for part in positions(point)]
    p = np.column_stack([raw[part] for part in parts])
    turned = rotation_rates(frame[3:])
    rates = R @ np.stack([slopes[part] for part in parts], axis=1)
    for k, name in enumerate(FRAME):
        if name in names:
            rates[:, :, names.index(name)] = np.eye(3)[k] if k < 3 else p @ turned[k - 3].T
    return p @ R.T + frame[:3], rates


def _drifted(experiment: Experiment, rig: Mapping[str, float], name: ChannelName) -> Floats | float:
    """By how much a channel's reading has drifted at each sample."""
    drift = rig.get(name.drift, 0.0)
    return drift * experiment.elapsed if drift else 0.0


def _controls(experiment: Experiment, rig: Mapping[str, float], channel: str) -> tuple[Floats, dict[str, Floats]]:
    """An actuator's control per sample, and its derivatives by the rig parameters that it depends on."""
    driven = experiment.twin_channel(channel)
    measured = experiment.dataset.values(channel)
    pulleys = gain_of(experiment, rig, driven.carrier) if driven.kind == TENSION else PulleyGain(1.0, {})
    gain = rig.get(driven.gain, 1.0) * pulleys.value
    free = (measured - rig.get(driven.offset, 0.0) - _drifted(experiment, rig, driven)) / gain
    if driven.kind == SHORTENING and (backlash := backlash_of(driven.carrier)) in rig:
        followed = play(free, 0.5 * rig[backlash])
        return followed.values, {driven.offset: -followed.by_shift, backlash: 0.5 * followed.by_half}
    # A cable does not push. Negative shortenings stay: one drawn out by the sagging robot is slack, and taut at zero.
    acts, controls = np.ones_like(free), free
    if driven.kind == TENSION:
        acts, controls = (free > 0).astype(float), np.maximum(free, 0.0)
    derivatives = {
        driven.offset: -acts / gain,
        driven.gain: -controls / rig.get(driven.gain, 1.0),
        driven.drift: -acts * experiment.elapsed / gain,
        **{friction: -controls * by / pulleys.value for friction, by in pulleys.by.items()},
    }
    return controls, {name: rate for name, rate in derivatives.items() if name in rig}
