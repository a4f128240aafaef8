"""The page of `softcal coupon`: what it shows, and which sentences it has where they are true and nowhere else."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from coupon_case import MOONEY_RIVLIN, mooney_coupon, strains_of, write_coupon
from typer.testing import CliRunner

from softcal.calibration.results.digits import interval_text, value_text
from softcal.cli import app
from softcal.plugins.coupons.comparison import LawComparison, compare_laws
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.material_block import material_block
from softcal.plugins.coupons.page import CouponCharts, render_coupon_page
from softcal.plugins.coupons.sentences import verdict
from softcal.plugins.coupons.tables import typical_rate
from softcal.report.figure import Picture

C10, C01 = 2e5, 5e4
ODD = "<b>one & two</b>"
CHARTS = CouponCharts(Picture("yeoh", "fit", ODD, b"png", b"svg"), None, None)
ONE_TEST = "One test does not show how far specimens differ"
SEVERAL = "tests do not show how far specimens differ"
DIFFER = "the 95 % bands include how far"
NO_BANDS = "has no 95 % bands"
UNSTABLE = "is unstable within strains of the size measured"
OPEN = "The tests do not determine"
NARROW = "The 95 % band is too narrow for tests that were not fitted"
MIXED_UP = "Check which stress was measured"
NEARER = "Nearer on what was held out, and not recommended"


def noisy(name: str, test: str, seed: int, constants: tuple[float, float] = (C10, C01)) -> Coupon:
    return mooney_coupon(name, test, constants, np.random.default_rng(seed).normal(0.0, 4e3, 25))


def page(found: LawComparison, further: Sequence[Coupon] = (), files: Sequence[str] = ()) -> str:
    chosen = found.recommended
    block = "" if chosen is None else material_block(chosen.fit, found, "bar")
    predicted = [found.shown.fit.material.predict(one) for one in further]
    return render_coupon_page(found, CHARTS, block=block, predicted=predicted, files=files)


def said(text: str) -> set[str]:
    """Which of the sentences are there."""
    known = ONE_TEST, SEVERAL, DIFFER, NO_BANDS, UNSTABLE, OPEN, NARROW, MIXED_UP, NEARER
    return {one for one in known if one in unescape(text)}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command on one test, with a test to predict whose specimen is stiffer by a quarter."""
    folder = tmp_path_factory.mktemp("page")
    strain = strains_of("uniaxial")[:, 0]
    exact = 1e-6 * MOONEY_RIVLIN["uniaxial"](C10, C01, strain)
    noise = np.random.default_rng(7).normal(0.0, 4e-3, len(strain))
    for name, factor in (("first", 1.0), ("a<i>b", 1.25)):
        columns = {"stretch": strain, "nominal_stress [MPa]": factor * exact + noise}
        write_coupon(folder / f"{name}.csv", columns)
    words = ["coupon", str(folder / "first.csv"), "--predict", str(folder / "a<i>b.csv"), "--test", "uniaxial"]
    words += ["--law", "mooney-rivlin", "--law", "neo-hooke", "--body", "bar", "--out", str(folder / "out")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    again = CliRunner().invoke(app, words)
    assert (again.exit_code, "nothing is overwritten" in " ".join(again.output.split())) == (2, True)
    return folder / "out"


def test_the_page_stands_alone_and_embeds_the_charts(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?:|<script|<link|@import|url\(", text)
    sources = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(sources) == 3
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)


def test_the_page_has_the_constants_of_the_record(written: Path):
    text = unescape((written / "report.html").read_text(encoding="utf-8"))
    record = json.loads((written / "coupon.json").read_text(encoding="utf-8"))
    assert f"Recommended: {record['recommended']}</h1>" in text
    law = record["laws"][record["recommended"]]
    shown = re.findall(
        r'class="symbol">([^<]*)</span>\s*<span class="value">([^<]*)</span>\s*<span[^>]*>95 %: ([^<]*)<', text
    )
    assert [name for name, *_ in shown] == ["C10", "C01"]
    for name, value, interval in shown:
        number, unit = value.split()
        factor = {"kPa": 1e3, "MPa": 1e6, "Pa": 1.0}[unit]
        ends = [float(end) * factor for end in interval.removesuffix(unit).split(" to ")]
        assert float(number) * factor == pytest.approx(law["fitted"][name]["value"], rel=0.02)
        assert ends == pytest.approx(law["fitted"][name]["interval"], rel=0.05)
    assert f">{100 * law['error']:.1f} <span" in text
    assert f">{100 * law['held_out_error']:.1f} <span" in text
    (prediction,) = record["predictions"]
    assert f"NMAD of {100 * prediction['nmad']:.2f} %" in text
    assert (written / "material.yaml").read_text(encoding="utf-8") in text


def test_names_are_escaped(written: Path):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert "a&lt;i&gt;b" in text
    assert "<i>" not in text
    odd = page(compare_laws([noisy(ODD, "uniaxial", 1)], ["neo-hooke"]), files=[ODD])
    assert "<b>" not in odd
    assert odd.count("&lt;b&gt;one &amp; two") >= 3


def test_a_band_that_does_not_hold_another_specimen_is_a_warning(written: Path):
    text = unescape((written / "report.html").read_text(encoding="utf-8"))
    inside = json.loads((written / "coupon.json").read_text())["predictions"][0]["inside_band"]
    assert f"{NARROW}: it holds {100 * inside:.0f} % of a<i>b." in text
    assert "With the predicted stresses times 1.2" in text
    found = compare_laws([noisy("one", "uniaxial", 3)], ["mooney-rivlin"])
    near = page(found, [noisy("two", "uniaxial", 4)])
    assert NARROW not in near
    assert "two, which was not fitted, is predicted" in near
    bare = page(found, [replace(noisy("two", "uniaxial", 4), stress=np.full((25, 1), np.nan))])
    assert "no stresses measured" in bare
    assert "is predicted with" not in bare


def test_what_the_specimens_do_not_show_is_said():
    one = page(compare_laws([noisy("one", "uniaxial", 3)], ["mooney-rivlin"]))
    assert said(one) == {ONE_TEST}
    assert "robot" not in unescape(one).split("<h2>Conclusions")[1].split("<h2>")[0]
    alike = page(compare_laws([noisy("one", "uniaxial", 3), noisy("two", "uniaxial", 4)], ["mooney-rivlin"]))
    assert said(alike) == {SEVERAL}
    factors = 1 + 0.05 * np.array([-1.3, -0.4, 0.1, 0.5, 1.1])
    apart = [noisy(f"s{i}", "uniaxial", i, (C10 * factor, C01)) for i, factor in enumerate(factors)]
    assert said(page(compare_laws(apart, ["mooney-rivlin"]))) == {DIFFER}


def test_without_a_recommendation_there_is_no_block():
    found = compare_laws(
        [noisy("one", "uniaxial", 1, (1e5, -8e4)), noisy("two", "equibiaxial", 2, (1e5, -8e3))], ["mooney-rivlin"]
    )
    text = page(found)
    assert "No law is recommended</h1>" in text
    assert UNSTABLE in text
    assert "gives way only beyond" not in text
    assert "For the project file" not in text
    assert verdict(found) in unescape(text)


@pytest.mark.long
def test_a_constant_that_is_not_determined_is_named():
    """A neo-Hookean body does not tell the terms of Ogden's law apart."""
    found = compare_laws([noisy("one", "uniaxial", 3, (C10, 0.0))], ["ogden-3"])
    one = found.shown
    (bound,) = [name for name, e in one.fit.estimates.items() if e.at_bound]
    text = unescape(page(found))
    assert OPEN in said(text)
    assert f"{OPEN} {bound} of ogden-3: at the bound of the search." in text
    assert text.count("not determined by the tests: at the bound of the search") == 1
    assert text.count('class="range">95 %') == len(one.fit.values) - 1


def test_a_fit_without_intervals_has_no_bands():
    found = compare_laws([noisy("one", "uniaxial", 3)], ["mooney-rivlin"])
    fit = found.shown.fit
    assert interval_text(fit.estimates["C10"]) in page(found)
    bare = replace(fit.statistics, intervals=dict.fromkeys(fit.statistics.intervals))
    fit = replace(fit, statistics=bare, material=replace(fit.material, covariance=None))
    text = page(replace(found, laws=(replace(found.shown, fit=fit),)))
    assert said(text) == {OPEN, NO_BANDS}
    assert value_text(fit.estimates["C10"]) in text
    assert 'class="range"' not in text


def test_an_error_that_is_not_finite_is_a_dash():
    found = compare_laws([noisy("one", "uniaxial", 3)], ["mooney-rivlin"])
    text = page(replace(found, laws=(replace(found.shown, held_out={"block 1 of 5": np.inf}),)))
    assert "most in block 1 of 5: –" in text
    assert not re.search(r"\b(inf|nan)\b", text)
    assert "No law is recommended" in text


def test_stresses_that_seem_mixed_up_are_a_warning_on_the_page():
    strain = strains_of("uniaxial", 2.3)
    wrong = Coupon("one", "uniaxial", strain, 1e5 * (strain**2 - 1 / strain))
    assert MIXED_UP in said(page(compare_laws([wrong], ["yeoh"])))


def test_laws_that_are_nearer_are_named_with_what_speaks_against_them():
    found = compare_laws([noisy("one", "uniaxial", 3)], ["mooney-rivlin", "mooney-rivlin-5", "neo-hooke"])
    nearer = [one for one in found.laws if one.held_out_error < found.shown.held_out_error]
    assert (NEARER in page(found)) == bool(nearer)
    only = replace(found, laws=tuple(one for one in found.laws if one not in nearer))
    assert NEARER not in page(only)
    best = replace(found.laws[0], held_out={"all": 1e-9}, fit=replace(found.laws[0].fit, stability=_giving_way(found)))
    first = replace(found, laws=(replace(best), *found.laws[1:]))
    assert f"{NEARER}: {best.name} (0.0 %, unstable" in unescape(page(first))


def _giving_way(found: LawComparison):
    return replace(found.laws[0].fit.stability, in_tests=False)


def test_holds_do_not_count_in_the_typical_rate():
    ramp = np.linspace(0.1, 2.0, 20)
    loaded = 0.1 + (ramp - ramp[0]) / 0.05  # the first row is reached at 1 1/s
    time = np.concatenate([loaded, loaded[-1] + np.linspace(10.0, 500.0, 20)])
    strain = np.concatenate([ramp, np.full(20, 2.0)])[:, None]
    coupon = Coupon("one", "shear", strain, strain, time)
    assert typical_rate(coupon) == pytest.approx(0.05)
    assert typical_rate(replace(coupon, time=None)) is None
    found = compare_laws([coupon], ["neo-hooke"])
    assert "0.05 1/s" in page(found)
    assert "Typical rate" not in page(compare_laws([noisy("one", "uniaxial", 3)], ["neo-hooke"]))
