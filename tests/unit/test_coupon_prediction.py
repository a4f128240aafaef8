"""Tests that a fitted material predicts, in the same command and from a stored fit, and laws of a file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from coupon_case import MOONEY_RIVLIN, strains_of, write_coupon
from typer.testing import CliRunner

from softcal.checks import Floats
from softcal.cli import app
from softcal.materials.catalogue import LAWS
from softcal.plugins.coupons.comparison import compare_laws
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.fitted_material import PredictedCoupon
from softcal.plugins.coupons.free_constants import free_constants
from softcal.plugins.coupons.history_response import response_of

PARTS = ("maxwell-1",)
TRUE = {"youngs_modulus": 3e5, "branch_modulus1": 8e4, "branch_time1": 6.0, "branch_exponent": 0.8}
NOISE = 1e3


def sheared(rate: float) -> tuple[Floats, Floats]:
    """Times and strains: a ramp to 3 and a hold."""
    ramp = np.linspace(0.0, 3.0 / rate, 12)[1:]
    return np.concatenate([ramp, ramp[-1] + np.linspace(1.0, 20.0, 8)]), np.minimum(
        rate * np.concatenate([ramp, np.full(8, ramp[-1])]), 3.0
    )


def table(path: Path, rate: float, seed: int, *, stress: bool = True) -> Path:
    time, strain = sheared(rate)
    constants = free_constants(LAWS["neo-hooke"], history=PARTS)
    bare = Coupon("x", "shear", strain[:, None], np.full((len(time), 1), np.nan), time)
    exact = response_of(constants, bare).stress(np.array([TRUE[name] for name in constants.names]))[:, 0]
    columns = {"time_s": time, "shear_gamma": strain}
    if stress:
        noise = np.random.default_rng(seed).normal(0.0, NOISE, len(time))
        columns["nominal_shear_stress_kPa"] = 1e-3 * (exact + noise)
    return write_coupon(path, columns)


def run(*words: object) -> str:
    done = CliRunner().invoke(app, ["coupon", *map(str, words)])
    assert done.exit_code == 0, done.output
    return done.output


def rows(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("predict")
    files = [table(folder / f"{name}.csv", rate, i) for i, (name, rate) in enumerate((("slow", 0.1), ("fast", 2.0)))]
    table(folder / "between.csv", 0.5, 7)
    table(folder / "bare.csv", 0.5, 7, stress=False)
    said = run(
        *files, "--test", "shear", "--law", "neo-hooke", "--history", *PARTS,
        "--predict", folder / "between.csv", "--predict", folder / "bare.csv", "--out", folder / "out",
    )  # fmt: skip
    return folder, said


@pytest.mark.slow
def test_a_rate_between_is_predicted_within_its_band(fitted: tuple[Path, str]):
    folder, said = fitted
    record = json.loads((folder / "out/coupon.json").read_text())
    between, bare = record["predictions"]
    assert between["nmad"] < 0.02
    assert between["inside_band"] >= 0.85
    assert between["factor"] == pytest.approx(1.0, abs=0.02)
    assert "nmad" not in bare
    assert f"{100 * between['nmad']:.2f} %" in said
    assert "no stresses measured" in " ".join(said.split())
    found = rows(folder / "out/predictions.csv")
    assert len(found) == 38
    np.testing.assert_array_equal(found["predicted_Pa"][:19], found["predicted_Pa"][19:])
    width = found["upper_Pa"] - found["lower_Pa"]
    assert (width > 2.0 * 1.9 * 0.6 * NOISE).all()
    assert (width < 2.0 * 1.97 * 2.0 * NOISE).all()
    assert {"predictions.png", "predictions.svg"} <= {path.name for path in (folder / "out").iterdir()}


def test_a_stored_fit_predicts_the_same_without_a_fit(fitted: tuple[Path, str], tmp_path: Path):
    folder, _ = fitted
    run("--from", folder / "out", "--predict", folder / "between.csv", "--test", "shear", "--out", tmp_path / "again")
    first, again = rows(folder / "out/predictions.csv")[:19], rows(tmp_path / "again/predictions.csv")
    for name in ("predicted_Pa", "lower_Pa", "upper_Pa"):
        np.testing.assert_allclose(again[name], first[name], rtol=1e-9)
    record = json.loads((tmp_path / "again/predictions.json").read_text())
    stored = json.loads((folder / "out/coupon.json").read_text())["predictions"][0]
    assert record["predictions"][0]["nmad"] == pytest.approx(stored["nmad"], rel=1e-9)


def test_the_deviation_is_as_it_is_defined():
    time, strain = np.arange(1.0, 4.0), np.ones((3, 1))
    coupon = Coupon("x", "shear", strain, np.array([[1.0], [-2.0], [np.nan]]), time)
    one = PredictedCoupon(coupon, np.array([[2.0], [-3.0], [9.0]]), np.full((3, 1), 1.5))
    assert one.nmad == pytest.approx(1.0 / 2.5)
    assert one.factor == pytest.approx(8.0 / 13.0)
    assert one.nmad_by_factor == pytest.approx((abs(16 / 13 - 1) + abs(24 / 13 - 2)) / 2 / (20 / 13))
    assert one.error == pytest.approx(math.sqrt(2.0 / 5.0))
    assert one.inside == 1.0
    nothing = replace(coupon, stress=0.0 * coupon.stress)
    assert math.isinf(PredictedCoupon(nothing, np.zeros((3, 1)), np.full((3, 1), 1.5)).factor)


def test_the_band_of_a_law_alone_is_that_of_the_calibration():
    strain = strains_of("shear")
    noise = np.random.default_rng(2).normal(0.0, 3e3, (25, 1))
    coupon = Coupon("x", "shear", strain, MOONEY_RIVLIN["shear"](1e5, 3e4, strain) + noise)
    fit = compare_laws([coupon], ["yeoh"]).laws[0].fit
    (one,) = fit.tests([coupon])
    np.testing.assert_allclose(one.half[:, 0], fit.statistics.bands["x"]["shear stress"], rtol=1e-9)


@pytest.fixture
def forgotten() -> Iterator[None]:
    yield
    LAWS.remove("stiffening")


LAW = """\
laws:
  stiffening:
    energy: mu_0/(2*b)*(exp(b*(I1_bar - 3)) - 1)
    constants: {mu_0: modulus, b: positive ratio, kappa: modulus}
"""


@pytest.mark.usefixtures("forgotten")
def test_a_law_of_a_file_is_fitted_as_any_other(tmp_path: Path):
    laws = tmp_path / "laws.yaml"
    laws.write_text(LAW)
    gamma = np.linspace(0.1, 2.0, 20)
    stress = 0.2 * gamma * np.exp(0.3 * gamma**2)
    path = write_coupon(tmp_path / "a.csv", {"amount_of_shear": gamma, "shear_stress [MPa]": stress})
    words = [path, "--test", "shear", "--law", "stiffening", "--law", "yeoh", "--laws", laws, "--out", tmp_path / "out"]
    assert "Recommended: stiffening" in run(*words)
    fitted = json.loads((tmp_path / "out/coupon.json").read_text())["laws"]["stiffening"]["fitted"]
    assert fitted["mu_0"]["value"] == pytest.approx(2e5, rel=1e-6)
    assert fitted["b"]["value"] == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bodies: {}\n", "the file has no laws"),
        (LAW.replace("exp(b", "open(b"), "there is no such function"),
        (LAW.replace("- 3)) - 1", "- 3)) - 2"), "the energy at rest is not zero"),
        ("laws: [1]\n", "this is of the wrong kind"),
    ],
)
def test_a_bad_file_of_laws_is_refused(tmp_path: Path, text: str, said: str):
    laws = tmp_path / "laws.yaml"
    laws.write_text(text)
    path = table(tmp_path / "a.csv", 1.0, 1)
    done = CliRunner().invoke(app, ["coupon", str(path), "--test", "shear", "--laws", str(laws)])
    if "stiffening" in LAWS:
        LAWS.remove("stiffening")
    assert (done.exit_code, said in " ".join(done.output.split())) == (2, True), done.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "there is no test to fit"),
        ("DATA", "the kind of test is missing"),
        ("--from OUT", "there is no test to predict"),
        ("DATA --from OUT --predict DATA --test shear", "a stored fit is not fitted again"),
        ("--from OUT --predict DATA --test shear --law yeoh", "the record has no such law"),
        ("--from OUT --predict BARE --test shear", "this history needs the times of the rows"),
        ("DATA --predict BARE --test shear --history maxwell-1", "this history needs the times of the rows"),
        ("--from NONE --predict DATA --test shear", "the record of a fit cannot be read"),
        ("--from BROKEN --predict DATA --test shear", "this record of softcal coupon is damaged"),
        ("DATA --predict DATA --test shear --test shear --test shear", "2: one for each"),
    ],
)
def test_bad_requests_are_refused(fitted: tuple[Path, str], tmp_path: Path, words: str, said: str):
    folder, _ = fitted
    record = json.loads((folder / "out/coupon.json").read_text())
    del record["laws"]["neo-hooke"]["material"]["spread"]
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/coupon.json").write_text(json.dumps(record))
    bare = write_coupon(tmp_path / "bare.csv", {"amount_of_shear": np.linspace(0.1, 1.0, 9)})
    places = {"DATA": folder / "slow.csv", "OUT": folder / "out", "NONE": tmp_path / "none"}
    places |= {"BROKEN": tmp_path / "broken", "BARE": bare}
    given = [str(places.get(word, word)) for word in words.split()]
    done = CliRunner().invoke(app, ["coupon", *given, "--out", str(tmp_path / "out")])
    assert (done.exit_code, said in " ".join(done.output.split())) == (2, True), done.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("values", -5.0, "youngs_modulus -5 (allowed"),
        ("values", float("nan"), "youngs_modulus nan (allowed"),
        ("covariance", -1.0, "a variance or noise below zero"),
        ("noise", float("nan"), "a variance, noise or number of degrees of freedom that is none"),
        ("dof", 0.0, "a variance, noise or number of degrees of freedom that is none"),
        ("poissons_ratio", 0.5, "poissons_ratio 0.5 (allowed"),
    ],
)
def test_an_edited_record_is_refused(fitted: tuple[Path, str], tmp_path: Path, key: str, value: float, said: str):
    folder, _ = fitted
    record = json.loads((folder / "out/coupon.json").read_text())
    material = record["laws"]["neo-hooke"]["material"]
    if key == "poissons_ratio":
        record[key] = value
    elif key == "values":
        material[key][0] = value
    elif key == "covariance":
        material[key][0][0] = value
    elif key == "noise":
        material[key] = dict.fromkeys(material[key], value)
    else:
        material[key] = value
    (tmp_path / "coupon.json").write_text(json.dumps(record))
    words = ["coupon", "--from", str(tmp_path), "--predict", str(folder / "slow.csv"), "--test", "shear"]
    done = CliRunner().invoke(app, words)
    assert (done.exit_code, said in " ".join(done.output.split())) == (2, True), done.output
