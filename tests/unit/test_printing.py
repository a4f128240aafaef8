"""Tables in a terminal of 80 columns: as wide as it at most, nothing cut off, no number wrapped."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from project_case import write_project
from report_example import example_content
from rich.table import Table
from sweep_case import write_sweep

from softcal.analysis import validation
from softcal.calibration.results.result import CalibrationResult
from softcal.cli import main, printing
from softcal.cli.calibration_table import print_results
from softcal.cli.commands.validate_command import _add_errors
from softcal.cli.printing import echo, print_report_table, print_table, shown_path
from softcal.report.tables import Column, ReportTable

Printed = Callable[[], list[str]]


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Printed:
    """A terminal of 80 columns, and what its tables hold when it is asked for."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")

    def lines() -> list[str]:
        out = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().out)
        found = [line for line in out.splitlines() if line[:1] in "┏┃┡│├└"]
        assert found, out
        assert max(map(len, found)) <= 80
        assert "…" not in out
        return found

    return lines


@pytest.mark.parametrize("code", ["\x1b]0;mine\x07", "\x1b[2J", "\x9b2J", "\u202e", "\r"])
def test_codes_of_a_terminal_are_printed_and_not_sent(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    echo(f"a {code} b\tc\nd µ")
    table = Table("name")
    table.add_row(f"[red]{code}")
    print_table(table)
    printed, shown = capsys.readouterr().out, code.encode("unicode_escape").decode()
    assert printed.startswith(f"a {shown} b\tc\nd µ\n")
    assert f"[red]{shown}" in printed
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", printed)


def test_the_console_is_written_to_by_way_of_echo() -> None:
    source = Path(printing.__file__).parents[1]
    others = [
        path for path in source.rglob("*.py") if re.search(r"typer\.echo\(|click\.echo\(", path.read_text("utf-8"))
    ]
    assert others == [Path(printing.__file__)]


def cells(lines: list[str]) -> set[str]:
    return {cell.strip() for line in lines for cell in re.split("[┃│]", line)}


def rows(lines: list[str], n_columns: int) -> list[list[str]]:
    """The lines of text of the tables with so many columns."""
    split = [[cell.strip() for cell in re.split("[┃│]", line)[1:-1]] for line in lines if line[0] in "┃│"]
    return [row for row in split if len(row) == n_columns]


def with_intervals(result: CalibrationResult) -> CalibrationResult:
    """Intervals of a tenth about the moduli, and of less about what has nearer bounds."""
    sure = {
        name: replace(p, standard_error=0.0123 * p.value, interval=((1 - reach) * p.value, (1 + reach) * p.value))
        for name, p in result.parameters.items()
        for reach in [0.1 if p.unit == "Pa" else 0.02]
    }
    return replace(result, parameters=sure)


def test_calibrations_side_by_side_as_far_as_they_fit(printed: Printed) -> None:
    results = {label: with_intervals(result) for label, result in example_content(n_trials=5).results.items()}
    print_results(results, verbose=True)
    lines = printed()
    assert {"neck.youngs_modulus", "1.90 ± 0.02 MPa", "1.08 to 1.32 MPa", "front.slack[20 mm, 2 mm/s]"} <= cells(lines)
    (labels, *of_each), joint = rows(lines, 4), rows(lines, 2)
    assert labels == ["", "20 mm, 2 mm/s", "20 mm, 5 mm/s", "35 mm, 2 mm/s"]
    assert joint[0] == ["", "joint"]
    assert of_each[-1] == ["trials", "5", "5", "5"]
    # What only the joint one has stands with it alone.
    assert not any("slack" in row[0] for row in of_each)


def test_a_table_that_fits_is_left_as_it_is(printed: Printed) -> None:
    table = Table("best for", "springs.youngs_modulus", "error")
    table.add_row("all", "800 MPa", "1.19 %")
    print_table(table)
    assert rows(printed(), 3) == [["best for", "springs.youngs_modulus", "error"], ["all", "800 MPa", "1.19 %"]]


def test_paper_bs_sweep_is_one_table(printed: Printed) -> None:
    table = Table("best for", "springs.youngs_modulus", "springs.poissons_ratio", "error", "nominal", "reduced by")
    table.add_row("marker1", "800 MPa", "0.4999", "1.19 %", "26.4 %", "2118 %")
    print_table(table)
    assert rows(printed(), 6) == [
        ["", "springs.", "springs.", "", "", ""],
        ["best for", "youngs_modulus", "poissons_ratio", "error", "nominal", "reduced by"],
        ["marker1", "800 MPa", "0.4999", "1.19 %", "26.4 %", "2118 %"],
    ]


def test_a_cell_that_is_wider_than_the_terminal_is_folded_not_cut(printed: Printed) -> None:
    table = Table("", "a")
    table.add_row("name " * 4, "x" * 200)
    print_table(table)
    assert sum(line.count("x") for line in printed()) == 200


def test_names_are_printed_as_they_are(printed: Printed) -> None:
    """A filament may be called so; Rich would leave its marks out, and ends at one that closes nothing."""
    names = ("TPU [shore 82A]", "A [/82]", ":red_circle: x", r"\[a]")
    print_report_table(ReportTable("", "", (Column("front.slack[pull]"),), tuple((name,) for name in names)))
    assert {"front.slack[pull]", *names} <= cells(printed())


def run(*arguments: object) -> None:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    assert not left.value.code


def test_a_sweep_over_three_parameters(printed: Printed, tmp_path: Path) -> None:
    over = (
        "springs.youngs_modulus=1.2GPa,0.7GPa",
        "springs.poissons_ratio=0.1,0.3",
        "cable1.friction_coefficient=0,0.1",
    )
    options = [text for axis in over for text in ("--over", axis)]
    run("sweep", write_sweep(tmp_path / "p"), *options, "--out", tmp_path / "run", "--no-report")
    assert {"youngs_modulus", "poissons_ratio", "friction_coefficient", "700 MPa", "reduced by"} <= cells(printed())


@pytest.mark.slow
def test_models_that_are_validated(printed: Printed, tmp_path: Path) -> None:
    run("validate", write_sweep(tmp_path / "p"), "--split", "springs.youngs_modulus")
    lines = printed()
    told = " ".join(row[0] for n in (2, 3) for row in rows(lines, n))
    assert "springs.youngs_modulus, without cable1" in told
    assert "predicted: cable2, distance (RMS)" in told
    assert "all predictions, distance (RMS)" in told
    assert any(re.fullmatch(r"[\d.e-]+ mm \([\d.e-]+ %\)", cell) for cell in cells(lines))


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("fleet/../runs/fleet/report.html", "runs/fleet/report.html"),
        ("{here}/runs/report.html", "runs/report.html"),
        ("../beside", "../beside"),
        ("./run/", "run"),
        ("/x/y", "/x/y"),
    ],
)
def test_paths_are_shown_as_seen_from_the_present_folder(
    written: str, shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert shown_path(Path(written.format(here=tmp_path))) == shown


def test_the_rounding_of_a_channel_is_not_shown(printed: Printed, tmp_path: Path) -> None:
    run("init", "bellows", tmp_path / "bellows")
    path = tmp_path / "bellows/project.yaml"
    coarse = path.read_text(encoding="utf-8").replace("folds: 3", "folds: 2, layers: 4, sectors: 4")
    path.write_text(coarse.replace("0 mm, 39 mm]", "0 mm, 27 mm]"), encoding="utf-8")
    run("simulate", path, "--pull", "main=1kPa", "--out", tmp_path / "blown")
    shown = cells(printed())
    assert {"tip.x", "0 mm"} <= shown
    assert not [cell for cell in shown if "e-" in cell]


@pytest.mark.slow
def test_commands_show_paths_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    write_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    for args in (
        ["calibrate", "project.yaml", "--out", "a/../run", "--option", "starts=1"],
        ["check", str(tmp_path / "project.yaml"), "--out", "a/../b", "--no-solve"],
        ["simulate", "project.yaml", "--out", str(tmp_path / "c")],
    ):
        with pytest.raises(SystemExit) as ended:
            main(args)
        assert not ended.value.code
    out = capsys.readouterr().out
    assert "\nRun: run\n" in out
    assert "\nReport: run/report.html\n" in out
    assert "\nPictures: b/robot.png" in out
    assert "\nWrote c\n" in out
    assert str(tmp_path) not in out
    assert ".." not in out


def test_every_command_shows_its_paths_by_one_function():
    """A path that is put into a line as it is would be as long as it was typed."""
    sources = Path(printing.__file__).parent.glob("*_command*.py")
    bare = r"echo\(\s*f?\"[^\"]*\{(?:out|path|folder|run|project|\w+\.(?:folder|page|path))\}"
    assert [source.name for source in sources if re.search(bare, source.read_text(encoding="utf-8"))] == []


def test_errors_of_predictions_have_readable_units(printed: Printed, monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {"main.pressure": 1234.5, "main.volume": 2.5e-6, "tip.z": 3.4e-5}
    monkeypatch.setattr(validation, "pooled_errors", lambda fits: errors)
    units = {"main.pressure": "Pa", "main.volume": "m^3", "tip.z": "m"}
    table = Table("", "model")
    # Each test has channels of its own.
    _add_errors(table, "predicted", [[SimpleNamespace(units={name: unit}) for name, unit in units.items()]])
    print_table(table)
    assert {"1.23 kPa", "2.5 ml", "0.034 mm"} <= cells(printed())
