"""Beginning and end of the commands that study a calibration or a project."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from softcal.cli.printing import echo, print_warnings, shown_path
from softcal.cli.values import parsed_values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from softcal.workflows.study_files import StudyKind
    from softcal.workflows.study_source import StudySource

S = TypeVar("S")

CalibrationName = Annotated[
    str, typer.Option(metavar="NAME", help="Calibration of the run; the joint one by default.", show_default=False)
]
StudyFolder = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="A folder that is new or empty; default for a run: the folder of this study in it, for its report.",
        show_default=False,
    ),
]


def begin_study(path: Path, values: list[str] | None, calibration: str) -> StudySource:
    """The source of a study. Prints the warnings of a project.

    Commands begin with it, before they import the modules of their study: a fault of a file is reported at once.

    Parameters
    ----------
    path
        A run folder, or a project file.
    values, calibration
        The options of the command.

    Raises
    ------
    InputError, StorageError
        See `study_source`.
    """
    from softcal.workflows.study_source import study_source

    source = study_source(path, parsed_values(values), calibration)
    print_warnings(source.project.warnings if not path.is_dir() else ())
    return source


def study_folder(kind: StudyKind[S], path: Path, out: Path | None) -> Path | None:
    """The new or empty folder of a study; None where the study is printed only.

    Parameters
    ----------
    kind
        The kind of study.
    path
        A run folder, or a project file.
    out
        The option of the command.

    Raises
    ------
    StorageError
        For a folder that holds files, or cannot be written.
    """
    from softcal.workflows.output import require_free_folder
    from softcal.workflows.study_source import default_folder

    folder = out if out is not None else default_folder(path, kind.folder)
    if folder is not None:
        require_free_folder(folder)
    return folder


def end_study(
    kind: StudyKind[S], study: S, source: StudySource, folder: Path | None, notes: Sequence[str], run: Path
) -> None:
    """Print a study's notes and sentences, and write it into its folder.

    Parameters
    ----------
    kind, study, notes
        The study, its kind and its notes.
    source
        What is studied.
    folder
        New or empty; None: the study is not written.
    run
        The run folder or project file of the command.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """
    for note in notes:
        echo(f"Note: {note}")
    for sentence in kind.sentences(study):
        echo(sentence)
    if folder is None:
        return
    from softcal.workflows.study_source import default_folder

    kind.write(study, source.project, source.calibration, folder)
    echo(f"Wrote {shown_path(folder)}")
    if folder == default_folder(run, kind.folder):
        echo(f"Add it to the report with: softcal report {run}")
