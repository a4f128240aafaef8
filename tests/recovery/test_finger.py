"""`softcal init finger`: checked, calibrated and reported as it is written, and its stated truth found again."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest

from softcal.cli import main
from softcal.geometry.generate import mesh_file
from softcal.geometry.quality import require_sound

pytestmark = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")


def softcal(*arguments: object) -> None:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    assert not left.value.code


def test_a_surface_with_many_bores_is_meshed(repository: Path):
    """Gmsh refused it: "Wrong topology of boundary mesh for parametrization"."""
    mesh = mesh_file(repository / "examples/finger/finger.stl", size=5e-3)
    assert mesh.n_tets < 4000
    # The box less eight notches, and the channel of 3 mm through the rest, which few facets make narrower.
    expected = 16 * 14 * 84 - 8 * 10 * 14 * 3 - 7.07 * (84 - 8 * 3)
    assert 1e9 * require_sound(mesh).volume == pytest.approx(expected, rel=0.02)


@pytest.mark.long
def test_check_calibrate_report(tmp_path: Path, capsys: pytest.CaptureFixture[str], repository: Path):
    softcal("init", "finger", tmp_path / "finger")
    project = tmp_path / "finger" / "project.yaml"
    softcal("check", project, "--out", tmp_path / "look")
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(r"via points lie in bores, [12]\.\d+ mm across \(median\), 2\.\d+ mm at most", said)
    assert (tmp_path / "look" / "robot.png").is_file()
    softcal("calibrate", project, "--out", tmp_path / "run")
    found = json.loads((tmp_path / "run" / "result.json").read_text())["parameters"]
    truth = float(re.search(r"\*\*E ([\d.]+) MPa", (repository / "examples/finger/README.md").read_text())[1])  # type: ignore[index]
    assert found["finger.youngs_modulus"]["value"] == pytest.approx(1e6 * truth, rel=0.03)
    assert found["tendon.slack[pull_7mm]"]["value"] == pytest.approx(0.6e-3, abs=0.1e-3)
    assert (tmp_path / "run" / "report.html").is_file()
    softcal("report", tmp_path / "run")
