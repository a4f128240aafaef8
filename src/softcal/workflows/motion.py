"""Transient simulation of a project: linear ramps, or experiments by the times of their samples; then rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from softcal.calibration.problem.friction import pulley_faults
from softcal.calibration.problem.observation import commands
from softcal.errors import Fault, InputError
from softcal.project.project import Project
from softcal.sensing.channel import of_kind
from softcal.sensing.sensors.actuators import TENSION
from softcal.twin.in_time import simulate_in_time
from softcal.twin.protocol import Command
from softcal.twin.response import Response
from softcal.twin.schedule import Schedule
from softcal.workflows.cases import Case
from softcal.workflows.simulation import simulate_each
from softcal.workflows.whole_record import TIME, ascends, whole_record

SNAPSHOTS = 40
# Called with the name of the case, then as by `simulate_in_time`: the time, and the end of its schedule, both [s].
Observer = Callable[[str, float, float], None]


def simulate_each_in_time(
    project: Project,
    cases: Mapping[str, Case],
    shapes: int = SNAPSHOTS,
    *,
    progress: Observer | None = None,
    ready: Callable[[str, Response], None] = lambda name, response: None,
) -> dict[str, Response]:
    """Case name -> transient response by the project's `dynamics`; see `schedule_of`.

    Parameters
    ----------
    project
        With the settings `dynamics`.
    cases
        Name -> case.
    shapes
        Number of shapes to keep.
    progress
        Called with the progress of each case.
    ready
        Called with each case's name and response.

    Raises
    ------
    InputError
        For invalid schedules, all cases at once; for a command that the robot cannot follow, or a robot without mass.
    SimulationError
        If a time step did not converge, or a robot did not come to rest.
    """
    schedules: dict[str, Schedule] = {}
    faults: list[Fault] = []
    for name, case in cases.items():
        try:
            schedules[name] = schedule_of(project, case)
        except InputError as error:
            faults.extend(error.faults)
    if faults:
        raise InputError(faults)
    settings = project.dynamics

    def moved(name: str) -> Response:
        observer = None if progress is None else partial(progress, name)
        return simulate_in_time(cases[name].robot, schedules[name], settings, snapshots=shapes, progress=observer)

    return simulate_each({name: name for name in cases}, moved, ready=ready)


def schedule_of(project: Project, case: Case) -> Schedule:
    """A pull as a linear ramp over the `ramp` of the project's `dynamics`; an experiment by the times of its samples,
    after a ramp if the first sample pulls already.

    Raises
    ------
    InputError
        For an experiment without a driving channel, or whose sample times do not ascend.
    """
    if not case.experiment:
        return Schedule(np.linspace(0.0, project.dynamics.ramp, case.protocol.n_samples), case.protocol.commands)
    experiment = project.experiments[case.experiment]
    if not experiment.drives:
        fault = Fault("the experiment has no driving channel", experiment.name, attempt="--pull, or --experiment")
        raise InputError(fault)
    # The compared samples if they have times, else all cycles that they were selected from.
    samples = experiment.dataset
    data = samples if ascends(samples) else whole_record(project, experiment.name)
    if data is None:
        got = "descending times" if TIME in samples.channels else "no column `time`"
        allowed = "a column `time` in every file, and no step that changes the order of the samples"
        what = "a transient simulation needs ascending sample times"
        raise InputError(Fault(what, experiment.name, got, allowed, "--pull"))
    if of_kind(TENSION, experiment.drives):
        if faults := pulley_faults(replace(experiment, dataset=data)):
            raise InputError(faults)
    times = data.values(TIME)
    driven = commands(replace(experiment, dataset=data), experiment.rig_values())
    kept = np.diff(times, prepend=-np.inf) > 0.0  # of samples that share a time, the first
    times = times[kept] - times[0]
    pulls = {name: command.values[kept] for name, command in driven.items()}
    if any(pull[0] != 0.0 for pull in pulls.values()):
        times = np.append(0.0, project.dynamics.ramp + times)
        pulls = {name: np.append(0.0, pull) for name, pull in pulls.items()}
    return Schedule(times, {name: Command(driven[name].control, pull) for name, pull in pulls.items()})
