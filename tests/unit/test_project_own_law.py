"""A law in the project file, by the text of its energy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project

from softcal import load
from softcal.errors import ProjectFileError
from softcal.materials.catalogue import LAWS
from softcal.project.law_schema import OwnLawSection
from softcal.project.own_law import read_laws
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

LAW = """\
laws:
  stiffening:
    energy: mu/(2*b)*(exp(b*(I1_bar - 3)) - 1)
    constants: {mu: modulus, b: positive ratio, kappa: modulus}
robot:
"""
OWN = "      law: stiffening\n      mu: 0.7 MPa\n      b: 2\n      kappa: 4 MPa\n"
CONSTANTS = "      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n"
FREE = "  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n"
CHANGES = (
    ("robot:\n", LAW),
    (CONSTANTS, OWN),
    (FREE, "  bar.mu: {bounds: [0.1 MPa, 4 MPa], scale: log}\n  bar.b: {bounds: [0.001, 2], scale: log}\n"),
)


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    yield
    LAWS.remove("stiffening")


def test_it_is_used_as_any_other(tmp_path: Path) -> None:
    project = load(write_project(tmp_path, *CHANGES))
    law = LAWS["stiffening"]
    assert law.shear_modulus({"mu": 7e5, "b": 2.0, "kappa": 4e6}) == pytest.approx(7e5, rel=1e-12)
    assert project.space is not None
    assert {one.name for one in project.space.parameters} >= {"bar.mu", "bar.b"}
    pull = Protocol({"front": Command("shortening", np.array([0.0, 0.01]))})
    own = simulate(project.robot, pull).channels["front.tension"]
    (body,) = project.robot.bodies
    neo = replace(body, law="yeoh", parameters={"C10": 0.35e6, "C20": 0.0, "C30": 0.0, "bulk_modulus": 4e6})
    soft = simulate(replace(project.robot, bodies=(neo,)), pull).channels["front.tension"]
    assert own[1] == pytest.approx(soft[1], rel=0.02)
    assert own[1] > soft[1] * (1.0 + 1e-4)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("exp(b*(I1_bar - 3)) - 1", "open('x')"), r"laws\.stiffening\.energy: there is no such function"),
        (("- 3)) - 1", "- 2)) - 1"), r"laws\.stiffening\.energy: the energy at rest is not zero"),
        (
            ("exp(b*(I1_bar - 3)) - 1", "J - 1"),
            r"energy: the (law is not free|shear modulus at rest)",
        ),
        (("mu/(2*b)", "mu/b*(J - 1) + mu/(2*b)"), r"laws\.stiffening\.energy: the law is not free of stress at rest"),
        (("b: positive ratio", "b: length"), r"laws\.stiffening\.constants\.b: a constant cannot be of this kind"),
        (("mu/(2*b)", "-mu/(2*b)"), r"laws\.stiffening\.energy: the shear modulus at rest is not above zero"),
        (("mu/(2*b)", "nu/(2*b)"), r"the law has no such symbol; got 'nu'"),
        (("    energy:", "    enrgy:"), r"laws\.stiffening\.enrgy: unknown key"),
        (("  stiffening:", "  yeoh:"), r"laws\.yeoh: .*another law of this name"),
    ],
)
def test_what_is_wrong_with_it_is_said_at_its_place(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    assert change[0] in LAW
    changed = (("robot:\n", LAW.replace(*change)), *CHANGES[1:])
    with pytest.raises(ProjectFileError, match=told):
        load(write_project(tmp_path, *changed))
    assert "stiffening" not in LAWS  # so that it can be mended and read again


NEO = "mu/2*(I1_bar - 3)"
MODULI = "{mu: modulus, kappa: modulus}"
DOUBLING = ", ".join(f"a{k}: exp(a{k - 1})+log(a{k - 1})+J" for k in range(1, 25))


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        # Numbers that SymPy would work out until memory ends.
        ({"energy": f"{NEO} + 0*2**(99*99*99*99*99*99)"}, r"energy: this power is too large"),
        ({"energy": f"{NEO} + 0*3**(99*99*99*99*(99+99))"}, r"energy: this power is too large"),
        ({"energy": f"{NEO} + 0*((((10**99)**99)**99)**99)"}, r"energy: the numbers of this become too long"),
        ({"energy": f"{NEO} + 0*7**n", "symbols": '{n: "999999999999"}'}, r"energy: this power is too large"),
        ({"bulk": "kappa + 0*7**(99*99*99*99*99*99)"}, r"bulk: this power is too large"),
        ({"bulk": "kappa + 0*7**n", "symbols": '{n: "999999999999"}'}, r"bulk: this power is too large"),
        ({"volumetric_strain": "J - 1 + 0*7**(99*99*99*99*99)"}, r"volumetric_strain: this power is too large"),
        ({"symbols": f"{{a0: J, {DOUBLING}}}"}, r"symbols\.a3: this power is too large"),
        # Tracebacks once.
        ({"symbols": '{a: "a + 1"}'}, r"symbols\.a: this symbol leads back to itself.*got 'a'"),
        ({"symbols": "{a: b, b: a}"}, r"symbols\.a: this symbol leads back to itself.*got 'b'"),
        (
            {"energy": "exp*(exp(I1_bar - 3) - 1)", "constants": "{exp: modulus, kappa: modulus}"},
            "stands for an invariant, a function or a number",
        ),
        ({"bulk": "kappa*J"}, r"bulk: a symbol is not allowed; got J; allowed: constants and numbers"),
        ({"bulk": '"0"'}, r"bulk: this, its inverse or a derivative is not a finite real function"),
        ({"bulk": "mu - mu"}, r"bulk: this, its inverse or a derivative is not a finite real function"),
        ({"energy": "Rational(mu, 2)*(I1_bar - 3)"}, r"energy: Rational is of two whole numbers"),
        ({"energy": "mu*sqrt(-1)*(I1_bar - 3)**2"}, r"energy: this is not a real number; got 'sqrt\(-1\)'"),
        ({"energy": "mu/2*(I1_bar - 3) + mu*sqrt(-J)"}, r"energy: this is not a real number at rest"),
        ({"volumetric_strain": '"0"'}, r"energy: the bulk modulus at rest is not above zero; got 0 Pa"),
        ({"volumetric_strain": "(J - 1)**2"}, r"energy: the bulk modulus at rest is not above zero; got 0 Pa"),
        ({"volumetric_strain": "kappa*(J - 1)"}, r"volumetric_strain: a symbol is not allowed; got kappa"),
        ({"volumetric_strain": "sqrt(J - 1)"}, r"volumetric_strain: this, its inverse or a derivative is not a"),
        # Names that mean something else, of which some gave wrong numbers in silence.
        (
            {"energy": "e/2*exp(0*J + 1)*(I1_bar - 3)", "constants": "{e: modulus, kappa: modulus}"},
            "stands for an invariant, a function or a number",
        ),
        (
            {"energy": "pi/2*(I1_bar - 3)", "constants": "{pi: modulus, kappa: modulus}"},
            "stands for an invariant, a function or a number",
        ),
        (
            {"energy": "J/2*(I1 - 3)", "constants": "{J: modulus, kappa: modulus}"},
            "stands for an invariant, a function or a number",
        ),
        ({"constants": "{I1_bar: modulus, mu: modulus, kappa: modulus}"}, "constants.I1_bar: this stands for an inv"),
        ({"symbols": "{I1_bar: I1}"}, r"symbols.I1_bar: this stands for an invariant"),
        ({"constants": "{lambda: modulus, mu: modulus, kappa: modulus}"}, r"cannot be a name; got 'lambda'"),
        ({"constants": "{µ: modulus, mu: modulus, kappa: modulus}"}, r"cannot be a name"),
        ({"constants": "{clamp: modulus, mu: modulus, kappa: modulus}"}, r"the name is taken by a key of a body"),
        # What has no derivatives, or is no law of an isotropic body.
        ({"energy": f"{NEO} + mu*sqrt((J - 1)**2)"}, r"energy: this, its inverse or a derivative is not a finite"),
        (
            {"energy": "mu*sqrt(I1_bar - 3)"},
            r"energy: this power has, or may have, infinite derivatives at rest, where its base is 0",
        ),
        (
            {"energy": "mu/2*(I1_bar - 3)**n", "constants": "{mu: modulus, n: positive ratio, kappa: modulus}"},
            r"energy: this power has, or may have, infinite derivatives at rest, where its base is 0"
            r"; got \(I1.* - 3\)\*\*n; allowed: a number as its exponent: 1, or 2 and more. Try: .*yeoh",
        ),
        (
            {"energy": f"{NEO} + mu*(I1_bar - 3)**1.5"},
            r"energy: this power has, or may have, infinite .* got .*\*\*1.5; allowed",
        ),
        ({"energy": "mu*(lambda1 - 1)**2"}, r"energy: the energy changes where the stretches change places"),
        ({"energy": "mu*(I1 - 3) + lambda1"}, r"energy: the law has no such symbol; got 'I1'"),
        ({"energy": "mu**mu**mu*(I1_bar - 3)"}, r"energy: the shear modulus at rest is not above zero"),
        ({"energy": "(-mu)**mu*(I1_bar - 3)"}, r"energy: (the shear modulus|this, its inverse)"),
        ({"energy": "log(-mu)*(I1_bar - 3)"}, r"energy: (the shear modulus|this, its inverse)"),
        ({"energy": "J**J**J*" + NEO + "**1e400"}, r"energy: this number is too large"),
        ({"energy": "'mu\n'"}, r"energy: "),
    ],
)
def test_a_law_without_sense_is_refused_in_a_sentence(tmp_path: Path, keys: dict[str, str], told: str) -> None:
    law = {"energy": NEO, "constants": MODULI, **keys}
    path = tmp_path / "laws.yaml"
    path.write_text("laws:\n  stiffening:\n" + "".join(f"    {key}: {text}\n" for key, text in law.items()))
    start = time.process_time()
    with pytest.raises(ProjectFileError, match=rf"laws\.yaml:\d+: laws\.stiffening.*{told}"):
        read_laws(path)
    assert time.process_time() - start < 5.0


def test_the_formula_of_a_long_law_has_an_end() -> None:
    constants = {"mu": "modulus", "kappa": "modulus", **{f"a{k}": "ratio" for k in range(6)}}
    law = OwnLawSection(energy="mu*(a0 + a1 + a2 + a3 + a4 + a5)**90*(I1_bar - 3)", constants=constants)
    assert law.law("stiffening").shear_formula == "2 mu (a0 + a1 + a2 + a3 + a4 + a5)^90"


@pytest.mark.parametrize("power", ["1", "1.0", "2", "2.5"])
def test_powers_with_finite_derivatives_at_rest_are_laws(power: str) -> None:
    law = OwnLawSection(energy=f"mu/2*((I1_bar - 3) + (I1_bar - 3)**{power})", constants={"mu": "modulus"}, bulk="mu")
    shear = law.law("stiffening").shear_modulus({"mu": 7e5})
    assert shear == pytest.approx(7e5 * (2.0 if float(power) == 1.0 else 1.0), rel=1e-12)


def test_a_constant_may_be_called_s() -> None:
    law = OwnLawSection(energy="s/2*(I1_bar - 3)", constants={"s": "modulus", "kappa": "modulus"}).law("stiffening")
    assert law.shear_modulus({"s": 7e5, "kappa": 4e6}) == pytest.approx(7e5, rel=1e-12)


def test_the_faults_of_a_law_are_not_repeated_at_each_body(tmp_path: Path) -> None:
    changed = (("robot:\n", LAW.replace("exp(b", "expo(b")), *CHANGES[1:])
    with pytest.raises(ProjectFileError) as error:
        load(write_project(tmp_path, *changed))
    assert len(error.value.faults) == 1


@pytest.mark.parametrize(
    ("factor", "count"),
    [("mu**2/(2*b)", 1), ("(mu + 1)/(2*b)", 1), ("1000/(2*b)", 1), ("mu*exp(mu/kappa)/(2*b)", 0), ("mu/(2*b)", 0)],
)
def test_an_energy_that_is_no_pressure_is_warned_of(tmp_path: Path, factor: str, count: int) -> None:
    constants = "mu: modulus, kappa: modulus, b: positive ratio"
    text = LAW.replace("mu/(2*b)", factor).replace("mu: modulus, b: positive ratio, kappa: modulus", constants)
    if "mu" not in factor:
        text = text.replace("mu: modulus, ", "")
    own = OWN if "mu" in factor else OWN.replace("      mu: 0.7 MPa\n", "")
    project = load(write_project(tmp_path, ("robot:\n", text), (CONSTANTS, own), (FREE, "")))
    assert sum("not proportional to its moduli" in str(warning) for warning in project.warnings) == count


def test_a_constant_that_is_in_no_text_is_warned_of(tmp_path: Path) -> None:
    text = LAW.replace("kappa: modulus}", "kappa: modulus, c: ratio}")
    project = load(write_project(tmp_path, ("robot:\n", text), (CONSTANTS, OWN + "      c: 1\n"), (FREE, "")))
    (warning,) = [str(one) for one in project.warnings if "no expression has this constant" in str(one)]
    assert "laws.stiffening.constants.c" in warning
