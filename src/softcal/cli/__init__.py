"""The command line: reads the arguments, calls the library, prints; its help lists the commands by their parts. Heavy
libraries are imported by the commands.
"""

from __future__ import annotations

import os
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from softcal.calibration.search.interrupts import exit_code, stop_signals_raised, stoppable
from softcal.cli.command import COMMANDS, PARTS
from softcal.cli.printing import any_terminal, echo


class _Commands(TyperGroup):
    """The registered commands, asked for only when one is named or all are listed."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for i, word in enumerate(args):  # a path of no characters would be the present folder
            if not word or (word.startswith("--") and word.endswith("=")):
                ctx.fail(f"the value of {word.rstrip('=') or ' '.join(args[max(0, i - 1) : i]) or 'a word'} is empty")
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        commands = sorted(COMMANDS.values(), key=lambda one: (PARTS.index(one.part), one.place, one.name))
        return [one.name for one in commands]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            self.commands.update({name: one.built() for name, one in COMMANDS.items()})  # to suggest another one
            return None
        return COMMANDS[cmd_name].built()

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        width = max(map(len, COMMANDS))
        for part in PARTS:
            names = [name for name in self.list_commands(ctx) if COMMANDS[name].part == part]
            if names:
                with formatter.section(part.capitalize()):
                    formatter.write_dl([(f"{name:<{width}}", COMMANDS[name].summary) for name in names])


app = typer.Typer(
    name="softcal",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        import softcal

        echo(f"softcal {softcal.__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_tell_version, is_eager=True)
    ] = False,
) -> None:
    """From bench measurements of a printed, cable-driven or pressurised robot to a calibrated finite-element twin."""


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
