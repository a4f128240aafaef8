"""Sweeps and nominal values in the report: surfaces, distances state by state, shapes, improvement."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sweep_case import FORCES, LENGTH, MODULUS, RATIO, robot, write_sweep

from softcal.errors import InputError
from softcal.project.project import Project, load
from softcal.report.comparison import comparison, improvement_table, improvements
from softcal.report.conclusions import conclusions, verdict
from softcal.report.content import ReportContent
from softcal.report.figure import report_pictures
from softcal.report.figures import configurations, twin
from softcal.report.figures.error_curves import draw_curves
from softcal.report.figures.error_surfaces import draw_surfaces
from softcal.report.figures.nominal_and_tuned import draw_comparison
from softcal.report.html import render_page
from softcal.report.scene_render import Rendering
from softcal.report.surfaces import error_curves, error_surfaces, searched_pair
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate
from softcal.workflows.comparing import compared_sweep
from softcal.workflows.reporting import report_content
from softcal.workflows.run_folder import load_run
from softcal.workflows.sweep import sweep

E, NU = "springs.youngs_modulus", "springs.poissons_ratio"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return load(write_sweep(tmp_path_factory.mktemp("project")))


@pytest.fixture(scope="module")
def content(project: Project, tmp_path_factory: pytest.TempPathFactory) -> ReportContent:
    folder = tmp_path_factory.mktemp("sweep") / "run"
    sweep(project, experiments=["cable1", "cable2"], out=folder)
    return report_content(load_run(folder))


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> ReportContent:
    home = tmp_path_factory.mktemp("calibration")
    project = load(write_sweep(home / "project"), values={NU: RATIO})
    calibrate(project, out=home / "run", trials=6)
    return report_content(load_run(home / "run"))


@pytest.fixture
def flat(monkeypatch: pytest.MonkeyPatch) -> None:
    """No 3-D renderer: scenes have no pictures."""
    for module in (configurations, twin):
        monkeypatch.setattr(module, "render_scenes", lambda *_: Rendering((), ""))


@pytest.mark.slow
def test_surfaces_hold_every_cell_in_ascending_order(content: ReportContent):
    result = content.headline_result
    surfaces = error_surfaces(result)
    assert [surface.section for surface in surfaces] == ["all", "marker1", "marker2"]
    assert searched_pair(result) == (E, NU)
    whole = surfaces[0]
    assert whole.x.tolist() == [0.4e9, 0.8e9, 1.2e9]
    assert whole.y.tolist() == [0.1, 0.3]
    assert whole.unit == "%"
    for trial in result.trials:
        at = list(whole.y).index(trial.theta[NU]), list(whole.x).index(trial.theta[E])
        assert whole.error[at] == trial.loss
    assert surfaces[2].best[:2] == (MODULUS, RATIO)
    assert surfaces[2].best[2] == surfaces[2].error.min()


def test_further_parameters_are_held_at_the_best_cell(content: ReportContent):
    result = content.headline_result
    shifted = [
        replace(t, number=t.number + 6, theta={**t.theta, "frame.x": 0.1}, loss=99.0, errors={}) for t in result.trials
    ]
    parameters = {**result.parameters, "frame.x": replace(result.parameters[NU], value=0.0, unit="m")}
    own = [replace(t, theta={**t.theta, "frame.x": 0.0}) for t in result.trials]
    surfaces = error_surfaces(replace(result, parameters=parameters, trials=(*own, *shifted)))
    assert surfaces[0].error.tolist() == error_surfaces(result)[0].error.tolist()


def test_distances_of_every_state_nominal_and_best(content: ReportContent):
    found = comparison(content)
    assert found is not None
    assert found.experiments == ("cable1",) * 3 + ("cable2",) * 3
    assert found.states == ("2.00 N", "4.00 N", "6.00 N") * 2
    assert (found.markers, found.unit, found.tuned_name) == (("marker1", "marker2"), "%", "best cell")
    protocol = Protocol({"cable2": Command("tension", np.array(FORCES))})
    nominal, true = simulate(robot(1.6e9, 0.43), protocol), simulate(robot(), protocol)
    away = [nominal.channels[f"marker2.{axis}"] - true.channels[f"marker2.{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(found.nominal[1, 3:], 100 * np.linalg.norm(away, axis=0) / LENGTH, atol=2e-3)
    assert found.tuned.max() < 0.01


def test_a_state_that_was_not_seen_has_no_bar(content: ReportContent):
    result = content.headline_result
    fit = result.experiments["cable1"]
    measured = {**fit.measured, "marker1.y": np.array([np.nan, *fit.measured["marker1.y"][1:]])}
    gone = replace(result, experiments={**result.experiments, "cable1": replace(fit, measured=measured)})
    found = comparison(replace(content, results={"sweep": gone}))
    assert found is not None
    assert np.isnan(found.tuned[0, 0])
    texts = [text.get_text().replace("\n", " ") for axes in draw_comparison(found).axes for text in axes.texts]
    assert "not seen" in texts


def test_what_was_gained_is_told_and_flagged(content: ReportContent):
    gains = improvements(content)
    assert [gain.name for gain in gains] == ["all sections", "marker1", "marker2"]
    for gain in gains:
        assert gain.nominal is not None
        assert gain.reduction == pytest.approx(100 * (1 - gain.tuned / gain.nominal))
        assert gain.improvement == pytest.approx(100 * (gain.nominal / gain.tuned - 1))
    table = improvement_table(content)
    assert [column.label for column in table.columns][-3:] == ["E", "ν", "At the end of its range"]
    assert table.rows[0][-1] == "ν at its highest, 0.3"
    texts = [sentence.text for sentence in conclusions(content)]
    assert any("is at its upper bound of 0.3" in text for text in texts)
    assert any(text.startswith("The error of all sections fell from 1") for text in texts)
    first, largest, last = verdict(content).sentences
    assert first.startswith("The best of 6 cells, E = 800.0000 MPa (95 %: 799.99")
    assert largest.startswith("All of the known variance of ν comes from the noise")
    assert "were not computed" not in " ".join(texts)
    assert last.startswith("The twin reproduces the markers to 0.0001")


def test_shapes_are_those_of_the_strongest_pull(project: Project, content: ReportContent):
    shapes = content.compared
    assert shapes is not None
    assert [one.name for one in shapes.configurations] == ["Nominal", "Best cell", "Worst cell"]
    assert "tension 6 N" in shapes.state
    nominal, best, worst = shapes.configurations
    assert best.distance < 1e-5
    assert worst.parameters == {E: 0.4e9, NU: 0.3}
    assert worst.distance > nominal.distance > 100 * best.distance
    assert set(best.simulated) == {"marker1", "marker2"}
    found = comparison(content)
    assert found is not None
    column = list(zip(found.experiments, found.states, strict=True)).index((shapes.state.split()[0], "6.00 N"))
    expected = np.sqrt(np.mean(found.nominal[:, column] ** 2))
    assert 100 * nominal.distance / LENGTH == pytest.approx(expected, rel=1e-3)


SHOWN = f"""  experiments: [cable1]
  show:
    A: {{{E}: 10 GPa, {NU}: 0.4999}}
    B: {{{E}: 10 GPa}}
"""


@pytest.mark.slow
def test_a_sweep_shows_the_configurations_it_names(tmp_path: Path):
    """None of them is a cell; what one leaves out is nominal."""
    project = load(write_sweep(tmp_path / "p", ("  experiments: [cable1]\n", SHOWN)))
    sweep(project, out=tmp_path / "run")
    shapes = report_content(load_run(tmp_path / "run")).compared
    assert shapes is not None
    first, second = shapes.configurations
    assert (first.name, second.name) == ("A", "B")
    assert first.parameters == {E: 10e9, NU: 0.4999}
    assert second.parameters == {E: 10e9, NU: 0.43}
    assert second.twin.robot.rods[0].parameters == {"youngs_modulus": 10e9, "poissons_ratio": 0.43}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ((": 0.4999", ": 0.5"), "0.4999"),
        ((f"    B: {{{E}: 10 GPa}}", "    B: {S1.mass: 10 g}"), "a parameter that is not swept; got S1.mass in B"),
        ((f"    B: {{{E}: 10 GPa}}", f"    B: {{{E}: '1 GPa, 2 GPa'}}"), "youngs_modulus: the unit does not fit"),
    ],
)
def test_what_a_sweep_cannot_show_is_refused(tmp_path: Path, change: tuple[str, str], said: str):
    with pytest.raises(InputError, match=said):
        sweep(load(write_sweep(tmp_path / "p", ("  experiments: [cable1]\n", SHOWN.replace(*change)))))


def test_measured_markers_are_brought_into_the_robots_frame(project: Project, content: ReportContent, tmp_path: Path):
    moved = load(
        write_sweep(
            tmp_path, ("    drive: [cable1.tension]", "    frame: {x: 50 mm, rz: 90 deg}\n    drive: [cable1.tension]")
        )
    )
    result = replace(content.headline_result, experiments={"cable1": content.headline_result.experiments["cable1"]})
    plain = compared_sweep(project, project.calibration, result)
    turned = compared_sweep(moved, moved.calibration, result)
    for name, at in plain.configurations[0].measured.items():
        x, y, z = at - np.array([0.05, 0.0, 0.0])
        np.testing.assert_allclose(turned.configurations[0].measured[name], [y, -x, z], atol=1e-12)


@pytest.mark.slow
@pytest.mark.usefixtures("flat")
def test_the_report_of_a_sweep_has_its_figures_and_page(content: ReportContent):
    pictures = report_pictures(content)
    assert {"error-surfaces", "nominal-and-tuned", "configurations"} <= {picture.name for picture in pictures}
    assert not [picture for picture in pictures if picture.section in ("search", "history")]
    page = render_page(content, pictures)
    for words in (
        "softcal sweep report",
        "E and ν swept over 6 cells, judged by cable1 and cable2",
        "The best cell for each section",
    ):
        assert words in page, words
    captions = {picture.name: picture.caption for picture in pictures}
    assert captions["twin"].startswith("The twin at the sweep's best cell at rest and at its largest pitch")
    assert "with the shapes of the twin at the sweep's best cell" in captions["places"]
    assert "calibration" not in re.sub(r"<style.*?</style>|data:[^\"]*", "", page, flags=re.DOTALL).lower()


@pytest.mark.slow
@pytest.mark.usefixtures("flat")
def test_the_report_of_a_calibration_compares_with_the_nominal_values(calibrated: ReportContent):
    pictures = report_pictures(calibrated)
    names = {picture.name for picture in pictures}
    assert {"nominal-and-tuned", "configurations"} <= names
    assert "error-surfaces" not in names
    found = improvements(calibrated)
    assert [gain.name for gain in found] == ["all sections", "marker1", "marker2"]
    assert (found[0].improvement or 0.0) > 1000
    assert calibrated.compared is not None
    assert [one.name for one in calibrated.compared.configurations] == ["Nominal", "Calibrated"]
    page = render_page(calibrated, pictures)
    assert "Nominal and calibrated" in page
    assert "softcal calibration report" in page


def test_one_parameter_gives_curves_and_uneven_values_a_logarithmic_axis(project: Project):
    found = sweep(project, over={E: "0.4GPa,0.8GPa,1.6GPa,3.2GPa,8GPa"}).result
    assert not error_surfaces(found)
    curves = error_curves(found)
    assert [curve.section for curve in curves] == ["all", "marker1", "marker2"]
    assert np.argmin(curves[0].error) == 1
    assert draw_curves(found, curves).axes[-1].get_xscale() == "log"


def test_the_best_cell_and_the_failed_ones_are_marked(content: ReportContent):
    result = content.headline_result
    failed = [
        replace(t, state="FAILED", loss=None, errors={}, reason="no") if t.theta[E] > 1e9 else t for t in result.trials
    ]
    surfaces = error_surfaces(replace(result, trials=tuple(failed)))
    figure = draw_surfaces(result, (E, NU), surfaces, {E: 0.6e9, NU: 0.2})
    labels = {line.get_label(): line.get_xydata().tolist() for line in figure.axes[0].lines}
    assert labels["could not be simulated"] == [[1.2, 0.1], [1.2, 0.3]]
    assert labels["best cell"] == [[0.8, 0.3]]
    assert labels["nominal values"] == [[0.6, 0.2]]
    (cells,) = figure.axes[0].collections
    assert np.ma.getmaskarray(cells.get_array())[:, 2].all()
    far = draw_surfaces(result, (E, NU), surfaces, {E: 9e9, NU: 0.2})
    assert "nominal values" not in {line.get_label() for line in far.axes[0].lines}


@pytest.mark.slow
def test_what_was_held_out_is_compared_but_not_counted_as_gained(tmp_path: Path):
    project = load(write_sweep(tmp_path / "project"), values={NU: RATIO})
    calibrate(project, out=tmp_path / "run", trials=6, hold_out=["cable2"])
    content = report_content(load_run(tmp_path / "run"))
    found = comparison(content)
    assert found is not None
    assert found.experiments == ("cable1",) * 3 + ("cable2 (predicted)",) * 3
    assert found.tuned[:, 3:].max() < 0.1 < found.nominal[:, 3:].min()
    first = improvements(content)[0]
    assert first.nominal == pytest.approx(np.sqrt(np.mean(found.nominal[:, :3] ** 2)), rel=1e-6)
    assert first.tuned == pytest.approx(np.sqrt(np.mean(found.tuned[:, :3] ** 2)), rel=1e-6)
