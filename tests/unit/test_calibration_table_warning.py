"""A search that did not converge is the first thing that `calibrate` prints."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_search_bounds import LOSSES, NAMES, WIDE, problem_of

from softcal.calibration.run import calibrate
from softcal.cli.calibration_table import print_results


def test_a_search_that_did_not_converge_is_warned_of_and_no_other(capsys: pytest.CaptureFixture[str]) -> None:
    problem = problem_of(LOSSES[0], {name: WIDE[name] for name in NAMES})
    short = calibrate(problem, trials=1, starts=1)
    assert short.converged is False
    assert all(one.standard_error is None and one.interval is None for one in short.parameters.values())
    print_results({"joint": short})
    told = capsys.readouterr()
    assert told.err.startswith("Warning: joint: Not converged after 1 trial")
    print_results({"joint": short}, verbose=True)
    told = capsys.readouterr()
    assert (told.err + told.out).count(f"joint: {short.status}") == 1
    for other in (calibrate(problem, starts=1), replace(short, converged=None)):
        print_results({"joint": other})
        assert "No intervals are given" not in capsys.readouterr().err
