"""What every command keeps, and a command in one file of a stranger's package."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import typer
from own_module import brought
from typer.testing import CliRunner

import softcal
from softcal import InputError, ParameterError
from softcal.cli import app
from softcal.cli.command import COMMANDS, PARTS, ConsoleCommand

WEIGH = '''
from pathlib import Path
from typing import Annotated

import typer

from softcal import Fault, InputError, register_command


@register_command("data")
def weigh_parts(
    scale: Path,
    unit: Annotated[str, typer.Option(help="Unit of the scale.")] = "g",
) -> None:
    """Read a scale: the mass of each part.

    A second paragraph, which the list of commands does not have.
    """
    if not scale.is_file():
        raise InputError(Fault("there is no such scale", str(scale)))
    typer.echo(f"{scale.read_text()} {unit}")
'''
GROUP = '''
import typer

from softcal.cli.command import exit_on_error, register_command

gripper = typer.Typer(name="gripper", help="Open and close a gripper.", no_args_is_help=True)
register_command("plan", 2)(gripper)


@gripper.command("open")
@exit_on_error
def open_it(width: float) -> None:
    """Open it."""
    typer.echo(f"open by {width}")


@gripper.command()
@exit_on_error
def close() -> None:
    """Close it."""
'''


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_it_has_a_help_and_a_place_in_the_list(name: str) -> None:
    command = COMMANDS[name]
    assert command.summary.endswith(".")
    assert command.part in PARTS
    assert "_" not in name
    shown = CliRunner().invoke(app, [name, "--help"])
    assert shown.exit_code == 0
    assert command.summary.split()[0] in shown.output


def test_the_help_lists_every_command_whole_and_by_its_part() -> None:
    shown = " ".join(CliRunner().invoke(app, ["--help"]).output.split())
    assert all(f"{name} {command.summary}" in shown for name, command in COMMANDS.items())
    assert [part for part in PARTS if f"{part.capitalize()}:" in shown] == list(PARTS)
    assert shown.index("Start: init ") < shown.index("Judge: validate ")


def test_a_package_brings_a_command_in_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "scales.py").write_text(WEIGH, encoding="utf-8")
    (tmp_path / "scale.txt").write_text("12", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with brought(COMMANDS, "scales:weigh_parts", "softcal.commands", "weigh-parts", monkeypatch):
        listed = " ".join(CliRunner().invoke(app, ["--help"]).output.split())
        assert "weigh-parts Read a scale: the mass of each part. Other programs:" in listed
        done = CliRunner().invoke(app, ["weigh-parts", str(tmp_path / "scale.txt"), "--unit", "kg"])
        assert (done.exit_code, done.output) == (0, "12 kg\n")
        failed = CliRunner().invoke(app, ["weigh-parts", "absent.txt"])
        assert (failed.exit_code, failed.output) == (2, "Error: absent.txt: there is no such scale.\n")
        assert "Did you mean 'weigh-parts'?" in CliRunner().invoke(app, ["weigh-part"]).output
    assert "weigh-parts" not in COMMANDS


def test_a_package_brings_a_group_of_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "grippers.py").write_text(GROUP, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with brought(COMMANDS, "grippers:gripper", "softcal.commands", "gripper", monkeypatch):
        assert CliRunner().invoke(app, ["gripper", "open", "2.5"]).output == "open by 2.5\n"
        assert "gripper Open and close a gripper." in " ".join(CliRunner().invoke(app, ["--help"]).output.split())


def test_an_installed_package_is_found_and_its_module_can_be_imported_first(tmp_path: Path) -> None:
    (tmp_path / "scales.py").write_text(WEIGH, encoding="utf-8")
    metadata = tmp_path / "scales-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: scales\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[softcal.commands]\nweigh = scales:weigh_parts\n")
    for first in ("", "import scales; "):
        code = (
            f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {first}from softcal.cli import main; main(['--help'])"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        assert "weigh-parts  Read a scale" in done.stdout


def test_what_is_no_command_is_refused() -> None:
    def unexplained() -> None:
        pass

    with pytest.raises(ParameterError) as error:
        COMMANDS.add(ConsoleCommand("unexplained", unexplained, "middle"))  # type: ignore[arg-type]
    told = str(error.value)
    assert "command unexplained: the command has no description" in told
    assert "softcal --help has no such part; got 'middle'" in told
    with pytest.raises(ParameterError, match="there is another command of this name"):
        COMMANDS.add(ConsoleCommand("calibrate", typer.echo, "start"))
    with pytest.raises(ParameterError, match="this is not a command"):
        COMMANDS.add(unexplained)  # type: ignore[arg-type]


@pytest.mark.parametrize("family", ["command", "export", "figure", "section"])
def test_a_decorator_without_its_brackets_registers_nothing_and_says_so(family: str) -> None:
    with pytest.raises(InputError, match="this is of the wrong kind; got <function"):
        getattr(softcal, f"register_{family}")(lambda: None)
