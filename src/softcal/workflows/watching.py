"""The page of a run in a process of its own, beside what computes the run."""

from __future__ import annotations

import html
import threading
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Annotated

from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.limits import Limit
from softcal.processes import beside

_SAID = "Page: "
PORTS = Limit("port numbers", 65535, 0)


@displayed
class WatchedPage:
    """A page that is served until it is closed, or this program ends; a notebook shows it in a frame.

    address: where it is.
    """

    def __init__(self, address: str, running: ExitStack) -> None:
        self.address, self._running = address, running

    def __enter__(self) -> WatchedPage:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"The page of the run: {self.address}"

    def _repr_html_(self) -> str:
        address = html.escape(self.address, quote=True)
        frame = f'<iframe src="{address}" width="100%" height="760" style="border: 1px solid #ddd"></iframe>'
        return f'<p>The page of the run: <a href="{address}" target="_blank">{address}</a></p>{frame}'

    def close(self) -> None:
        """End the page; the run is none of its business."""
        self._running.close()


@checked_arguments
def watch_run(folder: str | Path, *, port: Annotated[int, PORTS] | None = None) -> WatchedPage:
    """Serve the page of a run's folder on this machine alone, without waiting for the run; see `softcal watch`.

    port: by default the first free one from 8085 on; the folder may not be there yet.

    Raises
    ------
    InputError
        Where NiceGUI is not installed, or the page cannot be served.
    """
    options = ["--wait", "--no-browser", *([] if port is None else ["--port", str(port)])]
    arguments = ["watch", *options, "--", str(Path(folder).absolute())]
    with ExitStack() as stack:
        try:
            process = stack.enter_context(beside("softcal", *arguments))
        except OSError as error:
            raise InputError(Fault("the page cannot be served", str(folder), error.strerror or str(error))) from error
        assert process.stdout is not None  # noqa: S101
        said = process.stdout.readline()
        if not said.startswith(_SAID):
            rest = process.stdout.read()
            raise InputError((said + rest).strip().removeprefix("Error: ") or "the page ended before it was served")
        # What it says from now on, such as warnings of its libraries, would fill the pipe and stop it.
        threading.Thread(target=_drain, args=(process.stdout,), name="softcal-page", daemon=True).start()
        return WatchedPage(said.removeprefix(_SAID).split(" ")[0].strip(), stack.pop_all())


def _drain(lines: Iterable[str]) -> None:
    with suppress(ValueError, OSError):  # it was closed
        for _ in lines:
            pass
