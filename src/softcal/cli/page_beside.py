"""The page of a run beside the command that computes it: `--watch`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from softcal.cli.printing import echo, shown_path


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
