"""The report of calibrations as a page."""

from __future__ import annotations

from collections.abc import Sequence

from softcal.report.closeness import misses_of, worst
from softcal.report.comparison import improvements
from softcal.report.conclusions import conclusions, first_screen, verdict
from softcal.report.content import ReportContent
from softcal.report.figure import Picture
from softcal.report.first_screen import budget_note
from softcal.report.format import number
from softcal.report.headline import headline
from softcal.report.page import TEMPLATES, KeyNumber, marks, render
from softcal.report.positions import MM, places, pooled
from softcal.report.section import shown_sections
from softcal.report.statement import legend


def render_page(content: ReportContent, pictures: Sequence[Picture]) -> str:
    """The page of a report as HTML, with its figures as they are drawn, in order."""
    figures: dict[str, list[Picture]] = {}
    for picture in pictures:
        figures.setdefault(picture.section, []).append(picture)
    of = first_screen(content)
    shown, folded = of.shown
    return render(
        TEMPLATES / "report.html.j2",
        content=content,
        key_numbers=key_numbers(content),
        first=headline(content),
        statements=shown,
        folded=folded,
        legend=legend([*shown, *folded]),
        marks=marks(legend([*shown, *folded])),
        budget_note=budget_note(of),
        n_judged=len(of.judged),
        verdict=verdict(content),
        conclusions=conclusions(content),
        figures=figures,
        sections=shown_sections(content, figures),
    )


def key_numbers(content: ReportContent) -> list[KeyNumber]:
    """The gain over the nominal values, and the errors of the headline calibration."""
    numbers: list[KeyNumber] = []
    gains = improvements(content)
    if gains:
        gain, first = gains[0].reduction, gains[0]
        remark = f"{first.error_text(first.nominal)} at the nominal values, {first.error_text(first.tuned)} now"
        value = "–" if gain is None else number(gain)
        numbers.append(KeyNumber("Error reduced by", value, "%", remark))
    fitted = [place for place in places(content.headline_result) if not place.held_out]
    distance = pooled(fitted)
    if distance is not None:
        length = fitted[0].fit.length
        share = "" if length is None else f"{number(100 * distance.rms / length, 2)} % of the length; "
        remark = f"{share}{number(MM * distance.max)} mm at most"
        numbers.append(KeyNumber("Markers, RMS distance", number(MM * distance.rms), "mm", remark))
    misses = list(misses_of(content.samples, content.headline_result))
    for word in dict.fromkeys(miss.word for miss in misses):
        if (miss := worst(misses, word)) is not None:
            where = f"; largest in {miss.place}" if sum(one.word == word for one in misses) > 1 else ""
            share = "" if miss.share is None else f"{number(100 * miss.share, 2)} % of its range"
            value, _, unit = miss.size.partition(" ")
            numbers.append(KeyNumber(f"{word.capitalize()}, RMS error", value, unit, f"{share}{where}"))
    return numbers
