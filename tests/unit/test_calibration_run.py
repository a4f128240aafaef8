"""calibrate: joint and one by one, with workers, stopped, resumed, and when all fails."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from fake_twin import (
    NU,
    TRUE,
    E,
    all_necks_fail,
    fake_experiment,
    fake_robot,
    fake_simulate,
    soft_necks_fail,
)

from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, Simulate, make_problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.trial_journal import stored_trials
from softcal.calibration.run import calibrate
from softcal.calibration.search import evaluator, outcome
from softcal.calibration.search.search import Progress
from softcal.errors import CalibrationError, InputError, StorageError
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot

METHODS: tuple[tuple[str, int], ...] = (("least-squares", 30), ("tpe", 24), ("grid", 36))


def problem_of(simulate: Simulate = fake_simulate, *, noise: float = 0.02) -> Problem:
    parameters = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=0.2e6),
        FreeParameter(NU, "1", 0.4, 0.4999, start=0.41),
    ]
    experiments = [fake_experiment("20mm", reach=0.02, noise=noise), fake_experiment("40mm", noise=noise, seed=1)]
    return make_problem(fake_robot(), experiments, parameters, None, simulate)


def dying_twin(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    os._exit(9)


def soft_necks_end_their_worker(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    """As `soft_necks_fail`, but those end their process."""
    found = soft_necks_fail(robot, protocol, theta, sensitivities=sensitivities)
    if not found.succeeded:
        os._exit(9)
    return found


def same(one: CalibrationResult, other: CalibrationResult) -> None:
    """The same result but for how long it took."""
    assert one.parameters == other.parameters
    assert one.loss == other.loss
    assert one.importance == other.importance
    assert one.n_solves == other.n_solves
    assert [(t.number, t.theta, t.loss, t.reason) for t in one.trials] == [
        (t.number, t.theta, t.loss, t.reason) for t in other.trials
    ]


class Stop:
    """An observer at whose `at`-th trial the user presses Ctrl-C."""

    def __init__(self, at: int) -> None:
        self.at = at

    def __call__(self, progress: Progress) -> None:
        if progress.done == self.at and not progress.stage:
            raise KeyboardInterrupt


def test_the_truth_is_found_jointly_and_one_by_one() -> None:
    problem = problem_of(noise=0.0)
    joint = calibrate(problem)
    assert {name: p.value for name, p in joint.parameters.items()} == pytest.approx(TRUE, rel=1e-5)
    assert joint.n_solves == len(joint.trials) <= 12
    assert joint.n_factorisations == 20 * joint.n_solves
    assert joint.extra["importance_kind"] == "sensitivity"
    assert set(joint.experiments) == {"20mm", "40mm"}
    for name in ("20mm", "40mm"):
        result = calibrate(problem.alone(name), starts=1)
        assert set(result.experiments) == {name}
        assert result.parameters[E].value == pytest.approx(TRUE[E], rel=1e-5)


def test_a_result_says_how_sure_it_is_and_what_stands_at_a_bound() -> None:
    result = calibrate(problem_of())
    modulus = result.parameters[E]
    assert modulus.standard_error is not None
    assert abs(modulus.value - TRUE[E]) < 8 * modulus.standard_error
    narrow = make_problem(
        fake_robot(), [fake_experiment()], [FreeParameter(E, "Pa", 3e6, 40e6, "log")], None, fake_simulate
    )
    bound = calibrate(narrow)
    assert bound.parameters[E].at_bound
    assert bound.parameters[E].standard_error is None
    low, high = bound.parameters[E].interval
    assert low == bound.parameters[E].value < high
    assert any("is at its lower bound of 3 MPa" in note.text for note in bound.notes)


def test_tpe_has_fanova_importances_and_a_failed_trial_its_reason() -> None:
    result = calibrate(problem_of(soft_necks_fail), method="tpe", trials=40, seed=1)
    assert result.extra["importance_kind"] == "fanova"
    assert sum(result.importance.values()) == pytest.approx(1.0)
    assert result.importance[E] > result.importance[NU]
    failed = [trial for trial in result.trials if trial.state == "FAILED"]
    assert len(failed) == result.n_failed_trials > 0
    for trial in failed:
        assert trial.loss is None
        assert "No equilibrium beyond 12.0 mm." in trial.reason
        assert trial.theta[E] < 1.0e6 or trial.theta[NU] > 0.49
    note = next(note.text for note in result.notes if "could not be simulated" in note.text)
    assert re.search(rf"the first at {E} = [\d.]+ [kM]?Pa, ", note)


@pytest.mark.long
def test_a_thousand_trials_of_tpe_find_the_modulus_within_two_percent() -> None:
    result = calibrate(problem_of(noise=0.0), method="tpe", trials=1000, seed=1)
    assert result.parameters[E].value == pytest.approx(TRUE[E], rel=0.02)


@pytest.mark.parametrize(("method", "trials"), [("least-squares", 30), ("grid", 16)])
def test_any_number_of_workers_gives_the_same_result(method: str, trials: int) -> None:
    one = calibrate(problem_of(soft_necks_fail), method=method, trials=trials, workers=1)
    two = calibrate(problem_of(soft_necks_fail), method=method, trials=trials, workers=2)
    same(one, two)


@pytest.mark.slow
def test_tpe_is_the_same_search_for_any_number_of_workers() -> None:
    alone, two, three = (calibrate(problem_of(), method="tpe", trials=14, seed=4, workers=n) for n in (1, 2, 3))
    for other in (two, three):
        assert [dict(t.theta) for t in other.trials] == [dict(t.theta) for t in alone.trials]
        assert [t.loss for t in other.trials] == [t.loss for t in alone.trials]
    assert alone.extra["batch"] == 4


@pytest.mark.slow
def test_where_every_evaluation_ends_its_worker_the_search_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluator, "_HOPELESS", 2)
    told = "first 2 evaluations ended their workers.*tried 3 times.*fewer workers than 2"
    with pytest.raises(CalibrationError, match=told):
        calibrate(problem_of(dying_twin), method="grid", trials=9, workers=2)


@pytest.mark.slow
def test_an_evaluation_that_ends_its_worker_each_time_is_a_failed_trial() -> None:
    found = calibrate(problem_of(soft_necks_end_their_worker), method="grid", trials=4, workers=2)
    alone = calibrate(problem_of(soft_necks_fail), method="grid", trials=4)
    assert [trial.state for trial in found.trials] == [trial.state for trial in alone.trials]
    assert [trial.loss for trial in found.trials] == [trial.loss for trial in alone.trials]
    reasons = {trial.reason for trial in found.trials if trial.state == "FAILED"}
    assert reasons == {"It was tried 3 times, and its worker process ended unexpectedly, perhaps for lack of memory."}


@pytest.mark.parametrize(("method", "trials"), METHODS)
@pytest.mark.parametrize("at", [1, 3])
def test_stopped_and_resumed_it_is_as_if_it_had_never_stopped(
    method: str, trials: int, at: int, tmp_path: Path
) -> None:
    whole = calibrate(problem_of(soft_necks_fail), method=method, trials=trials, seed=7)
    options: dict[str, Any] = {"method": method, "trials": trials, "seed": 7, "store": tmp_path / "run"}
    with contextlib.suppress(CalibrationError):  # where all trials so far had failed there is no result yet
        partial = calibrate(problem_of(soft_necks_fail), **options, progress=Stop(at))
        assert f"Stopped by the user after {at} of at most" in partial.status
        assert load_result(tmp_path / "run").status == partial.status
    assert len(stored_trials(tmp_path / "run")) == at
    seen: list[int] = []
    resumed = calibrate(
        problem_of(soft_necks_fail),
        **options,
        resume=True,
        progress=lambda progress: None if progress.stage else seen.append(progress.done),
    )
    same(whole, resumed)
    same(whole, load_result(tmp_path / "run"))
    assert seen == list(range(1, len(whole.trials) + 1))


@pytest.mark.parametrize(("method", "trials"), METHODS)
def test_a_finished_run_is_resumed_without_a_single_solve(method: str, trials: int, tmp_path: Path) -> None:
    whole = calibrate(problem_of(), method=method, trials=trials, store=tmp_path / "run")

    def never(
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        raise AssertionError("simulated again")

    resumed = calibrate(problem_of(never), method=method, trials=trials, store=tmp_path / "run", resume=True)
    same(whole, resumed)
    assert resumed.experiments["40mm"].rmse == whole.experiments["40mm"].rmse


def test_tpe_resumed_with_more_workers_keeps_its_course_and_takes_more_trials(tmp_path: Path) -> None:
    calibrate(problem_of(), method="tpe", trials=8, seed=3, store=tmp_path / "run")
    more = calibrate(problem_of(), method="tpe", trials=16, seed=3, store=tmp_path / "run", resume=True, workers=2)
    same(calibrate(problem_of(), method="tpe", trials=16, seed=3), more)


def test_a_lock_that_a_killed_run_left_stops_no_resume(tmp_path: Path) -> None:
    options: dict[str, Any] = {"method": "tpe", "seed": 3}
    folder = tmp_path / "run"
    calibrate(problem_of(), **options, trials=4, store=folder)
    (folder / "optuna.journal.lock").symlink_to("run/optuna.journal")  # Optuna's own, of a path relative to elsewhere
    patience = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("The lock is waited for."))
    signal.alarm(15)
    try:
        resumed = calibrate(problem_of(), **options, trials=6, store=folder, resume=True)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, patience)
    same(calibrate(problem_of(), **options, trials=6), resumed)


@pytest.mark.parametrize(("method", "trials"), METHODS)
def test_optunas_own_tools_read_the_run(method: str, trials: int, tmp_path: Path) -> None:
    import optuna
    from optuna.storages.journal import JournalFileBackend

    result = calibrate(problem_of(soft_necks_fail), method=method, trials=trials, store=tmp_path / "run")
    storage = optuna.storages.JournalStorage(JournalFileBackend(str(tmp_path / "run" / "optuna.journal")))
    study = optuna.load_study(study_name="softcal", storage=storage)
    assert [trial.params for trial in study.trials] == [dict(trial.theta) for trial in result.trials]
    assert [trial.user_attrs["reason"] for trial in study.trials] == [trial.reason for trial in result.trials]
    assert study.best_params == pytest.approx({name: p.value for name, p in result.parameters.items()})
    assert sum(t.state == optuna.trial.TrialState.FAIL for t in study.trials) == result.n_failed_trials


def test_tpe_runs_with_the_papers_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    import optuna

    given: dict[str, object] = {}
    real = optuna.samplers.TPESampler

    def spy(**settings: object) -> optuna.samplers.TPESampler:
        given.update(settings)
        return real(**settings)  # type: ignore[arg-type]

    monkeypatch.setattr(optuna.samplers, "TPESampler", spy)
    calibrate(problem_of(), method="tpe", trials=2, seed=11)
    assert given == {
        "multivariate": False,
        "group": False,
        "n_startup_trials": 10,
        "n_ei_candidates": 24,
        "constant_liar": False,
        "seed": 11,
    }


@pytest.mark.parametrize(("method", "trials"), METHODS)
def test_when_every_trial_fails_there_is_no_result_but_a_sentence(method: str, trials: int, tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"All \d+ trials failed.*No equilibrium beyond 1\.0 mm\."):
        calibrate(problem_of(all_necks_fail), method=method, trials=trials, store=tmp_path / "run")
    assert not (tmp_path / "run" / "result.json").exists()
    held = stored_trials(tmp_path / "run")
    assert all("No equilibrium beyond 1.0 mm." in stored.trial.reason for stored in held.values())
    assert len(held) > 0


def test_progress_tells_the_best_so_far() -> None:
    seen: list[Progress] = []
    result = calibrate(
        problem_of(soft_necks_fail),
        method="tpe",
        trials=20,
        progress=lambda state: None if state.stage else seen.append(state),
    )
    assert [p.done for p in seen] == list(range(1, 21))
    assert {p.total for p in seen} == {20}
    losses = [p.best_loss for p in seen if p.best_loss is not None]
    assert losses == sorted(losses, reverse=True)
    assert seen[-1].best_loss == result.loss
    assert seen[-1].failed == result.n_failed_trials


def test_what_follows_the_search_is_told_before_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Progress] = []
    before_fanova: list[Progress] = []

    def watched(*arguments: object) -> dict[str, float]:
        before_fanova.append(seen[-1])
        return {}

    monkeypatch.setattr(outcome, "fanova_importance", watched)
    calibrate(problem_of(), method="tpe", trials=5, hold_out=["40mm"], progress=seen.append)
    (last,) = before_fanova
    assert (last.stage, last.done, last.total) == ("importances (fANOVA)", 5, 5)
    assert seen[-1].stage == "prediction of 40mm"
    assert not any(state.stage for state in seen[:5])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "simplex"}, "no such method"),
        ({"trials": 0}, "too few trials"),
        ({"method": "grid", "trials": 3}, "needs more trials; got 3; allowed: at least 4"),
        ({"workers": 0}, "too few workers"),
        ({"starts": 0}, "too few starts"),
        ({"seed": -1}, "this number is out of range"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        calibrate(problem_of(), **options)  # type: ignore[arg-type]


def test_the_curves_of_a_result_cannot_be_changed() -> None:
    fit = next(iter(calibrate(problem_of()).experiments.values()))
    curves = [*fit.measured.values(), *fit.simulated.values(), *fit.response.values(), *fit.bands.values()]
    assert len(curves) > 5
    assert not any(curve.flags.writeable for curve in curves)


def test_to_resume_there_must_be_a_folder_with_a_run(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="a run is resumed from its folder, which is missing"):
        calibrate(problem_of(), resume=True)
    with pytest.raises(StorageError, match="no run to resume"):
        calibrate(problem_of(), store=tmp_path, resume=True)


_SLOW_SCRIPT = """
import os, sys, time
sys.path[:0] = {path!r}
from pathlib import Path
from fake_twin import fake_simulate
from test_calibration_run import problem_of
from softcal.calibration.run import calibrate

AT_WORK = Path({at_work!r})  # holds a file for each worker that has started

def slow(robot, protocol, theta=None, **options):
    (AT_WORK / str(os.getpid())).touch()
    time.sleep(0.05)
    return fake_simulate(robot, protocol, theta, **options)

def tell(progress):
    if progress.done >= 5 and len(os.listdir(AT_WORK)) == 2:
        print("going on", flush=True)

if __name__ == "__main__":
    run = Path({folder!r})
    print(calibrate(problem_of(slow), method="grid", trials=2500, workers=2, store=run, progress=tell).status)
"""


def _with_two_workers(folder: Path, tmp_path: Path) -> subprocess.Popen[str]:
    """A calibration in a process of its own, which writes a line when both its workers are at work."""
    here = Path(__file__).parent
    script, at_work = tmp_path / "slow.py", tmp_path / "at_work"
    at_work.mkdir()
    script.write_text(_SLOW_SCRIPT.format(path=[str(here), str(here.parent)], folder=str(folder), at_work=str(at_work)))
    return subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


@pytest.mark.slow
def test_a_real_ctrl_c_ends_the_workers_and_keeps_every_trial(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = _with_two_workers(folder, tmp_path)
    # Ends the waiting below, whatever is wrong: with the processes their pipes are closed.
    watchdog = threading.Timer(120, os.killpg, (process.pid, signal.SIGKILL))
    watchdog.start()
    try:
        first_line = process.stdout.readline()
        # To the whole group, as a terminal does.
        os.killpg(process.pid, signal.SIGINT)
        out, error = process.communicate()
    finally:
        watchdog.cancel()
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert first_line == "going on\n", error
    assert "Stopped by the user after" in out, error
    assert "Traceback" not in error
    kept = load_result(folder)
    assert 0 < len(kept.trials) < 2500
    assert f"after {len(kept.trials)} of at most 2500" in out


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM], ids=["killed", "ended"])
def test_workers_end_with_their_parent_however_it_ends(tmp_path: Path, number: signal.Signals) -> None:
    """The workers share the parent's pipes, so these end when the last of them has."""
    process = _with_two_workers(tmp_path / "run", tmp_path)
    outlived: list[bool] = []

    def end_all() -> None:
        outlived.append(True)
        os.killpg(process.pid, signal.SIGKILL)

    assert process.stdout is not None
    watchdog = threading.Timer(120, end_all)
    watchdog.start()
    try:
        assert process.stdout.readline() == "going on\n"
        watchdog.cancel()
        watchdog = threading.Timer(15, end_all)
        watchdog.start()
        os.kill(process.pid, number)  # to it alone
        process.stdout.read()
    finally:
        watchdog.cancel()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    assert process.returncode == -number
    assert not outlived


_TPE_SCRIPT = """
import sys, time
sys.path[:0] = {path!r}
from pathlib import Path
from fake_twin import fake_simulate
from test_calibration_run import problem_of
from softcal.calibration.run import calibrate

def slow(robot, protocol, theta=None, **options):
    time.sleep(0.02)
    return fake_simulate(robot, protocol, theta, **options)

if __name__ == "__main__":
    tell = lambda progress: print(progress.done, flush=True)
    calibrate(problem_of(slow), method="tpe", trials=60, workers=3, store=Path({folder!r}), progress=tell)
"""


@pytest.mark.slow
@pytest.mark.parametrize("done", [pytest.param(1, marks=pytest.mark.long), 7, pytest.param(33, marks=pytest.mark.long)])
def test_a_search_by_three_workers_that_is_killed_ends_as_if_it_had_not_been(tmp_path: Path, done: int) -> None:
    here, folder, script = Path(__file__).parent, tmp_path / "run", tmp_path / "search.py"
    script.write_text(_TPE_SCRIPT.format(path=[str(here), str(here.parent)], folder=str(folder)))
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as process:
        watchdog = threading.Timer(120, process.kill)
        watchdog.start()
        try:
            assert process.stdout is not None
            assert any(int(line) >= done for line in process.stdout), "it ended before"
        finally:
            watchdog.cancel()
            process.kill()
    options = {"method": "tpe", "trials": 60}
    resumed = calibrate(problem_of(), store=folder, resume=True, workers=1, **options)
    whole = calibrate(problem_of(), workers=1, **options)
    assert len(whole.trials) == 60
    assert [(t.number, t.state, t.theta, t.loss) for t in resumed.trials] == [
        (t.number, t.state, t.theta, t.loss) for t in whole.trials
    ]
    assert resumed.parameters == whole.parameters


def test_a_run_tells_what_it_is_doing(tmp_path: Path) -> None:
    folder, seen = tmp_path / "run", []

    def look(progress: Progress) -> None:
        if not seen:
            time.sleep(1.5)  # it writes about once a second
            seen.append(json.loads((folder / "live.json").read_text(encoding="utf-8")))

    calibrate(problem_of(soft_necks_fail), method="grid", trials=9, store=folder, workers=2, progress=look)
    (live,) = seen
    assert live["pid"] == os.getpid()
    assert live["executor"] == "2 processes of this machine"
    assert len(live["workers"]) == 2
    assert not live["ended"]
    over = json.loads((folder / "live.json").read_text(encoding="utf-8"))
    assert over["ended"]
    assert (over["done"], over["total"], over["failed"]) == (9, 9, 5)
    assert sum(worker["done"] for worker in over["workers"]) == 9
    assert over["updated"] >= live["updated"] >= over["began"]
