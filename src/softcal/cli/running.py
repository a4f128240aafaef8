"""Displays beside a command: its stage, the progress of motions, the executor, and the page of `--watch`."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.cli.calibration_lines import MOST
from softcal.cli.printing import echo, shown_path
from softcal.mechanics.path_watch import PathProgress, paths_watched

if TYPE_CHECKING:
    from rich.progress import TaskID

    from softcal.executors.executor import Executor
    from softcal.workflows.motion import Observer


@contextmanager
def clock(*, keeps: bool = False) -> Generator[Callable[[str], None]]:
    """On a terminal, the current stage, how far its load path is, and its time; elsewhere a line where a minute passed
    without one. The stage "" removes the line, before something is printed. keeps: as of `paths_watched`.
    """
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())
    task = bar.add_task("", total=None)

    began = said = time.monotonic()
    stage = ""

    def say(doing: str) -> None:
        nonlocal said
        now = time.monotonic()
        if bar.disable and now - said >= MOST:
            said = now
            echo(f"{doing} ({now - began:.0f} s)", err=True)

    def show(doing: str) -> None:
        nonlocal stage
        stage = doing
        if not doing:
            bar.stop()
            return
        bar.start()  # once there is something to say
        bar.reset(task, description=doing)
        say(doing)

    def follow(path: PathProgress) -> None:
        if stage:
            bar.update(task, description=f"{stage}: {path}")
            say(f"{stage}: {path}")

    try:
        with paths_watched(follow, keeps=keeps):
            yield show
    finally:
        bar.stop()


@contextmanager
def steps(what: str) -> Generator[Callable[[str, int, int], None]]:
    """On a terminal, a bar of the steps of some work, with the present one; elsewhere a line at its beginning, and one
    where a minute passed.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())
    task = bar.add_task("", total=None)
    began, said = time.monotonic(), -MOST

    def show(doing: str, done: int, of: int) -> None:
        nonlocal said
        now = time.monotonic()
        bar.start()
        bar.update(task, description=f"{what}: {doing}", completed=done, total=of)
        if bar.disable and now - began - said >= MOST:
            said = now - began
            echo(f"{what}: {doing}, {done + 1} of {of} ({said:.0f} s)", err=True)

    try:
        yield show
    finally:
        bar.stop()


@contextmanager
def motion_bars(*, keeps: bool = False) -> Generator[Observer]:
    """On a terminal, a progress bar for each motion: over its schedule; the time to come to rest is unknown. keeps: as
    of `paths_watched`.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(20),
        TextColumn("{task.fields[moved]}"),
        TimeElapsedColumn(),
    )
    bars = Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty())
    tasks: dict[str, TaskID] = {}

    def end() -> None:
        for task in bars.tasks:
            bars.update(task.id, total=task.completed)

    def show(name: str, time: float, over: float) -> None:
        label, moved = (name, f"{time:.2f} of {over:.2f} s") if time <= over else (f"{name}: settling", f"{time:.2f} s")
        if label not in tasks:
            bars.start()
            end()
            tasks[label] = bars.add_task(label, total=over if time <= over else None, moved="")
        bars.update(tasks[label], completed=time, moved=moved)

    try:
        with paths_watched(lambda path: None, keeps=keeps):
            yield show
        end()
    finally:
        if tasks:
            bars.stop()


@contextmanager
def executor_told(on: str, workers: int | None) -> Generator[Executor]:
    """The executor that `--on` and `--workers` choose, closed at the end; says where work is done by other machines.

    Raises
    ------
    InputError
        Where there is no such executor, or it cannot be had.
    """
    from softcal.executors.each import executor_on

    with executor_on(on, workers) as executor:
        if not executor.here:
            there = sum(worker.state != "lost" for worker in executor.workers)
            waits = "" if there else "; what is to be computed waits for the first"
            echo(f"On {executor.told}: {there} worker{'s' * (there != 1)} at present{waits}.")
        yield executor


@contextmanager
def page_beside(folder: Path, *, wanted: bool) -> Generator[None]:
    """The page of a run beside the command, until it ends; on a terminal it is opened in the browser."""
    if not wanted:
        yield
        return
    from softcal.workflows.watching import watch_run

    with watch_run(folder) as page:
        echo(f"Page: {page.address} (until this command ends)", err=True)
        if sys.stderr.isatty():
            import webbrowser

            webbrowser.open(page.address)
        yield
    echo(f"The page has ended. It is shown again by: softcal watch {shlex.quote(shown_path(folder))}", err=True)
