"""The workspace of a robot, a project or a calibrated run: what is asked for, checked; the study and its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from softcal.analysis.workspace import (
    Workspace,
    WorkspaceState,
    compliance_unit,
    find_workspace,
    workspace_sentences,
)
from softcal.csv_text import csv_text
from softcal.declare import OrInfinite, checked_arguments
from softcal.errors import Fault, InputError, ParameterError, unknown
from softcal.geometry.obstacle import Obstacle
from softcal.limits import LIMITS
from softcal.project.project import Project, ProjectSource
from softcal.report.figures.workspace import draw_workspace
from softcal.twin.live import LiveTwin
from softcal.twin.parameters import with_parameters
from softcal.twin.robot import Control, Robot
from softcal.workflows.output import require_free_folder, require_picture, write_picture
from softcal.workflows.reach import asked
from softcal.workflows.run import CalibrationRun, headline_of
from softcal.workflows.run_folder import load_run
from softcal.workflows.study_files import StudyKind, has_values
from softcal.workflows.study_source import load_calibrated

MOST = 3  # channels


@checked_arguments
def workspace(  # noqa: PLR0913 (one keyword for each option)
    twin: ProjectSource | Robot,
    channels: Sequence[str],
    *,
    limits: Mapping[str, tuple[OrInfinite, OrInfinite]] | None = None,
    controls: Control | Mapping[str, Control] = "tension",
    pretension: float = 0.0,
    obstacles: Mapping[str, Obstacle] | None = None,
    theta: Mapping[str, float] | None = None,
    states: Annotated[int, LIMITS["samples"]] | None = None,
    seed: Annotated[int, LIMITS["seeds"]] = 1,
    picture: str | Path | None = None,
    out: str | Path | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Workspace:
    """The values that one to three channels can take together within limits, on the exact twin: border, mobility and
    compliance, singular poses.

    Parameters
    ----------
    twin
        A robot, a project, or the path of a project file or of a run folder, which has its calibrated values.
    channels
        Such as `("tip.x", "tip.z")`.
    limits
        Channel, or kind of channel such as "tension" -> lowest and highest value [SI], infinite for none. Every command
        needs an upper one, here or in the robot's `actuator_limits`, which hold too.
    controls
        What drives each actuator: a control such as "tension" or "shortening" (its effort, where it has no such
        control), or one by name of each that is driven.
    pretension
        Least tension of every driven cable [N].
    obstacles
        Name -> a half-space, sphere or box that the robot's surface must not enter.
    theta
        Values of robot parameters by dotted name [SI], replacing the robot's own.
    states
        Commands that are tried inside the limits; by default 64, 256 or 512 for one, two or three channels.
    seed
        Seed of these commands.
    picture
        A new file, .png or .svg: the workspace over its channels.
    out
        A new folder for the workspace as JSON and CSV; a run's report shows the one in its `workspace`.
    progress
        Called with what is computed, its number from 0, and how many there are.

    Returns
    -------
    Workspace
        The states inside and on the border, and the shape that they make.

    Raises
    ------
    ParameterError
        With all faults: unknown channels, more of them than commands, commands without an end, limits that contradict
        each other; for a parameter or actuator that there is not.
    InputError
        For a twin that is none, arguments of the wrong kind, or an `out` that holds files.
    SimulationError
        Where the robot has no equilibrium, or too few within the limits.
    """
    if picture is not None:
        require_picture(Path(picture))
    if out is not None:
        require_free_folder(Path(out))
        if isinstance(twin, Robot):
            raise InputError(Fault("a folder needs a project, not a robot alone", "out", attempt="a project"))
    run = None if isinstance(twin, Robot | Project) or not Path(twin).is_dir() else load_run(Path(twin))
    project = twin if isinstance(twin, Robot | Project) else load_calibrated(Path(twin))
    robot = project if isinstance(project, Robot) else project.robot
    live = LiveTwin(with_parameters(robot, theta or {}), controls)
    names = list(dict.fromkeys(channels))
    faults = [
        unknown("the robot has no such channel", "channels", one, live.units) for one in names if one not in live.units
    ]
    faults += [
        Fault(
            "this is neither a place nor an angle", "channels", f"{name} [{live.units[name]}]", "channels in m or rad"
        )
        for name in names
        if live.units.get(name, "m") not in ("m", "rad")
    ]
    if not 1 <= len(names) <= MOST or len(names) < len(channels):
        faults.append(Fault("this is no workspace", "channels", ", ".join(channels) or "none", f"1 to {MOST} channels"))
    try:
        task, _ = asked(live, None, limits=limits, pretension=pretension, obstacles=obstacles)
    except ParameterError as error:
        raise ParameterError([*faults, *error.faults]) from error
    if faults:
        raise ParameterError(faults)
    values, calibration = dict[str, float](), ""
    if isinstance(run, CalibrationRun) and not theta:
        calibration, result = headline_of(run.results)
        values = {label: estimate.value for label, estimate in result.parameters.items()}
    found = find_workspace(live, task, names, n_states=states, seed=seed, values=values, progress=progress)
    if picture is not None:
        write_picture(draw_workspace(found), "The workspace", Path(picture))
    if out is not None and isinstance(project, Project):
        WORKSPACE.write(found, project, calibration, Path(out))
    return found


def states_csv(found: Workspace) -> str:
    """A row for each state, in SI."""
    compliant = [name for name in found.channels if any(name in state.compliances for state in found.states)]
    commands, border = [*found.ranges], set(found.border)
    header = [f"{name} [{found.units[name]}]" for name in (*commands, *found.channels)]
    header += [f"mobility {k} [1]" for k in range(1, len(found.channels) + 1)]
    header += [f"compliance {name} [{compliance_unit(found.units[name])}]" for name in compliant]

    def row(number: int, state: WorkspaceState) -> list[object]:
        values = [state.commands[name] for name in commands] + [state.channels[name] for name in found.channels]
        softness = [state.compliances.get(name, "") for name in compliant]
        return [
            *values,
            *state.mobility,
            *softness,
            "border" if number in border else "inside",
            "; ".join(state.limits),
        ]

    return csv_text([*header, "place", "limits"], [row(k, state) for k, state in enumerate(found.states)])


WORKSPACE = StudyKind(
    what="the workspace",
    study=Workspace,
    file="workspace.json",
    folder="workspace",
    sentences=workspace_sentences,
    tables={"states.csv": states_csv},
    is_of=lambda study, result: has_values(result, study.values),
)
