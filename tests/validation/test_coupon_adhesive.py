"""An optically clear adhesive that others measured in shear, at several rates: fits, predictions, printed numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from softcal.materials.catalogue import LAWS
from softcal.plugins.coupons.comparison import ComparedLaw, compare_laws
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.fitted_material import FittedMaterial, PredictedCoupon
from softcal.plugins.coupons.free_constants import free_constants
from softcal.plugins.coupons.reading import read_coupons
from softcal.units import plain

FILES = {
    "5/60": "shear_relaxation_5",
    "1/60": "shear_relaxation_1",
    "6/60": "shear_relaxation_0d1",
    "0.05, one ramp": "monotonic_shear_0d05",
    "2/60, with unloading": "shear_relaxation",
}
TITLE = "## An adhesive at several rates"


@pytest.fixture(scope="module")
def tests(shared_data: Path) -> dict[str, Coupon]:
    folder = shared_data / "coupons/oca-shear"
    if not folder.is_dir():
        pytest.skip("no adhesive in ../shared/data/coupons")
    return {name: read_coupons(folder / f"{stem}.csv", "shear")[0] for name, stem in FILES.items()}


def section() -> str:
    text = (Path(__file__).parents[2] / "docs/coupons.md").read_text(encoding="utf-8")
    return text.split(TITLE)[1].split("\n## ")[0]


def rows(number: int) -> list[list[str]]:
    """The rows of a table of the section."""
    tables = [part for part in section().split("\n\n") if part.startswith("|")]
    return [line.strip("| ").split(" | ") for line in tables[number].splitlines()[2:]]


def fitted(tests: dict[str, Coupon], rates: list[str], law: str, history: str) -> ComparedLaw:
    return compare_laws([tests[rate] for rate in rates], [law], history=[history]).laws[0]


def prediction_cells(one: PredictedCoupon) -> list[str]:
    cells = [f"{100 * one.nmad:.2f} %", plain(one.factor, 3), f"{100 * one.nmad_by_factor:.2f} %"]
    return [*cells, f"{100 * one.inside:.0f} %"]


def test_the_printed_constants_predict_what_is_printed(tests: dict[str, Coupon]):
    """Without a fit: the shape at a rate in between within 2.5 % mean deviation, as printed."""
    said = re.search(r"C10 (\S+) kPa, C20 (\S+) Pa, C30 (\S+) Pa; .*?What it", " ".join(section().split()))
    assert said is not None
    printed = re.findall(r"-?\d+\.\d+", said[0])
    values = np.array([float(number) for number in printed]) * [1e3, 1.0, 1.0, 1e3, 1.0, 1e3, 1.0, 1.0]
    constants = free_constants(LAWS["yeoh"], history=["maxwell-2"])
    material = FittedMaterial(constants, values, None, np.zeros(8), np.inf, {})
    for name, nmad in (("5/60", rows(0)[0][4]), ("1/60", rows(0)[0][5])):
        assert 100 * material.predict(tests[name]).nmad == pytest.approx(float(nmad.split()[0]), abs=0.03)
    for row in (0, 1, 4):
        _, rate, nmad, factor, by_factor, _ = rows(1)[row]
        one = material.predict(tests[rate])
        assert 100 * one.nmad == pytest.approx(float(nmad.split()[0]), abs=0.03)
        assert one.factor == pytest.approx(float(factor), abs=0.01)
        assert 100 * one.nmad_by_factor == pytest.approx(float(by_factor.split()[0]), abs=0.03)
    assert material.predict(tests["0.05, one ramp"]).nmad_by_factor < 0.025


@pytest.mark.long  # five minutes: laws with a history, each fitted to both rates and to each
def test_the_printed_fits(tests: dict[str, Coupon]):
    for law, history, *printed in rows(0):
        one = fitted(tests, ["5/60", "1/60"], law, history)
        deviations = [f"{100 * one.fit.material.predict(tests[rate]).nmad:.2f} %" for rate in ("5/60", "1/60")]
        found = [str(len(one.fit.values)), f"{100 * one.fit.error:.1f} %", *deviations]
        assert [*found, f"{100 * one.held_out_error:.1f} %"] == printed, (law, history)


@pytest.mark.long  # two minutes: three sets of tests fitted
def test_the_printed_predictions(tests: dict[str, Coupon]):
    fits: dict[str, ComparedLaw] = {}
    for rates, rate, *printed in rows(1):
        if rates not in fits:
            fits[rates] = fitted(tests, rates.split(", "), "yeoh", "maxwell-2")
        assert prediction_cells(fits[rates].fit.material.predict(tests[rate])) == printed, (rates, rate)
    between = fits["5/60, 1/60, 6/60"].fit.material.predict(tests["0.05, one ramp"])
    assert between.nmad < 0.025
    assert between.inside == 1.0
