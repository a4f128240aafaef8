"""A project, or a calibrated run of one, as files for other programs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.errors import Fault, ParameterError, UnitError
from softcal.limits import LIMITS
from softcal.project.project import Project
from softcal.quantities import QUANTITIES
from softcal.twin.response import Response, Shown
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.workflows.cases import Case, protocols_of
from softcal.workflows.film import films
from softcal.workflows.motion import SNAPSHOTS, Observer, simulate_each_in_time
from softcal.workflows.output import new_folder, require_free_folder
from softcal.workflows.simulation import keep_silent, simulate_each

if TYPE_CHECKING:
    from softcal.export.reduced import Reach

Tell = Callable[[str], None]
"""Given a sentence that a reader of what is written must know."""

REDUCED_SAMPLES = {1: 33, 2: 9, 3: 7}  # number of cables -> nodes along each


def export_vtk(
    project: Project,
    cases: Mapping[str, Case],
    folder: Path,
    shapes: int | None = None,
    *,
    in_time: bool = False,
    progress: Observer | None = None,
    tell: Tell = keep_silent,
    stage: Tell = keep_silent,
) -> list[Path]:
    """Shapes of each case, by name, as .vtu files for ParaView in a new folder; see `softcal.export.vtk`.

    shapes: how many, evenly from no pull to the furthest, each solved; by default those at which the pull was solved.
    in_time: shapes of the motion, by the project's `dynamics`; `shapes` of them, by default 40, until the schedule is
    over, and as often after that. progress: is told of each motion how far it is; tell: of bodies that
    cross and cables that are drawn out in what was solved; stage: of what is begun.

    Raises
    ------
    ParameterError
        For a number of shapes of what is no pull; see `softcal.workflows.film`.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        Where the twin could not follow a protocol; nothing is then written.
    """
    from softcal.export.vtk import write_vtk

    require_free_folder(folder)
    if in_time:
        n = SNAPSHOTS if shapes is None else shapes
        LIMITS["shapes of a film"].check(n, where="--shapes")
        responses = simulate_each_in_time(project, cases, n, progress=progress)
    elif shapes is None:
        responses = _simulated(cases, True, stage)
    else:
        told = films(protocols_of(cases), shapes)
        filmed = {name: replace(case, protocol=told[name]) for name, case in cases.items()}
        responses = _simulated(filmed, "samples", stage)
    _tell_of_shapes(responses, tell)
    return _write_each(responses, folder, lambda name, inside: write_vtk(cases[name].robot, responses[name], inside))


def _simulated(cases: Mapping[str, Case], snapshots: Shown, stage: Tell) -> dict[str, Response]:
    return simulate_each(cases, lambda case: simulate(case.robot, case.protocol, snapshots=snapshots), stage=stage)


def _tell_of_shapes(responses: Mapping[str, Response], tell: Tell) -> None:
    """Tell of each response what must be known of its shapes."""
    for name, response in responses.items():
        for told in response.warnings:
            tell(f"{name}: {told}")


def export_calculix(
    cases: Mapping[str, Case], folder: Path, *, tell: Tell = keep_silent, stage: Tell = keep_silent
) -> list[Path]:
    """The last shape of each case, by name, as a CalculiX deck in a new folder; see `softcal.export.calculix`.

    It is the shape of the robot with CalculiX's own law and elements, so that the cables' forces balance in them.

    Raises
    ------
    ParameterError
        For what CalculiX cannot be given: rods, contact, friction along cables.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        Where the twin could not follow a protocol; nothing is then written.
    """
    from softcal.export.calculix import in_its_law, write_calculix

    require_free_folder(folder)
    own = {name: replace(case, robot=in_its_law(case.robot)) for name, case in cases.items()}
    responses = _simulated(own, True, stage)
    _tell_of_shapes(responses, tell)
    return _write_each(
        responses,
        folder,
        lambda name, inside: write_calculix(
            own[name].robot, responses[name].snapshots[-1], inside, given=cases[name].robot
        ),
    )


def export_sofa(project: Project, cases: Mapping[str, Case], folder: Path) -> list[Path]:
    """The robot as a SOFA scene in a new folder: that case which pulls most, with its protocol as schedule.

    It moves by the project's `dynamics`; `run.py` runs it to rest by its `engines`. See `softcal.export.sofa_export`.

    Raises
    ------
    InputError
        For what no scene can hold: contact, friction along cables; for a pull that no cable can follow.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        Where parameters for linear tets are to be identified, and the twin cannot follow the protocol.
    """
    from softcal.export.sofa_export import furthest, write_sofa

    require_free_folder(folder)
    chosen = furthest(protocols_of(cases))
    experiment = chosen if len(cases) > 1 else ""
    return write_folder(
        folder,
        lambda part: write_sofa(
            cases[chosen].robot,
            cases[chosen].protocol,
            part,
            project.name,
            experiment=experiment,
            slack=_slack(project, cases[chosen]),
            motion=project.dynamics,
            settings=project.engines.sofa,
        ),
    )


def _slack(project: Project, case: Case) -> dict[str, float]:
    """By cable the slack [m] that a case's shortening is less than the travel on the bench; none for a plain pull."""
    if not case.experiment:
        return {}
    experiment = project.experiments[case.experiment]
    rig = experiment.rig_values()
    driven = [experiment.twin_channel(channel).rpartition(".") for channel in experiment.drives]
    return {cable: rig[f"{cable}.slack"] for cable, _, control in driven if control == "shortening"}


def export_reduced(
    project: Project,
    folder: Path,
    reach: str,
    cables: Sequence[str] = (),
    samples: int | None = None,
    *,
    tell: Tell = keep_silent,
) -> list[Path]:
    """The cable-space model for a controller, with its evaluator, in a new folder; see `softcal.export.reduced`.

    reach: a force or a length for all the cables (8 N, 40mm), or one for each (front=8N,left=40mm). cables: by default
    those that `reach` names, else all. samples: along each cable, by default 33 of one, 9 of two, 7 of three.

    Raises
    ------
    InputError
        For cables, a reach or samples that make no model, or a folder that holds files or cannot be written.
    SimulationError
        Where a state within reach has no equilibrium; nothing is then written.
    """
    from softcal.export.reduced import reduced, write_reduced

    require_free_folder(folder)
    reaches = _reaches(project.robot, reach, cables)
    model = reduced(project.robot, reaches, samples or REDUCED_SAMPLES.get(len(reaches), 2), tell=tell)
    return write_folder(folder, lambda part: write_reduced(model, part))


def _reaches(robot: Robot, text: str, cables: Sequence[str]) -> dict[str, Reach]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    of_each = dict((name.strip(), value.strip()) for name, sign, value in (p.partition("=") for p in parts) if sign)
    if not of_each and len(parts) == 1:
        of_each = dict.fromkeys(cables or [cable.name for cable in robot.cables], parts[0])
    elif len(of_each) != len(parts) or (cables and set(cables) != set(of_each)):
        allowed = "one reach for all the cables (8N), or one for each of them (front=8N,left=40mm)"
        raise ParameterError(Fault("this does not say how far each cable goes", "--reach", f"'{text}'", allowed))
    return {name: _reach(value) for name, value in of_each.items()}


def _reach(text: str) -> Reach:
    from softcal.export.reduced import Reach

    try:
        return Reach(QUANTITIES["shortening"].read(text), "m")
    except UnitError:
        return Reach(QUANTITIES["tension"].read(text, where="--reach"), "N")


def _write_each(names: Collection[str], folder: Path, write: Callable[[str, Path], list[Path]]) -> list[Path]:
    """Let `write` fill a new folder with what each name stands for, several ones in folders of their names in it."""
    return write_folder(
        folder, lambda part: [path for name in names for path in write(name, _subfolder(part, name, len(names)))]
    )


def write_folder(folder: Path, write: Callable[[Path], list[Path]]) -> list[Path]:
    """Let `write` fill a new folder, whole or not at all; the files as they lie there then.

    Raises
    ------
    StorageError
        Where the folder holds files, or cannot be written.
    """
    with new_folder(folder) as part:
        written = [path.relative_to(part) for path in write(part)]
    return [folder / path for path in written]


def _subfolder(folder: Path, name: str, n: int) -> Path:
    inside = folder / name if n > 1 else folder
    inside.mkdir(exist_ok=True)
    return inside
