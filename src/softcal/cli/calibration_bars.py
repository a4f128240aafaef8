"""What is seen of a calibration while it runs."""

from __future__ import annotations


class CalibrationBars:
    """A progress bar for each calibration, with the best loss so far."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[best]}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )
        self._tasks: dict[str, object] = {}

    def __enter__(self) -> CalibrationBars:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._tasks:
            self._progress.stop()

    def show(self, label: str, state: object) -> None:
        """Move the bar of a calibration."""
        from rich.progress import TaskID

        from softcal.calibration.run import Progress

        if not isinstance(state, Progress):
            raise TypeError(type(state))
        self._progress.start()
        if label not in self._tasks:
            self._tasks[label] = self._progress.add_task(label, total=state.total, best="")
        best = "" if state.best_loss is None else f"best loss {state.best_loss:.6g}"
        failed = f", {state.failed} failed" if state.failed else ""
        task = self._tasks[label]
        self._progress.update(TaskID(int(str(task))), completed=state.done, total=state.total, best=best + failed)
