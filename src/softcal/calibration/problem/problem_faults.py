"""Faults of a calibration problem that show before any simulation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from softcal.calibration.problem.experiment import Experiment, rig_parameters
from softcal.calibration.problem.friction import friction_faults
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.parameters import SearchSpace, search_space
from softcal.calibration.problem.uncertain import UncertainParameter, free_and_uncertain, uncertain_parameters
from softcal.errors import Fault, ParameterError, unknown
from softcal.sensing.channel import carriers
from softcal.twin.channels import channels_of, sensors_of
from softcal.twin.parameters import out_of_range, robot_parameters, unknown_name
from softcal.twin.robot import Robot


def problem_faults(
    robot: Robot,
    experiments: Sequence[Experiment],
    space: SearchSpace,
    loss: Loss,
    uncertain: Sequence[UncertainParameter] = (),
) -> list[Fault]:
    """Every fault of a problem's parts, and of how they go together.

    Parameters
    ----------
    robot, experiments
        The robot, and its experiments.
    space, loss
        The search space, and the loss.
    uncertain
        The uncertain parameters.
    """
    known = {**robot_parameters(robot), **rig_parameters(experiments)}
    varied = {
        e.name: space.free_in(e.name) | {t for p in uncertain if p.serves(e.name) for t in p.targets}
        for e in experiments
    }
    names = [experiment.name for experiment in experiments]
    parts = [part.name for part in robot.actuated]
    what = f"the robot has no such {robot.actuator_word}"
    faults = [Fault("two experiments share a name", got=name) for name in sorted(set(names)) if names.count(name) > 1]
    faults += [
        Fault("the experiment's name cannot name a file", "", f"'{name}'", "letters, digits, space and . _ + -")
        for name in sorted(names)
        if not re.fullmatch(r"[\w.+-][\w.+ -]*", name)
    ]
    if not experiments:
        faults.append(Fault("there is no experiment to calibrate with", "experiments", allowed="at least one"))
    for experiment in experiments:
        faults += [unknown(what, experiment.name, part, parts) for part in experiment.actuated if part not in parts]
        faults += channel_faults(robot, experiment)
    faults += [
        Fault("the parameter belongs to no experiment of the problem", p.label, allowed=", ".join(sorted(set(names))))
        for p in space.parameters
        if not p.serves(*names)
    ]
    if not loss.uses_priors:
        what, attempt = f"the loss '{loss.name}' does not use priors", "the loss 'likelihood', or no prior"
        faults += [Fault(what, p.label, attempt=attempt) for p in space.parameters if p.prior_sd is not None]
    try:
        search_space(space.parameters, (), known)
    except ParameterError as error:
        faults += error.faults
    for experiment in experiments:
        where = f"settings of {experiment.name}"
        here = {**robot_parameters(robot), **rig_parameters([experiment])}
        free = space.free_in(experiment.name)
        for name, value in experiment.settings.items():
            if name not in here:
                faults.append(replace(unknown_name(name, here), where=f"{where}, {name}"))
            elif fault := out_of_range(known[name], value):
                faults.append(replace(fault, where=f"{where}, {name}"))
            if name in free:
                what = "the parameter is set and free at once"
                faults.append(Fault(what, f"{where}, {name}", attempt="one of the two"))
    for experiment in experiments:
        faults += friction_faults(robot, experiment, varied[experiment.name])
    try:
        uncertain_parameters(uncertain, (), known)
    except ParameterError as error:
        return [*faults, *error.faults]
    return [*faults, *free_and_uncertain(uncertain, names, {name: space.free_in(name) for name in names})]


def channel_faults(robot: Robot, experiment: Experiment) -> list[Fault]:
    """Compared channels that the robot does not have, one fault for each part that it lacks."""
    there = channels_of(sensors_of(robot))
    faults: dict[str, Fault] = {}
    for short in experiment.compared:
        channel = experiment.twin_channel(short)
        own = [str(one) for one in there if one.carrier == channel.carrier]
        if channel in there or channel.carrier in experiment.actuated:
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
