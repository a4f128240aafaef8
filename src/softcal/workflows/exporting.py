"""Export of a project, or of a calibrated run, to files for other programs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.errors import Fault, ParameterError, UnitError
from softcal.limits import LIMITS
from softcal.project.project import Project
from softcal.quantities import QUANTITIES
from softcal.sensing.sensors.cable import SHORTENING
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

Reporter = Callable[[str], None]
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
    tell: Reporter = keep_silent,
    stage: Reporter = keep_silent,
) -> list[Path]:
    """Shapes of each case as .vtu files for ParaView in a new folder; see `softcal.export.vtk`.

    shapes: their number, evenly spaced from no pull to the furthest, each solved; by default the solved load steps.
    in_time: shapes of the motion by the project's `dynamics`; `shapes` of them (default 40) over the schedule, and at
    the same rate afterwards. progress: called with the progress of each motion; tell: called with warnings on bodies
    that penetrate and cables that are drawn out; stage: called with the name of each stage.

    Raises
    ------
    ParameterError
        For a number of shapes of a case that is no pull; see `softcal.workflows.film`.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        If a protocol has no solution; nothing is then written.
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
        animations = films(protocols_of(cases), shapes)
        filmed = {name: replace(case, protocol=animations[name]) for name, case in cases.items()}
        responses = _simulated(filmed, "samples", stage)
    _report_warnings(responses, tell)
    return _write_each(responses, folder, lambda name, inside: write_vtk(cases[name].robot, responses[name], inside))


def _simulated(cases: Mapping[str, Case], snapshots: Shown, stage: Reporter) -> dict[str, Response]:
    return simulate_each(cases, lambda case: simulate(case.robot, case.protocol, snapshots=snapshots), stage=stage)


def _report_warnings(responses: Mapping[str, Response], tell: Reporter) -> None:
    """Report the warnings of each response."""
    for name, response in responses.items():
        for sentence in response.warnings:
            tell(f"{name}: {sentence}")


def export_calculix(
    cases: Mapping[str, Case], folder: Path, *, tell: Reporter = keep_silent, stage: Reporter = keep_silent
) -> list[Path]:
    """The last shape of each case as a CalculiX deck in a new folder; see `softcal.export.calculix`.

    The shape is solved with CalculiX's material law and elements, so that it is in equilibrium there.

    Raises
    ------
    ParameterError
        For features that a deck cannot represent: rods, contact, friction along cables.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        If a protocol has no solution; nothing is then written.
    """
    from softcal.export.calculix import in_its_law, write_calculix

    require_free_folder(folder)
    own = {name: replace(case, robot=in_its_law(case.robot)) for name, case in cases.items()}
    responses = _simulated(own, True, stage)
    _report_warnings(responses, tell)
    return _write_each(
        responses,
        folder,
        lambda name, inside: write_calculix(
            own[name].robot, responses[name].snapshots[-1], inside, given=cases[name].robot
        ),
    )


def export_sofa(project: Project, cases: Mapping[str, Case], folder: Path) -> list[Path]:
    """The robot as a SOFA scene in a new folder, with the protocol of the case with the largest pull as schedule.

    The scene uses the project's `dynamics`, `run.py` its `engines`. See `softcal.export.sofa_export`.

    Raises
    ------
    InputError
        For features that a scene cannot represent: contact, friction along cables; for a pull that no cable can follow.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        If parameters for linear tets are to be identified, and the protocol has no solution.
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
    """Cable -> slack [m]: travel on the bench minus the case's shortening; empty for a pull given by the user."""
    if not case.experiment:
        return {}
    experiment = project.experiments[case.experiment]
    rig = experiment.rig_values()
    driven = [experiment.twin_channel(channel) for channel in experiment.drives]
    return {name.carrier: rig[name.offset] for name in driven if name.kind == SHORTENING}


def export_reduced(
    project: Project,
    folder: Path,
    reach: str,
    cables: Sequence[str] = (),
    samples: int | None = None,
    *,
    tell: Reporter = keep_silent,
) -> list[Path]:
    """The cable-space model for a controller, with its evaluator, in a new folder; see `softcal.export.reduced`.

    reach: a force or a length for all the cables (8 N, 40mm), or one for each (front=8N,left=40mm). cables: by default
    those that `reach` names, else all. samples: along each cable, by default 33 of one, 9 of two, 7 of three.

    Raises
    ------
    InputError
        For invalid cables, reach or samples, or a folder that holds files or cannot be written.
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
        raise ParameterError(Fault("the reach is not defined for each cable", "--reach", f"'{text}'", allowed))
    return {name: _reach(value) for name, value in of_each.items()}


def _reach(text: str) -> Reach:
    from softcal.export.reduced import Reach

    try:
        return Reach(QUANTITIES["shortening"].read(text), "m")
    except UnitError:
        return Reach(QUANTITIES["tension"].read(text, where="--reach"), "N")


def _write_each(names: Collection[str], folder: Path, write: Callable[[str, Path], list[Path]]) -> list[Path]:
    """Let `write` fill a new folder; several names get a subfolder each."""
    return write_folder(
        folder, lambda part: [path for name in names for path in write(name, _subfolder(part, name, len(names)))]
    )


def write_folder(folder: Path, write: Callable[[Path], list[Path]]) -> list[Path]:
    """Let `write` fill a new folder, completely or not at all; returns the final paths.

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
