"""Progress display of a calibration on a terminal."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from softcal.mechanics.path_watch import PathProgress, paths_watched

if TYPE_CHECKING:
    from softcal.calibration.search.search import Progress
    from softcal.cli.calibration_lines import CalibrationLines

WIDE = 110  # columns


def calibration_progress() -> CalibrationBars | CalibrationLines:
    """Progress bars on a terminal, otherwise lines at intervals."""
    from rich.console import Console

    from softcal.cli.calibration_lines import CalibrationLines

    return CalibrationBars() if Console(stderr=True).is_terminal else CalibrationLines()


class CalibrationBars:
    """A progress bar for each calibration, with the best loss so far, and one for each stage after the search."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
        from rich.table import Column

        console = Console(stderr=True)
        # In a narrow terminal the bar is short and names wrap; numbers stay whole.
        self._progress = Progress(
            TextColumn("{task.description}", table_column=Column(overflow="fold")),
            BarColumn(40 if console.width >= WIDE else 10),
            TextColumn("{task.fields[count]}"),
            TextColumn("{task.fields[best]}"),
            TimeElapsedColumn(table_column=Column(no_wrap=True)),
            console=console,
        )
        self._tasks: dict[str, object] = {}
        self._stage: object = None
        self._present: tuple[object, str] | None = None  # the task of the present simulation, and its count of trials
        self._watch = ExitStack()

    def __enter__(self) -> CalibrationBars:
        self._watch.enter_context(paths_watched(self.follow))
        return self

    def __exit__(self, *exception: object) -> None:
        self._watch.close()
        self._end_stage()
        self._end_tasks()
        if self._tasks:
            self._progress.stop()

    def show(self, label: str, state: Progress) -> None:
        """Update the bar of a calibration, or start that of a stage, which shows only the time."""
        from rich.progress import TaskID

        self._progress.start()
        self._end_stage()
        if label not in self._tasks:
            self._end_tasks()
            self._tasks[label] = self._progress.add_task(label, total=None, count="", best="")
        best = "" if state.best_loss is None else f"best loss {state.best_loss:.6g}"
        failed = f", {state.failed} failed" if state.failed else ""
        self._progress.update(
            TaskID(int(str(self._tasks[label]))),
            completed=state.done,
            # How far a search is that ends at its minimum is not known.
            total=None if state.is_limit and not state.stage else state.done if state.is_limit else state.total,
            count=state.count,
            best=best + failed,
        )
        self._present = self._tasks[label], f"{state.count}, "
        if state.stage:
            self._stage = self._progress.add_task(f"{label}: {state.stage}", total=None, count="", best="")
            self._present = self._stage, ""

    def say(self, text: str) -> None:
        """Print a line above the bars."""
        self._progress.console.print(text, markup=False, highlight=False, emoji=False)

    def follow(self, path: PathProgress) -> None:
        """Show how far a load path of the present simulation is."""
        from rich.progress import TaskID

        if self._present is not None:
            task, count = self._present
            self._progress.update(TaskID(int(str(task))), count=f"{count}{100.0 * path.share:.0f} %")

    def _end_tasks(self) -> None:
        """A bar whose end was not known is full."""
        for task in self._progress.tasks:
            if task.total is None:
                self._progress.update(task.id, total=max(task.completed, 1), completed=max(task.completed, 1))

    def _end_stage(self) -> None:
        from rich.progress import TaskID

        if self._stage is not None:
            self._progress.update(TaskID(int(str(self._stage))), total=1, completed=1)
            self._stage = None
