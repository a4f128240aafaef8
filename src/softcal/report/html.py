"""The report as one self-contained HTML page: embedded style and pictures, no scripts, no external resources."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from softcal.analysis.importance_verdict import importance_sentences
from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.calibration.result import SearchResult
from softcal.report.closeness import misses_of, worst
from softcal.report.comparison import improvements
from softcal.report.conclusions import conclusions, first_screen, verdict
from softcal.report.content import ReportContent
from softcal.report.figure import Picture
from softcal.report.first_screen import budget_note
from softcal.report.format import material_kinds, number
from softcal.report.headline import headline
from softcal.report.positions import MM, places, pooled
from softcal.report.statement import SOURCES, ErrorSource, Statement, legend
from softcal.report.tables import ReportTable, provenance_rows
from softcal.twin.parameter_name import parameter_name

_MOST_ROWS = 24  # of a table that is not folded
_COLOURS = 4  # for uncertain parameters
_LETTER = 0.022  # width of a letter over that of a bar, on the narrowest pages


@dataclass(frozen=True)
class KeyNumber:
    """A number of the first screen: its name, value, unit, and a small remark."""

    label: str
    value: str
    unit: str
    remark: str


def render_page(content: ReportContent, pictures: Sequence[Picture], tables: Mapping[str, ReportTable]) -> str:
    """The page as text."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folder = Path(__file__).parent / "templates"
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"embedded": embedded, "unbroken": unbroken, "moment": moment}
    sections: dict[str, list[Picture]] = {}
    for picture in pictures:
        sections.setdefault(picture.section, []).append(picture)
    of = first_screen(content)
    shown, folded = of.shown
    return environment.get_template("report.html.j2").render(
        content=content,
        key_numbers=key_numbers(content),
        first=headline(content),
        statements=shown,
        folded=folded,
        legend=legend([*shown, *folded]),
        marks=marks([*shown, *folded]),
        budget_note=budget_note(of),
        bar_text=bar_text,
        most_rows=_MOST_ROWS,
        n_judged=len(of.judged),
        verdict=verdict(content),
        conclusions=conclusions(content),
        sections=sections,
        tables=tables,
        record_failures=[
            f"{name}: comparison with the whole record failed: {found.failure}"
            for records in content.records.values()
            for name, found in records.items()
            if found.failure
        ],
        provenance={name: provenance_rows(e.prepared) for name, e in content.experiments.items()},
        fits_table_1=_fits_table_1(content),
        importance_sentences=() if content.importance is None else importance_sentences(content.importance),
        mesh_verdicts=() if content.mesh_study is None else mesh_verdicts(content.mesh_study),
    )


def marks(statements: Sequence[Statement]) -> dict[str, str]:
    """The style's class for each source of error; uncertain parameters share a few colours."""
    fixed = {source.kind for source in SOURCES}
    own = [source.kind for source in legend(statements) if source.kind not in fixed]
    return {kind: kind for kind in fixed} | {kind: f"uncertain-{i % _COLOURS}" for i, kind in enumerate(own)}


def _fits_table_1(content: ReportContent) -> bool:
    """Whether paper A's Table I can show the material's estimates: each of its constants at most once."""
    kinds = [[parameter_name(name).kind for name in result.parameters] for result in content.results.values()]
    return all(held.count(kind) <= 1 for held in kinds for kind in material_kinds(content.results.values()))


def bar_text(source: ErrorSource, share: float, words: str) -> str:
    """The text on a source's part of a bar: its name and its share, or what of them has room."""
    return next((text for text in (f"{source.short} {words}", words) if len(text) * _LETTER < share), "")


def moment(created: str) -> str:
    """A time of ISO 8601 to the minute: "2026-11-22 18:51 UTC"; any other text as it is."""
    try:
        at = datetime.fromisoformat(created)
    except ValueError:
        return created
    return f"{at:%Y-%m-%d %H:%M} {at.tzname() or ''}".rstrip()


def unbroken(text: str) -> str:
    """The text with exponents that no line break divides."""
    return re.sub(r"(?<=\de)-(?=\d)", "\N{NON-BREAKING HYPHEN}", text)


def embedded(picture: Picture) -> str:
    """The picture as a data URL."""
    data, kind = (picture.svg, "svg+xml") if picture.shown == "svg" else (picture.png, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def key_numbers(content: ReportContent) -> list[KeyNumber]:
    """What was gained over the nominal values, and the errors of the headline calibration."""
    found: list[KeyNumber] = []
    gains = improvements(content)
    if gains:
        gain, first = gains[0].reduction, gains[0]
        remark = f"{first.error_text(first.nominal)} at the nominal values, {first.error_text(first.tuned)} now"
        value = "–" if gain is None else number(gain)
        found.append(KeyNumber("Error reduced by", value, "%", remark))
    return found + _key_errors(content, content.headline_result)


def _key_errors(content: ReportContent, result: SearchResult) -> list[KeyNumber]:
    """The RMS distance of all markers, and the errors that the third sentence of the first screen tells."""
    found: list[KeyNumber] = []
    fitted = [place for place in places(result) if not place.held_out]
    distance = pooled(fitted)
    if distance is not None:
        length = fitted[0].fit.length
        share = "" if length is None else f"{number(100 * distance.rms / length, 2)} % of the length; "
        remark = f"{share}{number(MM * distance.max)} mm at most"
        found.append(KeyNumber("Markers, RMS distance", number(MM * distance.rms), "mm", remark))
    misses = list(misses_of(content.samples, result))
    for word in dict.fromkeys(miss.word for miss in misses):
        if (miss := worst(misses, word)) is not None:
            where = f"; largest in {miss.place}" if sum(one.word == word for one in misses) > 1 else ""
            share = "" if miss.share is None else f"{number(100 * miss.share, 2)} % of its range"
            value, _, unit = miss.size.partition(" ")
            found.append(KeyNumber(f"{word.capitalize()}, RMS error", value, unit, f"{share}{where}"))
    return found
