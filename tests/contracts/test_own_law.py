"""A law in one file of the user's own: registered, it works from the project file as softcal's laws do."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from own_module import imported
from project_case import PROJECT, bar_robot, write_project

from softcal import Law, Parameter, calibrate, load, quantity, register_law, robot_parameters
from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.materials.catalogue import LAWS
from softcal.plugins.calculix.deck import in_its_law
from softcal.plugins.sofa.robot import linear_robot
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.checking import check

GENT = """
from softcal import Law, Parameter, quantity, register_law

GENT = register_law(
    Law(
        name="own-gent",
        parameters=(
            Parameter("shear_modulus", "mu", "μ₀", quantity("modulus"), typical=4e5),
            Parameter("limit", "Jm", "J_m", quantity("positive ratio"), typical=50.0),
            Parameter("bulk_modulus", "kappa", "κ", quantity("modulus"), typical=4e6, default=2e6),
        ),
        symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
        distortional="-mu*Jm/2*log(1 - (I1_bar - 3)/Jm)",
        volumetric_strain="J - 1",
        bulk="kappa",
        reference="Gent, Rubber Chemistry and Technology 69 (1996) 59",
    )
)
"""
MU, LIMIT, KAPPA = 0.45e6, 0.4, 2e6


@pytest.fixture
def gent(tmp_path: Path) -> Generator[Law]:
    """Gent's law, as a module of the user's registers it."""
    yield imported(tmp_path / "gent_law.py", GENT).GENT
    LAWS.remove("own-gent")


def gent_project(folder: Path, *changes: tuple[str, str]) -> Path:
    """The project of a bar with the law, and bench data made by it."""
    (body,) = bar_robot().bodies
    own = replace(body, law="own-gent", parameters={"shear_modulus": MU, "limit": LIMIT, "bulk_modulus": KAPPA})
    shortening = np.linspace(0.0, 0.02, 25)
    seen = simulate(replace(bar_robot(), bodies=(own,)), Protocol({"front": Command("shortening", shortening)}))
    assert seen.succeeded, seen.status
    table = np.column_stack(
        [
            0.1 * np.arange(25),
            1e3 * shortening,
            seen.channels["front.tension"],
            np.rad2deg(seen.channels["plate.pitch"]),
        ]
    )
    lines = ["Time [s],Displacement [mm],Force [N],Pitch [deg]"]
    lines += [",".join(f"{value:.8f}" for value in row) for row in table]
    text = PROJECT.replace(
        "      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n",
        "      law: own-gent\n      shear_modulus: 0.3 MPa\n      limit: 2\n",
    )
    text = text.replace(
        "  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n"
        "  front.slack: {bounds: [0 mm, 5 mm], per: experiment}\n",
        "  bar.shear_modulus: {bounds: [0.1 MPa, 4 MPa], scale: log}\n  bar.limit: {bounds: [0.3, 5], scale: log}\n",
    )
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = write_project(folder, data="\n".join(lines) + "\n")
    path.write_text(text, encoding="utf-8")
    return path


def test_both_constants_are_calibrated_from_a_project_file(gent: Law, tmp_path: Path) -> None:
    project = load(gent_project(tmp_path))
    assert robot_parameters(project.robot)["bar.bulk_modulus"].value == KAPPA  # the law's default
    assert any("μ₀ 300 kPa, J_m 2, κ 2 MPa" in str(row) for row in check(project).rows)
    (result,) = calibrate(project, out=tmp_path / "run").results.values()
    assert "Converged" in result.status
    assert result.parameters["bar.shear_modulus"].value == pytest.approx(MU, rel=1e-3)
    assert result.parameters["bar.limit"].value == pytest.approx(LIMIT, rel=1e-2)


@pytest.mark.slow
def test_workers_know_the_law(gent: Law, tmp_path: Path) -> None:
    project = load(gent_project(tmp_path))
    here, there = (
        next(
            iter(calibrate(project, out=tmp_path / f"{n}", method="tpe", trials=4, workers=n, seed=1).results.values())
        )
        for n in (1, 2)
    )
    assert [trial.loss for trial in there.trials] == [trial.loss for trial in here.trials]
    assert all(trial.loss is not None for trial in there.trials)


def test_sofa_refuses_it_and_calculix_gets_its_moduli_at_small_strain(gent: Law, tmp_path: Path) -> None:
    robot = load(gent_project(tmp_path)).robot
    with pytest.raises(ParameterError, match=r"bar\.law: SOFA does not support this law; got own-gent"):
        linear_robot(robot)
    (body,) = in_its_law(robot).bodies
    E = 9.0 * KAPPA * 0.3e6 / (3.0 * KAPPA + 0.3e6)
    assert body.parameters["youngs_modulus"] == pytest.approx(E, rel=1e-12)
    assert body.parameters["poissons_ratio"] == pytest.approx(0.5 * E / 0.3e6 - 1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("      limit: 2\n", ""), r"bar\.limit: a key is missing; allowed: 'limit' must be given"),
        (("limit: 2\n", "limit: -2\n"), r"robot\.bodies\.bar\.limit: the positive ratio is out of range; got -2"),
        (("limit: 2\n", "limit: 2 MPa\n"), r"bar\.limit: the unit does not fit; got 'MPa'; allowed: a plain number"),
        (("limit: 2\n", "limit: 2\n      youngs_modulus: 2 MPa\n"), r"bar\.youngs_modulus: unknown key"),
        (("limit: 2\n", "limti: 2\n"), r"bar\.limti: unknown key; .* Try: 'limit'"),
    ],
)
def test_faults_of_its_constants_are_those_of_any_key(
    gent: Law, tmp_path: Path, change: tuple[str, str], told: str
) -> None:
    with pytest.raises(ProjectFileError, match=told) as error:
        load(gent_project(tmp_path, change))
    assert len(error.value.faults) == 1


def test_a_law_that_cannot_be_told_from_others_is_refused(gent: Law) -> None:
    modulus = quantity("modulus")
    with pytest.raises(ParameterError, match="another law of this name"):
        register_law(replace(gent, bulk="2*kappa"))
    assert register_law(gent) is gent
    for constant, told in (
        (Parameter("poissons_ratio", "nu", "ν", modulus, 1.0), "another unit"),
        (Parameter("density", "rho", "ρ", modulus, 1.0), "the name is taken by a key of a body"),
        (Parameter("stiff ness", "k", "k", modulus, 1.0), "cannot be a name"),
        (Parameter("stiffness", "J", "k", modulus, 1.0), "stands for an invariant"),
        (Parameter("stiffness", "mu", "k", modulus, 1.0), "two symbols have one name"),
    ):
        with pytest.raises(ParameterError, match=told):
            register_law(replace(gent, name="other", parameters=(*gent.parameters, constant)))
    assert "other" not in LAWS


def test_an_expression_that_cannot_be_read_is_refused_at_once(gent: Law) -> None:
    wrong = replace(gent, name="wrong", distortional="mu*(I1 - 3", bulk="kapa + mu")
    with pytest.raises(ParameterError) as error:
        register_law(wrong)
    told = str(error.value)
    assert "law wrong, distortional: this is not an expression; got 'mu*(I1 - 3'" in told
    assert "law wrong, bulk: the law has no such symbol; got 'kapa'" in told
    assert "Try: 'kappa'" in told
    assert len(error.value.faults) == 2


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"distortional": "mu/2*(I1 - 3)"}, "distortional: the law is not free of stress at rest; got .* Pa, at"),
        ({"distortional": "mu/2*(I1_bar - 2)"}, "distortional: the energy at rest is not zero"),
        ({"distortional": "-mu/2*(I1_bar - 3)"}, "distortional: the shear modulus at rest is not above zero"),
        ({"distortional": "mu/2*(I1_bar - 3)**1.5"}, "distortional: this power has, or may have, infinite derivatives"),
        ({"bulk": "0"}, "bulk: this, its inverse or a derivative is not a finite"),
        ({"volumetric_strain": "J"}, "distortional: the (energy at rest is not zero|law is not free of stress)"),
    ],
)  # fmt: skip
def test_a_law_that_is_none_at_rest_is_refused_as_it_is_registered(
    gent: Law, change: dict[str, str], told: str
) -> None:
    with pytest.raises(ParameterError, match=f"law wrong, {told}"):
        register_law(replace(gent, name="wrong", **change))
    assert "wrong" not in LAWS


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"name": 5}, "name: this is of the wrong kind; got 5; allowed: text"),
        ({"name": " "}, "law: this cannot be a name; got ' '"),
        ({"parameters": None}, "parameters: this is of the wrong kind; got None"),
        ({"parameters": (5,)}, "parameters.* wrong kind"),
        ({"symbols": ["a"]}, "symbols: this is of the wrong kind"),
        ({"symbols": {5: "J"}}, "symbols: a name is of the wrong kind; got 5"),
        ({"volumetric_strain": 3}, "volumetric_strain: this is of the wrong kind; got 3"),
    ],
)
def test_a_law_of_other_kinds_is_refused(gent: Law, change: dict[str, object], told: str) -> None:
    with pytest.raises(InputError, match=told):
        register_law(replace(gent, **{"name": "wrong", **change}))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"name": 5}, "name: this is of the wrong kind; got 5; allowed: text"),
        ({"quantity": "modulus"}, "quantity: this is of the wrong kind; got 'modulus'; allowed: a Quantity"),
        ({"typical": float("nan")}, "typical: this is not finite"),
        ({"typical": -1.0}, "stiffness, typical: the modulus is out of range"),
        ({"default": -1.0}, "stiffness, default: the modulus is out of range"),
        ({"default": "3"}, "default: this is of the wrong kind; got '3'"),
    ],
)
def test_a_constant_of_another_kind_or_out_of_range_is_refused(change: dict[str, object], told: str) -> None:
    with pytest.raises(InputError, match=told):
        replace(Parameter("stiffness", "k", "k", quantity("modulus"), 1e6), **change)  # type: ignore[arg-type]
