"""Project templates, copied into a new folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import softcal
from softcal.errors import InputError, unknown
from softcal.workflows.output import new_folder


def templates() -> list[str]:
    """Names of the available templates."""
    return sorted(entry.name for entry in _home().iterdir() if entry.is_dir())


def write_template(name: str, folder: str | Path) -> Path:
    """Copy a template into a folder that is new or empty, and return its project file.

    Raises
    ------
    InputError
        For a template that does not exist.
    StorageError
        Where the folder holds files, or cannot be written.
    """
    if name not in templates():
        raise InputError(unknown("there is no such template", "", name, templates()))
    with new_folder(Path(folder), "another DIR") as part:
        shutil.copytree(_home() / name, part, dirs_exist_ok=True)
    return Path(folder) / "project.yaml"


def _home() -> Path:
    return Path(softcal.__file__).parent / "templates"
