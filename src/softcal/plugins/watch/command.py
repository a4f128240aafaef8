"""The commands `softcal watch` and `softcal new`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo

PORTS = 65535


@register_command("start", 6)
def watch(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN", help="A folder that calibrate, sweep, fleet or bench run writes.", show_default=False
        ),
    ],
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address of this machine; other than its own needs a token.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(min=0, max=PORTS, help="Port; by default the first free one from 8085 on.", show_default=False),
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    wait: Annotated[bool, typer.Option("--wait", help="Take a folder that does not exist yet.")] = False,
) -> None:
    """Show a run on a local page while it works: progress, losses, parameters, failures, the twin, the report."""
    from softcal.errors import Fault, InputError
    from softcal.extras import require_extra
    from softcal.plugins.watch.server import serve
    from softcal.regular_file import FOLDER, NOTHING, not_a_file

    require_extra("watch", "nicegui", where="softcal watch")
    found = not_a_file(run) or "a file"
    if found != FOLDER and not (wait and found == NOTHING):
        allowed = "a folder that calibrate, sweep, fleet or bench run writes"
        got, attempt = ("", "--wait, if it will be there") if found == NOTHING else (found, "")
        raise InputError(Fault("there is no such folder", str(run), got, allowed, attempt))

    _until_ctrl_c(lambda ready: serve(run, host=host, port=port, ready=ready), browser)


@register_command("start", 1)
def new(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A folder with a mesh, STL or STEP file and tables, or a new one.")
    ] = Path(),
    port: Annotated[
        int | None,
        typer.Option(min=0, max=PORTS, help="Port; by default the first free one from 8085 on.", show_default=False),
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Write a project file by clicks, on a local page: faces, bores, tables; checked as it grows."""
    from softcal.errors import Fault, InputError
    from softcal.extras import require_extra
    from softcal.plugins.watch.new_page import serve_new
    from softcal.regular_file import FOLDER, NOTHING, not_a_file
    from softcal.workflows.output import unwritable

    require_extra("watch", "nicegui", where="softcal new")
    found = not_a_file(folder) or "a file"
    if found == NOTHING:
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise unwritable(folder, error) from error
    elif found != FOLDER:
        raise InputError(
            Fault("this is no folder", str(folder), found, "a folder with the files of your robot, or none")
        )
    _until_ctrl_c(lambda ready: serve_new(folder, port=port, ready=ready), browser)


def _until_ctrl_c(serve: Callable[[Callable[[str], None]], None], browser: bool) -> None:
    """Serve a page, say where it is, and show it in the browser."""

    def ready(address: str) -> None:
        echo(f"Page: {address} (Ctrl-C ends it)")
        if browser:
            import webbrowser

            webbrowser.open(address)

    try:
        serve(ready)
    except KeyboardInterrupt as stop:
        if str(stop):  # another signal than Ctrl-C
            raise
