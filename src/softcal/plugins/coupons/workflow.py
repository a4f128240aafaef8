"""Coupon tests read, laws fitted to them and compared, and what is written of them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from softcal.calibration.results.store import write_text
from softcal.calibration.search.outcome import installed_versions
from softcal.csv_text import csv_text
from softcal.errors import Fault, InputError, ParameterError
from softcal.plugins.coupons.comparison import ComparedLaw, LawComparison, require_apart
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.figure import draw_coupons
from softcal.plugins.coupons.fitted_material import PredictedCoupon
from softcal.plugins.coupons.material_block import material_block, priors
from softcal.plugins.coupons.page import CouponCharts, render_coupon_page
from softcal.plugins.coupons.plausibility import require_signs
from softcal.plugins.coupons.reading import read_coupons
from softcal.plugins.coupons.record import FORMAT, RECORD, material_json, prediction_json
from softcal.report.figure import Picture
from softcal.report.format import file_stem, joined
from softcal.report.style import encode
from softcal.workflows.output import new_folder

_DRAWN = 3  # laws in the chart of several
PAGE, BLOCK, CONSTANTS, LAWS_TABLE, STRESSES, PREDICTIONS = (
    "report.html",
    "material.yaml",
    "constants.csv",
    "laws.csv",
    "stresses.csv",
    "predictions.csv",
)


def all_coupons(
    files: Sequence[Path], tests: Sequence[str], predicted: Sequence[Path] = ()
) -> tuple[list[Coupon], list[Coupon]]:
    """The tests of files to be fitted, and of files to be predicted.

    Parameters
    ----------
    files
        Tables of tests to be fitted.
    tests
        Kind of all tests, or of each one, those to be predicted last.
    predicted
        Tables of tests to be predicted, in which stresses may be missing.

    Raises
    ------
    ParameterError
        Where the kinds of test do not match the files, or two tests are of one specimen.
    InputError
        With all faults of all files.
    """
    every = [*files, *predicted]
    if len(tests) not in (1, len(every)):
        allowed = f"one for all files, or {len(every)}: one for each"
        raise ParameterError(Fault("the kinds of test do not match the files", "--test", str(len(tests)), allowed))
    found: tuple[list[Coupon], list[Coupon]] = [], []
    faults: list[Fault] = []
    for i, (path, test) in enumerate(zip(every, tests if len(tests) > 1 else [*tests] * len(every), strict=True)):
        is_fitted = i < len(files)
        try:
            coupons = read_coupons(path, test, needs_stress=is_fitted)
            require_signs(coupons, path)
            found[0 if is_fitted else 1].extend(coupons)
        except InputError as error:
            faults += [fault for fault in error.faults if fault not in faults]
    if faults:
        raise InputError(faults)
    for coupons in found:
        require_apart(coupons)
    return found


def write_predictions(predicted: Sequence[PredictedCoupon], name: str, folder: Path) -> None:
    """Write predictions into a new folder: `predictions.json`, a table and a chart.

    Parameters
    ----------
    predicted
        The tests as predicted.
    name
        Name of the law.
    folder
        New or empty.

    Raises
    ------
    StorageError
        If the folder holds files, or cannot be written; nothing is then written.
    """
    with new_folder(folder) as part:
        _add_predictions(predicted, name, part)
        record = {"law": name, "predictions": [prediction_json(one) for one in predicted]}
        write_text(part / "predictions.json", json.dumps(record, indent=2, allow_nan=False) + "\n")


def _add_predictions(predicted: Sequence[PredictedCoupon], name: str, folder: Path) -> Picture:
    write_text(folder / PREDICTIONS, predictions_csv(predicted))
    caption = f"Further tests as measured (points), and as {name} predicts them (curves)."
    return _draw({name: predicted}, folder / "predictions", caption)


def _draw(laws: Mapping[str, Sequence[PredictedCoupon]], stem: Path, caption: str = "") -> Picture:
    png, svg = encode(draw_coupons(laws))
    for ending, content in ((".png", png), (".svg", svg)):
        stem.with_name(stem.name + ending).write_bytes(content)
    return Picture(stem.name, "fit", caption, png, svg)


def write_comparison(
    found: LawComparison,
    body: str,
    folder: Path,
    predicted: Sequence[PredictedCoupon] = (),
    files: Sequence[Path] = (),
) -> None:
    """Write a comparison into a new folder: a page (`report.html`), `coupon.json`, tables, a chart of the three best
    laws and of each law with its band, and for the recommended law the block of a project file (`material.yaml`); and
    what the law that is shown predicts of further tests.

    Parameters
    ----------
    found
        The comparison.
    body
        Name of the body in the block.
    folder
        New or empty.
    predicted
        Further tests.
    files
        Files of the fitted tests, which the page names.

    Raises
    ------
    StorageError
        If the folder holds files, or cannot be written; nothing is then written.
    """
    with new_folder(folder) as part:
        write_text(part / LAWS_TABLE, laws_csv(found))
        write_text(part / CONSTANTS, constants_csv(found))
        write_text(part / STRESSES, stresses_csv(found))
        said = {one.name: one.fit.tests(found.coupons) for one in found.laws}
        best = {one.name: said[one.name] for one in found.laws[:_DRAWN]}
        caption = f"Points: measured. Curves: {joined(best)}, the nearest on what was held out."
        several = _draw(best, part / "laws", caption) if len(said) > 1 else None
        shown: dict[str, Picture] = {}
        for one in found.laws:
            with_band = one.fit.material.covariance is not None
            band = (
                ", with the 95 % band of a further test"
                if with_band
                else ", without a band: not all constants have intervals"
            )
            caption = f"Nominal stress as measured (points) and by {one.name} (curves){band}."
            shown[one.name] = _draw({one.name: said[one.name]}, part / file_stem(one.name), caption)
        further = _add_predictions(predicted, found.shown.name, part) if predicted else None
        charts = CouponCharts(shown[found.shown.name], several, further)
        chosen = found.recommended
        block = "" if chosen is None else material_block(chosen.fit, found, body)
        if block:
            write_text(part / BLOCK, block)
        write_text(part / RECORD, json.dumps(comparison_json(found, predicted), indent=2, allow_nan=False) + "\n")
        names = [path.name for path in files]
        created = datetime.now(UTC).isoformat()
        page = render_coupon_page(found, charts, block=block, predicted=predicted, files=names, created=created)
        write_text(part / PAGE, page)


def laws_csv(found: LawComparison) -> str:
    """A row for each law."""
    header = ["law", "constants [1]", "error [1]", "error on tests held out [1]", "AICc [1]", "stable [1]"]
    limits = [f"unstable from, {mode} [1]" for mode in found.laws[0].fit.stability.limits]
    rows = [
        [
            one.name,
            len(one.fit.values),
            one.fit.error,
            _finite(one.held_out_error),
            _finite(one.fit.aic),
            int(one.fit.stability.is_stable),
            *one.fit.stability.limits.values(),
        ]
        for one in found.laws
    ]
    return csv_text([*header, *limits], rows)


def constants_csv(found: LawComparison) -> str:
    """A row for each fitted constant of each law [SI]."""
    rows = [
        [one.name, name, e.unit, e.value, e.standard_error, *(e.interval or (None, None)), int(e.at_bound)]
        for one in found.laws
        for name, e in one.fit.estimates.items()
    ]
    return csv_text(["law", "constant", "unit", "value", "standard error", "lower", "upper", "at bound"], rows)


def stresses_csv(found: LawComparison) -> str:
    """A row for each measured stress: strains, and nominal stresses as measured and by each law [SI]."""
    rows: list[list[object]] = []
    for i, coupon in enumerate(found.coupons):
        second = coupon.strain[:, 1] if coupon.strain.shape[1] > 1 else [None] * len(coupon.strain)
        time = [None] * len(coupon.strain) if coupon.time is None else coupon.time
        for k, component in enumerate(coupon.kind.components):
            columns = [coupon.stress[:, k], *(one.fit.predicted[i][:, k] for one in found.laws)]
            for at, first, other, *values in zip(time, coupon.strain[:, 0], second, *columns, strict=True):
                rows.append([coupon.name, coupon.test, component, at, first, other, *values])
    header = ["specimen", "test", "stress", "time [s]", "strain 1 [1]", "strain 2 [1]", "measured [Pa]"]
    return csv_text([*header, *(f"{one.name} [Pa]" for one in found.laws)], rows)


def predictions_csv(predicted: Sequence[PredictedCoupon]) -> str:
    """A row for each stress of each predicted test, with its 95 % band [SI]."""
    rows: list[list[object]] = []
    for one in predicted:
        coupon, n = one.coupon, len(one.coupon.strain)
        time = [None] * n if coupon.time is None else coupon.time.tolist()
        second = coupon.strain[:, 1].tolist() if coupon.strain.shape[1] > 1 else [None] * n
        for k, component in enumerate(coupon.kind.components):
            of = [coupon.stress[:, k], one.stress[:, k], one.stress[:, k] - one.half[:, k]]
            of.append(one.stress[:, k] + one.half[:, k])
            for i in range(n):
                row = [_finite(float(values[i])) for values in of]
                rows.append([coupon.name, coupon.test, component, time[i], coupon.strain[i, 0], second[i], *row])
    header = ["specimen", "test", "stress", "time [s]", "strain 1 [1]", "strain 2 [1]"]
    return csv_text([*header, "measured [Pa]", "predicted [Pa]", "lower [Pa]", "upper [Pa]"], rows)


def comparison_json(found: LawComparison, predicted: Sequence[PredictedCoupon] = ()) -> dict[str, Any]:
    """The comparison as a record, all in SI."""
    chosen = found.recommended
    return {
        "format": FORMAT,
        "recommended": None if chosen is None else chosen.name,
        "poissons_ratio": found.poissons_ratio,
        "history": list(found.history),
        "tests": [{"specimen": c.name, "test": c.test, "rows": len(c.strain)} for c in found.coupons],
        "laws": {one.name: _law_json(one, found) for one in found.laws},
        "predictions": [prediction_json(one) for one in predicted],
        "same_as": dict(found.same_as),
        "left_out": dict(found.left_out),
        "versions": installed_versions(),
    }


def _law_json(one: ComparedLaw, found: LawComparison) -> dict[str, Any]:
    fit = one.fit
    return {
        "constants": dict(fit.theta),
        "small_strain": asdict(fit.small_strain),
        "material": material_json(fit.material),
        "tests": [prediction_json(one) for one in fit.tests(found.coupons)],
        "fitted": {name: asdict(estimate) for name, estimate in fit.estimates.items()},
        "priors": {name: {"mean": mean, "sd": sd} for name, (mean, sd) in priors(fit, found).items()},
        "error": fit.error,
        "errors": dict(fit.errors),
        "held_out_error": _finite(one.held_out_error),
        "held_out": {name: _finite(error) for name, error in one.held_out.items()},
        "aic": _finite(fit.aic),
        "stability": {**asdict(fit.stability), "is_stable": fit.stability.is_stable},
        "notes": [str(note) for note in fit.statistics.notes],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
