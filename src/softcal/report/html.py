"""The report as one self-contained HTML page: embedded style and pictures, no scripts, no external resources."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.calibration.result import SearchResult
from softcal.report.comparison import improvements
from softcal.report.conclusions import conclusions, headline_sentence
from softcal.report.content import ReportContent
from softcal.report.figure import Picture
from softcal.report.format import (
    estimate_scale,
    material_kinds,
    number,
    ordered_parameters,
    parameter_label,
    scale_of,
    with_error,
)
from softcal.report.headline import headline
from softcal.report.positions import MM, places, pooled
from softcal.report.tables import ReportTable, provenance_rows, share_of_peak
from softcal.sensing.channel import channel_name, channel_unit
from softcal.twin.parameter_name import parameter_name
from softcal.units import format_range

_FEW = 4  # numbers on the first screen


@dataclass(frozen=True)
class KeyNumber:
    """A number of the first screen: its symbol, value with error, unit, and a small remark."""

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
    environment.filters["embedded"] = embedded
    sections: dict[str, list[Picture]] = {}
    for picture in pictures:
        sections.setdefault(picture.section, []).append(picture)
    return environment.get_template("report.html.j2").render(
        content=content,
        key_numbers=key_numbers(content),
        first=headline(content),
        summary=headline_sentence(content),
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
        mesh_verdicts=() if content.mesh_study is None else mesh_verdicts(content.mesh_study),
    )


def _fits_table_1(content: ReportContent) -> bool:
    """Whether paper A's Table I can show the material's estimates: each of its constants at most once."""
    kinds = [[parameter_name(name).kind for name in result.parameters] for result in content.results.values()]
    return all(held.count(kind) <= 1 for held in kinds for kind in material_kinds(content.results.values()))


def embedded(picture: Picture) -> str:
    """The picture as a data URL."""
    data, kind = (picture.svg, "svg+xml") if picture.shown == "svg" else (picture.png, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def key_numbers(content: ReportContent) -> list[KeyNumber]:
    """The estimates of the headline calibration, material parameters first; per-experiment ones only if few."""
    result = content.headline_result
    found: list[KeyNumber] = []
    names = ordered_parameters({content.headline: result})
    if len(names) > _FEW:
        names = [name for name in names if not parameter_name(name).experiment] or names
    for name in names[:_FEW]:
        estimate = result.parameters[name]
        scale = estimate_scale(estimate)
        error = None if estimate.standard_error is None else estimate.standard_error / scale.factor
        remark = f"bounds {format_range(estimate.lower, estimate.upper, estimate.unit)}"
        if estimate.at_bound:
            remark = f"at its bound; {remark}"
        value = with_error(estimate.value / scale.factor, error)
        found.append(KeyNumber(parameter_label(name, result.parameters), value, scale.unit, remark.rstrip()))
    gains = improvements(content)
    if gains:
        gain, first = gains[0].reduction, gains[0]
        remark = f"{first.error_text(first.nominal)} at the nominal values, {first.error_text(first.tuned)} now"
        value = "–" if gain is None else number(gain)
        found.append(KeyNumber("Error reduced by", value, "%", remark))
    return found + _key_errors(result)


def _key_errors(result: SearchResult) -> list[KeyNumber]:
    """The largest RMS error of each compared channel, and the RMS distance of all markers."""
    found: list[KeyNumber] = []
    fitted = [place for place in places(result) if not place.held_out]
    distance = pooled(fitted)
    if distance is not None:
        length = fitted[0].fit.length
        share = "" if length is None else f"{number(100 * distance.rms / length, 2)} % of the length; "
        remark = f"{share}{number(MM * distance.max)} mm at most"
        found.append(KeyNumber("Markers, RMS distance", number(MM * distance.rms), "mm", remark))
    for channel in ("tension", "pitch", "shortening"):
        fits = [(fit.rmse[channel], name, fit) for name, fit in result.experiments.items() if channel in fit.rmse]
        if not fits:
            continue
        error, name, fit = max(fits, key=lambda item: item[0])
        scale, share = scale_of(fit.units.get(channel, channel_unit(channel) or "1")), share_of_peak(fit, channel)
        remark = f"{'largest, in ' if len(fits) > 1 else ''}{name}"
        if share is not None:
            remark += f"; {number(100 * share, 2)} % of the largest value"
        found.append(
            KeyNumber(f"{channel_name(channel).label}, RMS error", number(error / scale.factor), scale.unit, remark)
        )
    return found
