"""Moduli at small strain: of every law, of a fit to coupon tests, and of rods that have a law."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from coupon_case import OGDEN, mooney_coupon, strains_of
from robot_case import write_robot

from softcal.errors import InputError, ParameterError
from softcal.materials.catalogue import LAWS
from softcal.plugins.coupons.comparison import LawComparison, compare_laws
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.material_block import material_block
from softcal.plugins.coupons.sentences import moduli
from softcal.plugins.coupons.tables import moduli_table, modulus_texts
from softcal.project.project import load
from softcal.twin.robot import Rod
from softcal.workflows.checking import check

MU, ALPHA = 215.4e3, 2.6
MAST = "youngs_modulus: 1 GPa\n      poissons_ratio: 0.35"
OGDEN_MAST = "law: ogden-1\n      mu1: 215.4 kPa\n      alpha1: 2.6\n      bulk_modulus: 140 MPa"


@pytest.fixture(scope="module")
def found() -> LawComparison:
    strain = strains_of("uniaxial", 2.0)
    stress = OGDEN["uniaxial"](MU, ALPHA, strain) * (1 + 0.01 * np.random.default_rng(0).normal(size=strain.shape))
    return compare_laws([Coupon("a", "uniaxial", strain, stress)], ["ogden-1", "yeoh", "neo-hooke"])


@pytest.mark.parametrize("name", LAWS)
def test_the_formula_is_the_shear_modulus(name: str):
    law = LAWS[name]
    theta = {p.name: p.typical for p in law.parameters}
    text = law.shear_formula.replace("^", "**").replace(" (", "*(").replace(" + ", "+").replace(" - ", "-")
    value = eval(text.replace(" ", "*"), {}, dict(theta))
    assert value == pytest.approx(law.shear_modulus(theta), rel=1e-3)
    at = law.at_small_strain(theta)
    assert at["youngs_modulus"] == pytest.approx(2 * law.shear_modulus(theta) * (1 + at["poissons_ratio"]))


def test_ogdens_mu_is_twice_the_shear_modulus_over_alpha():
    assert LAWS["ogden-1"].shear_formula == "alpha1 mu1/2"
    assert LAWS["mooney-rivlin"].shear_formula == "2 C01 + 2 C10"


def test_every_fitted_law_has_its_moduli(found: LawComparison):
    true = MU * ALPHA / 2 * 2 * 1.499
    by_name = {one.name: one for one in found.laws}
    at = by_name["ogden-1"].fit.small_strain
    assert at.youngs_modulus == pytest.approx(true, rel=0.02)
    assert at.interval is not None
    assert at.interval[1] * at.interval[0] == pytest.approx(at.youngs_modulus**2)
    assert 0.002 < (at.interval[1] - at.interval[0]) / true < 0.05
    assert (at.formula, at.poissons_ratio) == ("alpha1 mu1/2", pytest.approx(0.499))
    of_one = by_name["neo-hooke"].fit
    assert of_one.small_strain.interval == pytest.approx(of_one.estimates["youngs_modulus"].interval, rel=1e-6)
    table = moduli_table(found)
    assert [row[0] for row in table.rows] == [one.name for one in found.laws]
    said = moduli(by_name["ogden-1"])
    E, interval = modulus_texts(at)
    assert said.startswith(f"At small strain ogden-1 has E = {E} ({interval}) and ν = 0.499")
    assert re.search(r"its shear modulus is alpha1 mu1/2 = 2\d\d kPa", said)
    block = material_block(by_name["ogden-1"].fit, found, "arm")
    assert re.search(r"# G = alpha1 mu1/2 = 2\d\d kPa\.", block)
    assert "# A rod (robot.rods.arm) takes the law" in block


def test_what_is_not_determined_has_no_interval():
    (one,) = compare_laws([mooney_coupon("a", "uniaxial", (0.2e6, 0.0))], ["gent"]).laws
    assert not one.fit.is_determined
    assert one.fit.small_strain.interval is None
    assert "(" not in moduli(one).partition(" and ")[0]


def test_a_rod_takes_a_law_and_has_its_moduli_at_small_strain(tmp_path: Path):
    project = load(write_robot(tmp_path, (MAST, OGDEN_MAST)))
    rod = project.robot.rods[0]
    theta = {"mu1": MU, "alpha1": ALPHA, "bulk_modulus": 140e6}
    assert rod.parameters == pytest.approx(LAWS["ogden-1"].at_small_strain(theta))
    assert rod.parameters["youngs_modulus"] == pytest.approx(3 * MU * ALPHA / 2, rel=2e-3)
    assert "mast.youngs_modulus" in project.parameters
    rows = check(project, solve=False).rows
    said = next(text for name, text in rows if name == "  material" and "ogden" in text)
    assert said.startswith("ogden-1 at small strain, as rods use it at any: E 83")
    alone = Rod("mast", rod.centreline, rod.section, LAWS["ogden-1"].at_small_strain(theta), rod.clamped, law="ogden-1")
    assert alone.parameters == rod.parameters


@pytest.mark.parametrize(
    ("written", "told"),
    [
        (f"{OGDEN_MAST}\n      youngs_modulus: 1 MPa", "unknown key; got 'youngs_modulus'"),
        ("law: ogden-1\n      mu1: 1 MPa\n      bulk_modulus: 140 MPa", "alpha1"),
        ("law: ogdn-1", "there is no such law; got 'ogdn-1'"),
        (
            "law: neo-hooke-layered\n      youngs_modulus: 1 MPa\n      poissons_ratio: 0.4\n      build_ratio: 1.1",
            "law: a rod has one modulus; got 'neo-hooke-layered'",
        ),
    ],
)
def test_what_is_wrong_with_the_law_of_a_rod_is_said(tmp_path: Path, written: str, told: str):
    with pytest.raises(InputError, match=told):
        load(write_robot(tmp_path, (MAST, written)))


def test_constants_that_a_law_does_not_allow_are_refused_at_the_rod(tmp_path: Path):
    both = OGDEN_MAST.replace("alpha1: 2.6", "alpha1: -2.6")
    with pytest.raises(InputError, match="mast"):
        load(write_robot(tmp_path, (MAST, both)))


def test_the_law_of_the_file_is_looked_at_at_rest(tmp_path: Path):
    laws = "laws:\n  bad: {energy: mu*(I1_bar - 2), constants: {mu: modulus, kappa: modulus}}\nrobot:\n"
    mast = "law: bad\n      mu: 1 MPa\n      kappa: 100 MPa"
    with pytest.raises(InputError, match="the energy at rest is not zero"):
        load(write_robot(tmp_path, ("robot:\n", laws), (MAST, mast)))
    assert "bad" not in LAWS
    with pytest.raises(ParameterError):
        LAWS.named("bad")
