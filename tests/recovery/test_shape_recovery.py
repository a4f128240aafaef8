"""A bar that is 3 % larger than its mesh: its scale is found with the modulus, or widens its interval."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from project_case import MODULUS, PROJECT, write_project

from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh
from softcal.project.project import load
from softcal.workflows.calibration import calibrate, make_problem

DRAWN = ("      fixed: foot\n", "      shape: drawn\n      fixed: foot\n")
FREE = ("  front.slack:", "  bar.scale: {bounds: [0.9, 1.1]}\n  front.slack:")
END = PROJECT.rstrip().splitlines()[-1]
UNCERTAIN = (END, f"{END}\nuncertain:\n  bar.scale: {{sd: 2 %}}")
SMALLER = 0.97


def smaller_mesh(folder: Path) -> bytes:
    """The mesh of the project's bar [mm], drawn smaller."""
    size = SMALLER * np.array([20.0, 20.0, 100.0])
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(box_mesh(size.tolist(), [2, 2, 8], origin=[-0.5 * size[0], -0.5 * size[1], 0.0]), folder / "small.msh")
    return (folder / "small.msh").read_bytes()


def parameters(project: Path) -> dict[str, dict]:
    """What a calibration of the project says of its parameters."""
    calibrate(load(project), out=project.parent / "run")
    return json.loads((project.parent / "run" / "result.json").read_text())["parameters"]


def test_a_scale_is_found_with_the_modulus(tmp_path: Path):
    """The plate and the cable's end on it are drawn lower, too, and move up with the bar."""
    lower = [
        ("reference: [0 mm, 0 mm, 100 mm]", "reference: [0 mm, 0 mm, 97 mm]"),
        ("at: [30 mm, 0 mm, 100 mm]", "at: [30 mm, 0 mm, 97 mm]"),
    ]
    found = parameters(write_project(tmp_path / "bar", DRAWN, FREE, *lower, mesh=smaller_mesh(tmp_path)))
    assert found["bar.scale"]["value"] == pytest.approx(1.0 / SMALLER, rel=2e-3)
    assert found["bar.youngs_modulus"]["value"] == pytest.approx(MODULUS, rel=5e-3)
    low, high = found["bar.scale"]["interval"]
    assert low < 1.0 / SMALLER < high


def test_an_uncertain_scale_widens_the_interval_and_has_its_share(tmp_path: Path):
    """At one shortening the tension is as E and a power of the scale between two and four."""
    sure, unsure = (
        parameters(write_project(tmp_path / str(k), DRAWN, *more))["bar.youngs_modulus"]
        for k, more in enumerate([(), (UNCERTAIN,)])
    )
    assert "bar.scale" not in sure["shares"]
    added = unsure["standard_error"] ** 2 - sure["standard_error"] ** 2
    assert 2.0 < np.sqrt(added) / (0.02 * unsure["value"]) < 4.0
    assert unsure["shares"]["bar.scale"] == pytest.approx(added / unsure["standard_error"] ** 2, rel=0.05)


def test_a_value_that_the_mesh_cannot_have_is_a_failed_trial_with_a_sentence(tmp_path: Path):
    wide = (FREE[0], FREE[1].replace("bar.scale: {bounds: [0.9, 1.1]}", "bar.wall_offset: {bounds: [-15 mm, 1 mm]}"))
    problem = make_problem(load(write_project(tmp_path, DRAWN, wide)))
    start = dict(problem.space.start)
    assert problem.evaluate(start).failure == ""
    failed = problem.evaluate({**start, "bar.wall_offset": -0.014})
    assert "tets are turned inside out; got wall_offset -14 mm" in failed.failure
