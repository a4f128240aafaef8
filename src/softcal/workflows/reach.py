"""Commands for wanted poses: what is asked for, checked and resolved to channels; the study and its tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from softcal.analysis.reach import (
    PREFERENCES,
    TOLERANCES,
    TOUCH,
    Prefer,
    ReachResult,
    ReachStep,
    ReachTask,
    reach_sentences,
    reach_targets,
)
from softcal.checks import Floats
from softcal.csv_text import csv_text
from softcal.declare import OrInfinite, checked_arguments
from softcal.errors import Fault, InputError, ParameterError, SimulationError, unknown
from softcal.extras import require_extra
from softcal.geometry.locate import nearest_places
from softcal.geometry.obstacle import Obstacle
from softcal.limits import LIMITS
from softcal.project.project import Project, ProjectSource
from softcal.quantities import QUANTITIES
from softcal.report.reach_view import ReachView, draw_reach
from softcal.report.twin_view import TwinView
from softcal.sensing.channel import channel_name, positions
from softcal.twin.build import twin_of
from softcal.twin.live import LiveTwin
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import times_fault
from softcal.twin.robot import Control, Robot
from softcal.units import format_quantity
from softcal.workflows.export import ExportRequest
from softcal.workflows.output import require_free_folder, require_picture, write_picture
from softcal.workflows.run_band import RunBand
from softcal.workflows.study_files import StudyKind
from softcal.workflows.study_source import load_calibrated

STIFFNESS_TOLERANCE = 1e-3  # of the least stiffness that is wanted
_BY_UNIT = {"m": "length", "rad": "angle", "N": "force"}  # the range of a channel whose kind has none of its own


@checked_arguments
def reach(  # noqa: PLR0913 (one keyword for each option)
    twin: ProjectSource | Robot,
    targets: Mapping[str, float | Sequence[float]],
    *,
    times: Sequence[float] | None = None,
    controls: Control | Mapping[str, Control] = "tension",
    limits: Mapping[str, tuple[OrInfinite, OrInfinite]] | None = None,
    rates: Mapping[str, float] | None = None,
    tolerances: Mapping[str, float] | None = None,
    weights: Mapping[str, float] | None = None,
    prefer: Prefer = "effort",
    pretension: float = 0.0,
    obstacles: Mapping[str, Obstacle] | None = None,
    theta: Mapping[str, float] | None = None,
    picture: str | Path | None = None,
    out: str | Path | None = None,
    progress: Callable[[int, ReachStep], None] | None = None,
) -> ReachResult:
    """Commands of any actuators that bring channels to wanted values, within limits, on the exact twin.

    Parameters
    ----------
    twin
        A robot, a project, or the path of a project file or of a run folder, which has its calibrated values.
    targets
        Channel -> wanted value [SI], or values of one target after the other: `{"tip.x": 0.02, "tip.pitch": 0.3}`. A
        stiffness stands beside the channels, such as `tip.x_stiffness` [N/m], see `LiveState.stiffnesses`.
    times
        Times of the targets [s], for rates and for materials that relax or flow; by default each is held for long.
    controls
        What drives each actuator: a control such as "tension" or "shortening" (its effort, where it has no such
        control), or one by name of each that is driven.
    limits
        Channel, or kind of channel such as "tension" -> lowest and highest value [SI], infinite for none. The robot's
        `actuator_limits` hold beside them.
    rates
        As limits: largest change per second [SI/s] from one target to the next.
    tolerances
        As limits: error [SI] below which a target counts as reached, by default 10 um, 0.01 deg and 10 mN, of a
        stiffness 0.1 % of what is wanted.
    weights
        As limits: of an error, in units of its tolerance, where targets cannot be reached together.
    prefer
        Which commands are taken where several reach the target: of least "effort", or "nearest" to the last ones.
    pretension
        Least tension of every driven cable [N].
    obstacles
        Name -> a half-space, sphere or box that the robot's surface must not enter.
    theta
        Values of robot parameters by dotted name [SI], replacing the robot's own.
    picture
        A new file, .png or .svg: the state of the last target over rest, with what was wanted and the obstacles.
    out
        A new folder for the result as JSON, and the commands as CSV.
    progress
        Called after every target with its number, from 1, and its step.

    Returns
    -------
    ReachResult
        Each target reached within its tolerances, or the nearest state with what limits it, or the reason why not.

    Raises
    ------
    ParameterError
        With all faults of the targets and the options: unknown channels, values out of range, limits that contradict
        each other or a target, obstacles in which the robot is at rest; for a parameter or actuator that there is not.
    InputError
        For a twin that is none, arguments of the wrong kind, or an `out` that holds files.
    SimulationError
        Where the robot has no equilibrium, or no commands keep the limits.
    """
    if picture is not None:
        require_extra("pictures", "pyvista", where="picture")
        require_picture(Path(picture))
    if out is not None:
        require_free_folder(Path(out))
        if isinstance(twin, Robot):
            raise InputError(Fault("a folder needs a project, not a robot alone", "out", attempt="a project"))
    project = twin if isinstance(twin, Robot | Project) else load_calibrated(Path(twin))
    robot = project if isinstance(project, Robot) else project.robot
    robot = with_parameters(robot, theta or {})
    live = LiveTwin(robot, controls)
    task, wanted = asked(live, targets, times, limits, rates, tolerances, weights, prefer, pretension, obstacles)
    band = None  # after all that may be refused: it simulates the experiments again
    if not isinstance(twin, Robot | Project) and Path(twin).is_dir() and isinstance(project, Project):
        band = RunBand.of(ExportRequest(replace(project, robot=robot), run=twin))
        if live.remembers:
            live = LiveTwin(robot, controls, sensitivities=[*band.steps])
    steps: list[ReachStep] = []
    for step in reach_targets(live, task, wanted, times):
        if band is not None:
            bands, of_commands = band.at(live.state, task, tuple(targets))
            step = replace(step, bands=bands, command_bands=of_commands if step.outcome == "reached" else {})
        steps.append(step)
        if progress is not None:
            progress(len(steps), step)
    told = f"Of the commands for the same target those {PREFERENCES[prefer]} are taken"
    told += f", with at least {format_quantity(pretension, 'N')} in every cable." if pretension else "."
    number = {name: k for k, name in enumerate(task.units)}
    result = ReachResult(
        steps=tuple(steps),
        units=dict(task.units),
        tolerances={name: float(task.tolerances[number[name]]) for name in targets},
        preference=told,
        without_bands=band.told if band is not None and not band.steps else "",
    )
    if picture is not None:
        bent, places = live.state.shape, dict[str, tuple[Floats, Floats]]()
        last = steps[-1]
        for point in dict.fromkeys(one.point for one in map(channel_name, last.wanted) if one.point):
            reached = {str(axis): last.channels[str(axis)] for axis in positions(point)}
            wanted_there = [last.wanted.get(axis, value) for axis, value in reached.items()]
            places[point] = np.array(wanted_there), np.array([*reached.values()])
        tets = {name: mesh.tets for name, mesh in twin_of(live.robot).meshes.items()}
        view = ReachView(TwinView(live.robot, live.reset().shape, bent, tets), places, obstacles or {})
        write_picture(draw_reach(view), "Commands for a pose", Path(picture))
    if out is not None and isinstance(project, Project):
        REACH.write(result, project, "", Path(out))
    return result


def asked(  # noqa: PLR0913 (one argument for each option)
    live: LiveTwin,
    targets: Mapping[str, float | Sequence[float]] | None,
    times: Sequence[float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    rates: Mapping[str, float] | None = None,
    tolerances: Mapping[str, float] | None = None,
    weights: Mapping[str, float] | None = None,
    prefer: Prefer = "effort",
    pretension: float = 0.0,
    obstacles: Mapping[str, Obstacle] | None = None,
) -> tuple[ReachTask, list[dict[str, float]]]:
    """The task, and each target by channel; arguments as of `reach`. Without targets (None) the limits alone count.

    Parameters
    ----------
    live
        The twin.
    targets, times, limits, rates, tolerances, weights, prefer, pretension, obstacles
        See `reach`.

    Raises
    ------
    ParameterError
        With all faults.
    """
    faults: list[Fault] = []
    if targets is not None and not targets:
        faults.append(Fault("there is no target", "targets", allowed="a channel and its value"))
    if not live.actuators:
        known = ", ".join(one.name for one in live.robot.commandable) or "none"
        faults.append(Fault("no actuator is commanded", "controls", "none", f"one or more of the robot's: {known}"))
    targets = targets or {}
    stated = {*targets, *(limits or {}), *(tolerances or {}), *(weights or {})}
    stiffnesses = {name: unit for name, unit in live.stiffness_units.items() if name in stated}
    units = {**live.units, **stiffnesses}
    names = list(units)
    number = {name: k for k, name in enumerate(names)}
    kinds = dict.fromkeys(channel_name(name).kind.name for name in live.units)
    # Actuators that are not driven are slack: what is stated of all tensions is not of theirs.
    kind_of = {
        name: "" if (one := channel_name(name)).kind.drives and one.carrier not in live.controls else one.kind.name
        for name in names
    }

    def numbers(key: str, where: str) -> list[int]:
        """The channels of a name or of a kind."""
        found = [k for k, name in enumerate(names) if key in (name, kind_of[name])]
        if not found:
            known = [*live.units, *live.stiffness_units, *kinds]
            faults.append(unknown("the robot has no such channel", where, key, known))
        return found

    def each(given: Mapping[str, float] | None, where: str, default: Iterable[float]) -> Floats:
        """Positive numbers by channel."""
        values = np.array(list(default))
        for key, value in (given or {}).items():
            if not value > 0.0:
                faults.append(Fault("this must be positive", f"{where}.{key}", f"{value:g}"))
            values[numbers(key, where)] = value
        return values

    tolerance = each(tolerances, "tolerances", [TOLERANCES.get(unit, np.nan) for unit in units.values()])
    weight, rate = each(weights, "weights", np.ones(len(names))), each(rates, "rates", np.full(len(names), np.inf))
    lower, upper = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    # The machines' own; of an actuator that does not drive, only where one that drives pulls it, as a cable of a drive.
    led = {**dict.fromkeys(live.controls, ""), **live.robot.led}
    driving = {name for name in led if name in live.controls or led[name] in live.controls}
    own = {name: ends for name, ends in live.robot.limited.items() if channel_name(name).carrier in driving}
    for key, (low, high) in (*own.items(), *(limits or {}).items()):
        found = numbers(key, "limits")
        if found and not (low <= high and low < np.inf and high > -np.inf):
            got = f"{_shown(low, units[names[found[0]]])} to {_shown(high, units[names[found[0]]])}"
            faults.append(Fault("the limits contradict each other", f"limits.{key}", got, "the lower one first"))
        lower[found], upper[found] = np.maximum(lower[found], low), np.minimum(upper[found], high)
    tensions = [number[f"{one.name}.tension"] for one in live.actuators if one.effort == "tension"]
    if pretension and (fault := QUANTITIES["tension"].fault(pretension, "pretension")):
        faults.append(fault)
    lower[tensions] = np.maximum(lower[tensions], pretension)
    crossed = [k for k in np.flatnonzero(lower > upper).tolist() if not np.isnan(lower[k])]
    if crossed and not faults:
        for k in crossed:
            got = f"at least {_shown(lower[k], units[names[k]])}, at most {_shown(upper[k], units[names[k]])}"
            faults.append(Fault("the limits contradict each other", f"limits.{names[k]}", got))
    columns: dict[str, Floats] = {}
    for name, value in targets.items():
        where = f"targets.{name}"
        column = columns[name] = np.atleast_1d(np.array(value, dtype=np.float64))
        if name not in number:
            known = [*live.units, *live.stiffness_units]
            faults.append(unknown("the robot has no such channel", "targets", name, known))
            continue
        kind, k = channel_name(name).kind, number[name]
        unit = units[name]
        quantity = QUANTITIES.get(kind.name) or QUANTITIES.get(_BY_UNIT.get(kind.unit, ""))
        worst = float(column[int(np.argmax(np.abs(column)))]) if len(column) else 0.0
        beyond = column[(column < lower[k]) | (column > upper[k])]
        if quantity is not None and (
            fault := next((f for v in column if (f := quantity.fault(float(v), where))), None)
        ):
            faults.append(fault)
        elif abs(worst) > kind.most:
            got = _shown(worst, unit)
            faults.append(
                Fault("this is not plausible", where, got, f"at most {_shown(kind.most, unit)}", kind.mistake)
            )
        elif len(beyond):
            allowed = f"{_shown(lower[k], unit)} to {_shown(upper[k], unit)}"
            faults.append(Fault("the target is beyond a limit", where, _shown(float(beyond[0]), unit), allowed))
        elif name in stiffnesses and not column.min(initial=np.inf) > 0.0:
            faults.append(Fault("a stiffness is positive", where, _shown(float(column.min()), unit)))
        elif name in stiffnesses and np.isnan(tolerance[k]):
            tolerance[k] = STIFFNESS_TOLERANCE * float(column.min(initial=np.inf))
        if np.isnan(tolerance[k]):
            faults.append(Fault("the target needs a tolerance", where, f"no tolerance in {unit}", attempt="tolerances"))
    for k, name in enumerate(names):
        if name in stiffnesses and np.isnan(tolerance[k]):
            ends = np.abs([lower[k], upper[k]])
            tolerance[k] = STIFFNESS_TOLERANCE * float(ends[np.isfinite(ends)].max(initial=1.0))
    try:
        live.state.stiffnesses(*stiffnesses)
    except SimulationError as error:
        faults.append(Fault("the robot has no such stiffness", ", ".join(stiffnesses), str(error)))
    rest = live.state.clearances(obstacles) if obstacles else None
    for name, obstacle in (obstacles or {}).items():
        points, where = obstacle.drawn(np.zeros(3), live.extent)[0], f"obstacles.{name}"
        around = [
            b.name for b in live.robot.bodies if not nearest_places(b.mesh, points, tolerance=0.0).distances.all()
        ]
        if rest is not None and (depth := -float(rest.values[k := rest.nearest(name)])) > TOUCH:
            got = f"{rest.parts[k]} by {_shown(depth, 'm')}"
            faults.append(Fault("the robot at rest is inside the obstacle", where, got, "outside"))
        elif around:
            faults.append(Fault("the obstacle is inside the robot at rest", where, ", ".join(around), "outside"))
    lengths = {len(column) for column in columns.values()}
    if len(lengths) > 1:
        faults.append(Fault("the targets have different numbers of values", "targets", str(sorted(lengths))))
    n = max(lengths, default=0)
    if n == 0 and targets:
        faults.append(Fault("there is no target", "targets", "no value", "one or more"))
    if fault := LIMITS["samples"].fault(n, "targets") if n else None:
        faults.append(fault)
    if times is not None and len(lengths) == 1 and (fault := times_fault(np.asarray(times), n)):
        faults.append(fault)
    if rates and times is None:
        faults.append(Fault("a rate needs times", "rates", ", ".join(rates), "times of the targets"))
    if faults:
        raise ParameterError(faults)
    tolerance = np.nan_to_num(tolerance, nan=1.0)
    task = ReachTask(units, tolerance, weight, lower, upper, rate, prefer, dict(obstacles or {}))
    return task, [{name: float(column[k]) for name, column in columns.items()} for k in range(n)]


def _shown(value: float, unit: str) -> str:
    return format_quantity(value, unit) if np.isfinite(value) else f"{value:g}"


def commands_csv(found: ReachResult) -> str:
    """The commands in SI, a row per target, as `softcal simulate --commands` takes them."""
    return _table(found, [(name, [step.commands[name] for step in found.steps]) for name in found.steps[0].commands])


def reached_csv(found: ReachResult) -> str:
    """The wanted and the reached values as CSV, with the bands of a calibration, a row per target, in SI."""
    columns: list[tuple[str, Sequence[object]]] = []
    for name in found.steps[0].wanted:
        columns.append((name, [step.channels[name] for step in found.steps]))
        columns.append((f"wanted {name}", [step.wanted[name] for step in found.steps]))
    for what, each in (
        ("band", [step.bands for step in found.steps]),
        ("command band", [step.command_bands for step in found.steps]),
    ):
        for name in dict.fromkeys(name for bands in each for name in bands):
            columns.append((f"{what} {name}", [bands.get(name, "") for bands in each]))
    return _table(found, columns, [step.outcome for step in found.steps])


def _table(found: ReachResult, columns: Sequence[tuple[str, Sequence[object]]], outcomes: Sequence[str] = ()) -> str:
    """Columns in SI with their units, behind that of the times."""
    times = [step.time for step in found.steps]
    header = ["time [s]"] * (None not in times)
    header += [f"{name} [{found.units[name.rpartition(' ')[2]]}]" for name, _ in columns]
    cells: list[Sequence[object]] = [*[times] * (None not in times), *(values for _, values in columns)]
    if outcomes:
        header, cells = [*header, "outcome"], [*cells, outcomes]
    return csv_text(header, zip(*cells, strict=True))


REACH = StudyKind(
    what="the commands",
    study=ReachResult,
    file="reach.json",
    sentences=reach_sentences,
    tables={"commands.csv": commands_csv, "reached.csv": reached_csv},
)
