"""The command line: reads the arguments, calls the library, prints. Heavy libraries are imported by the commands."""

import os

from softcal.calibration.search.interrupts import stop_signals_raised
from softcal.cli.app import app
from softcal.cli.printing import any_terminal


def main(argv: list[str] | None = None) -> None:
    """Run the command line and exit with its code.

    0 success; 1 failure; 2 invalid input; 128 plus the signal's number: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP.
    """
    os.environ["MPLBACKEND"] = "agg"  # charts are drawn into files, whatever the user's own programs draw on
    with stop_signals_raised(), any_terminal():
        app(args=argv)
