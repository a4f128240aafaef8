"""Coupon tests from tables: what the names of the columns say, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from coupon_case import write_coupon
from typer.testing import CliRunner

from softcal.cli import app
from softcal.plugins.coupons.plausibility import implausible
from softcal.plugins.coupons.reading import read_coupons

STRETCH = np.linspace(1.1, 2.3, 9)
NOMINAL = STRETCH - STRETCH**-2  # [MPa], a neo-Hookean body


@pytest.mark.parametrize(
    "columns",
    [
        {"stretch": STRETCH, "nominal_stress [MPa]": NOMINAL},
        {"Stretch [-]": STRETCH, "Nominal_Stress [kPa]": 1e3 * NOMINAL},
        {"engineering_strain": STRETCH - 1, "nominal_stress_MPa": NOMINAL},
        {"engineering_strain [%]": 100 * (STRETCH - 1), "true_stress [N/mm^2]": NOMINAL * STRETCH},
        {"note": ["x"] * 9, "stretch": STRETCH, "true_stress [MPa]": NOMINAL * STRETCH},
    ],
)
def test_the_columns_say_what_was_measured(tmp_path: Path, columns: dict[str, np.ndarray]):
    (found,) = read_coupons(write_coupon(tmp_path / "a.csv", columns), "uniaxial")
    assert (found.name, found.test) == ("a", "uniaxial")
    np.testing.assert_allclose(found.strain[:, 0], STRETCH, rtol=1e-12)
    np.testing.assert_allclose(found.stress[:, 0], 1e6 * NOMINAL, rtol=1e-12)


def test_specimens_of_one_file_are_told_apart(tmp_path: Path):
    columns = {
        "specimen": ["B", "A"] * 6,
        "stretch": np.repeat(np.linspace(2, 1.1, 6), 2),
        "nominal_stress [MPa]": [x * factor for x in np.linspace(2, 1, 6) for factor in (1, 2)],
    }
    found = {one.name: one for one in read_coupons(write_coupon(tmp_path / "a.csv", columns), "planar")}
    assert list(found) == ["B", "A"]
    np.testing.assert_allclose(found["A"].stress, 2 * found["B"].stress)
    assert (np.diff(found["A"].along_strain().strain[:, 0]) > 0).all()


def test_a_true_stress_of_a_biaxial_test_is_over_its_own_stretch(tmp_path: Path):
    first, second = np.linspace(1.1, 2, 6), np.linspace(1.0, 1.5, 6)
    columns = {
        "stretch_1": first,
        "stretch_2": second,
        "true_stress_1 [MPa]": 3 * first,
        "nominal_stress_2 [MPa]": 0 * first + 2,
    }
    (found,) = read_coupons(write_coupon(tmp_path / "a.csv", columns), "biaxial")
    np.testing.assert_allclose(found.stress, np.full((6, 2), [3e6, 2e6]), rtol=1e-12)


ROWS = {"stretch": STRETCH, "nominal_stress [MPa]": NOMINAL}


@pytest.mark.parametrize(
    ("columns", "options", "said"),
    [
        ({"stretch": STRETCH, "stress [MPa]": NOMINAL}, "", ("needs another column", "nominal_stress, true_stress")),
        ({**ROWS, "true_stress [MPa]": NOMINAL}, "", ("two columns have the same quantity",)),
        ({"stretch": STRETCH, "nominal_stress": NOMINAL}, "", ("the unit is missing", "in brackets")),
        ({"engineering_strain [mm]": STRETCH, "nominal_stress [N]": NOMINAL}, "", ("2 faults", "'mm'", "'N'")),
        ({**ROWS, "nominal_stress [MPa]": [*NOMINAL[:-1], "nan"]}, "", ("1 value(s) are not numbers", "line 10")),
        ({**ROWS, "stretch": [0.0, -1.0, *STRETCH[2:]]}, "", ("out of range in 2 row(s)", "lines 2, 3")),
        ({**ROWS, "stretch": 100 * STRETCH}, "", ("out of range in 9 row(s)", "engineering_strain")),
        ({name: cells[:4] for name, cells in ROWS.items()}, "", ("too few rows", "5 or more")),
        ({**ROWS, "stretch": 1 / STRETCH}, "", ("a.csv, specimen 'a': the stresses in compression have the",)),
        ({**ROWS, "nominal_stress [MPa]": -NOMINAL}, "", ("a.csv, specimen 'a': the stresses in extension have the",)),
        ({**ROWS, "nominal_stress [MPa]": 1e-300 * NOMINAL}, "", ("a.csv, specimen 'a': no material has such str",)),
        ({**ROWS, "nominal_stress [MPa]": 1e300 * NOMINAL}, "", ("a.csv, specimen 'a': no material has such str",)),
        (
            {"stretch": STRETCH, "true_stress [MPa]": 1e307 * NOMINAL},
            "",
            ("no material has such stresses; got up to inf",),
        ),
        ({**ROWS, "nominal_stress [MPa]": 0 * NOMINAL}, "", ("every stress is zero",)),
        ({**ROWS, "stretch": 0 * STRETCH + 1}, "", ("specimen 'a': the coupon is never strained",)),
        (
            {
                "specimen": [*"AB"] * 9,
                "stretch": 1 + np.ravel(np.outer(STRETCH - 1, [0.0, 1.0])),
                "nominal_stress [MPa]": np.ravel(np.outer(NOMINAL, [1.0, 0.0])),
            },
            "--history softening",
            ("2 faults", "specimen 'A': the coupon is never strained", "specimen 'B': every stress is zero"),
        ),
        (ROWS, "--law foo --law neo-hooke-layered", ("2 faults", "no such law", "direction")),
        (ROWS, "--law stvenant-kirchhoff", ("no incompressible form",)),
        (ROWS, "--poissons-ratio 0.5", ("out of range",)),
        (ROWS, "--reach 0.9", ("--reach", "above 1")),
        *((ROWS, f"--body {body}", ("--body: this cannot be a name",)) for body in ("a:b", "{x}", "../x", "-", "#")),
        (ROWS, f"--body {'x' * 5000}", ("--body: there are too many characters",)),
        (ROWS, "--body rig", ("--body: the name is reserved",)),
    ],
)
def test_bad_input_is_refused_in_a_sentence(
    tmp_path: Path, columns: dict[str, np.ndarray], options: str, said: tuple[str, ...]
):
    path = write_coupon(tmp_path / "a.csv", columns)
    done = CliRunner().invoke(
        app, ["coupon", str(path), "--test", "uniaxial", *options.split(), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 2, done.output
    for text in said:
        assert text in done.output
    assert "Traceback" not in done.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("body", ["", "a\nsoftcal: 1", "- a", "a: b"])
def test_a_body_is_named_as_in_a_project(tmp_path: Path, body: str):
    path = write_coupon(tmp_path / "a.csv", ROWS)
    done = CliRunner().invoke(app, ["coupon", str(path), "--test", "uniaxial", "--body", body])
    assert done.exit_code == 2, done.output
    assert "--body" in done.output


def test_what_happens_in_time_is_no_kind_of_test(tmp_path: Path):
    path = write_coupon(tmp_path / "a.csv", ROWS)
    done = CliRunner().invoke(app, ["coupon", str(path), "--test", "relaxation"])
    assert (done.exit_code, "is in a column 'time'" in " ".join(done.output.split())) == (2, True)


def test_faults_of_all_files_are_reported_together(tmp_path: Path):
    good, bad = write_coupon(tmp_path / "a.csv", ROWS), write_coupon(tmp_path / "b.csv", {**ROWS, "stretch": -STRETCH})
    done = CliRunner().invoke(app, ["coupon", str(good), str(bad), str(tmp_path / "none.csv"), "--test", "uniaxial"])
    assert done.exit_code == 2
    assert "2 faults" in done.output
    twice = CliRunner().invoke(app, ["coupon", str(good), str(good), "--test", "uniaxial"])
    assert (twice.exit_code, "two uniaxial tests are of one specimen" in twice.output) == (2, True)
    tests = CliRunner().invoke(app, ["coupon", str(good), "--test", "uniaxial", "--test", "planar"])
    assert (tests.exit_code, "do not match the files" in tests.output) == (2, True)


@pytest.mark.parametrize(("column", "stress"), [("nominal_stress", NOMINAL * STRETCH), ("true_stress", NOMINAL)])
def test_stresses_of_the_other_measure_are_warned_of(tmp_path: Path, column: str, stress: np.ndarray):
    wrong = read_coupons(write_coupon(tmp_path / "a.csv", {"stretch": STRETCH, f"{column} [MPa]": stress}), "uniaxial")
    (said,) = implausible(wrong)
    other = {"nominal_stress": "taken for true", "true_stress": "taken for nominal"}[column]
    assert said.startswith(f"a: {other} stresses")
    right = "true_stress" if column == "nominal_stress" else "nominal_stress"
    path = write_coupon(tmp_path / "b.csv", {"stretch": STRETCH, f"{right} [MPa]": stress})
    assert implausible(read_coupons(path, "uniaxial")) == []


def test_stretches_in_a_column_of_strains_are_warned_of(tmp_path: Path):
    path = write_coupon(tmp_path / "a.csv", {"engineering_strain": STRETCH, "nominal_stress [MPa]": NOMINAL})
    said = implausible(read_coupons(path, "uniaxial"))
    assert any(
        "the least stretch is 2.1: are these stretches, or per cent, that were read as strains?" in one for one in said
    )
