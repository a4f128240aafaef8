"""A stranger's way, by the pages alone: a finger of one's own from STEP, an odd table, a project file, a report."""

from __future__ import annotations

import csv
import importlib.util
import json
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from command_line import run

pytestmark = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")

# A round finger of 60 mm along x that tapers from 20 to 14 mm, three grooves above, a bore that slopes as its side.
STEP = """\
import gmsh, sys
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
cuts = [(3, occ.addBox(x, -12, 1, 4, 24, 12)) for x in (12, 27, 42)]
cuts += [(3, occ.addCylinder(-2, 0, 6.1, 64, 0, -3.2, 1.5))]
occ.cut([(3, occ.addCone(0, 0, 0, 60, 0, 0, 10, 7))], cuts)
occ.synchronize()
gmsh.write(sys.argv[1])
"""
ROBOT = """\
softcal: 1
name: My finger
robot:
  bodies:
    finger:
      mesh: {file: finger.step, size: 7 mm, edges_around: 4}
      youngs_modulus: 6 MPa
      poissons_ratio: 0.45
      density: 1.2 g/cm^3
      regions:
        foot: {plane: {point: [0 mm, 0 mm, 0 mm], normal: [1, 0, 0]}}
        end: {plane: {point: [60 mm, 0 mm, 0 mm], normal: [1, 0, 0]}}
      fixed: foot
  plates:
    tip: {reference: [60 mm, 0 mm, 0 mm], body: finger, region: end}
  cables:
    tendon:
      via:
        - {on: finger, at: [59.5 mm, 0 mm, 3.025 mm], radius: 3 mm}
        - {on: finger, at: [0.5 mm, 0 mm, 5.975 mm]}
        - {at: [-20 mm, 0 mm, 7 mm]}
  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]
"""
TEST = """\
experiments:
  pull1:
    cable: tendon
    files:
      - path: Zug 1.TXT
        skip_footer: 1
        columns: {time: {name: Prüfzeit}, shortening: {name: Standardweg}, tension: {name: Standardkraft}}
    prepare:
      - zero: {channel: shortening, by: first}
    noise: {tension: 0.03 N}
parameters:
  finger.youngs_modulus: {bounds: [1 MPa, 20 MPa], scale: log}
  tendon.slack: {bounds: [0 mm, 2 mm], per: experiment}
  tendon.tension_offset: {bounds: [-0.5 N, 0.5 N], per: experiment}
calibration: {method: least-squares, loss: likelihood}
"""
E, SLACK, ZERO, NOISE = 3.7, 0.8, 0.06, 0.03  # [MPa, mm, N, N]
KGF = 9.80665
# Of the pages: what check writes, and what is in a run folder.
RUN = {
    *("project.yaml", "inputs", "run.json", "result.json", "trials.csv", "response-pull1.csv"),
    *("calibrations", "report.html", "figures", "tables"),
}


def machine_table(response: Path, path: Path) -> None:
    """What a machine writes of the simulated pull: remarks, decimal commas, kgf, an empty column, a word at the end."""
    with response.open(newline="", encoding="utf-8") as stream:
        header, *rows = list(csv.reader(stream))
    pull = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    travel = np.arange(0.0, 5.0, 0.2)
    taut = np.interp(travel - SLACK, 1e3 * pull["tendon.shortening [m]"], pull["tendon.tension [N]"])
    noise = NOISE * np.random.default_rng(4).normal(size=len(travel))
    force = np.where(travel < SLACK, 0.0, taut) + ZERO + noise
    head = ["Prüfprotokoll;;;;", "Prüfer;M. Muster;;;", "Vorkraft;0,05;N;;", "Geschwindigkeit;30;mm/min;;", ""]
    head += ["Prüfzeit;Standardweg;;Standardkraft;Zyklus", "s;mm;;kgf;-"]
    lines = [f"{2 * s:.2f};{12.5 + s:.4f};;{f / KGF:.5f};1" for s, f in zip(travel, force, strict=True)]
    text = "\r\n".join([*head, *(line.replace(".", ",") for line in lines), "Ende der Prüfung", ""])
    path.write_bytes(text.encode("cp1252"))


def in_order(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    code, out, err = run(capsys, *arguments)
    assert code == 0, out + err
    return " ".join((out + err).split())


def test_the_robot_is_that_of_the_page_on_a_coarser_mesh(repository: Path) -> None:
    finer = ROBOT.replace("size: 7 mm, edges_around: 4", "size: 3 mm, edges_around: 6")
    assert textwrap.indent(finer, "    ") in (repository / "docs" / "cad.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_finger_of_ones_own_and_an_odd_table_to_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bench, own = tmp_path / "bench", tmp_path / "own"
    bench.mkdir()
    own.mkdir()
    subprocess.run([sys.executable, "-c", STEP, str(own / "finger.step")], check=True)
    (bench / "finger.step").write_bytes((own / "finger.step").read_bytes())
    (bench / "project.yaml").write_text(ROBOT, encoding="utf-8")
    monkeypatch.chdir(bench)
    in_order(
        capsys, *"simulate project.yaml --pull tendon=5mm --out pull".split(), "--set", f"finger.youngs_modulus={E}MPa"
    )
    machine_table(bench / "pull" / "response-pull.csv", own / "Zug 1.TXT")
    (own / "project.yaml").write_text(ROBOT + TEST, encoding="utf-8")
    given = {path.name: path.read_bytes() for path in own.iterdir()}

    monkeypatch.chdir(own)
    seen = in_order(capsys, "check", "project.yaml")
    assert "25 of 25 samples, shortening 0 mm to 4.8 mm" in seen
    assert "The project is in order." in seen
    said = in_order(capsys, "calibrate", "project.yaml", "--no-mesh-error")
    (own / "run" / "report.html").unlink()
    in_order(capsys, "report", "run")

    found = json.loads((own / "run" / "result.json").read_text(encoding="utf-8"))["parameters"]
    modulus = found["finger.youngs_modulus"]
    low, high = modulus["interval"]
    assert low < 1e6 * E < high
    assert modulus["value"] == pytest.approx(1e6 * E, rel=0.03)
    assert found["tendon.slack[pull1]"]["value"] == pytest.approx(1e-3 * SLACK, abs=1e-4)
    assert "E = 3." in said

    assert {path.name for path in own.iterdir()} == {*given, "check", "run"}
    assert {name: (own / name).read_bytes() for name in given} == given
    assert {path.name for path in (own / "check").iterdir()} == {"robot.png", "states.png", "data-pull1.png"}
    assert {path.name for path in (own / "run").iterdir()} == RUN
    figures = {path.stem for path in (own / "run" / "figures").iterdir()}
    assert figures >= {"overview", "force-displacement-pull1", "trajectory-pull1", "parameter-finger-youngs-modulus"}
    page = (own / "run" / "report.html").read_text(encoding="utf-8")
    assert page.count("<figcaption>") == page.count("</figure>") >= 8
    assert page.count('<img src="data:image/') >= 7
