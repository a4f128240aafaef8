"""What a notebook shows of a project, a response and a result."""

from __future__ import annotations

import base64
import math
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from project_case import write_project

import softcal
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.statistics.estimate import Remark
from softcal.display import pictures_of
from softcal.html_text import MOST_ROWS, curve, heading, html_table, paragraph, picture
from softcal.project.project import Project
from softcal.report import plots
from softcal.report.scene import Projection, Surface
from softcal.report.sketch import draw_sketch
from softcal.report.style import as_png

SCRIPT = "<script>alert(1)</script>"


class Cells(HTMLParser):
    """The texts of a piece of HTML; every tag must be closed, and none may be a script."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.pictures: list[bytes] = []
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in ("table", "thead", "tbody", "tr", "th", "td", "div", "b", "svg", "polyline", "img")
        if tag == "img":
            kind, _, data = str(dict(attrs)["src"]).partition(",")
            assert kind == "data:image/png;base64"
            self.pictures.append(base64.b64decode(data))
        elif tag != "polyline":
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("polyline", "img"):
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return softcal.load(write_project(tmp_path_factory.mktemp("project")))


@pytest.fixture(scope="module")
def result(project: Project) -> CalibrationResult:
    return softcal.calibrate(project, starts=1).headline


def test_a_project_says_what_it_has(project: Project):
    texts = Cells(project._repr_html_()).texts
    assert texts[:2] == ["a square bar", "1 body, 1 plate, 1 cable"]
    assert texts[6:10] == ["pull", "25", "shortening", "tension, pitch"]
    row = texts.index("bar.youngs_modulus")
    assert texts[row : row + 3] == ["bar.youngs_modulus", "100 kPa to 40 MPa", "log"]
    assert "Warning" not in " ".join(texts)
    warned = replace(project, name=SCRIPT, warnings=(softcal.Fault(SCRIPT),), held={"bar.poissons_ratio": 0.45})
    texts = Cells(warned._repr_html_()).texts
    assert texts[0] == SCRIPT
    assert texts[-1] == f"Warning: {SCRIPT}."
    assert texts[texts.index("bar.poissons_ratio") + 1] == "0.45"


def test_a_response_says_what_its_channels_are(project: Project):
    response = softcal.simulate(project)
    texts = Cells(response._repr_html_()).texts
    assert texts[0] == response.status
    row = texts.index("front.tension")
    tension = response.channels["front.tension"]
    assert texts[row + 2] == f"{tension.max():.4g} N"
    assert f"over {len(tension)} samples" in texts
    assert "<svg" in response._repr_html_()
    failed = replace(response, succeeded=False, status=SCRIPT, channels={"c": tension * math.nan}, units={"c": "N"})
    texts = Cells(failed._repr_html_()).texts
    assert texts[0] == f"Failed: {SCRIPT}"
    assert texts[texts.index("c") + 1] == "–"
    assert Cells(replace(failed, channels={}, remarks=SCRIPT)._repr_html_()).texts[-1] == f"Warning: {SCRIPT}"


def test_a_result_says_its_values_and_intervals_as_they_are(result: CalibrationResult):
    texts = Cells(result._repr_html_()).texts
    row = texts.index("bar.youngs_modulus")
    assert texts[row + 1] == "1.3 MPa"
    assert " to " in texts[row + 2]
    assert texts[row + 3] == "100 kPa to 40 MPa"
    assert result.status in texts
    one = result.parameters["bar.youngs_modulus"]
    bound = replace(one, at_bound=True, interval=None)
    told = replace(result, parameters={SCRIPT: bound}, notes=(Remark(SCRIPT, "warning"),), n_failed_trials=2)
    texts = Cells(told._repr_html_()).texts
    row = texts.index(SCRIPT)
    assert texts[row + 1 : row + 3] == ["1.3 MPa (at a bound)", "–"]
    assert texts[-1] == f"Warning: {SCRIPT}"
    assert texts[0].endswith(", 2 of them failed")


def test_long_tables_are_cut_and_say_so():
    texts = Cells(html_table(["a"], [[k] for k in range(MOST_ROWS + 5)])).texts
    assert texts[-2:] == [str(MOST_ROWS - 1), "and 5 more"]
    assert Cells(html_table(["a"], [[None]])).texts == ["a"]
    assert Cells(heading("a & b") + paragraph('"')).texts == ["a & b", '"']


def test_a_curve_of_any_values():
    assert curve([1.0]) == curve([math.nan, 2.0]) == ""
    assert 'points="0.0,23.0 120.0,1.0"' in curve([1.0, 2.0])
    assert 'points="0.0,23.0 60.0,23.0 120.0,23.0"' in curve([5.0] * 3)
    assert "nan" not in curve([1.0, math.nan, math.inf, 3.0])
    assert len(curve(range(100000))) < 3000


def pixels(png: bytes) -> np.ndarray:
    """RGB (height, width, 3) of a picture."""
    return np.asarray(Image.open(BytesIO(png)).convert("RGB"), dtype=np.int64)


def coloured(png: bytes) -> float:
    """The share of a picture's pixels that are neither white nor grey."""
    return float((np.ptp(pixels(png), axis=2) > 25).mean())


def blue(png: bytes) -> float:
    """The share of a picture's pixels that are blue, as the largest displacements are."""
    shown = pixels(png)
    return float((shown[:, :, 2] - shown[:, :, 0] > 60).mean())


def test_a_project_is_shown_with_its_robot(project: Project):
    (robot,) = Cells(project._repr_html_()).pictures
    assert (pixels(robot) < 250).any(axis=2).mean() > 0.05
    assert coloured(robot) > 0.002  # its cable


def test_a_response_is_shown_where_it_has_shapes(project: Project):
    assert Cells(softcal.simulate(project)._repr_html_()).pictures == []
    response = softcal.simulate(project, snapshots=True)
    (shape,) = Cells(response._repr_html_()).pictures
    assert coloured(shape) > 0.02
    assert ((pixels(shape) < 240).all(axis=2) & (np.ptp(pixels(shape), axis=2) < 20)).mean() > 0.01  # at rest, grey
    assert blue(shape) > 0.02
    still = replace(response, snapshots=(response.snapshots[0],) * 2)
    (unmoved,) = Cells(still._repr_html_()).pictures
    assert blue(unmoved) == 0.0  # nothing has moved


def test_a_result_is_shown_with_its_losses_and_its_fit(result: CalibrationResult):
    assert len(Cells(result._repr_html_()).pictures) == 2
    assert len(Cells(replace(result, trials=())._repr_html_()).pictures) == 1
    assert len(Cells(replace(result, experiments={})._repr_html_()).pictures) == 1
    many = {f"pull {k}": result.experiments["pull"] for k in range(plots.MOST + 2)}
    assert len(Cells(replace(result, experiments=many)._repr_html_()).pictures) == 1 + plots.MOST


def test_what_cannot_be_drawn_is_no_picture_and_the_tables_are_there(
    project: Project, result: CalibrationResult, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: object) -> None:
        raise RuntimeError("no canvas")

    monkeypatch.setattr(plots, "as_png", broken)
    response = softcal.simulate(project, snapshots=True)
    for thing in (project, result, response):
        cells = Cells(thing._repr_html_())
        assert (cells.pictures, len(cells.texts) > 5) == ([], True)
    assert pictures_of(object()) == ()


def test_a_sketch_shows_what_is_nearer_over_what_is_further():
    x, y, z = np.eye(3)
    camera = Projection(x, y, z, (0.0, 1.0, 0.0, 1.0))
    square, cells = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0]], dtype=float), np.array([[0, 1, 2]])
    near, far = Surface(square + z, cells, colour="red"), Surface(square, cells, colour="blue")

    def middle(*layers: list[Surface]) -> tuple[int, ...]:
        shown = pixels(as_png(draw_sketch(layers[0], camera, *layers[1:]), 40.0))
        return tuple(shown[shown.shape[0] // 2, shown.shape[1] // 2].tolist())

    red, blue = (255, 0, 0), (0, 0, 255)
    assert middle([near, far]) == middle([far, near]) == red
    assert middle([far], [near]) == blue  # what is behind is covered by the others


def test_what_a_picture_shows_is_escaped():
    assert picture(b"png", '"><script>') == ('<img src="data:image/png;base64,cG5n" alt="&quot;&gt;&lt;script&gt;"/>')
