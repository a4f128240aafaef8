"""What every figure and section of a report keeps, and each in one file of the user's own."""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from own_module import brought, imported
from project_case import write_project
from report_example import bench_experiment, example_content, tpe_result
from typer.testing import CliRunner

from softcal import (
    Column,
    InputError,
    ParameterError,
    ReportTable,
    load,
    register_figure,
    register_section,
    write_report,
)
from softcal.cli import app
from softcal.report.content import ReportContent
from softcal.report.figure import FIGURES, ReportFigure, named_figures
from softcal.report.figures import twin
from softcal.report.scene_render import Rendering
from softcal.report.section import SECTIONS, ReportSection
from softcal.workflows.calibration import calibrate

HISTOGRAM = '''
from matplotlib.figure import Figure

from softcal import Drawing, register_figure


@register_figure("fit")
def residual_histogram(content):
    """A histogram of the residuals."""
    for name, fit in content.headline_result.experiments.items():
        for channel in fit.rmse:
            figure = Figure()
            axes = figure.add_subplot(title="Residuals")
            axes.hist(fit.simulated[channel] - fit.measured[channel])
            yield Drawing(figure, f"Residuals of {channel} in {name}.", of=f"{channel} {name}")
'''


SECTION = '''
from softcal import Column, Gallery, Remark, ReportTable, Small, register_section


@register_section("Largest residuals", place=45)
def largest(content):
    """The largest residual of each channel."""
    fits = content.headline_result.experiments
    rows = [
        (name, channel, float(abs(fit.simulated[channel] - fit.measured[channel]).max()))
        for name, fit in fits.items()
        for channel in fit.rmse
    ]
    yield f"There are {len(rows)} <channels>."
    yield Remark("A remark.", "warning")
    yield Remark("Another one.", "good")
    yield Gallery()
    yield ReportTable("largest-residuals", "By channel", (Column("of"), Column("channel"), Column("SI")), tuple(rows))
    yield Small("Small print.")


@register_section("Empty")
def empty(content):
    """Nothing but small print."""
    yield Gallery()
    yield Small("Small print alone.")
''' + HISTOGRAM.replace('"fit"', '"largest"')


@pytest.fixture(scope="module")
def whole() -> ReportContent:
    return example_content(n_trials=20)


@pytest.fixture(scope="module")
def bare() -> ReportContent:
    """One experiment, and a calibration that keeps no trials: what every report has."""
    experiment = bench_experiment("20mm", 0.02, 2e6, pitch=False)
    result = replace(tpe_result([experiment], 2e6, 0.45, n_trials=4), trials=(), n_failed_trials=0)
    return ReportContent("neck", {"20mm": result}, {"20mm": experiment})


@pytest.mark.parametrize("name", sorted(FIGURES))
def test_it_says_what_it_shows_and_stands_in_a_file_of_its_name(name: str) -> None:
    figure = FIGURES[name]
    assert figure.summary.endswith(".")
    assert figure.module == f"softcal.report.figures.{name.replace('-', '_')}"


@pytest.mark.parametrize("name", sorted(FIGURES))
def test_its_drawings_have_captions_and_names_of_their_own(
    name: str, whole: ReportContent, bare: ReportContent, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(twin, "render_scenes", lambda *_: Rendering((), ""))
    for content in (whole, bare):
        drawn = list(FIGURES[name].function(content))
        assert all(one.caption.endswith(".") and one.figure.axes for one in drawn)
        titles = [one.heading for one in drawn]
        assert len(set(titles)) == len(titles)
        assert all(" " in title and title[0].isupper() for title in titles), titles
        assert len({one.of for one in drawn}) == len(drawn)
        assert all(one.of for one in drawn) or len(drawn) < 2


def test_a_report_without_data_has_fewer_figures(whole: ReportContent, bare: ReportContent) -> None:
    def drawn(content: ReportContent) -> set[str]:
        return {name for name in FIGURES if name != "twin" and any(FIGURES[name].function(content))}

    assert drawn(bare) == {"overview", "force-displacement", "trajectory", "loss", "parameter"}
    assert drawn(whole) == drawn(bare) | {"history", "plausible-modulus"}


@pytest.mark.parametrize("name", sorted(SECTIONS))
def test_a_section_has_a_title_and_tables_of_its_own(name: str, whole: ReportContent, bare: ReportContent) -> None:
    for content in (whole, bare):
        tables = SECTIONS[name].tables(content)
        assert len({table.key for table in tables}) == len(tables)
    assert SECTIONS[name].title[0].isupper()


def test_a_section_of_ones_own_is_in_the_report(tmp_path: Path) -> None:
    """With its figures, remarks and tables, at its place; one without anything to show is left out."""
    calibrate(load(write_project(tmp_path / "p")), out=tmp_path / "run")
    imported(tmp_path / "own_section.py", SECTION)
    try:
        paths = write_report(tmp_path / "run", figures=["residual-histogram"])
    finally:
        FIGURES.remove("residual-histogram")
        SECTIONS.remove("largest")
        SECTIONS.remove("empty")
    page = paths.page.read_text(encoding="utf-8")
    titles = re.findall("<h2>(.*)</h2>", page)
    assert titles.index("Results") < titles.index("Largest residuals") < titles.index("Measurements")
    assert "Empty" not in titles
    section = page[page.index("<h2>Largest residuals</h2>") :].partition("</section>")[0]
    assert "<p>There are 2 &lt;channels&gt;.</p>" in section
    assert section.count("<ul ") == 1
    assert re.findall('class="is-(\\w+)"', section) == ["warning", "good"]
    assert "<figcaption>Residuals of tension in pull.</figcaption>" in section
    assert section.count("<h3>By channel</h3>") == 1
    assert "Small print." in section
    table = (tmp_path / "run" / "tables" / "largest-residuals.csv").read_text(encoding="utf-8").splitlines()
    assert table[0] == "of,channel,SI"
    assert len(table) == 3


def test_a_row_of_a_table_has_a_cell_for_each_column() -> None:
    with pytest.raises(InputError, match="a row has a cell for each column; got 1 cells in row 2"):
        ReportTable("own", "Own", (Column("a"), Column("b")), ((1, 2), (3,)))


def test_what_is_no_section_is_refused(whole: ReportContent) -> None:
    def unnamed(content: ReportContent) -> list[str]:
        return []

    with pytest.raises(ParameterError, match="section unnamed: the section has no title"):
        register_section(" ")(unnamed)
    with pytest.raises(ParameterError, match="there is another section of this name"):
        SECTIONS.add(ReportSection("twin", unnamed, "The twin"))
    with pytest.raises(ParameterError, match="the first screen of a report is no section"):
        SECTIONS.add(ReportSection("overview", unnamed, "Overview"))
    with pytest.raises(ParameterError, match="this is not a section"):
        SECTIONS.add(whole)  # type: ignore[arg-type]


@pytest.fixture
def histogram(tmp_path: Path) -> Generator[ModuleType]:
    """The figure, as a module of the user's registers it."""
    yield imported(tmp_path / "histogram_figure.py", HISTOGRAM)
    FIGURES.remove("residual-histogram")


def test_a_figure_of_ones_own_is_in_the_report(histogram: ModuleType, tmp_path: Path) -> None:
    calibrate(load(write_project(tmp_path / "p")), out=tmp_path / "run")
    given = ["report", str(tmp_path / "run"), "--out", str(tmp_path / "r"), "--figures", "residual-histogram, overview"]
    found = CliRunner().invoke(app, given)
    assert found.exit_code == 0, found.output
    stems = {path.stem for path in (tmp_path / "r" / "figures").glob("*.png")}
    assert stems == {"overview", "residual-histogram-tension-pull", "residual-histogram-pitch-pull"}
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    (section,) = [part for part in page.split("<section>") if "<h2>Measured and simulated</h2>" in part]
    assert "<figcaption>Residuals of tension in pull.</figcaption>" in section
    assert named_figures(())[-1].name == "residual-histogram"
    assert "<title>Residuals</title>" in (tmp_path / "r/figures/residual-histogram-tension-pull.svg").read_text()


def test_a_figure_that_nobody_registered_is_refused(tmp_path: Path) -> None:
    calibrate(load(write_project(tmp_path / "p")), out=tmp_path / "run")
    found = CliRunner().invoke(app, ["report", str(tmp_path / "run"), "--figures", "twn,residual-histogram"])
    told = found.output.replace("\n", " ")
    assert found.exit_code == 2
    assert "Error: 2 faults" in told
    assert "figures: there is no such figure; got 'twn'" in told
    assert "Try: 'twin'" in told
    assert not (tmp_path / "run" / "report.html").exists()


def test_a_package_brings_it_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = HISTOGRAM.replace("def residual_histogram", "def brought")
    (tmp_path / "brought_figure.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with brought(FIGURES, "brought_figure:brought", "softcal.figures", "brought", monkeypatch) as figure:
        assert figure.section == "fit"


def test_what_is_no_figure_is_refused(whole: ReportContent) -> None:
    def unexplained(content: ReportContent) -> list[object]:
        return []

    with pytest.raises(ParameterError) as error:
        register_figure("middle")(unexplained)  # type: ignore[arg-type, type-var]
    told = str(error.value)
    assert "figure unexplained: the figure has no description" in told
    assert "the report has no such section; got 'middle'; allowed: one of 12 names" in told
    with pytest.raises(ParameterError, match="there is another figure of this name"):
        FIGURES.add(ReportFigure("twin", twin.twin, "fit"))
    with pytest.raises(ParameterError, match="this is not a figure"):
        FIGURES.add(whole)  # type: ignore[arg-type]
    assert "unexplained" not in FIGURES
