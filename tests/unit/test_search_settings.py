"""One object for how a search is set: changes by name, an optimiser's own where nothing is given, and refusals."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_twin import NU, E, fake_experiment, fake_robot, fake_simulate
from project_case import write_project

from softcal import SearchSettings, load
from softcal import calibrate as calibrate_project
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.run import calibrate
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.errors import InputError


def problem() -> Problem:
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log"), FreeParameter(NU, "1", 0.4, 0.4999)]
    return make_problem(fake_robot(), [fake_experiment("a"), fake_experiment("b")], free, None, fake_simulate)


def test_changes_take_the_place_of_the_settings() -> None:
    by_name = calibrate(problem(), method="grid", trials=4, hold_out=["b"])
    whole = calibrate(problem(), SearchSettings("tpe", trials=4, hold_out=("b",)), method="grid")
    assert [t.theta for t in by_name.trials] == [t.theta for t in whole.trials]
    assert by_name.extra == whole.extra
    assert (by_name.method, len(by_name.trials), list(by_name.held_out)) == ("grid", 4, ["b"])


def test_what_a_run_records_is_complete_and_holds_nothing_that_was_not_heeded() -> None:
    given = SearchSettings(seed=7, options={"starts": 5})
    recorded = {name: OPTIMISERS[name].settled(given.changed(method=name)).record() for name in OPTIMISERS}
    common = {"seed": 7}
    assert recorded["least-squares"] == {
        "method": "least-squares", "trials": 40, "starts": 5, "batch": 1, **common,
    }  # fmt: skip
    assert recorded["tpe"] == {"method": "tpe", "trials": 1000, "startup_trials": 10, "batch": 4, **common}
    assert recorded["grid"] == {"method": "grid", "trials": 400, "batch": 1, **common}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"trails": 3}, r"trails: there is no such setting of a search; allowed: .* Try: 'trials'"),
        ({"method": "gird"}, r"method: there is no such method; got 'gird'; .* Try: 'grid'"),
        ({"trials": 0}, "trials: there are too few trials; got 0"),
        ({"starts": 0}, "starts: there are too few starts; got 0"),
        ({"starts": 2.5}, "starts: this is of the wrong kind; got 2.5; allowed: a whole number"),
        ({"seed": -1}, "seed: this number is out of range; got -1"),
        ({"workers": 0}, "workers: there are too few workers; got 0"),
    ],
)
def test_what_makes_no_sense_is_refused_by_its_name(changes: dict, told: str) -> None:
    with pytest.raises(InputError, match=told) as error:
        calibrate(problem(), **changes)
    assert len(error.value.faults) == 1


def test_a_project_takes_any_of_its_calibration_section_and_nothing_else(tmp_path: Path) -> None:
    project = load(write_project(tmp_path))
    assert project.calibration.search == SearchSettings(options={"starts": 1})
    for given, said in (
        ({"methd": "grid"}, r"^--option methd=grid: neither the method .* has this option; .* Try: 'method'"),
        ({"start": 3}, r"^--option start=3: neither .* allowed: alpha, beta, starts\. Try: 'starts'"),
        ({"starts": 0}, r"^--option starts=0: there are too few starts"),
        ({"hold_out": 3}, r"^--hold-out: this is of the wrong kind"),
    ):
        with pytest.raises(InputError, match=said):
            calibrate_project(project, out=tmp_path / "run", **given)
    assert not (tmp_path / "run").exists()
    heavier = calibrate_project(project, method="grid", trials=4, alpha=0.6, beta=2.0).headline
    plain = calibrate_project(project, method="grid", trials=4, alpha=None, starts=None).headline
    assert [t.loss for t in heavier.trials] == pytest.approx([2 * (t.loss or 0.0) for t in plain.trials])


def test_the_error_of_the_mesh_is_computed_once_and_for_no_fit_of_a_validation(tmp_path: Path) -> None:
    project = load(write_project(tmp_path))
    assert project.calibration.mesh_error
    assert not project.calibration.search.mesh_error
