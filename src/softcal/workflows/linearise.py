"""The linear system of a twin's small motions about an equilibrium, and its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from softcal.calibration.results.store import write_text
from softcal.calibration.results.stored import sealed
from softcal.calibration.search.outcome import installed_versions
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.limits import LIMITS
from softcal.project.project import Project, ProjectSource
from softcal.twin.linear_system import ARRAYS, LinearSystem
from softcal.twin.live import LiveTwin
from softcal.twin.parameters import with_parameters
from softcal.twin.robot import Control, Robot
from softcal.twin.time_settings import TimeSettings
from softcal.units import format_quantity
from softcal.workflows.output import new_folder, require_free_folder
from softcal.workflows.study_source import load_calibrated


@checked_arguments
def linearise(
    twin: ProjectSource | Robot,
    commands: Mapping[str, float] | None = None,
    *,
    controls: Control | Mapping[str, Control] = "tension",
    modes: Annotated[int, LIMITS["modes"]] = 6,
    settings: TimeSettings | None = None,
    theta: Mapping[str, float] | None = None,
    parameters: Sequence[str] = (),
    out: str | Path | None = None,
) -> LinearSystem:
    """The linear system of small motions about an equilibrium: M, C, K, inputs and outputs in a few modes.

    The inputs are the efforts of all actuators that are commanded by these, such as tensions; one that is commanded by
    its coordinate, such as a shortening, stays at it. The outputs are all channels. The static gain is exact.

    Parameters
    ----------
    twin
        A robot, a project, or the path of a project file or of a run folder, which has its calibrated values.
    commands
        Actuator -> its effort or coordinate [SI] at the equilibrium, by `controls`; those without one are slack.
    controls
        What drives each actuator: a control such as "tension" or "shortening" (its effort, where it has no such
        control), or one by name of each that is driven.
    modes
        Number of modes, beside which there is a coordinate for each input.
    settings
        Settings of the time integration, of which the damping and the choice of the mass matrix count; by default the
        project's `dynamics`.
    theta
        Values of robot parameters by dotted name [SI], replacing the robot's own.
    parameters
        Parameters of the robot by which M, C, K, the frequencies and the poles get derivatives.
    out
        A new folder for the system as `.npz` and JSON, and its modes as CSV.

    Raises
    ------
    ParameterError
        For a command, a control or a parameter that there is not, too many modes, or a robot without mass.
    InputError
        For a twin that is none, arguments of the wrong kind, or an `out` that holds files.
    StorageError
        Where `out` holds files or cannot be written.
    SimulationError
        Where there is no equilibrium, or no linear form: friction, a memory, an unstable equilibrium.
    """
    if out is not None:
        require_free_folder(Path(out))
    project = twin if isinstance(twin, Robot | Project) else load_calibrated(Path(twin))
    robot = project if isinstance(project, Robot) else project.robot
    if settings is None:
        settings = project.dynamics if isinstance(project, Project) else TimeSettings()
    live = LiveTwin(with_parameters(robot, theta or {}), controls)
    found = live.at(dict(commands or {})).linearised(modes, settings, parameters)
    if out is not None:
        _write(found, project, Path(out))
    return found


def linear_sentences(found: LinearSystem) -> list[str]:
    """Sentences on the system."""
    told = f"The first mode left out has {format_quantity(found.next_frequency, 'Hz')}."
    error = max(found.frequency_errors.tolist(), default=0.0)
    return [
        f"{told} The frequencies are within {max(error, 1e-12):.1g} of those of the whole twin, relative.",
        f"The static gain is within {max(found.static_error, 1e-12):.1g} of the twin's derivatives, relative."
        if found.inputs
        else "There is no input: every actuator is at a prescribed coordinate.",
    ]


def modes_csv(found: LinearSystem) -> str:
    """The modes, a row each."""
    header = ["frequency [Hz]", "damping ratio [1]", "relative error [1]"]
    columns = (found.frequencies, found.damping_ratios, found.frequency_errors)
    return csv_text(header, zip(*(one.tolist() for one in columns), strict=True))


def _write(found: LinearSystem, project: Project | Robot, folder: Path) -> None:
    entries = {name: getattr(found, name) for name in ARRAYS}
    # JSON has no complex numbers: the real and the imaginary part of each.
    entries["pole_rates"] = np.stack([found.pole_rates.real, found.pole_rates.imag], axis=-1)
    record = {
        "project": project.name if isinstance(project, Project) else "",
        "commands": dict(found.commands),
        "values": dict(found.values),
        "units": dict(found.units),
        "inputs": list(found.inputs),
        "channels": list(found.channels),
        "parameters": list(found.parameters),
        "system": {name: one if isinstance(one, float) else one.tolist() for name, one in entries.items()},
        "sentences": linear_sentences(found),
        "hashes": dict(project.hashes) if isinstance(project, Project) else {},
        "versions": installed_versions(),
    }
    with new_folder(folder) as part:
        found.save(part / "linear.npz")
        write_text(part / "modes.csv", modes_csv(found))
        write_text(part / "linear.json", sealed(record))
