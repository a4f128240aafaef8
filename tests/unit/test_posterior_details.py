"""Details of posteriors: the range of the surrogate, the reasons that are given, a stop on the way."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from interval_cases import linear_problem, values
from project_case import write_project

from softcal.calibration.interval_studies import posterior as module
from softcal.calibration.interval_studies.posterior import LogPosterior, posterior, reasons
from softcal.calibration.interval_studies.surrogate import Surrogate
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.cli import main

SIZE, REACH, THIN = 8, 0.3, 1e-4


def ridge(along: np.ndarray, covariance: np.ndarray) -> LogPosterior:
    """A density that is thin across a line through the middle of the box, and constant along it."""
    across = np.linalg.svd(along[None, :])[2][1:].T
    slopes = REACH * across / THIN  # by u = (z - 0.5) / REACH
    surrogate = Surrogate(
        np.full(SIZE, 0.5), np.eye(SIZE) / REACH, 1, np.concatenate([np.zeros((1, SIZE - 1)), slopes]), 0.0
    )
    found = SimpleNamespace(minimum=np.full(SIZE, 0.5), root=np.eye(SIZE), dof=np.full(SIZE, 1e6))
    return LogPosterior(SimpleNamespace(found=found), surrogate, 0.0, np.full(SIZE, 0.5), covariance)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_thin_ridge_is_followed_to_the_end_of_the_surrogates_range(angle: float):
    """Along the axis of a parameter, or else along a principal direction of the draws."""
    along = np.zeros(SIZE)
    along[:2] = np.cos(angle), np.sin(angle)
    covariance = 1e-6 * np.eye(SIZE) + 1e-2 * np.outer(along, along)
    beyond = ridge(along, covariance).beyond(np.random.default_rng(0))
    assert len(beyond)
    away = (beyond - 0.5) @ along
    assert np.abs(away) == pytest.approx(1.3 * REACH)
    assert {float(np.sign(one)) for one in away} == {-1.0, 1.0}


def test_a_reason_is_given_where_the_draws_show_one():
    chance = np.random.default_rng(2)
    normal = 0.5 + 0.1 * chance.standard_normal((20_000, 4))
    normal[:, 3] = 0.5 + 0.05 * (normal[:, 0] - 0.5) + 0.05 * chance.standard_normal(len(normal))
    assert set(reasons("abcd", normal).values()) == {""}
    z = normal.copy()
    z[:, 0] -= 0.45
    z[:, 1] = 0.3 + 0.9 * z[:, 0] + 0.02 * chance.standard_normal(len(z))
    z[:, 2] = 0.2 + 0.1 * chance.exponential(size=len(z))
    z = z[z[:, 0] > 0.0]
    found = reasons("abcd", z)
    assert found["a"].startswith("a bound cuts the posterior, and the posterior is skewed towards high values (+0.")
    assert "a bound cuts the posterior of a, with which it is correlated (+0.9" in found["b"]
    assert found["c"].startswith("the posterior is skewed towards high values (+")
    assert "bound" not in found["c"]
    assert found["d"] == ""


@pytest.mark.slow
def test_a_linear_twin_far_from_its_bounds_has_no_reason():
    problem = linear_problem(LikelihoodLoss(), noise=0.9)
    found = posterior(problem, values(problem))
    assert {one.reason for one in found.intervals.values()} == {""}
    for one in found.intervals.values():
        assert replace(one, quick=(0.5 * one.value, 2 * one.value)).differs


def test_ctrl_c_during_the_sampling_ends_with_a_sentence_and_no_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    project = write_project(tmp_path)
    with pytest.raises(SystemExit):
        main(["calibrate", str(project), "--out", str(tmp_path / "run"), "--no-report", "--no-mesh-error"])
    capsys.readouterr()
    calls, function = [0], LogPosterior.function

    def interrupted(self: LogPosterior):
        value = function(self)

        def wrapped(z: np.ndarray) -> np.ndarray:
            calls[0] += 1
            if calls[0] == 60:
                signal.raise_signal(signal.SIGINT)
            return value(z)

        return wrapped

    monkeypatch.setattr(module.LogPosterior, "function", interrupted)
    with pytest.raises(SystemExit) as ended:
        main(["intervals", str(tmp_path / "run"), "--by", "posterior"])
    said = capsys.readouterr()
    assert ended.value.code == 130
    assert said.err.splitlines()[-1] == "Stopped."
    assert "emcee" not in said.out + said.err
    assert not (tmp_path / "run" / "intervals-posterior").exists()
