"""Friction is modelled with the sign of a cable that is pulled: tests that release a cable are refused, with the
reason.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.errors import Fault
from softcal.experiments.steps.branches import PULLEY_STEP, branch_of
from softcal.sensing.sensors.actuators import TENSION
from softcal.twin.protocol import let_go_fault, lets_go
from softcal.twin.robot import Robot


def friction_faults(robot: Robot, experiment: Experiment, free: Collection[str]) -> list[Fault]:
    """Faults of an experiment that cannot be compared with the friction of its pulleys and cables.

    Parameters
    ----------
    robot, experiment
        The robot, and one of its experiments.
    free
        The parameters that are free or uncertain in it.
    """
    faults = pulley_faults(experiment)
    selected = branch_of(experiment.dataset)
    branch = selected or "loading"
    if branch != "loading" or _lets_go(experiment):
        for cable in robot.cables:
            key = f"{cable.name}.friction_coefficient"
            friction = experiment.settings.get(key, cable.friction_coefficient)
            reverses = cable.line.friction_memory or cable.name not in experiment.actuated
            if not reverses and (friction > 0.0 or key in free):
                got = "its samples do both" if branch == "loading" else f"take_branch: {branch}"
                faults.append(let_go_fault(experiment.name, cable.name, got))
    takes_order = robot.remembers or experiment.rig.backlash is not None
    if takes_order and (experiment.dataset.labels or branch in ("unloading", "mean")):  # no load path in their order
        reasons = (
            (any(c.line.friction_memory for c in robot.cables), "friction with a memory", "friction_memory: false"),
            (
                any(one.history for one in robot.deformable),
                "a material with a history",
                "no history of bodies and rods",
            ),
            (True, "a drive with backlash", "no backlash"),
        )
        what, attempt = next((what, attempt) for holds, what, attempt in reasons if holds)
        faults.append(
            Fault(
                f"{what} needs the samples in the order in which they were made",
                experiment.name,
                got=f"take_branch: {selected}" if selected else "samples with labels, each a state of its own",
                allowed="a record, row by row",
                attempt=attempt,
            )
        )
    times = experiment.times
    if robot.needs_time and (times is None or not np.all(np.diff(times) >= 0.0)):
        faults.append(
            Fault(
                "a material that relaxes or flows needs the time of every sample",
                experiment.name,
                got="no time, or not of all samples" if times is None else "times that do not ascend",
                allowed="a channel time, whose values never fall",
                attempt="columns: {time: {name: NAME}} of the file, or no relaxation, maxwell or flow in the history",
            )
        )
    return faults


def pulley_faults(experiment: Experiment) -> list[Fault]:
    """Tensions corrected for the pulleys as on one branch although the samples are of both branches; and where their
    friction has a memory, samples that are no load path, or whose slip is unknown.
    """
    if experiment.rig.pulleys is not None and experiment.rig.pulleys.friction_memory:
        dataset = experiment.dataset
        channels = [experiment.twin_channel(c) for c in (*experiment.drives, *experiment.compared)]
        slips = {name.carrier: experiment.shortening_of(name.carrier) for name in channels if name.kind == TENSION}
        known = {cable: slip and bool(np.all(np.isfinite(dataset.values(slip)))) for cable, slip in slips.items()}
        faults = [
            Fault(
                "the pulleys' friction has a memory, and the slip over them is unknown",
                experiment.name,
                got=f"no shortening of {cable}" if not slips[cable] else f"samples without {slips[cable]}",
                allowed="the shortening of every sample",
            )
            for cable in slips
            if not known[cable]
        ]
        if slips and (dataset.labels or branch_of(dataset)):
            faults.append(
                Fault(
                    "the pulleys' friction has a memory, and the samples are no load path in their order",
                    experiment.name,
                    got="samples with labels" if dataset.labels else f"take_branch: {branch_of(dataset)}",
                    allowed="both branches, as they were recorded",
                    attempt="friction_memory: false in rig.pulleys",
                )
            )
        return faults
    corrected = any(s.name == PULLEY_STEP and s.settings["exponent"] > 0.0 for s in experiment.dataset.provenance)
    turning = experiment.rig.pulleys is not None and experiment.rig.pulleys.turning > 0.0
    tensions = [c for c in (*experiment.drives, *experiment.compared) if experiment.twin_channel(c).kind == TENSION]
    if not tensions or not (corrected or turning) or not _lets_go(experiment):
        return []
    return [
        Fault(
            "the pulleys' friction has opposite signs during loading and unloading",
            experiment.name,
            got=f"samples of both, one correction of {', '.join(tensions)}",
            allowed="one branch, or the mean of both",
            attempt="find_cycles and take_branch in its preparation",
        )
    ]


def _lets_go(experiment: Experiment) -> bool:
    """Whether the samples, one after the other, pull the one driven cable and release it again.

    Samples with labels, and those of several actuators, are independent states.
    """
    dataset, drive = experiment.dataset, experiment.drive
    if dataset.labels or not isinstance(drive, str) or not experiment.cable:
        return False
    values = dataset.values(drive)
    return bool(np.all(np.isfinite(values))) and lets_go(values)
