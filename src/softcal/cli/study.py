"""How the commands that study a calibration or a project begin and end."""

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
        help="A folder that is new or empty; default for a run: one of the study's name in it, for its report.",
        show_default=False,
    ),
]


def begin_study(
    path: Path, name: str, values: list[str] | None, calibration: str, out: Path | None
) -> tuple[StudySource, Path | None]:
    """What is studied, and the folder of the study; None where it is printed only. Prints a project's warnings.

    Parameters
    ----------
    path
        A run folder, or a project file.
    name
        The default folder in a run.
    values, calibration, out
        The options of the command.

    Raises
    ------
    InputError, StorageError
        See `study_source`; and for a folder that holds files.
    """
    from softcal.workflows.output import require_free_folder
    from softcal.workflows.study_source import default_folder, study_source

    source = study_source(path, parsed_values(values), calibration)
    folder = out if out is not None else default_folder(path, name)
    if folder is not None:
        require_free_folder(folder)
    print_warnings(source.project.warnings if not path.is_dir() else ())
    return source, folder


def end_study(
    kind: StudyKind[S], study: S, source: StudySource, folder: Path | None, notes: Sequence[str], run: Path
) -> None:
    """Print a study's notes and sentences, and write it into its folder.

    Parameters
    ----------
    kind, study
        The study and its kind.
    source
        What is studied.
    folder
        New or empty; None: the study is not written.
    notes
        Of the study.
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
    kind.write(study, source.project, source.calibration, folder)
    echo(f"Wrote {shown_path(folder)}")
    if run.is_dir() and kind.folder and folder == run / kind.folder:
        echo(f"Into the report with: softcal report {run}")
