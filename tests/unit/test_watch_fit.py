"""What was measured beside what the twin does at the best trial, as the page shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from project_case import write_project

from softcal.errors import Fault, InputError
from softcal.plugins.watch import fit_drawing
from softcal.plugins.watch.fit_drawing import MOST, fit_drawings, fits_at
from softcal.plugins.watch.twin import FitPicture, TwinShape
from softcal.plugins.watch.twin_panel import fit_text
from softcal.project.project import Project, load
from softcal.twin.response import Response
from softcal.workflows.calibration import make_problem, project_at

THETA = {"bar.youngs_modulus": 1.1e6, "front.slack[pull]": 1e-3}


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return load(write_project(tmp_path_factory.mktemp("project")))


def test_the_fit_at_a_trial_is_that_of_the_search(project: Project):
    fits, missing = fits_at(project_at(project, THETA, {}, ["pull"]), ["pull"], {})
    assert (list(fits), missing) == (["pull"], "")
    expected = make_problem(project).evaluate(THETA).observations["pull"].predicted
    assert fits["pull"].simulated.keys() == expected.keys()
    for channel, values in expected.items():
        np.testing.assert_allclose(fits["pull"].simulated[channel], values, rtol=1e-9)
    (drawing,) = fit_drawings(project, "pull", fits)
    assert drawing.of == "pull"


def test_an_experiment_that_cannot_be_simulated_is_a_sentence(project: Project, monkeypatch: pytest.MonkeyPatch):
    failed = Response({}, {}, "No equilibrium was found.", succeeded=False, n_factorisations=0)
    fits, missing = fits_at(project, ["pull"], {"pull": failed})
    assert (fits, missing) == ({}, "pull: No equilibrium was found.")
    assert list(fit_drawings(project, "pull", fits)) == []

    def refuse(*_: object, **__: object) -> Response:
        raise InputError(Fault("the cable is released"))

    monkeypatch.setattr(fit_drawing, "simulate", refuse)
    assert fits_at(project, ["pull"], {})[1] == "pull: the cable is released."


def test_of_many_experiments_the_first_are_drawn_and_the_page_says_so(project: Project):
    failed = Response({}, {}, "No.", succeeded=False, n_factorisations=0)
    names = [f"e{k}" for k in range(MOST + 2)]
    many = replace(project, experiments={name: project.experiments["pull"] for name in names})
    _, missing = fits_at(many, names, dict.fromkeys(names, failed))
    assert missing.startswith("e0: No. e1: No. ")
    assert missing.endswith(f"e5: No. The first {MOST} of 8 experiments are drawn.")


def test_the_page_says_which_trial_the_figures_are_of():
    shape = TwinShape(7, "front", 0.01, b"x", "", (FitPicture("a", b"png"),), "b: none.")
    assert fit_text(shape) == "Trial 7. b: none."
    assert fit_text(replace(shape, fits=())) == "b: none."
    assert fit_text(replace(shape, trial=None, missing="")) == ""
