"""The run folder: never overwritten, never half written, and read back as it was."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import resource
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_trials import change_trials, undigested
from fake_twin import NU, E, fake_experiment, fake_robot, fake_simulate, soft_necks_fail

from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.results.payload import decode, encode
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.result_files import result_json
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.store import RunStore, write_text
from softcal.calibration.results.trial_journal import cut_to_whole_lines, stored_trials
from softcal.calibration.run import calibrate
from softcal.calibration.search.search import Progress
from softcal.calibration.statistics.estimate import Remark
from softcal.errors import StorageError

MODULUS = FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=0.2e6)
RATIO = FreeParameter(NU, "1", 0.4, 0.4999)


def problem_of(reach: float = 0.04) -> Problem:
    experiments = [fake_experiment("pull", reach=reach, noise=0.02)]
    return make_problem(fake_robot(), experiments, [MODULUS, RATIO], None, soft_necks_fail)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CalibrationResult]:
    folder = tmp_path_factory.mktemp("runs") / "run"
    return folder, calibrate(problem_of(), store=folder, files={"project.yaml": "name: neck\n"})


def test_result_json_holds_what_is_promised_in_si(run: tuple[Path, CalibrationResult]) -> None:
    folder, result = run
    held = json.loads((folder / "result.json").read_text())
    profile = held["parameters"][E].pop("profile")
    assert held["parameters"][E].pop("moved_by") == dict(result.parameters[E].moved_by) != {}
    low, high = held["parameters"][E]["interval"]
    assert profile[0][0] < low < high < profile[-1][0]
    assert [list(pair) for pair in result.parameters[E].profile] == profile
    assert held["parameters"][E] == {
        "off_prior": None,
        "value": result.parameters[E].value,
        "unit": "Pa",
        "at_bound": False,
        "lower": 0.1e6,
        "upper": 40e6,
        "standard_error": result.parameters[E].standard_error,
        "interval": list(result.parameters[E].interval),
        "scale": "log",
        "shares": dict(result.parameters[E].shares),
        "dof": result.parameters[E].dof,
        "of": [],
        "beyond": None,
    }
    for key in ("loss", "method", "seed", "n_solves", "n_factorisations", "wall_s", "status", "n_failed_trials"):
        assert held[key] == getattr(result, key)
    assert held["loss_name"] == "papers"
    assert set(held["importance"]) == {E, NU}
    errors = held["experiments"]["pull"]
    residual = result.experiments["pull"].simulated["tension"] - result.experiments["pull"].measured["tension"]
    assert errors["tension_rmse"] == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert errors["tension_rmse_detrended"] <= errors["tension_rmse"]
    assert {"pitch_rmse", "pitch_rmse_detrended"} <= set(errors)
    assert (folder / "project.yaml").read_text() == "name: neck\n"


def test_a_channel_that_is_not_compared_has_null_errors() -> None:
    experiment = fake_experiment()
    only = type(experiment)("pull", experiment.dataset, "front", "plate", compared=("tension",))
    result = calibrate(make_problem(fake_robot(), [only], [MODULUS], None, fake_simulate))
    assert result_json(result)["experiments"]["pull"]["pitch_rmse"] is None


def test_every_header_of_the_tables_has_its_unit(run: tuple[Path, CalibrationResult]) -> None:
    folder, result = run
    with (folder / "response-pull.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == [
        "front.shortening [m]",
        "front.tension [N]",
        "plate.pitch [rad]",
        "plate.roll [rad]",
        "measured.shortening [m]",
        "measured.tension [N]",
        "measured.pitch [rad]",
        "simulated.tension [N]",
        "simulated.pitch [rad]",
        "band.tension [N]",
        "band.pitch [rad]",
        "repeat.tension [N]",
        "repeat.pitch [rad]",
    ]
    assert len(rows) == 41
    with (folder / "trials.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == [
        "number",
        "state",
        "loss",
        "seconds [s]",
        "n_factorisations",
        "reason",
        f"{E} [Pa]",
        f"{NU} [1]",
        "loss of pull",
        "error of pull: tension [N]",
        "error of pull: pitch [rad]",
    ]
    assert len(rows) == len(result.trials)
    assert {row[1] for row in rows} == {"COMPLETE", "FAILED"}


def test_a_result_is_read_back_as_it_was_written(run: tuple[Path, CalibrationResult]) -> None:
    folder, result = run
    held = load_result(folder)
    for key in ("parameters", "loss", "importance", "trials", "status", "notes", "hashes", "versions", "extra"):
        assert getattr(held, key) == getattr(result, key)
    fit, again = result.experiments["pull"], held.experiments["pull"]
    assert again.rmse == fit.rmse
    assert again.rmse_detrended == fit.rmse_detrended
    assert again.units == {name: fit.units[name] for name in again.units}
    for family in ("measured", "simulated", "response"):
        assert set(getattr(again, family)) == set(getattr(fit, family))
        for channel, values in getattr(fit, family).items():
            np.testing.assert_array_equal(getattr(again, family)[channel], values)


def test_the_level_of_a_note_is_kept_and_an_earlier_files_notes_are_plain(tmp_path: Path) -> None:
    free = [FreeParameter(E, "Pa", 0.1e6, 1e6, "log")]
    problem = make_problem(fake_robot(), [fake_experiment("pull")], free, None, fake_simulate)
    result = calibrate(problem, store=tmp_path / "run", starts=1)
    (warning,) = [note for note in result.notes if note.tone == "warning"]
    assert "is at its upper bound of 1 MPa" in warning.text
    assert load_result(tmp_path / "run").notes == result.notes
    document = undigested(json.loads((tmp_path / "run" / "result.json").read_text()))
    assert document["notes"] == [note.text for note in result.notes]
    del document["warnings"]
    (tmp_path / "run" / "result.json").write_text(json.dumps(document))
    assert load_result(tmp_path / "run").notes == tuple(Remark(note.text) for note in result.notes)


@pytest.mark.parametrize(
    ("file", "text"),
    [("result.json", "{"), ("result.json", "{}"), ("trials.csv", ""), ("response-pull.csv", "front.tension [N]\nx\n")],
)
def test_a_broken_result_is_told_in_a_sentence(
    file: str, text: str, run: tuple[Path, CalibrationResult], tmp_path: Path
) -> None:
    for name in ("result.json", "trials.csv", "response-pull.csv"):
        (tmp_path / name).write_text((run[0] / name).read_text())
    (tmp_path / file).write_text(text)
    with pytest.raises(StorageError, match="cannot be read"):
        load_result(tmp_path)


def test_a_folder_without_a_result_is_told(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="there is no result"):
        load_result(tmp_path)


def test_a_folder_that_holds_anything_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(StorageError, match="not empty"):
        calibrate(problem_of(), store=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(StorageError, match="a file, not a folder"):
        calibrate(problem_of(), store=tmp_path / "thesis.tex")


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="cannot be kept"):
        calibrate(problem_of(), store=tmp_path / "file" / "run")


def test_a_full_disk_is_told_and_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.json"
    path.write_text("before")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="No space left on device"):
        write_text(path, "after")
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_resume_of_something_else_is_refused_with_every_difference(run: tuple[Path, CalibrationResult]) -> None:
    folder, _ = run
    with pytest.raises(StorageError) as caught:
        calibrate(problem_of(reach=0.03), store=folder, resume=True, seed=9, hashes={"project file": "abc"})
    text = str(caught.value)
    assert len(caught.value.faults) == 3
    for words in ("experiment pull", "project file", "other settings: seed; got 9"):
        assert words in text


def test_another_engine_is_one_fault_beside_what_else_differs(tmp_path: Path) -> None:
    sofa = {"engine": "sofa", "engines.sofa.ramp": "0.1", "engines.sofa.states": "9"}
    space = problem_of().space
    RunStore.create(tmp_path / "run", space, identity={"robot": "a"}, settings={}, versions={}).close()
    with pytest.raises(StorageError) as caught:
        RunStore.resume(tmp_path / "run", space, identity={"robot": "b", **sofa}, settings={})
    engine, robot = map(str, caught.value.faults)
    assert "another engine; got sofa; allowed: softcal. Try: --engine softcal." in engine
    assert "something else: robot; got b; allowed: a" in robot


def test_another_number_of_trials_is_another_grid(tmp_path: Path) -> None:
    calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run")
    with pytest.raises(StorageError, match="another grid"):
        calibrate(problem_of(), method="grid", trials=16, store=tmp_path / "run", resume=True)


def test_two_calibrations_cannot_share_a_folder(tmp_path: Path) -> None:
    space = problem_of().space
    with (
        RunStore.create(tmp_path / "run", space, identity={}, settings={}, versions={}),
        pytest.raises(StorageError, match=r"locked by another process. Try: wait for the other calibration"),
    ):
        RunStore.resume(tmp_path / "run", space, identity={}, settings={})
    RunStore.resume(tmp_path / "run", space, identity={}, settings={}).close()


def test_a_calibration_that_could_not_be_opened_leaves_the_folder_free(tmp_path: Path) -> None:
    space, path = problem_of().space, tmp_path / "run" / "optuna.journal"
    RunStore.create(tmp_path / "run", space, identity={}, settings={}, versions={}).close()
    whole = path.read_bytes()
    path.write_bytes(b"[]\n")
    with pytest.raises(StorageError, match="cannot be read"):
        RunStore.resume(tmp_path / "run", space, identity={}, settings={})
    path.write_bytes(whole)
    RunStore.resume(tmp_path / "run", space, identity={}, settings={}).close()


def test_trials_that_do_not_fit_the_search_stop_a_resume(tmp_path: Path) -> None:
    calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run")
    change_trials(tmp_path / "run", lambda trial: trial["params"].update({E: 1e6, NU: 0.45}), only=4)
    with pytest.raises(StorageError, match="trial 4 on disk is not the one"):
        calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run", resume=True)


def test_a_damaged_record_is_told(tmp_path: Path) -> None:
    calibrate(problem_of(), method="grid", trials=4, store=tmp_path / "run")
    (tmp_path / "run" / "run.json").write_text("{")
    with pytest.raises(StorageError, match="record of the run cannot be read"):
        calibrate(problem_of(), method="grid", trials=4, store=tmp_path / "run", resume=True)


def test_observations_come_back_from_bytes_bit_by_bit() -> None:
    problem = make_problem(fake_robot(), [fake_experiment(noise=0.02)], [MODULUS, RATIO], None, fake_simulate)
    evaluation = problem.evaluate({E: 1.23456789e6, NU: 0.4321}, jacobian=True)
    held = decode(encode(evaluation.observations), Path("0.npz"), "trial 0")
    again = problem.judge(evaluation.theta, held, 1, 20, 0.0)
    assert again.loss == evaluation.loss
    assert again.gradient is not None
    np.testing.assert_array_equal(again.gradient, evaluation.gradient)


@pytest.mark.parametrize("lines", [0, 1, 4, 9])
@pytest.mark.parametrize("more", [b"", b'{"op_code":4,"wor', bytes(4096)], ids=["nothing", "half a line", "zeros"])
def test_trials_that_were_cut_short_are_evaluated_again(tmp_path: Path, lines: int, more: bytes) -> None:
    """As a process that is killed while it writes, or a computer that loses its power, leaves them."""
    folder = tmp_path / "run"
    whole = calibrate(problem_of(), method="grid", trials=9, store=folder)
    path = folder / "optuna.journal"
    held = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(held[:lines]) + more)
    again = calibrate(problem_of(), method="grid", trials=9, store=folder, resume=True)
    assert [trial.loss for trial in again.trials] == [trial.loss for trial in whole.trials]
    assert list(stored_trials(folder)) == list(range(9))
    assert len(path.read_bytes().splitlines()) == len(held)


def test_trials_that_are_damaged_are_not_said_to_lie_in_a_wrong_folder(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    calibrate(problem_of(), method="grid", trials=9, store=folder)
    path = folder / "optuna.journal"
    path.write_bytes(path.read_bytes()[:1000] + bytes(50) + path.read_bytes()[1050:])
    with pytest.raises(StorageError) as told:
        calibrate(problem_of(), method="grid", trials=9, store=folder, resume=True)
    assert str(told.value).startswith(f"{path}: the trials of the run cannot be read; got ")
    assert "Try: a copy of it that is whole, or a new run" in str(told.value)
    assert "written to" not in str(told.value)


def test_a_run_of_an_earlier_format_is_reported_but_not_resumed(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    whole = calibrate(problem_of(), method="grid", trials=4, store=folder)
    (folder / "optuna.journal").rename(folder / "trials.sqlite")
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**record, "format": 1}))
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(
        StorageError, match=r"trials\.sqlite: the run is of an earlier version of softcal, and cannot be"
    ):
        calibrate(problem_of(), method="grid", trials=4, store=folder, resume=True)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    assert load_result(folder).loss == whole.loss


def test_a_trial_whose_arrays_are_gone_stops_a_resume(tmp_path: Path) -> None:
    calibrate(problem_of(), store=tmp_path / "run", starts=1)
    first = min(int(path.stem) for path in (tmp_path / "run" / "arrays").iterdir())
    (tmp_path / "run" / "arrays" / f"{first}.npz").unlink()
    with pytest.raises(StorageError, match=rf"{first}\.npz: trial {first} of the run cannot be read; got No such file"):
        calibrate(problem_of(), store=tmp_path / "run", starts=1, resume=True)
    change_trials(tmp_path / "run", lambda trial: trial["user_attrs"].update(arrays=False), only=first)
    with pytest.raises(StorageError, match=f"trial {first} of the run cannot be read: its arrays are not kept with it"):
        calibrate(problem_of(), store=tmp_path / "run", starts=1, resume=True)


@pytest.mark.parametrize("vanished", ["run", "run/optuna.journal"])
def test_trials_are_not_written_where_nobody_finds_them(tmp_path: Path, vanished: str) -> None:
    def vanish(progress: Progress) -> None:
        if progress.done == 3:
            (tmp_path / vanished).rename(tmp_path / "elsewhere")

    with pytest.raises(StorageError, match="the run cannot be kept; got No such file or directory"):
        calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run", progress=vanish)
    assert not (tmp_path / vanished).exists()


def test_a_journal_that_another_took_the_place_of_is_not_written_on(tmp_path: Path) -> None:
    path = tmp_path / "run" / "optuna.journal"

    def replace(progress: Progress) -> None:
        if progress.done == 3:
            held = path.read_bytes()
            path.unlink()
            (tmp_path / "reserved").write_text("")  # so that its number in the file system is not given again
            path.write_bytes(held)

    with pytest.raises(StorageError, match="replaced by another file"):
        calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run", progress=replace)
    assert len(stored_trials(tmp_path / "run")) == 3


def test_a_full_disk_ends_a_search_and_the_trials_so_far_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = os.fsync, 0

    def full(number: int) -> None:
        nonlocal calls
        calls += 1
        if calls > 8:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(number)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(StorageError, match="No space left on device"):
            calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run")
    assert 0 < len(stored_trials(tmp_path / "run")) < 9
    whole = calibrate(problem_of(), method="grid", trials=9)
    again = calibrate(problem_of(), method="grid", trials=9, store=tmp_path / "run", resume=True)
    assert again.trials[-1].loss == whole.trials[-1].loss


def test_a_folder_without_a_trial_has_none(tmp_path: Path) -> None:
    assert stored_trials(tmp_path / "run") == {}
    RunStore.create(tmp_path / "run", problem_of().space, identity={}, settings={}, versions={}).close()
    before = (tmp_path / "run" / "optuna.journal").read_bytes()
    assert stored_trials(tmp_path / "run") == {}
    assert (tmp_path / "run" / "optuna.journal").read_bytes() == before


_WRITER = """
import sys, time
sys.path[:0] = {path!r}
from pathlib import Path
from test_calibration_store import problem_of
from softcal.calibration.run import calibrate

calibrate(problem_of(), method="grid", trials=400, store=Path({folder!r}))
"""


@pytest.mark.long
def test_trials_are_read_while_another_process_writes_them(tmp_path: Path) -> None:
    here, folder = Path(__file__).parent, tmp_path / "run"
    script = _WRITER.format(path=[str(here), str(here.parent)], folder=str(folder))
    seen: list[int] = []
    with subprocess.Popen([sys.executable, "-c", script]) as process:
        while process.poll() is None:
            held = stored_trials(folder)
            assert list(held) == list(range(len(held)))
            assert all(stored.trial.number == number for number, stored in held.items())
            seen.append(len(held))
    assert process.returncode == 0
    assert seen == sorted(seen)
    assert any(0 < n < 400 for n in seen)
    held = stored_trials(folder)
    assert [stored.trial for stored in held.values()] == list(load_result(folder).trials)
    assert any(stored.arrays is not None and stored.arrays.is_file() for stored in held.values())


def test_a_process_that_is_killed_as_a_run_begins_leaves_nothing_that_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, space = tmp_path / "run", problem_of().space
    about: dict[str, Any] = {"identity": {}, "settings": {}, "versions": {}, "files": {"about.txt": "a"}}
    written: list[str] = []

    def killed(path: Path, text: str) -> None:
        path.write_text(text)
        written.append(path.name)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        # What was written so far stays, and nothing is tidied up.
        patched.setattr("softcal.calibration.results.store.write_text", killed)
        patched.setattr("shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(KeyboardInterrupt):
            RunStore.create(folder, space, **about)
    assert written == ["about.txt"]
    assert not folder.exists()
    with RunStore.create(folder, space, **about):
        assert {path.name for path in folder.iterdir()} >= {"about.txt", "run.json"}


@pytest.mark.parametrize("line", [10, 2**16 - 1, 2**16, 2**16 + 1, 10**6])
@pytest.mark.parametrize("lines", [0, 1, 3])
@pytest.mark.parametrize("tail", [0, 1, 2**16, 300_000])
def test_a_last_line_that_does_not_end_is_cut_off(tmp_path: Path, line: int, lines: int, tail: int):
    path = tmp_path / "journal"
    whole = (b"1" * line + b"\n") * lines
    path.write_bytes(whole + b"2" * tail)
    cut_to_whole_lines(path)
    assert path.read_bytes() == whole


def test_a_file_without_lines_is_not_cut(tmp_path: Path):
    with (tmp_path / "journal").open("wb") as file:
        file.write(b"a line\n")
        file.truncate(3 * 2**30)
    with pytest.raises(ValueError, match="a line has more than"):
        cut_to_whole_lines(tmp_path / "journal")
    assert (tmp_path / "journal").stat().st_size == 3 * 2**30


def test_arrays_that_unpack_to_gigabytes_are_refused_before_they_do(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file, file.open("keys.npy", "w") as one:
        np.lib.format.write_array_header_1_0(one, {"descr": "<f8", "fortran_order": False, "shape": (40 * 2**20,)})
        for _ in range(40):
            one.write(bytes(2**23))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(StorageError, match="the unpacked arrays have more than 268435456 bytes"):
        decode(buffer.getvalue(), tmp_path / "0.npz", "trial 0")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000
