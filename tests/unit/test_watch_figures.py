"""The figures of a run's report on its page: which are shown, and what is served."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from watch_case import write_json, write_run

from softcal.plugins.watch.report_figures import figure_bytes, report_figures
from softcal.plugins.watch.run_reader import RunReader
from softcal.report.style import encode, new_figure

PNG = b"\x89PNG\r\n\x1a\nand more"


def write_figure(folder: Path, stem: str) -> None:
    (folder / "figures").mkdir(exist_ok=True)
    (folder / "figures" / f"{stem}.png").write_bytes(PNG)
    (folder / "figures" / f"{stem}.svg").write_text("<svg/>")


def test_the_figures_of_a_report_are_there_with_it_the_fit_first(tmp_path: Path):
    run = write_run(tmp_path)
    for stem in ("loss-joint", "trajectory-pull", "overview"):
        write_figure(run, stem)
    assert RunReader(run).read().figures == ()
    (run / "report.html").write_text("<h1>The report</h1>")
    found = RunReader(run).read().figures
    assert [one.name for one in found] == ["overview.png", "trajectory-pull.png", "loss-joint.png"]
    assert [one.title for one in found] == ["Overview", "Trajectory pull", "Loss joint"]
    assert figure_bytes(run, "overview.png") == PNG
    os.utime(run / "figures" / "overview.png", ns=(1, 1))
    assert RunReader(run).read().figures[0].changed == 1


def test_a_figure_has_the_title_that_its_drawing_has(tmp_path: Path):
    run = write_run(tmp_path / "run")
    title = "Loss over the parameters: <b> & ν"
    figures = run / "figures"
    figures.mkdir()
    figure = new_figure()
    figure.add_subplot()
    (figures / "loss-joint.png").write_bytes(PNG)
    (figures / "loss-joint.svg").write_bytes(encode(figure, title)[1])
    (tmp_path / "secret.svg").write_text("<svg><title>a secret</title></svg>")
    (figures / "out.png").write_bytes(PNG)
    (figures / "out.svg").symlink_to(tmp_path / "secret.svg")
    assert {one.name: one.title for one in report_figures(run)} == {"loss-joint.png": title, "out.png": "Out"}


def test_a_fleet_has_the_figures_of_its_report(tmp_path: Path):
    write_json(tmp_path / "fleet.json", {"format": 1, "specimens": [], "statement": {}})
    write_figure(tmp_path, "specimens-E")
    assert RunReader(tmp_path).read().figures == ()
    (tmp_path / "report.html").write_text("<h1>The report</h1>")
    assert [one.name for one in RunReader(tmp_path).read().figures] == ["specimens-E.png"]


def test_other_files_are_neither_shown_nor_served(tmp_path: Path):
    run = write_run(tmp_path / "run")
    (tmp_path / "secret.png").write_bytes(PNG)
    write_figure(run, "overview")
    (run / "own.png").write_bytes(PNG)
    figures = run / "figures"
    (figures / "alone.png").write_bytes(PNG)  # a report would have written its SVG too
    for stem, target in (("out", tmp_path / "secret.png"), ("within", run / "own.png"), ("loop", figures / "loop.png")):
        (figures / f"{stem}.svg").write_text("")
        (figures / f"{stem}.png").symlink_to(target)
    (figures / "folder.svg").write_text("")
    (figures / "folder.png").mkdir()
    (figures / "pipe.svg").write_text("")
    os.mkfifo(figures / "pipe.png")
    os.rename(figures / "loop.png", run / "loop.png")
    assert [one.name for one in report_figures(run)] == ["overview.png"]
    names = ("out.png", "within.png", "folder.png", "pipe.png", "overview.svg", "../own.png", "..", "", "a\0.png")
    assert {name: figure_bytes(run, name) for name in names} == dict.fromkeys(names, b"")
    (figures / "overview.png").write_text("<svg><script/></svg>")
    assert figure_bytes(run, "overview.png") == b""


def test_figures_in_a_folder_that_leads_elsewhere_are_not_shown(tmp_path: Path):
    write_figure(tmp_path, "overview")
    run = write_run(tmp_path / "run")
    (run / "figures").symlink_to(tmp_path / "figures")
    assert report_figures(run) == ()
    assert figure_bytes(run, "overview.png") == b""


@pytest.mark.parametrize("name", ["<b>x.png", "a b%2e?.png", "\udcff.png"])
def test_a_figure_with_an_odd_name_is_text_or_nothing(name: str, tmp_path: Path):
    run = write_run(tmp_path)
    write_figure(run, name.removesuffix(".png"))
    found = report_figures(run)
    assert [one.name for one in found] == ([name] if name.isprintable() else [])
    "".join(one.title for one in found).encode()
