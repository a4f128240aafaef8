"""The report of a fleet: a page, its figures, its tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.calibration.results.stored import read_bytes
from softcal.plugins.fleet.figures import draw_infill, draw_specimens
from softcal.plugins.fleet.folder import FLEET, REPORT, held_fleet
from softcal.plugins.fleet.page import FleetPage, render_fleet_page
from softcal.plugins.fleet.tables import fleet_tables
from softcal.plugins.fleet.workflow import Fleet
from softcal.project.yaml_file import read_document
from softcal.report.figure import Picture
from softcal.report.format import file_stem
from softcal.report.style import encode
from softcal.report.write import write_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE, FIGURES, TABLES = REPORT
_DRAWN = 6  # parameters


def write_fleet_report(found: Fleet) -> Path:
    """Write report.html, figures/*.png, figures/*.svg and tables/*.csv into the fleet's folder; returns the page.

    Raises
    ------
    StorageError
        Where a file cannot be written, or another process goes on with the fleet.
    """
    pictures = fleet_pictures(found)
    files: dict[Path, bytes] = {}
    for one in pictures:
        files[found.folder / FIGURES / f"{one.name}.png"] = one.png
        files[found.folder / FIGURES / f"{one.name}.svg"] = one.svg
    for table in fleet_tables(found.specimens, found.statement, len(found.specimens)):
        if table.rows:
            files[found.folder / TABLES / f"{table.key}.csv"] = table.as_csv().encode()
    record = json.loads(read_bytes(found.folder / FLEET, "the record of the fleet"))
    page = FleetPage(str(read_document(found.table.template).data["name"]), record["created"])
    path = found.folder / PAGE
    files[path] = render_fleet_page(page, found.specimens, found.statement, pictures).encode()
    with held_fleet(found.folder):
        write_files(files)
    return path


def fleet_pictures(found: Fleet) -> list[Picture]:
    """The figures: each parameter over the specimens, and each modulus against the infill."""
    statement, specimens = found.statement, [one for one in found.specimens if one.state == "DONE"]
    pictures = [
        _picture(
            f"infill-{file_stem(law.label)}",
            f"{law.label} against the infill; bars are 95 % intervals.",
            draw_infill(law, specimens, statement),
        )
        for law in statement.laws
    ]
    for one in statement.populations[:_DRAWN]:
        caption = f"{one.label} of each specimen with its 95 % interval."
        pictures.append(
            _picture(f"specimens-{file_stem(one.label)}", caption, draw_specimens(one, specimens, statement))
        )
    return pictures


def _picture(name: str, caption: str, figure: Figure) -> Picture:
    png, svg = encode(figure, caption.removesuffix("."))
    return Picture(name, "overview", caption, png, svg)
