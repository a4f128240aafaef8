"""What an experiment compares must be a channel of the robot."""

from __future__ import annotations

from softcal.calibration.experiment import Experiment
from softcal.errors import Fault, unknown
from softcal.sensing.channel import carriers
from softcal.twin.channels import channels_of, sensors_of
from softcal.twin.robot import Robot


def channel_faults(robot: Robot, experiment: Experiment) -> list[Fault]:
    """Compared channels that the robot does not have, one fault for each part that it lacks."""
    there = channels_of(sensors_of(robot))
    faults: dict[str, Fault] = {}
    for short in experiment.compared:
        channel = experiment.twin_channel(short)
        own = [str(one) for one in there if one.carrier == channel.carrier]
        if channel in there or channel.carrier in experiment.cables:
            continue
        if own:
            what = f"{channel.carrier} has no such channel"
            faults[short] = unknown(what, experiment.name, str(channel), own, got=short)
            continue
        parts = ("plates",) if short != str(channel) else carriers(channel.kind)
        known = [part.name for of in parts for part in getattr(robot, of)]
        what = f"the robot has no such {' or '.join(of.removesuffix('s') for of in parts) or 'channel'}"
        faults[channel.carrier] = unknown(what, experiment.name, channel.carrier, known, got=channel.carrier or short)
    return [faults[key] for key in sorted(faults)]
