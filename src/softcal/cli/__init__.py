"""The command line: reads the arguments, calls the library, prints. Heavy libraries are imported by the commands."""

import os

from softcal.calibration.search.interrupts import exit_code, stop_signals_raised, stoppable
from softcal.cli.app import app
from softcal.cli.printing import any_terminal


def main(argv: list[str] | None = None) -> None:
    """Run the command line and exit with its code.

    0 success; 1 failure; 2 invalid input; 128 plus the signal's number: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP.
    """
    os.environ["MPLBACKEND"] = "agg"  # charts are drawn into files, whatever the user's own programs draw on
    # Before NumPy is imported: its threads wait for work on the cores that MKL's need, and have little of their own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with stop_signals_raised(), stoppable() as stop, any_terminal():
        try:
            app(args=argv)
        except SystemExit as ended:
            # Typer's own, of a signal before the command has begun, is that of Ctrl-C.
            if stop.by is not None and ended.code == exit_code(KeyboardInterrupt()):
                raise SystemExit(exit_code(stop.by)) from None
            raise
