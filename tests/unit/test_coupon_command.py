"""`softcal coupon`: which law is recommended, what is printed and written, and the block of a project file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from coupon_case import MOONEY_RIVLIN, mooney_coupon, strains_of, write_coupon
from project_case import write_project
from ruamel.yaml import YAML
from typer.testing import CliRunner

from softcal.calibration.problem.loss import gradient, total
from softcal.cli import app
from softcal.materials.catalogue import LAWS as MATERIALS
from softcal.plugins.coupons.comparison import compare_laws
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import free_constants
from softcal.plugins.coupons.held_out import folds
from softcal.plugins.coupons.material_block import material_block, priors
from softcal.plugins.coupons.problem import CouponProblem, coupon_loss
from softcal.project.project import load

C10, C01 = 2e5, 5e4
LAWS = ("neo-hooke", "mooney-rivlin", "yeoh")


def noisy(name: str, test: str, constants: tuple[float, float], seed: int):
    noise = np.random.default_rng(seed).normal(0.0, 4e3, 25)
    return mooney_coupon(name, test, constants, noise)


@pytest.fixture(scope="module")
def specimens():
    """Five specimens of one kind of test, whose C10 differs by 5 %."""
    factors = 1 + 0.05 * np.array([-1.3, -0.4, 0.1, 0.5, 1.1])
    return [noisy(f"s{i}", "uniaxial", (C10 * factor, C01), i) for i, factor in enumerate(factors)]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory):
    """The command on two kinds of test, and its folder."""
    folder = tmp_path_factory.mktemp("coupon")
    files: list[str] = []
    for test in ("uniaxial", "equibiaxial"):
        strain = strains_of(test)[:, 0]
        noise = np.random.default_rng(7).normal(0.0, 4e-3, len(strain))
        stress = 1e-6 * MOONEY_RIVLIN[test](C10, C01, strain) + noise
        columns = {"stretch": strain, "nominal_stress [MPa]": stress}
        files.append(str(write_coupon(folder / f"{test}.csv", columns)))
    words = [
        "coupon",
        *files,
        "--test",
        "uniaxial",
        "--test",
        "equibiaxial",
        *(w for law in LAWS for w in ("--law", law)),
    ]
    done = CliRunner().invoke(app, [*words, "--body", "bar", "--out", str(folder / "out")])
    assert done.exit_code == 0, done.output
    return done.output, folder / "out"


@pytest.mark.slow
def test_the_law_that_made_the_data_is_recommended(written: tuple[str, Path]):
    said, folder = written
    record = json.loads((folder / "coupon.json").read_text())
    assert record["recommended"] == "mooney-rivlin"
    assert "Recommended: mooney-rivlin, stable up to strains of the size measured" in said
    errors = {name: law["held_out_error"] for name, law in record["laws"].items()}
    assert min(errors, key=lambda name: errors[name]) == "mooney-rivlin"
    assert list(record["laws"]["yeoh"]["held_out"]) == ["uniaxial", "equibiaxial"]
    assert min(record["laws"], key=lambda name: record["laws"][name]["aic"]) == "mooney-rivlin"


def test_everything_is_written(written: tuple[str, Path]):
    _, folder = written
    charts = [f"{stem}.{kind}" for stem in ("laws", *LAWS) for kind in ("png", "svg")]
    tables = ["report.html", "coupon.json", "material.yaml", "constants.csv", "laws.csv", "stresses.csv"]
    assert sorted(path.name for path in folder.iterdir()) == sorted([*charts, *tables])
    fitted = json.loads((folder / "coupon.json").read_text())["laws"]["mooney-rivlin"]["fitted"]
    for name, true in (("C10", C10), ("C01", C01)):
        low, high = fitted[name]["interval"]
        assert low < high < low + 0.2 * true
        assert true == pytest.approx(0.5 * (low + high), abs=high - low)
    stresses = np.genfromtxt(folder / "stresses.csv", delimiter=",", names=True)
    assert np.abs(stresses["mooneyrivlin_Pa"] / stresses["measured_Pa"] - 1).mean() < 0.05


def test_the_scatter_between_specimens_is_the_prior_of_a_further_body(specimens: list[Coupon], tmp_path: Path):
    found = compare_laws(specimens, ["mooney-rivlin"])
    fit = found.laws[0].fit
    mean, sd = priors(fit, found)["C10"]
    assert mean == pytest.approx(C10, rel=0.03)
    assert 0.02 * C10 < sd < 0.15 * C10
    shares = fit.estimates["C10"].shares
    assert shares["experiments"] > 0.5
    block = YAML(typ="safe").load(material_block(fit, found, "bar"))
    stated = block.pop("parameters")
    lines = "".join(f"      {key}: {value}\n" for key, value in block.items())
    free = f"  bar.C10: {json.dumps(stated['bar.C10'])}\n"
    path = write_project(
        tmp_path,
        ("      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n", lines),
        ("  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n", free),
    )
    project = load(path)
    (body,) = project.robot.bodies
    assert body.law == "mooney-rivlin"
    for name, value in fit.theta.items():
        assert body.parameters[name] == pytest.approx(value, rel=1e-5)
    assert project.space is not None
    (prior,) = [p for p in project.space.parameters if p.name == "bar.C10"]
    assert (prior.prior_mean, prior.prior_sd) == (pytest.approx(mean, rel=1e-5), pytest.approx(sd, rel=1e-2))


def test_names_that_yaml_takes_for_something_else_stay_names(specimens: list[Coupon]):
    found = compare_laws(specimens, ["yeoh"])
    fit = found.laws[0].fit
    named = replace(fit, constants=replace(fit.constants, law=replace(fit.law, name="a: [b")))
    block = YAML(typ="safe").load(material_block(named, found, "1 (x)"))
    assert block["law"] == "a: [b"
    assert all(name.startswith("1 (x).") for name in block["parameters"])


def test_one_specimen_gives_no_prior():
    found = compare_laws([noisy("one", "uniaxial", (C10, C01), 3)], ["neo-hooke"])
    text = material_block(found.laws[0].fit, found, "bar")
    assert "No prior: 1 specimen of one kind of test" in text
    assert "parameters:" not in text


def test_laws_that_are_the_same_in_a_coupon_are_listed_once():
    tests = [noisy("one", "uniaxial", (C10, C01), 3), noisy("two", "planar", (C10, C01), 4)]
    found = compare_laws(tests, ["neo-hooke", "neo-hooke-isochoric", "stable-neo-hooke", "yeoh"])
    assert found.same_as == {"neo-hooke-isochoric": "neo-hooke", "stable-neo-hooke": "neo-hooke"}
    assert {one.name for one in found.laws} == {"neo-hooke", "yeoh"}


def test_an_unstable_law_is_marked_and_not_recommended():
    """Stresses of a law that gives way: the fit that follows them is not recommended."""
    tests = [noisy("one", "uniaxial", (1e5, -8e4), 1), noisy("two", "equibiaxial", (1e5, -8e3), 2)]
    found = compare_laws(tests, ["mooney-rivlin"])
    assert not found.laws[0].fit.stability.is_stable
    assert found.recommended is None


def test_one_kind_of_test_is_held_out_in_blocks_of_rows():
    coupons = [noisy("one", "uniaxial", (C10, C01), 3), noisy("two", "uniaxial", (C10, C01), 4)]
    found = folds(coupons)
    assert len(found) == 5
    for fold in found:
        assert sum(len(c.strain) for c in (*fold.kept, *fold.held_out)) == 50
        highest = max(c.strain.max() for c in fold.held_out)
        assert not any(((c.strain > fold.held_out[0].strain.min()) & (c.strain < highest)).any() for c in fold.kept)


def test_the_intervals_are_those_of_the_loss_that_is_fitted():
    tests = [noisy("one", "uniaxial", (C10, C01), 3), noisy("two", "planar", (C10, C01), 4)]
    problem = CouponProblem(free_constants(MATERIALS["yeoh"]), tests, coupon_loss(tests))
    values = np.array([2e5, 1e3, 50.0])
    residuals, blocks = problem.residuals(values), problem.blocks(values)
    assert total(problem.loss, blocks) == pytest.approx(float(residuals @ residuals))
    slope = gradient(problem.loss, blocks)
    np.testing.assert_allclose(slope, 2 * residuals @ problem.jacobian(values), rtol=1e-10)


def test_akaikes_criterion_counts_the_constants_and_the_noise():
    tests = [noisy("one", "uniaxial", (C10, C01), 3)]
    fit = compare_laws(tests, ["mooney-rivlin"]).laws[0].fit
    n, k = 25, 3
    assert fit.aic == pytest.approx(n * np.log(fit.error**2) + 2 * k + 2 * k * (k + 1) / (n - k - 1))
