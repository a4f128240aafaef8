"""Files of a simulation: response-<name>.csv, a picture of the twin, and a record of its settings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from softcal.calibration.results.result_files import response_file
from softcal.calibration.search.outcome import installed_versions
from softcal.project.project import Project
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.workflows.cases import Case
from softcal.workflows.engines import SOFTCAL, engine_for
from softcal.workflows.motion import Observer, simulate_each_in_time
from softcal.workflows.output import new_folder, require_free_folder
from softcal.workflows.simulation import keep_silent, response_csv, response_to, simulate_each, twin_view


def simulate_to_folder(
    project: Project,
    cases: Mapping[str, Case],
    folder: Path,
    *,
    in_time: bool = False,
    engine: str = SOFTCAL,
    progress: Observer | None = None,
    stage: Callable[[str], None] = keep_silent,
    ready: Callable[[str, Response], None] = lambda name, response: None,
) -> dict[str, Response]:
    """Simulate each case and write the results into a new folder, completely or not at all.

    Where the watch of the load paths keeps what is ready, a stop leaves out what is not: see `simulate_each`.

    Parameters
    ----------
    project
        The project of the cases.
    cases
        Name -> case.
    folder
        New or empty.
    in_time
        Transient by the project's `dynamics` instead of equilibria.
    engine
        Computes the equilibria.
    progress
        Called with the progress of each motion.
    stage
        Called with the name of each stage.
    ready
        Called with each case's name and response.

    Raises
    ------
    InputError
        For an engine that is unknown, not installed, or does not support the robot.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        If no sample of a protocol could be reached; nothing is then written. If only some could, those are written and
        the response's status lists the others.
    """
    require_free_folder(folder)
    simulator = engine_for(engine, project.robot, project.engines)
    of_engine: dict[str, object] = {}
    if engine != SOFTCAL:
        from softcal.export.engine import engine_settings

        own = engine_settings(engine, project.engines)
        of_engine = {"engines": {} if own is None else {engine: asdict(own)}}
    if in_time:
        responses = simulate_each_in_time(project, cases, progress=progress, ready=ready)
    else:
        responses = simulate_each(
            cases,
            lambda case: response_to(case.robot, case.protocol, snapshots=True, engine=simulator),
            partly=True,
            stage=stage,
            ready=ready,
        )
    stage("Drawing and writing")
    with new_folder(folder) as part:
        for name, response in responses.items():
            (part / response_file(name)).write_text(response_csv(response), encoding="utf-8")
            _draw(cases[name].robot, name, response, part)
        tests = {name: project.experiments[case.experiment] for name, case in cases.items() if case.experiment}
        settings = {name: {"settings": dict(test.settings)} for name, test in tests.items() if test.settings}
        record = {
            "project": project.name,
            "parameters": {n: {"value": info.value, "unit": info.unit} for n, info in project.parameters.items()},
            "responses": {
                name: {
                    "status": response.status,
                    "succeeded": response.succeeded,
                    "n_factorisations": response.n_factorisations,
                    **settings.get(name, {}),
                }
                for name, response in responses.items()
            },
            **({"dynamics": asdict(project.dynamics)} if in_time else {"engine": engine}),
            **of_engine,
            "hashes": dict(project.hashes),
            "versions": installed_versions(),
        }
        (part / "simulation.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return responses


def _draw(robot: Robot, name: str, response: Response, folder: Path) -> None:
    view = twin_view(robot, response)
    if view is None:
        return
    from softcal.report.figures.twin import draw_twin
    from softcal.report.style import encode

    png, svg = encode(draw_twin(view).figure)
    stem = response_file(name).removeprefix("response-").removesuffix(".csv")
    (folder / f"twin-{stem}.png").write_bytes(png)
    (folder / f"twin-{stem}.svg").write_bytes(svg)
