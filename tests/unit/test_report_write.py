"""The whole report and the check pictures, written and read back."""

from __future__ import annotations

import base64
import html
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from report_example import bench_experiment, column_mesh, example_content, neck_robot, tpe_result

from softcal.errors import StorageError
from softcal.experiments.dataset import Dataset, Step
from softcal.report import check_figures
from softcal.report.check_figures import draw_check
from softcal.report.content import Landscape, ReportContent
from softcal.report.figure import FIGURES, report_pictures
from softcal.report.html import render_page
from softcal.report.scene_render import Rendering
from softcal.report.twin_view import TwinFrame
from softcal.report.write import ReportPaths, write_files, write_report


@pytest.fixture(scope="module")
def content() -> ReportContent:
    whole = example_content(n_trials=40)
    frame = TwinFrame('<script>"a" < 1 && b</script>', 3, "It moves.")
    return replace(whole, frame=frame, results={label: whole.results[label] for label in ("20 mm, 5 mm/s", "joint")})


@pytest.fixture(scope="module")
def written(content: ReportContent, tmp_path_factory: pytest.TempPathFactory) -> ReportPaths:
    return write_report(content, tmp_path_factory.mktemp("report"))


@pytest.mark.slow
def test_the_page_stands_alone(written: ReportPaths, content: ReportContent) -> None:
    page = written.page.read_text()
    assert written.page.stat().st_size < 5e6
    # A script is in a frame alone, which has an origin of its own: it reads nothing of the page, and loads nothing.
    assert "<script" not in page
    frames = re.findall(r"<iframe [^>]*>", page)
    assert len(frames) == 1
    assert 'sandbox="allow-scripts"' in frames[0]
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frames[0])[1]) == content.frame.page  # type: ignore[index,union-attr]
    assert "@media print { .frame { display: none; }" in page
    assert 'loading="lazy"' not in page  # a browser may print, or archive, the page without them
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources
    assert all(source.startswith("data:image/") for source in sources)


def test_the_page_says_what_a_supervisor_asks(written: ReportPaths) -> None:
    page = written.page.read_text()
    for words in (
        "Soft neck, bench of May", "1.900 ± 0.021", "MPa", "ν is not identified", "Table I.", "Table II.", "fANOVA",
        "pulley friction", "1.17 to 2.83 MPa (green)", "Neither angles nor positions were compared in 20 mm, 5 mm/s",
    ):  # fmt: skip
        assert words in page, words
    assert "Eq. (" not in page


def test_every_figure_is_there_twice_and_readable(written: ReportPaths) -> None:
    stems = {path.stem for path in written.figures}
    assert len(written.figures) == 2 * len(stems)
    for wanted in (
        "twin",
        "overview",
        "plausible-modulus",
        "loss-20-mm-5-mm-s",
        "history-joint",
        "parameter-neck-youngs-modulus",
    ):
        assert wanted in stems
    for path in written.figures:
        if path.suffix == ".svg":
            assert ElementTree.fromstring(path.read_bytes()).tag.endswith("svg")
        else:
            assert path.read_bytes().startswith(b"\x89PNG")


def test_embedded_pictures_are_the_files(written: ReportPaths) -> None:
    page = written.page.read_text()
    twin = next(path for path in written.figures if path.name == "twin.png")
    assert base64.b64encode(twin.read_bytes()).decode() in page


def test_labels_from_the_project_are_escaped(content: ReportContent) -> None:
    hostile = replace(content, project_name="<b>neck</b> & co")
    page = render_page(hostile, [])
    assert "<b>neck" not in page
    assert "&lt;b&gt;neck&lt;/b&gt; &amp; co" in page


@pytest.mark.slow
def test_writing_twice_gives_the_same_files(content: ReportContent, tmp_path: Path) -> None:
    name = "20 mm, 5 mm/s"
    experiments = {name: content.experiments[name]}
    lean = ReportContent("neck", {name: content.results[name]}, experiments)
    told: list[tuple[str, int, int]] = []

    def progress(*step: Any) -> None:
        told.append(step)

    first = {path: path.read_bytes() for path in _all(write_report(lean, tmp_path, progress=progress))}
    n = len(FIGURES) + 1
    assert told[-1] == ("writing the page", n - 1, n)
    assert [step[1:] for step in told] == [(k, n) for k in range(n)]
    assert "drawing trajectory" in [step[0] for step in told]
    (tmp_path / "mine.txt").write_text("kept")
    second = {path: path.read_bytes() for path in _all(write_report(lean, tmp_path))}
    assert first == second
    assert (tmp_path / "mine.txt").read_text() == "kept"


def _all(paths: ReportPaths) -> list[Path]:
    return [paths.page, *paths.figures, *paths.tables]


def test_an_unwritable_place_is_one_sentence(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(StorageError, match="the file cannot be written"):
        write_files({blocked / "report.html": b"x"})
    folder = tmp_path / "taken"
    (folder / "report.html" / "inside").mkdir(parents=True)
    with pytest.raises(StorageError, match=r"report\.html: a folder is in the place of a file"):
        write_files({folder / "figures" / "twin.png": b"x", folder / "report.html": b"x"})
    assert [path.name for path in folder.iterdir()] == ["report.html"]


@pytest.mark.slow
def test_one_parameter_few_trials_and_no_extras_still_give_a_report(tmp_path: Path) -> None:
    experiment = bench_experiment("20mm", 0.02, 2e6, pitch=False)
    result = tpe_result([experiment], 2e6, 0.45, n_trials=4)
    alone = {"neck.youngs_modulus": result.parameters["neck.youngs_modulus"]}
    content = ReportContent("neck", {"20mm": replace(result, parameters=alone, importance={})}, {"20mm": experiment})
    paths = write_report(content, tmp_path)
    assert "loss-20mm.png" in {path.name for path in paths.figures}
    empty = replace(result, trials=(), n_failed_trials=0)
    assert report_pictures(replace(content, results={"20mm": empty}))


@pytest.mark.slow
def test_a_landscape_is_drawn_as_a_map(content: ReportContent) -> None:
    x, y = np.geomspace(1e5, 4e7, 8), np.linspace(0.4, 0.4999, 6)
    loss = 0.1 + np.abs(np.log(x[None] / 2e6)) + y[:, None]
    failed = np.zeros((6, 8), dtype=int)
    failed[0, 0] = 1
    grid = Landscape("neck.youngs_modulus", "neck.poissons_ratio", x, y, loss, failed)
    lean = replace(
        content,
        twin=None,
        results={"joint": replace(content.results["joint"], method="tpe")},
        landscapes={"joint": grid},
    )
    captions = [picture.caption for picture in report_pictures(lean) if picture.section == "search"]
    assert "on a grid" in captions[0]


def test_an_experiment_driven_by_tension_compares_the_travel(tmp_path: Path) -> None:
    experiment = replace(bench_experiment("8N", 0.02, 2e6), drive="tension")
    result = tpe_result([experiment], 2e6, 0.45, n_trials=4)
    travel = experiment.prepared.values("shortening")
    fit = replace(
        result.experiments["8N"], rmse={"shortening": 1e-3}, rmse_detrended={"shortening": 5e-4},
        measured={"shortening": travel}, simulated={"shortening": travel + 1e-3}, units={"shortening": "m"},
    )  # fmt: skip
    page = write_report(
        ReportContent("neck", {"8N": replace(result, experiments={"8N": fit})}, {"8N": experiment}), tmp_path
    ).page
    assert "the travel to 1.00 mm RMS (5.0 % of its range)" in page.read_text()


@pytest.mark.slow
def test_a_record_without_force_is_captioned_as_it_is_drawn() -> None:
    """No light tones, and no samples in blue beside them."""
    content = example_content(n_trials=3)
    name, experiment = next(iter(content.experiments.items()))
    still = Dataset("still", {key: experiment.raw.channels[key] for key in ("time", "pitch")})
    averaged = replace(still, provenance=(*still.provenance, Step("average", {}, "")))
    hung = replace(experiment, raw=still, prepared=averaged, corrected=None)
    content = replace(content, experiments={**content.experiments, name: hung})
    (caption,) = [p.caption for p in report_pictures(content) if p.section == "bench" and p.caption.startswith(name)]
    assert caption == f"{name}: the record; the fit uses it after average."


def test_check_pictures_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_figures, "render_scenes", lambda *_: Rendering((), "no pictures"))
    robot = neck_robot(column_mesh(n_rings=8))
    paths = draw_check(robot, {"20 mm": bench_experiment("20 mm", 0.02, 2e6).raw}, tmp_path)
    assert [path.exists() for path in (paths.robot, paths.datasets["20 mm"])] == [True] * 2
    assert paths.notes == ("no pictures",)


def test_importing_the_report_loads_nothing_heavy() -> None:
    code = (
        "import sys, softcal.report.write, softcal.report.check_figures, softcal.report.scene_worker\n"
        "print([m for m in ('matplotlib', 'pyvista', 'pandas', 'jinja2', 'pint') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_figures_are_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "pictures").mkdir()
    (tmp_path / "run" / "figures").symlink_to(tmp_path / "pictures")
    files = {tmp_path / "run" / name: b"x" for name in ("figures/error.png", "report.html")}
    with pytest.raises(StorageError, match="a link leads out of the folder"):
        write_files(files)
    assert not any((tmp_path / "pictures").iterdir())
