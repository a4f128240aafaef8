"""Positions in the report: distance of each simulated marker from its measured position, fitted and predicted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from softcal.calibration.results.result import Distance, ExperimentFit, SearchResult
from softcal.calibration.statistics.estimate import Remark, Tone
from softcal.report.content import ReportContent
from softcal.report.format import joined, number, result_label
from softcal.report.headline import headline
from softcal.report.tables import Cell, Column, ReportTable

MM = 1e3
# Ratio of prediction error to fit error: good up to the first; above the second the fit does not generalise.
_CARRIES_OVER, _DOUBTFUL = 1.5, 3.0
# Share of the values of a predicted test within the 95 % band of a further one: good from the first on; below the
# second the test contradicts the others.
_INSIDE, _OUTSIDE = 0.8, 0.5


@dataclass(frozen=True)
class Place:
    """Distances of one experiment by marker, and whether it was held out of the fit."""

    experiment: str
    fit: ExperimentFit
    held_out: bool


def places(result: SearchResult) -> list[Place]:
    """Experiments of a result with compared positions, sorted by name."""
    found = [Place(name, fit, held_out=False) for name, fit in result.experiments.items() if fit.distances]
    found += [Place(name, one.fit, held_out=True) for name, one in result.held_out.items() if one.fit.distances]
    return sorted(found, key=lambda place: place.experiment)


def distances_table(content: ReportContent) -> ReportTable:
    """Distance of every marker in every experiment and calibration (paper B, Eq. 1)."""
    rows: list[tuple[Cell, ...]] = []
    for label, result in content.results.items():
        for place in places(result):
            first = (result_label(label), place.experiment, "predicted" if place.held_out else "fitted")
            length = place.fit.length
            for marker, d in place.fit.distances.items():
                shares = (None, None) if length is None else (100 * d.mean / length, 100 * d.max / length)
                sizes = (MM * d.mean, MM * d.max, MM * d.rms, *shares)
                rows.append((*first, marker, *sizes, d.n, place.fit.missing.get(marker, 0)))
    headings = (headline(content).kind.capitalize(), "Experiment", "", "Marker")
    numbers = (("Mean", "mm"), ("Largest", "mm"), ("RMS", "mm"), ("Mean", "% of length"), ("Largest", "% of length"))
    columns = [Column(text) for text in headings] + [Column(text, unit) for text, unit in numbers]
    note = "Predicted: the experiment was held out of the fit. Not seen: states without a measurement of the marker."
    columns += [Column("States"), Column("Not seen")]
    return ReportTable(
        "distances", "Distance of the markers from their measured positions", tuple(columns), tuple(rows), note
    )


def pooled(found: Iterable[Place]) -> Distance | None:
    """Distance over all markers of several experiments; None if there are none."""
    parts = [distance for place in found for distance in place.fit.distances.values()]
    every = {str(i): distance for i, distance in enumerate(parts)}
    return ExperimentFit({}, {}, {}, {}, {}, distances=every).distance


def distance_text(distance: Distance, length: float | None) -> str:
    """A distance in words: "0.81 mm RMS (0.19 % of the length)"."""
    share = "" if length is None else f" ({number(100 * distance.rms / length, 2)} % of the length)"
    return f"{number(MM * distance.rms)} mm RMS{share}"


def fitted_distance(result: SearchResult) -> str:
    """Distance of the markers over the fitted experiments, in words; "" if no positions were fitted."""
    fitted = [place for place in places(result) if not place.held_out]
    distance = pooled(fitted)
    return "" if distance is None else distance_text(distance, fitted[0].fit.length)


def fit_sentence(result: SearchResult) -> str:
    """Overall distance of the markers and the largest one; "" if no positions were fitted."""
    fitted = [place for place in places(result) if not place.held_out]
    if not fitted:
        return ""
    furthest = {
        (place.experiment, marker): distance.max for place in fitted for marker, distance in place.fit.distances.items()
    }
    (experiment, marker), worst = max(furthest.items(), key=lambda item: item[1])
    largest = f"{marker} in {experiment}, {number(MM * worst)} mm"
    return f"The twin reproduces the markers to {fitted_distance(result)}; the largest distance is {largest}."


def _within_bands(fit: ExperimentFit) -> dict[str, float]:
    """Channel -> the share [-] of its values that is within its band; those without bands are omitted."""
    off = {c: np.abs(fit.measured[c] - fit.simulated[c]) for c in fit.bands if c in fit.measured}
    return {
        c: float(np.mean((d <= fit.bands[c])[np.isfinite(fit.bands[c])]))
        for c, d in off.items()
        if np.isfinite(fit.bands[c]).any()
    }


def prediction_sentence(result: SearchResult) -> Remark | None:
    """Prediction errors of held-out experiments; its tone says whether the fit generalises, "note": in part."""
    predicted = [place for place in places(result) if place.held_out]
    ahead, fitted = pooled(predicted), pooled(place for place in places(result) if not place.held_out)
    if ahead is None:
        held = {name: one.fit for name, one in result.held_out.items()}
        errors = "; ".join(
            f"{name}, {joined(f'{c} to {number(error)} {fit.units[c]}' for c, error in fit.rmse.items())}"
            for name, fit in held.items()
        )
        text = f"Held out of the fit and predicted (RMS): {errors}"
        within = {(name, c): share for name, fit in held.items() for c, share in _within_bands(fit).items()}
        if not within:
            return Remark(f"{text}.") if errors else None
        (test, channel), share = min(within.items(), key=lambda one: one[1])
        inside = f"{100 * share:.0f} % of the values of {channel} of {test} are within the 95 % band of a further test"
        text += f"; {'at worst ' * (len(within) > 1)}{inside}"
        if share < _OUTSIDE:
            return Remark(f"{text}: {test} contradicts the fitted tests, or the model is wrong there.", "warning")
        return Remark(f"{text}.", "good" if share > _INSIDE else "note")
    distances = ((place, place.fit.distance) for place in predicted)
    each = joined(f"{at.experiment} to {distance_text(d, at.fit.length)}" for at, d in distances if d is not None)
    text = f"Held out of the fit and predicted: {each}"
    if fitted is None or fitted.rms <= 0:
        return Remark(f"{text}.")
    ratio = ahead.rms / fitted.rms
    tone: Tone = "good" if ratio <= _CARRIES_OVER else "warning" if ratio > _DOUBTFUL else "note"
    return Remark(f"{text}; {number(ratio, 2)} times the distance in the fitted tests.", tone)
