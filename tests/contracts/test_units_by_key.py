"""Every key of a project file that takes a value of a parameter refuses a length for a modulus."""

from __future__ import annotations

from pathlib import Path

import pytest
from project_case import write_project

import softcal
from softcal.errors import InputError

SETTINGS = ("    cable: front\n", "    cable: front\n    settings: {bar.youngs_modulus: 3 mm}\n")
SWEEP = "sweep:\n  over: {bar.youngs_modulus: [1 MPa, 2 MPa]}\n"
BOUNDS = "{bounds: [0.1 MPa, 40 MPa], scale: log}"


def added(text: str) -> tuple[str, str]:
    return "calibration: {", f"{text}calibration: {{"


KEYS: dict[str, list[tuple[str, str]]] = {
    "sweep.over": [added("sweep: {over: {bar.youngs_modulus: [3 mm, 4 mm]}}\n")],
    "sweep.over.bar": [added("sweep: {over: {bar.youngs_modulus: '3 mm:5 mm:1 mm'}}\n")],
    "sweep.show": [added(f"{SWEEP}  show: {{B: {{bar.youngs_modulus: 3 mm}}}}\n")],
    "bounds": [(BOUNDS, "{bounds: [0.1 mm, 40 MPa], scale: log}")],
    "start": [(BOUNDS, "{bounds: [0.1 MPa, 40 MPa], start: 3 mm}")],
    "prior": [(BOUNDS, "{bounds: [0.1 MPa, 40 MPa], prior: {mean: 1 MPa, sd: 3 mm}}")],
    "uncertain": [
        (f"  bar.youngs_modulus: {BOUNDS}\n", ""),
        added("uncertain: {bar.youngs_modulus: {sd: 3 mm}}\n"),
    ],
    "settings": [(f"  bar.youngs_modulus: {BOUNDS}\n", ""), SETTINGS],
    "candidates.other.settings": [added("candidates: {other: {like: pull, settings: {bar.youngs_modulus: 3 mm}}}\n")],
    "candidates.other.shortening": [added("candidates: {other: {like: pull, shortening: 3 MPa}}\n")],
    "candidates.other.noise": [added("candidates: {other: {like: pull, noise: {tension: 3 MPa}}}\n")],
}


@pytest.mark.parametrize("key", KEYS)
def test_a_length_for_a_modulus_is_refused_by_its_key(key: str, tmp_path: Path) -> None:
    path = write_project(tmp_path, *KEYS[key])
    with pytest.raises(InputError, match=r"(?s)project\.yaml:\d+.*(unit|dimension)") as error:
        softcal.load(path)
    assert len(error.value.faults) == 1
    assert key in str(error.value)
