"""Source of a twin: a project file, or a run folder with its calibrated values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from softcal.project.project import Project, load


def load_calibrated(path: Path, values: Mapping[str, str] | None = None) -> Project:
    """The project of a file, or that of a run folder at the calibrated values; then `values` are set.

    Raises
    ------
    InputError
        For a project that cannot be loaded, or an invalid value.
    StorageError
        For a folder that holds no run.
    """
    if not path.is_dir():
        return load(path, values=values or {})
    from softcal.project.search import held_values
    from softcal.twin.parameters import robot_parameters, with_parameters
    from softcal.workflows.calibration import calibrated
    from softcal.workflows.run_folder import load_run, refuse_project_folder

    refuse_project_folder(path)
    run = load_run(path)
    project = calibrated(run.project, run.headline)
    held = held_values(values or {}, robot_parameters(project.robot))
    return replace(project, robot=with_parameters(project.robot, held))
