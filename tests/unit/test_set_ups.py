"""Experiments of one set-up share nuisances: the frame of the cameras, which stay where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manipulator_case import FREE, LENGTH, MODULI, experiment, manipulator
from project_case import write_project

from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.run import calibrate
from softcal.calibration.search import hold_out
from softcal.errors import ParameterError, ProjectFileError
from softcal.project.project import load
from softcal.workflows.calibration import calibrated

FIRST, SECOND = (0.01, -0.02, 0.03, 0.1, -0.2, 0.1), (-0.02, 0.0, 0.01, 0.0, 0.1, -0.1)
FRAMES = tuple(FreeParameter(n, "m" if len(n) == 7 else "rad", -0.5, 0.5, per_set_up=True) for n in FRAME)


def problem(*free):
    """Two cables pulled before the cameras were moved, and one after."""
    tests = [
        replace(experiment("cable1", frame=FIRST), set_up="before"),
        replace(experiment("cable5", frame=FIRST), set_up="before"),
        replace(experiment("cable2", frame=SECOND), set_up="after"),
    ]
    return make_problem(manipulator(), tests, free, DistanceLoss(LENGTH))


def frame_of(result, set_up):
    return [result.parameters[f"{name}[{set_up}]"].value for name in FRAME]


def test_a_set_up_has_one_frame_and_every_experiment_of_it_feels_it():
    posed = problem(*FREE, *FRAMES)
    assert sum(label.startswith("frame.x") for label in posed.space.labels) == 2
    assert posed.alone("cable5").space.labels == posed.alone("cable1").space.labels
    theta = {**MODULI} | {
        f"{name}[{set_up}]": value
        for set_up, frame in (("before", FIRST), ("after", SECOND))
        for name, value in zip(FRAME, frame, strict=True)
    }
    assert posed.evaluate(theta).loss == pytest.approx(0.0, abs=2e-3)
    moved = posed.evaluate({**theta, "frame.x[before]": 0.02}).experiment_losses
    assert moved["cable1"] > 1.0
    assert moved["cable5"] > 1.0
    assert moved["cable2"] == pytest.approx(0.0, abs=2e-3)


def test_the_gradient_by_a_shared_frame_is_that_of_central_differences():
    posed = problem(*FREE, *FRAMES)
    theta = {**dict.fromkeys(MODULI, 0.9e9), **{p.label: 0.01 for p in posed.space.parameters if p.experiment}}
    label = "frame.ry[before]"
    # All with derivatives: without them, the twin reads its curve between other equilibria.
    here, above, below = (
        posed.evaluate({**theta, label: theta[label] + step}, jacobian=True) for step in (0.0, 1e-6, -1e-6)
    )
    slope = (above.loss - below.loss) / 2e-6
    assert here.gradient[posed.space.labels.index(label)] == pytest.approx(slope, rel=1e-8)


@pytest.mark.slow
def test_what_is_held_out_is_predicted_in_the_frame_of_its_set_up():
    found = calibrate(problem(*FREE, *FRAMES), starts=1, hold_out=["cable5"])
    np.testing.assert_allclose(frame_of(found, "before"), FIRST, atol=1e-5)
    assert found.held_out["cable5"].own == {}
    assert found.held_out["cable5"].loss < 1e-2
    alone = calibrate(problem(*FREE, *FRAMES), starts=1, hold_out=["cable2"])
    assert set(alone.held_out["cable2"].own) == {f"{name}[after]" for name in FRAME}


@pytest.mark.slow
def test_a_held_out_experiment_whose_own_values_did_not_converge_says_so(monkeypatch):
    settled = calibrate(problem(*FREE, *FRAMES), starts=1, hold_out=["cable2"])
    assert not any("cable2 was held out" in note.text for note in settled.notes)
    monkeypatch.setattr(hold_out, "_BUDGET", 1)
    found = calibrate(problem(*FREE, *FRAMES), starts=1, hold_out=["cable2"])
    (note,) = [note for note in found.notes if "cable2 was held out" in note.text]
    assert "The fit of its own parameters (frame.x[after], " in note.text
    assert "Not converged after 1 trial" in note.text


def test_an_experiment_without_a_set_up_is_one_by_itself():
    tests = [replace(experiment("cable1"), set_up="before"), experiment("cable2")]
    posed = make_problem(manipulator(), tests, (*FREE, FRAMES[0]), DistanceLoss(LENGTH))
    assert [label for label in posed.space.labels if "frame" in label] == ["frame.x[before]", "frame.x[cable2]"]


@pytest.mark.slow
def test_a_parameter_of_the_robot_may_be_a_set_ups_own_but_not_of_what_is_held_out():
    stiff, *others = FREE
    posed = problem(replace(stiff, per_set_up=True), *others)
    assert calibrate(posed, starts=1, trials=2, hold_out=["cable5"]).held_out["cable5"].own == {}
    with pytest.raises(ParameterError, match="a robot of its own"):
        calibrate(posed, starts=1, trials=2, hold_out=["cable2"])


SET_UPS = (
    ("    cable: front\n", "    set_up: monday\n    cable: front\n"),
    ("    files:\n", "    files: &files\n"),
    (
        "    noise: {tension: 0.05 N, pitch: 0.2 deg}\n",
        "  again:\n    set_up: monday\n    cable: front\n    plate: plate\n    files: *files\n",
    ),
    ("per: experiment", "per: set_up"),
    ("starts: 1}", "starts: 1, trials: 4}"),
)


def project(folder, *changes):
    """The project with its experiment twice, both in one set-up."""
    return write_project(folder, *SET_UPS, *changes)


def test_a_project_says_set_ups_and_takes_their_values_back(tmp_path):
    loaded = load(project(tmp_path))
    assert loaded.space is not None
    assert loaded.space.labels == ("bar.youngs_modulus", "front.slack[monday]")
    from softcal.workflows.calibration import calibrate as calibrate_project

    result = calibrate_project(loaded).headline
    at_values = calibrated(loaded, result)
    slack = result.parameters["front.slack[monday]"].value
    assert slack > 1e-4
    assert [e.rig_values()["front.slack"] for e in at_values.experiments.values()] == [slack, slack]


def test_a_set_up_cannot_be_called_as_another_experiment(tmp_path):
    with pytest.raises(ProjectFileError, match="an experiment has the name of the set-up"):
        load(project(tmp_path, ("pull:\n    set_up: monday", "pull:\n    set_up: again")))
