"""Whole cycles of the fitted samples: loops, softening and set, measured and of the twin; in result, report, print."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project
from test_whole_record import LOOP, cycles, dataset, table, with_steps

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import Observation
from softcal.calibration.results.fit import experiment_fit
from softcal.calibration.results.result import ExperimentFit
from softcal.calibration.results.result_reading import load_result
from softcal.cli.calibration_table import print_results
from softcal.experiments.dataset import Dataset
from softcal.experiments.hysteresis import loops
from softcal.experiments.steps.cycles import find_cycles
from softcal.project.project import load
from softcal.report.conclusions import conclusions
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.cycles import cycle_sentence
from softcal.report.figures.loops import loops as loops_figure
from softcal.report.section import all_tables
from softcal.workflows.calibration import calibrate
from softcal.workflows.run_folder import calibration_folder


def fit_of(data: Dataset, tension: np.ndarray) -> ExperimentFit:
    """The fit of a twin with this tension."""
    experiment = Experiment("pull", data, cable="front", plate="plate", compared=("tension",))
    return experiment_fit(experiment, Observation({"tension": tension}, {}, {}, {}))


def spring(shortening: np.ndarray, loading: float, slack: float) -> np.ndarray:
    """N, of 1000 N/m: `loading` times that while it is pulled; without force below the slack as it is let go."""
    away = np.maximum(shortening - slack, 0.0)
    rises = np.diff(shortening, prepend=-1.0) > 0.0
    return np.where(rises, loading * 1e3 * shortening, 1e3 * away)


def test_a_loop_has_the_area_between_its_branches_and_ends_where_the_force_vanishes() -> None:
    d = 1e-3 * np.concatenate([np.linspace(0.0, 10.0, 201), np.linspace(10.0, 0.0, 201)[1:]])
    measured = replace(dataset({"time": np.arange(401.0), "shortening": d, "tension": spring(d, 1.0, 2e-3)}))
    data = replace(measured, cycle=np.zeros(401))
    fit = fit_of(data, spring(d, 1.0, 4e-3))
    (cycle,) = fit.cycles
    assert cycle.measured.loading_energy == pytest.approx(0.05, rel=1e-3)
    assert cycle.measured.lost_energy == pytest.approx(0.05 - 0.032, rel=2e-2)
    assert cycle.simulated.lost_energy == pytest.approx(0.05 - 0.018, rel=2e-2)
    assert cycle.measured.vanishes_at == pytest.approx(2.2e-3, abs=3e-5)  # 2 % of the peak
    assert cycle.simulated.vanishes_at == pytest.approx(4.2e-3, abs=3e-5)
    told = cycle_sentence("pull", fit)
    assert "the force vanishes at 2.20 mm" in told
    assert "the twin's, at 4.20 mm" in told


def test_samples_that_go_one_way_or_have_gaps_have_no_cycles() -> None:
    data = find_cycles(dataset(cycles(2)))
    assert len(fit_of(data, data.values("tension")).cycles) == 2
    up = data.take(np.diff(data.values("shortening"), prepend=-1.0) > 0.0, data.provenance[-1])
    assert not fit_of(up, up.values("tension")).cycles
    assert not fit_of(replace(data, cycle=None), data.values("tension")).cycles
    gap = np.where(np.arange(data.n_samples) == 30, np.nan, data.values("tension"))
    holed = replace(data, channels={**data.channels, "tension": replace(data.channels["tension"], values=gap)})
    assert not fit_of(holed, data.values("tension")).cycles


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration of an elastic twin to three cycles that lose energy."""
    to = tmp_path_factory.mktemp("cycles")
    project = load(write_project(to, with_steps("find_cycles"), data=table()))
    calibrate(project, out=to / "run")
    return to / "run"


def test_the_result_has_them_in_its_file(folder: Path) -> None:
    result = load_result(calibration_folder(folder, "pull"))
    (fit,) = result.experiments.values()
    (entry,) = json.loads((folder / "result.json").read_text())["experiments"].values()
    assert [one["measured"]["number"] for one in entry["cycles"]] == [0, 1, 2]
    expected = loops(find_cycles(dataset(cycles())))
    for cycle, loop, held in zip(fit.cycles, expected, entry["cycles"], strict=True):
        assert cycle.measured.lost_energy == pytest.approx(loop.lost_energy, rel=1e-6)
        assert cycle.measured.hysteresis == pytest.approx(2 * LOOP / (1 + LOOP), rel=0.08)  # of 20 samples a way
        assert abs(cycle.simulated.lost_energy) < 1e-3 * loop.lost_energy  # the twin is elastic
        assert held["measured"]["lost_energy"] == cycle.measured.lost_energy


def test_report_and_print_have_them_where_they_are(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = load_result(calibration_folder(folder, "pull"))
    (name,) = result.experiments
    project = load(folder.parent / "project.yaml")
    data = project.experiments[name].dataset
    content = ReportContent("bar", {name: result}, {name: ExperimentContent(name, data, data)})
    rows = all_tables(content)["loops"].rows
    assert len(rows) == 3
    assert len(list(loops_figure(content))) == 1
    said = f"{name}: 3 cycles lose "
    assert any(one.text.startswith(said) for one in conclusions(content))
    print_results({name: result}, verbose=True)
    assert said in " ".join(capsys.readouterr().out.split())
    bare = replace(result, experiments={name: replace(result.experiments[name], cycles=())})
    content = replace(content, results={name: bare})
    assert "loops" not in all_tables(content)
    assert not list(loops_figure(content))
    assert not any(said in one.text for one in conclusions(content))
    print_results({name: bare})
    assert "cycles lose" not in capsys.readouterr().out
