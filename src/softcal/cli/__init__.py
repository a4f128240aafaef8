"""The command line: reads the arguments, calls the library, prints. Heavy libraries are imported by the commands.

One module for each group of commands; importing it adds them to the application, in the order in which `--help` lists
them.
"""

import os

# isort: off
from softcal.cli import project_commands
from softcal.cli import simulate_command
from softcal.cli import calibrate_commands
from softcal.cli import fleet_command
from softcal.cli import validate_command
from softcal.cli import mesh_study_command
from softcal.cli import intervals_command
from softcal.cli import importance_command
from softcal.cli import next_test_command
from softcal.cli import sweep_command
from softcal.cli import coupon_command
from softcal.cli import marker_commands
from softcal.cli import export_commands
from softcal.cli import crosscheck_command
from softcal.cli import bench_command
from softcal.cli import watch_command

# isort: on
from softcal.calibration.interrupts import stop_signals_raised
from softcal.cli.app import app
from softcal.cli.printing import any_terminal

COMMAND_GROUPS = (
    project_commands,
    simulate_command,
    calibrate_commands,
    fleet_command,
    validate_command,
    mesh_study_command,
    intervals_command,
    importance_command,
    next_test_command,
    sweep_command,
    coupon_command,
    marker_commands,
    export_commands,
    crosscheck_command,
    bench_command,
    watch_command,
)


def main(argv: list[str] | None = None) -> None:
    """Run the command line and exit with its code.

    0 success; 1 failure; 2 invalid input; 128 plus the signal's number: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP.
    """
    os.environ["MPLBACKEND"] = "agg"  # charts are drawn into files, whatever the user's own programs draw on
    with stop_signals_raised(), any_terminal():
        app(args=argv)
