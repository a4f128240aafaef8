"""Coupons with times: a law and a history along the rows, as they were strained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from coupon_case import write_coupon
from mechanics_cases import held, irregular_box, placed
from project_case import write_project
from ruamel.yaml import YAML
from typer.testing import CliRunner

from softcal.checks import Floats
from softcal.cli import app
from softcal.materials.catalogue import LAWS
from softcal.materials.histories import history_of
from softcal.plugins.coupons.comparison import compare_laws
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import free_constants
from softcal.plugins.coupons.held_out import folds
from softcal.plugins.coupons.history_response import response_of
from softcal.plugins.coupons.material_block import material_block
from softcal.project.project import load
from softcal.twin.build import build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Body, Robot

# Up, a hold, down and up again beyond.
TIMES = np.array([0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 9.0, 9.5, 10.0, 10.5, 11.5, 12.5, 13.0])
STRAIN = np.array([0.2, 0.4, 0.6, 0.8, 0.8, 0.8, 0.8, 0.5, 0.2, 0.05, 0.4, 0.8, 1.2])
HISTORY = {
    "softening_amount": 2.0, "softening_energy": 4e4, "softening_range": 0.1,
    "relaxing_share1": 0.3, "relaxation_time1": 2.0,
    "branch_modulus1": 1.5e5, "branch_time1": 1.2, "branch_exponent": 1.3,
    "flow_modulus": 1e5, "flow_threshold": 2e4, "flow_time": 3.0,
}  # fmt: skip
LAW = {"C10": 1e5, "C20": 5e3, "C30": 200.0}


def strains(test: str, strain: Floats) -> Floats:
    if test == "shear":
        return strain[:, None]
    return np.column_stack([1.0 + strain, 1.0 + 0.4 * strain]) if test == "biaxial" else 1.0 + strain[:, None]


def pulled(
    name: str, test: str, parts: tuple[str, ...], rate: float = 1.0, law: str = "yeoh", size: float = 1.0
) -> Coupon:
    """A test without noise; rate: how much faster than `TIMES`; size: strains over `STRAIN`."""
    constants = free_constants(LAWS[law], history=parts)
    values = np.array([{**LAW, **HISTORY, "youngs_modulus": 6e5}[name] for name in constants.names])
    strain = strains(test, size * STRAIN)
    empty = Coupon(name, test, strain, np.full_like(strain, np.nan), TIMES / rate)
    stress = response_of(constants, empty).stress(values)
    return Coupon(name, test, empty.strain, stress, empty.time)


@pytest.mark.parametrize("test", ["uniaxial", "biaxial", "shear"])
def test_derivatives_through_a_history_are_exact(test: str):
    parts = ("softening", "relaxation-1", "maxwell-1", "flow")
    constants = free_constants(LAWS["yeoh"], history=parts)
    values = np.array([{**LAW, **HISTORY}[name] for name in constants.names])
    response = response_of(constants, pulled("one", test, parts))
    slopes = response.by_constants(values)
    for k, name in enumerate(constants.names):
        h = 1e-5 * values[k] * np.eye(len(values))[k]
        expected = (response.stress(values + h) - response.stress(values - h)) / (2.0 * h[k])
        np.testing.assert_allclose(slopes[..., k], expected, rtol=0, atol=1e-6 * np.abs(expected).max(), err_msg=name)


@pytest.mark.parametrize("parts", [("maxwell-1",), ("softening",), ("relaxation-1", "flow")])
def test_constants_of_a_history_are_found_from_two_rates(parts: tuple[str, ...]):
    """And from two amplitudes, which tell the two constants of the width of the softening."""
    rates = {"slow": (0.3, 1.0), "fast": (3.0, 1.5)}
    tests = [pulled(name, "uniaxial", parts, rate, "neo-hooke", size) for name, (rate, size) in rates.items()]
    (one,) = compare_laws(tests, ["neo-hooke"], history=parts).laws
    assert one.fit.error < 1e-6
    true = {**HISTORY, "youngs_modulus": 6e5}
    for name in one.fit.estimates:
        assert one.fit.theta[name] == pytest.approx(true[name], rel=1e-3), name


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_a_block_of_elements_has_the_stresses_of_the_coupon(element: str):
    """Simple shear: the force by the work of F12, of a body with that law and history in a robot."""
    parts = ("softening", "maxwell-1", "flow")
    coupon = pulled("one", "shear", parts)
    mesh = irregular_box((0.02, 0.03, 0.025), (2, 2, 2), element)
    names = [p.name for p in (*LAWS["yeoh"].parameters, *history_of(parts).parameters)]
    own = {name: {**LAW, **HISTORY, "bulk_modulus": 1e8}[name] for name in names}
    body = Body("body", mesh, np.array([0]), own, "yeoh", element, history=parts)
    system = build_twin(Robot((body,))).system
    state, stress, theta = placed(system, mesh.points), list[float](), parameter_values(Robot((body,)))
    for gamma, dt in zip(coupon.strain[:, 0], np.diff(TIMES, prepend=0.0), strict=True):
        F = np.eye(3)
        F[0, 1] = gamma
        at, controls = replace(placed(system, mesh.points @ F.T), memory=state.memory), replace(held(), elapsed=dt)
        force = system.linearise(at, controls, theta, tangent=False).full[: mesh.points.size]
        stress.append(float(force.reshape(-1, 3)[:, 0] @ mesh.points[:, 1]) / (0.02 * 0.03 * 0.025))
        state = system.advanced(at, controls, theta)
    np.testing.assert_allclose(stress, coupon.stress[:, 0], rtol=1e-8)


def test_a_way_is_kept_where_stresses_are_held_out():
    one = pulled("one", "shear", ("maxwell-1",))
    found = folds([one], has_history=True)
    assert [int(fold.held_out[0].measured.sum()) for fold in found] == [3, 3, 2, 3, 2]
    for fold in found:
        np.testing.assert_array_equal(fold.kept[0].strain, one.strain)
        np.testing.assert_array_equal(fold.kept[0].measured, ~fold.held_out[0].measured)
    assert [fold.name for fold in folds([one, pulled("two", "shear", ())], has_history=True)] == [
        "shear test of one",
        "shear test of two",
    ]


@pytest.mark.slow
def test_the_block_of_a_material_with_a_history_is_that_of_a_project(tmp_path: Path):
    parts = ("softening", "maxwell-1")
    tests = [pulled("slow", "uniaxial", parts, 0.3), pulled("fast", "uniaxial", parts, 3.0)]
    found = compare_laws(tests, ["yeoh"], history=parts)
    block = YAML(typ="safe").load(material_block(found.laws[0].fit, found, "bar"))
    lines = "".join(f"      {key}: {', '.join(value) if key == 'history' else value}\n" for key, value in block.items())
    lines = lines.replace("history: softening, maxwell-1", "history: [softening, maxwell-1]")
    path = write_project(
        tmp_path,
        ("      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n", lines),
        ("  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n", "  bar.C10: {bounds: [1 kPa, 1 GPa]}\n"),
    )
    (body,) = load(path).robot.bodies
    assert body.history == parts
    for name, value in found.laws[0].fit.theta.items():
        assert body.parameters[name] == pytest.approx(value, rel=1e-5)


ROWS = {"time [s]": TIMES, "amount_of_shear": STRAIN, "shear_stress [kPa]": 100.0 * STRAIN}


@pytest.mark.parametrize(
    ("columns", "options", "said"),
    [
        ({**ROWS, "time [s]": TIMES[::-1]}, "", "the time goes back in 12 row(s)"),
        ({**ROWS, "time [s]": TIMES - 1.0}, "", "times from 0 on, at which the specimen is at rest"),
        ({k: v for k, v in ROWS.items() if "time" not in k}, "--history maxwell-1", "needs the times of the rows"),
        ({**ROWS, "time [mm]": TIMES} | {"time [s]": TIMES}, "", "2 columns have the name 'time'"),
        ({**ROWS, "amount_of_shear": 0.0 * STRAIN}, "", "the coupon is never strained"),
        (ROWS, "--history maxwel-2", "there is no such part of a history"),
        (ROWS, "--history maxwell-1 --history maxwell-2", "a history can have only one part of this kind"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, columns: dict[str, np.ndarray], options: str, said: str):
    path = write_coupon(tmp_path / "a.csv", columns)
    words = ["coupon", str(path), "--test", "shear", "--law", "neo-hooke", *options.split()]
    done = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "out")])
    assert (done.exit_code, said in " ".join(done.output.split())) == (2, True), done.output
    assert not (tmp_path / "out").exists()
