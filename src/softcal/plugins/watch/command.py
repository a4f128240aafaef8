"""The command `softcal watch`."""

from __future__ import annotations

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

    def ready(address: str) -> None:
        echo(f"Page: {address} (Ctrl-C ends it)")
        if browser:
            import webbrowser

            webbrowser.open(address)

    try:
        serve(run, host=host, port=port, ready=ready)
    except KeyboardInterrupt as stop:
        if str(stop):  # another signal than Ctrl-C
            raise
