"""Errors of predictions against measurements: of points and channels, and the share inside their bands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from softcal.calibration.results.stored import Amount, Count, Schema
from softcal.checks import Floats
from softcal.plugins.bench.predictions import LONGEST_NAME, Predictions
from softcal.plugins.bench.record import SPLITS, CaseRecord, Split

Name = Annotated[str, Field(max_length=LONGEST_NAME)]
Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Error:
    """Root mean square, mean, 95th percentile and largest of some distances [m], or of errors of a channel [SI]."""

    rms: Amount
    mean: Amount
    most_95: Amount
    largest: Amount


@dataclass(frozen=True)
class SplitScore:
    """The errors of the samples of one split.

    Attributes
    ----------
    n_samples
        Number of samples.
    points
        Point -> its distances.
    all_points
        The distances of all points together; None where the record has no positions.
    channels
        Any other channel -> its errors.
    coverage
        Share of all measured values inside their predicted 95 % bands [-]; one without a band is outside. None where
        no value has one.
    """

    n_samples: Count
    points: Mapping[Name, Error]
    all_points: Error | None
    channels: Mapping[Name, Error]
    coverage: Share | None


@dataclass(frozen=True)
class Score(Schema):
    """The score of a method in a case; the schema of `score.json`, in SI.

    Attributes
    ----------
    case, method
        Their names.
    splits
        Split -> its errors; the fitted split only where it was predicted too.
    evaluations, wall_s
        Number of simulations of the whole fit, and its wall time [s], where they are known.
    parameters
        What was identified, in words by name.
    data
        Name of the file with further samples that were predicted in the place of the case's own; "" for its own.
    """

    case: Name
    method: Name
    splits: Mapping[Split, SplitScore]
    evaluations: Count | None = None
    wall_s: Amount | None = None
    parameters: Mapping[Name, Name] | None = None
    data: Name = ""


def score(case: str, record: CaseRecord, predictions: Predictions, *, aligned: bool, data: str = "") -> Score:
    """The score of predictions that `require_matching` has accepted.

    Parameters
    ----------
    case
        Name of the case.
    record
        Its samples as measured.
    predictions
        The same samples as predicted.
    aligned
        One translation per split, the mean error, is taken off the positions first.
    data
        Name of the file with the samples; "" for the case's own.
    """
    splits: dict[Split, SplitScore] = {}
    for split in SPLITS:
        chosen = record.of(split)
        if chosen.any() and predictions.has(record, split):
            rows = predictions.rows(np.array(record.samples)[chosen])
            every, shift = distances_of(record, predictions, chosen, aligned=aligned)
            seen = {point: distance[np.isfinite(distance)] for point, distance in every.items()}
            distances = {point: distance for point, distance in seen.items() if len(distance)}
            errors = {
                name: np.abs(predictions.channels[name][rows] - record.channels[name][chosen]) for name in record.others
            }
            told = {name: error[np.isfinite(error)] for name, error in errors.items() if np.isfinite(error).any()}
            everything = np.concatenate([np.zeros(0), *distances.values()])
            inside: list[np.ndarray] = []
            for name, measured in record.channels.items():
                off = predictions.channels[name][rows] - measured[chosen]
                if name not in record.others:
                    off = off - shift["xyz".index(name[-1])]
                band = predictions.bands[name][rows] if name in predictions.bands else np.full(len(rows), np.nan)
                inside.append(np.where(np.isfinite(band), np.abs(off) <= band, False)[np.isfinite(off)])
            banded = any(np.isfinite(band[rows]).any() for band in predictions.bands.values())
            whole = np.concatenate(inside) if banded else np.zeros(0)
            splits[split] = SplitScore(
                int(chosen.sum()),
                {point: _error(distance) for point, distance in distances.items()},
                _error(everything) if len(everything) else None,
                {name: _error(error) for name, error in told.items()},
                float(whole.mean()) if len(whole) else None,
            )
    return Score(
        case,
        predictions.method,
        splits,
        predictions.evaluations,
        predictions.wall_s,
        predictions.parameters or None,
        data,
    )


def distances_of(
    record: CaseRecord, predictions: Predictions, chosen: np.ndarray, *, aligned: bool
) -> tuple[dict[str, Floats], Floats]:
    """Point -> distance (k,) [m] of its predicted from its measured position, NaN where one is missing; and the
    translation (3,) [m] that is taken off first, zero unless `aligned`.

    Parameters
    ----------
    record, predictions, aligned
        See `score`.
    chosen
        Samples of the record that count (n_samples,), as flags.
    """
    rows = predictions.rows(np.array(record.samples)[chosen])
    offsets = {point: predictions.positions(point)[rows] - record.positions(point)[chosen] for point in record.points}
    shift = np.zeros(3)
    if aligned and offsets:
        everything = np.concatenate(list(offsets.values()))
        shift = everything[np.isfinite(everything).all(axis=1)].mean(axis=0)
    return {point: np.linalg.norm(offset - shift, axis=1) for point, offset in offsets.items()}, shift


def _error(values: Floats) -> Error:
    return Error(
        float(np.sqrt(np.mean(values**2))),
        float(np.mean(values)),
        float(np.percentile(values, 95.0)),
        float(np.max(values)),
    )
