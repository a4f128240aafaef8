"""The page of a fleet: what its specimens say together, and each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from softcal.plugins.fleet.population import Population
from softcal.plugins.fleet.specimen import Specimen
from softcal.plugins.fleet.statement import FleetStatement
from softcal.plugins.fleet.tables import fleet_tables
from softcal.plugins.fleet.verdict import ends_text, fleet_sentences, spread_of, value_text
from softcal.report.figure import Picture
from softcal.report.format import duration
from softcal.report.page import KeyNumber, render

_LISTED = 1000  # specimens of the page's table


@dataclass(frozen=True)
class FleetPage:
    """What a page says of a fleet beside its specimens: its template's name, and when it was begun, in ISO 8601."""

    name: str
    created: str


def render_fleet_page(
    page: FleetPage, specimens: Sequence[Specimen], found: FleetStatement, pictures: Sequence[Picture]
) -> str:
    """The page as text."""
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
