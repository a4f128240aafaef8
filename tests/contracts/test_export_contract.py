"""What every export keeps, and an export in one file of the user's own."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from types import ModuleType

import pytest
from own_module import brought, imported
from project_case import write_project
from typer.testing import CliRunner

from softcal import (
    ExportOption,
    ExportRequest,
    InputError,
    ParameterError,
    StorageError,
    load,
    register_export,
    write_export,
)
from softcal.cli import app
from softcal.cli.printing import shown_path
from softcal.workflows.export import EXPORTS, Export

PLATES = '''
from softcal import ExportOption, register_export


@register_export("*.csv", hint="open it there: {out}", digits=ExportOption(int, "Significant digits.", "N"))
def plates(request, folder, digits=6):
    """For a spreadsheet: where the plates are in every solved state."""
    written = []
    for name, response in request.solved(request.cases()).items():
        request.note(f"{name}: {len(response.snapshots)} states")
        states = [(state.label, *one) for state in response.snapshots for one in state.plates.items()]
        rows = [f"{state},{plate},{at[2]:.{digits}g}\\n" for state, plate, (at, _) in states]
        written.append(folder / f"{name}.csv")
        written[-1].write_text("state,plate,z [m]\\n" + "".join(rows), encoding="utf-8")
    return written
'''
# What each one must be given.
GIVEN = {"reduced": {"reach": "2mm", "samples": 10}, "web": {"samples": 10}}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EXPORTS))
def test_it_says_what_it_writes_and_lists_it(name: str, tmp_path: Path) -> None:
    export = EXPORTS[name]
    assert export.summary.endswith(".")
    assert export.module in (f"softcal.workflows.exports.{name}", f"softcal.plugins.{name}.export")
    project, out = load(write_project(tmp_path / "p")), tmp_path / "deep" / "out"
    written = write_export(
        name, ExportRequest(project, ["front=1mm"] if export.pulled else []), out, **GIVEN.get(name, {})
    )
    inside = [path.relative_to(out) for path in written]
    assert all(any(path.match(pattern) for pattern in export.files) for path in inside)
    assert all(any(path.match(pattern) for path in inside) for pattern in export.files)
    assert all(path.stat().st_size > 0 for path in written)
    with pytest.raises(StorageError, match="the folder is not empty"):
        write_export(name, ExportRequest(project), out, **GIVEN.get(name, {}))


@pytest.mark.parametrize("name", sorted(EXPORTS))
def test_its_command_has_its_options(name: str) -> None:
    told = CliRunner().invoke(app, ["export", name, "--help"], terminal_width=200).output
    export = EXPORTS[name]
    assert ("--pull" in told) is export.pulled
    for option, described in export.options.items():
        assert f"--{option.replace('_', '-')}" in told
        assert described.help.split(";")[0] in " ".join(told.split())
    assert export.summary.split(",")[0] in CliRunner().invoke(app, ["export", "--help"], terminal_width=200).output


def test_one_that_fails_leaves_nothing(tmp_path: Path) -> None:
    request = ExportRequest(load(write_project(tmp_path / "p")), ["frnt=1mm"])
    with pytest.raises(InputError, match="no such cable"):
        write_export("vtk", request, tmp_path / "not" / "there" / "out")
    assert not (tmp_path / "not").exists()


@pytest.fixture
def plates(tmp_path: Path) -> Generator[ModuleType]:
    """The export, as a module of the user's registers it."""
    yield imported(tmp_path / "plates_export.py", PLATES)
    EXPORTS.remove("plates")


def test_an_export_of_ones_own_is_a_command(plates: ModuleType, tmp_path: Path) -> None:
    path, out = write_project(tmp_path / "p"), tmp_path / "out"
    found = CliRunner().invoke(
        app, ["export", "plates", str(path), "--digits", "3", "--pull", "front=2mm", "--out", str(out)]
    )
    assert found.exit_code == 0, found.output
    shown = shown_path(out)
    assert f"Wrote 1 file into {shown}; open it there: {shown}" in found.output
    head, *rows = (out / "pull.csv").read_text(encoding="utf-8").splitlines()
    assert head == "state,plate,z [m]"
    assert f"pull: {len(rows)} states" in found.output
    assert all(len(row.rpartition(",")[2].replace("0.", "").lstrip("0")) <= 3 for row in rows)
    listed = CliRunner().invoke(app, ["export", "--help"]).output
    assert "plates" in listed
    assert CliRunner().invoke(app, ["export", "plate", str(path), "--out", str(out)]).exit_code == 2


def test_a_package_brings_it_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "brought_export.py").write_text(PLATES.replace("def plates", "def brought"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with brought(EXPORTS, "brought_export:brought", "softcal.exports", "brought", monkeypatch) as export:
        assert export.files == ("*.csv",)


def test_what_is_no_export_is_refused(tmp_path: Path) -> None:
    def unexplained(request: ExportRequest, folder: Path, n: int = 1) -> list[Path]:
        return []

    with pytest.raises(ParameterError) as error:
        register_export("*.csv", m=ExportOption(int, "A number."), n=ExportOption(float, "A number."))(unexplained)
    told = str(error.value)
    assert "export unexplained, m: the function has no such parameter; allowed: n" in told
    assert "export unexplained, n: there is no such kind of option; got <class 'float'>" in told
    assert "the export has no description" in told
    with pytest.raises(ParameterError, match="there is no such kind of option; got 4; allowed: an ExportOption of int"):
        register_export("*.csv", n=4)(unexplained)  # type: ignore[arg-type]

    def lacking(request: ExportRequest, folder: Path, n: int) -> list[Path]:
        """Needs a number."""
        return []

    with pytest.raises(ParameterError, match="export lacking, n: the function needs a value that no option gives"):
        register_export("*.csv")(lacking)
    with pytest.raises(ParameterError, match="has too few parameters; got request; allowed: the request, the folder"):
        register_export("*.csv")(lambda request: [])
    with pytest.raises(ParameterError, match="there is another export of this name"):
        EXPORTS.add(Export("vtk", EXPORTS["sofa"].function, ()))
    with pytest.raises(ParameterError, match="this is no export"):
        EXPORTS.add(tmp_path)  # type: ignore[arg-type]
    assert "unexplained" not in EXPORTS
    with pytest.raises(ParameterError, match=r"there is no such export; got 'vkt'.*Try: 'vtk'"):
        write_export("vkt", ExportRequest(load(write_project(tmp_path / "p"))), tmp_path / "out")
