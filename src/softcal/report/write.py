"""Writes a report: the page, the figures as PNG and SVG, the tables as CSV."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from softcal.display import displayed
from softcal.errors import Fault, StorageError
from softcal.regular_file import is_inside, write_whole
from softcal.report.content import ReportContent
from softcal.report.figure import named_figures, report_pictures
from softcal.report.html import render_page
from softcal.report.section import all_tables

Observer = Callable[[str, int, int], None]  # called with what is done next, its number from 0, and how many there are


@displayed
@dataclass(frozen=True)
class ReportPaths:
    """Files written. notes: remarks for the reader, such as a renderer that failed."""

    page: Path
    figures: tuple[Path, ...]
    tables: tuple[Path, ...]
    notes: tuple[str, ...] = ()


def write_report(
    content: ReportContent,
    out_dir: str | Path,
    *,
    figures: Collection[str] = (),
    progress: Observer | None = None,
) -> ReportPaths:
    """Write `report.html`, `figures/*.png`, `figures/*.svg` and `tables/*.csv` into a folder.

    An older report in the folder is replaced file by file; other files are kept. All figures are drawn before any file
    is written.

    Parameters
    ----------
    content
        What the report shows.
    out_dir
        Its folder.
    figures
        Names of the figures that are drawn; by default all.
    progress
        Called before each figure and the page.

    Raises
    ------
    ParameterError
        For a name without a figure.
    StorageError
        Where the folder cannot be written.
    """
    folder, begin = Path(out_dir), progress or (lambda stage, done, of: None)
    n = len(named_figures(figures))

    def drawing(name: str, done: int) -> None:
        begin(f"drawing {name}", done, n + 1)

    pictures, tables = report_pictures(content, figures, drawing), all_tables(content)
    files: dict[Path, bytes] = {}
    for picture in pictures:
        files[folder / "figures" / f"{picture.name}.png"] = picture.png
        files[folder / "figures" / f"{picture.name}.svg"] = picture.svg
    for table in tables.values():
        files[folder / "tables" / f"{table.key}.csv"] = table.as_csv().encode()
    begin("writing the page", n, n + 1)
    page = folder / "report.html"
    files[page] = render_page(content, pictures).encode()
    write_files(files)
    notes = tuple(picture.note for picture in pictures if picture.note)
    drawn, csv_files = (tuple(p for p in files if p.parent.name == name) for name in ("figures", "tables"))
    return ReportPaths(page, drawn, csv_files, notes)


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files of one folder and of folders in it, each completely or not at all.

    Raises
    ------
    StorageError
        Where a file cannot be written, or a link leads out of the folder.
    """
    folder = min((path.parent for path in files), key=lambda parent: len(parent.parts))
    if out := sorted({str(path.parent) for path in files if not is_inside(path.parent, folder)}):
        raise StorageError([Fault("a link leads out of the folder", place, allowed="a folder in it") for place in out])
    if taken := [path for path in files if path.is_dir()]:
        raise StorageError([Fault("a folder is in the place of a file", str(path)) for path in taken])
    for path, data in files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, data)
        except OSError as error:
            raise StorageError(
                Fault(
                    "the file cannot be written",
                    where=str(path),
                    got=error.strerror or str(error),
                    allowed="a folder with free space in which you may write",
                )
            ) from error
