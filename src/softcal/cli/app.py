"""The application: the commands of the family, and the help that lists them by its parts."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from softcal.cli.command import COMMANDS, PARTS
from softcal.cli.printing import echo


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
