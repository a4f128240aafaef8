"""The report of a fleet: a page, its figures, its tables."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.calibration.results.stored import read_bytes
from softcal.plugins.fleet.figures import draw_infill, draw_specimens
from softcal.plugins.fleet.folder import FLEET, REPORT, held_fleet
from softcal.plugins.fleet.population import Population
from softcal.plugins.fleet.specimen import Specimen
from softcal.plugins.fleet.statement import FleetStatement
from softcal.plugins.fleet.tables import fleet_tables
from softcal.plugins.fleet.verdict import ends_text, fleet_sentences, spread_of, value_text
from softcal.plugins.fleet.workflow import Fleet
from softcal.project.yaml_file import read_document
from softcal.report.figure import Picture
from softcal.report.format import duration, file_stem
from softcal.report.page import KeyNumber, render
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


_LISTED = 1000  # specimens of the page's table


@dataclass(frozen=True)
class FleetPage:
    """Heading of a fleet's page: the name of the template, and the start of the fleet in ISO 8601."""

    name: str
    created: str


def render_fleet_page(
    page: FleetPage, specimens: Sequence[Specimen], found: FleetStatement, pictures: Sequence[Picture]
) -> str:
    """The page as text.

    Parameters
    ----------
    page
        Name of the fleet, and when it was begun.
    specimens
        The fleet's specimens.
    found
        What they say together.
    pictures
        The figures.
    """
    sentences = fleet_sentences(specimens, found)
    seconds = sum(one.seconds for one in specimens)
    text = f"{found.done} calibrated"
    if found.failed:
        text += f", {found.failed} failed"
    return render(
        Path(__file__).with_name("fleet.html.j2"),
        title=f"{page.name}: {len(specimens)} specimens",
        created=page.created,
        subject=f"{text}; {duration(seconds)} of computation.",
        key_numbers=key_numbers(found.populations),
        warnings=[one.text for one in sentences if one.tone == "warning"],
        conclusions=[one for one in sentences if one.tone != "warning"],
        pictures=pictures,
        tables=fleet_tables(specimens, found, _LISTED),
    )


def key_numbers(populations: Sequence[Population]) -> list[KeyNumber]:
    """Mean and spread of the first parameters."""
    found: list[KeyNumber] = []
    for one in populations[:3]:
        mean, _, unit = value_text(one.mean, one.interval, one.unit).partition(" ")
        spread, ends = spread_of(one)
        remark = f"95 %: {ends_text(one.interval, one.unit, one.mean)}; spread {spread}, 95 %: {ends}"
        found.append(KeyNumber(one.label, mean, unit, remark))
    return found
