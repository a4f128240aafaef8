"""The real pneumatic arm: what its example says; its tables from the motion capture files beside the repository."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from example_script import example_script

from softcal.geometry.quality import check_quality
from softcal.project.project import load
from softcal.workflows.calibration import calibrate

EXAMPLE = Path(__file__).parents[2] / "examples" / "pneumatic-arm"
README = (EXAMPLE / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def result():
    return calibrate(load(EXAMPLE / "project.yaml")).headline


@pytest.fixture(scope="module")
def arm_data() -> Path:
    folder = Path(__file__).parents[3] / "shared" / "data" / "bench" / "diffpd-arm"
    if not folder.is_dir():
        pytest.skip("no ../shared/data/bench/diffpd-arm beside the repository")
    return folder


def row(title: str) -> list[float]:
    line = re.search(rf"^\| {re.escape(title)} \|(.*)$", README, re.MULTILINE)
    assert line is not None, title
    return [float(text) for text in re.findall(r"[\d.]+", line[1])]


def test_the_shipped_tables_are_what_the_files_give(arm_data: Path, tmp_path: Path):
    derive = example_script(EXAMPLE / "derive.py")
    derive.write_tables(arm_data, tmp_path)
    for name in ("fit.csv", "predict.csv"):
        assert (tmp_path / name).read_text(encoding="utf-8") == (EXAMPLE / name).read_text(encoding="utf-8"), name


def test_the_shipped_mesh_has_the_measures_of_the_authors():
    derive = example_script(EXAMPLE / "derive.py")
    shipped, made = load(EXAMPLE / "project.yaml").robot.bodies[0].mesh, derive.arm_mesh()
    np.testing.assert_allclose(np.sort(shipped.points, axis=0), np.sort(made.points, axis=0), atol=1e-9)
    r = np.hypot(*made.points[:, :2].T)
    assert r.max() == pytest.approx(22.2e-3, abs=1e-6)
    inside = r[np.unique(made.face_sets["cavity"])]
    assert inside.max() == pytest.approx(22.2e-3 - 2.03e-3, rel=2e-3)
    assert np.ptp(made.points[np.unique(made.face_sets["cavity"]), 2]) == pytest.approx(100e-3 - 6.93e-3)
    finer = derive.arm_mesh(3, 8)
    assert check_quality(finer).volume == pytest.approx(check_quality(made).volume, rel=5e-3)


@pytest.mark.slow
def test_the_readme_states_what_the_fit_finds(result):
    estimate = result.parameters["arm.E"]
    E, low, high, rms = row("100 to 400 mbar")
    assert E == pytest.approx(estimate.value / 1e3, abs=1.0)
    assert [low, high] == pytest.approx([edge / 1e3 for edge in estimate.interval], abs=2.0)
    assert rms == pytest.approx(1e3 * result.experiments["fit"].distance.rms, abs=0.05)
    (predicted,) = row("450 mbar, predicted")[-1:]
    assert predicted == pytest.approx(1e3 * result.held_out["predict"].fit.distance.rms, abs=0.1)


@pytest.mark.slow
def test_the_readme_states_the_fit_with_one_modulus_for_arm_and_sleeve(tmp_path: Path):
    """The sleeve omits E, so that it has the file's value, of which `check` warns."""
    project = tmp_path / "arm"
    shutil.copytree(EXAMPLE, project)
    path = project / "project.yaml"
    text = path.read_text(encoding="utf-8")
    assert any("arm.sleeve.E" in str(warning) for warning in load(path).warnings)
    line = "  arm.E: {bounds: [350 kPa, 1 MPa], scale: log}\n"
    assert text.count(line) == 1
    tied = line.replace("arm.E: {", "silicone.E: {of: [arm.E, arm.sleeve.E], ")
    path.write_text(text.replace(line, tied), encoding="utf-8")
    assert load(path).warnings == ()
    estimate = calibrate(load(path)).headline.parameters["silicone.E"]
    stated = re.search(r"E is ([\d.]+) kPa\s+\(95 %: ([\d.]+) to ([\d.]+) kPa\)", README)
    assert stated is not None
    assert [float(text) for text in stated.groups()] == pytest.approx(
        [value / 1e3 for value in (estimate.value, *estimate.interval)], abs=1.0
    )


@pytest.mark.slow
def test_the_arm_is_stiffer_than_the_silicone_of_the_authors_beam(result):
    """264 kPa by their beam: the webs, the fibres and the ends of the chambers are not theirs."""
    low, high = result.parameters["arm.E"].interval
    assert low > 300e3
    assert high < 700e3
