"""What the page of a run costs: its process and the twin's, with and without a browser; writes docs/watch.md.

python -m benchmarks.watch [--seconds 40] [--rounds 2] [--out FILE]

The run is examples/neck by TPE with two workers. First it is finished, and the page is served and looked at. Then it is
searched without an end, and its trials are counted in windows of so many seconds: by itself, with the page served, and
with the page in a headless Chromium of the same machine, forwards and backwards, since later trials take longer.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.machine import load as machine_load
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.plugins.watch.trials import TrialReader
from softcal.processes import beside

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "watch.md"
PROJECT = HERE.parent / "examples" / "neck" / "project.yaml"
TRIALS, ENDLESS, WORKERS = 200, 100_000, 2
SETTLED = 20.0  # [s] until a page that was opened has drawn everything once
PATIENCE = 180.0  # [s]
# WebGL without a graphics card.
CHROMIUM = ["--headless=new", "--no-sandbox", "--remote-debugging-port=0", "--use-gl=angle", "--use-angle=swiftshader"]
CHROMIUM += ["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--window-size=1300,1400"]
ALONE, SERVED, LOOKED_AT = "alone", "page served", "page in a browser"


@dataclass(frozen=True)
class Spent:
    """Processor time [s] of the page's own process, of the twin's, and of the browser; memory [MB] of the page's."""

    page: float
    twin: float
    browser: float
    memory: float


@dataclass(frozen=True)
class Window:
    """What was spent in some seconds, and how many trials were done in them."""

    kind: str
    seconds: float
    trials: int
    spent: Spent


@dataclass(frozen=True)
class Shown:
    """The page's process, and the browser's that looks at it, or None."""

    page: psutil.Process
    browser: psutil.Process | None


def spent(shown: Shown | None) -> Spent:
    """What was spent until now."""
    if shown is None:
        return Spent(0.0, 0.0, 0.0, 0.0)
    times = shown.page.cpu_times()
    twin = times.children_user + times.children_system + _of_all(shown.page.children(recursive=True))
    browser = 0.0
    if shown.browser is not None:
        ended = shown.browser.cpu_times()
        browser = _of_all([shown.browser, *shown.browser.children(recursive=True)])
        browser += ended.children_user + ended.children_system
    return Spent(times.user + times.system, twin, browser, shown.page.memory_info().rss / 1e6)


def _of_all(processes: Iterable[psutil.Process]) -> float:
    """Processor time [s] of processes that run, without that of their children."""
    total = 0.0
    for one in processes:
        try:
            times = one.cpu_times()
        except psutil.Error:  # it has ended, and counts among its parent's
            continue
        total += times.user + times.system
    return total


def difference(before: Spent, after: Spent) -> Spent:
    """What was spent between two moments; the memory is that at the end."""
    return Spent(
        after.page - before.page, after.twin - before.twin, after.browser - before.browser, after.memory
    )  # fmt: skip


@contextmanager
def served(run: Path, *, browser: bool) -> Generator[Shown]:
    """The page of a run, and a browser that looks at it; both have settled."""
    with beside("softcal", "watch", str(run), "--no-browser", "--port", "0") as page:
        assert page.stdout is not None
        address = page.stdout.readline().removeprefix("Page: ").split(" ")[0].strip()
        process = psutil.Process(page.pid)
        if not browser:
            time.sleep(SETTLED)
            yield Shown(process, None)
            return
        with looking(address) as looker:
            wait_for(lambda: any(one.status == "ESTABLISHED" for one in process.net_connections("tcp")))
            time.sleep(SETTLED)
            yield Shown(process, looker)


@contextmanager
def looking(address: str) -> Generator[psutil.Process]:
    """A headless Chromium that has opened an address."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        raise SystemExit("There is no Chromium on this machine.")
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as profile:
        command = [found, *CHROMIUM, f"--user-data-dir={profile}", address]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(command, **silent) as process:
            try:
                yield psutil.Process(process.pid)
            finally:
                process.terminate()


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until something is so; give up after some minutes."""
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise SystemExit("The page was not opened in time.")
        time.sleep(0.2)


@contextmanager
def searching(run: Path) -> Generator[TrialReader]:
    """A calibration that goes on; its trials."""
    place = run / "calibrations" / "joint"
    trials = TrialReader(place)
    with beside("softcal", *calibrate(run, ENDLESS)):
        wait_for(lambda: place.is_dir() and len(trials.read()) >= 20)
        yield trials


def calibrate(run: Path, trials: int) -> list[str]:
    """The words of a calibration."""
    options = ["--fit", "joint", "--method", "tpe", "--trials", str(trials), "--workers", str(WORKERS)]
    return ["calibrate", str(PROJECT), *options, "--out", str(run)]


def window(kind: str, seconds: float, shown: Shown | None, trials: TrialReader | None) -> Window:
    """Wait so many seconds, and count."""
    done, before, began = _count(trials), spent(shown), time.monotonic()
    time.sleep(seconds)
    after, took = spent(shown), time.monotonic() - began
    return Window(kind, took, _count(trials) - done, difference(before, after))


def _count(trials: TrialReader | None) -> int:
    return 0 if trials is None else len(trials.read())


def beside_a_search(run: Path, seconds: float, rounds: int) -> list[Window]:
    """Windows beside a calibration: each kind as often, forwards and backwards."""
    order = [ALONE, SERVED, LOOKED_AT]
    found: list[Window] = []
    with searching(run) as trials:
        for kind in [*order, *reversed(order)] * rounds:
            if kind == ALONE:
                time.sleep(SETTLED / 4)
                found.append(window(kind, seconds, None, trials))
            else:
                with served(run, browser=kind == LOOKED_AT) as shown:
                    found.append(window(kind, seconds, shown, trials))
            print(found[-1])
    return found


def rates(windows: Sequence[Window]) -> str:
    """The trials in a second, of the slowest window to the fastest."""
    found = [one.trials / one.seconds for one in windows]
    return f"{min(found):.2f} to {max(found):.2f}"


def row(name: str, windows: Sequence[Window]) -> list[str]:
    """A row of the table: memory of the page's process, and shares of a core."""
    seconds = sum(one.seconds for one in windows)

    def share(what: str) -> str:
        return f"{100 * sum(getattr(one.spent, what) for one in windows) / seconds:.1f} %"

    looked = any(one.spent.browser > 0.0 for one in windows)
    memory = max(one.spent.memory for one in windows)
    return [name, f"{memory:.0f} MB", share("page"), share("twin"), share("browser") if looked else "–"]


def page(finished: Sequence[Window], drawing: float, beside: Sequence[Window], load: str) -> str:
    """The page with its numbers; drawing: processor time [s] of the twin of the finished run."""
    by_kind = {kind: [one for one in beside if one.kind == kind] for kind in (ALONE, SERVED, LOOKED_AT)}
    rows = [row(f"finished run, {one.kind}", [one]) for one in finished]
    rows += [row(f"beside a calibration, {kind}", by_kind[kind]) for kind in (SERVED, LOOKED_AT)]
    head = ["", "memory of the page's process", "page's process", "twin's process", "browser"]
    numbers = {"table": "\n".join(table(head, rows)), "load": load, "drawing": f"{drawing:.1f}"}
    numbers |= {"seconds": f"{beside[0].seconds:.0f}", "windows": str(len(by_kind[ALONE])), "workers": str(WORKERS)}
    numbers |= {
        name: rates(by_kind[kind]) for name, kind in (("alone", ALONE), ("served", SERVED), ("looked", LOOKED_AT))
    }
    return written_page(PAGE, numbers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=40.0, help="of a window; 40 by default")
    parser.add_argument("--rounds", type=int, default=2, help="of six windows beside a calibration; 2 by default")
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/watch.md by default")
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    load = machine_load()
    with tempfile.TemporaryDirectory(prefix="watch-", ignore_cleanup_errors=True) as place:
        run = Path(place, "finished")
        command = [sys.executable, "-m", "softcal", *calibrate(run, TRIALS)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        finished, drawing = list[Window](), 0.0
        for kind in (SERVED, LOOKED_AT):
            with served(run, browser=kind == LOOKED_AT) as shown:
                finished.append(window(kind, arguments.seconds, shown, None))
                drawing = spent(shown).twin
            print(finished[-1])
        windows = beside_a_search(Path(place, "searching"), arguments.seconds, arguments.rounds)
    arguments.out.write_text(page(finished, drawing, windows, load), encoding="utf-8")


if __name__ == "__main__":
    main()
