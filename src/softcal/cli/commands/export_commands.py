"""The commands `softcal export …`, one for each registered export."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from softcal.cli.command import exit_on_error, register_command
from softcal.cli.printing import echo, print_warnings, shown_path
from softcal.cli.running import clock, motion_bars
from softcal.cli.values import Pull, Source, Values, parsed_values
from softcal.workflows.export import EXPORTS, ExportRequest, write_export

Out = Annotated[Path, typer.Option(metavar="DIR", help="A folder that is new or empty.", show_default=False)]


class _Exports(TyperGroup):
    """The registered exports as commands, asked for only when one is named or all are listed."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(EXPORTS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in EXPORTS:
            return None
        export = EXPORTS[cmd_name]

        def run(
            source: Path, out: Path, values: list[str] | None, pull: list[str] | None = None, **options: Any
        ) -> None:
            from softcal.workflows.study_source import load_calibrated

            project = load_calibrated(source, parsed_values(values))
            warnings: list[str] = []  # printed after the progress display is removed
            notes: list[str] = []
            with clock() as stage, motion_bars() as motion:
                calibrated = source if source.is_dir() else None
                request = ExportRequest(project, pull or (), warnings.append, notes.append, stage, motion, calibrated)
                written = write_export(export.name, request, out, **options)
            print_warnings(warnings)
            for text in notes:
                echo(text)
            hint = f"; {export.hint.format(out=shown_path(out))}" if export.hint else ""
            echo(f"Wrote {len(written)} file{'s' * (len(written) != 1)} into {shown_path(out)}{hint}")

        empty = inspect.Parameter.empty
        arguments: dict[str, tuple[Any, Any]] = {"source": (Source, empty), "out": (Out, empty)}
        arguments |= {"pull": (Pull, None)} if export.pulled else {}
        for name, option in export.options.items():
            typed = typer.Option(
                f"--{name.replace('_', '-')}", metavar=option.metavar or None, help=option.help, show_default=False
            )
            default = export.defaults[name]
            arguments[name] = (Annotated[option.kind | None if default is None else option.kind, typed], default)
        arguments["values"] = (Values, None)
        keyword = inspect.Parameter.KEYWORD_ONLY
        run.__dict__["__signature__"] = inspect.Signature(
            [
                inspect.Parameter(n, keyword, default=default, annotation=kind)
                for n, (kind, default) in arguments.items()
            ]
        )
        run.__annotations__ = {name: kind for name, (kind, _) in arguments.items()}
        alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
        alone.command(export.name, help=export.summary)(exit_on_error(run))
        return typer.main.get_command(alone)


register_command("other programs", 1)(
    typer.Typer(
        name="export",
        cls=_Exports,
        help="Write a project, or the result of a calibration, for other programs.",
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,
    )
)
