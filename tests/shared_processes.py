"""Processes that share a study: begun, awaited, and what must be there once they ended."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

from fake_twin import NU, E, soft_necks_fail
from test_calibration_run import problem_of

from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.trial_journal import StoredTrial, stored_trials
from softcal.calibration.run import calibrate
from softcal.calibration.search import storage_url
from softcal.calibration.search.optimisers.tpe import tpe_sampler
from softcal.calibration.search.shared_search import Sharing
from softcal.calibration.search.shared_study import SharedStudy, StudyIdentity
from softcal.calibration.search.storage_url import StorageUrl

_PROCESS = """
import sys, time
sys.path[:0] = {path!r}
from pathlib import Path
from fake_twin import soft_necks_fail
from test_calibration_run import problem_of
from softcal.calibration.search import shared_study
from softcal.calibration.run import calibrate
from softcal.calibration.search.shared_search import Sharing

shared_study.BEAT, shared_study.GRACE = 0.2, 2.0

def slow(robot, protocol, theta=None, **options):
    time.sleep({pause})
    return soft_necks_fail(robot, protocol, theta, **options)

def tell(progress):
    print(progress.done, flush=True)

calibrate(problem_of(slow), method="tpe", trials={trials}, store=Path({folder!r}), sharing=Sharing({url!r}),
          progress=tell, resume={resume!r})
"""


@contextlib.contextmanager
def processes(
    folders: list[Path], url: str, trials: int, *, pause: float = 0.01
) -> Generator[list[subprocess.Popen[str]]]:
    """A process for each folder; the run in a folder is resumed, where there is one."""
    here = Path(__file__).parent
    settings = {"path": [str(here), str(here / "unit")], "pause": pause, "trials": trials, "url": url}
    scripts = [
        _PROCESS.format(folder=str(folder), resume=(folder / "run.json").is_file(), **settings) for folder in folders
    ]
    begun = [subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) for script in scripts]
    watchdog = threading.Timer(500, lambda: [one.kill() for one in begun])
    watchdog.start()
    try:
        yield begun
    finally:
        watchdog.cancel()
        for one in begun:
            one.kill()
            one.wait()
            if one.stdout is not None:
                one.stdout.close()


def until(process: subprocess.Popen[str], done: int) -> None:
    """Wait until a process has seen so many trials told."""
    assert process.stdout is not None
    assert any(int(line) >= done for line in process.stdout), "it ended before"


def at_end(process: subprocess.Popen[str]) -> int:
    """The exit code of a process, its output read to the end."""
    assert process.stdout is not None
    process.stdout.read()
    return process.wait()


@contextlib.contextmanager
def study_at(url: str, *, new: bool = False) -> Generator[Any]:
    import optuna

    with storage_url.storage_url(url).opened() as storage:
        if new:
            optuna.create_study(study_name="softcal", storage=storage)
        yield optuna.load_study(study_name="softcal", storage=storage)


def require_whole(url: str, trials: int, folders: list[Path]) -> None:
    """Every trial once, in the study and in every folder, and none that has not ended."""
    with study_at(url) as study:
        held = study.trials
    counts = Counter(trial.state.name for trial in held)
    assert set(counts) <= {"COMPLETE", "FAIL", "PRUNED"}, counts
    told = {t.number: t for t in held if t.state.name == "COMPLETE" or t.user_attrs.get("softcal", {}).get("failed")}
    assert len(told) == trials
    assert all(trial.params.keys() == {E, NU} for trial in told.values())
    assert len({tuple(trial.params.values()) for trial in told.values()}) == trials  # no point is there twice
    for folder in folders:
        kept = stored_trials(folder)
        assert list(kept) == sorted(told)
        for number, stored in kept.items():
            assert dict(stored.trial.theta) == told[number].params
            assert stored.trial.loss == told[number].value
            assert bool(stored.trial.reason) == (stored.trial.loss is None)
        result = load_result(folder)
        assert len(result.trials) == trials
        assert result.loss == min(trial.value for trial in told.values() if trial.value is not None)


def shared(folder: Path | None, place: str, trials: int, simulate: Any = soft_necks_fail, **options: Any) -> Any:
    given: dict[str, Any] = {"method": "tpe", "trials": trials, **options}
    return calibrate(problem_of(simulate), **given, store=folder, sharing=Sharing(place))


def joined(place: str | StorageUrl) -> SharedStudy:
    about = StudyIdentity("softcal", {"robot": "a"}, {"seed": 1})
    space = problem_of().space
    place = storage_url.storage_url(place) if isinstance(place, str) else place
    return SharedStudy(place, about, space, seed=1, sampler=tpe_sampler)


def outcome(number: int, theta: Any, loss: float | None = 1.0) -> StoredTrial:
    from softcal.calibration.results.result import Trial

    state = "FAILED" if loss is None else "COMPLETE"
    return StoredTrial(Trial(number, theta, state, loss, "" if loss else "No."), 1, 1.0, None)
