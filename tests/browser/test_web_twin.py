"""The twin as a page: its JavaScript is the reduced model of Python, its shapes and bands are the twin's."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.conftest import Seen
from browser.test_watch_page import SCRIPT, complaints
from project_case import bench_csv, write_project
from sweep_case import write_sweep

import softcal
from softcal import ExportRequest, InputError, load, write_export
from softcal.cli import main
from softcal.export.tension_grid_model import GridModel
from softcal.report.twin_page import drawn
from softcal.report.twin_view import TwinView
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.workflows.calibrated_shapes import furthest_response
from softcal.workflows.reporting import write_report
from softcal.workflows.study_source import load_calibrated

TOO = """\
    left:
      via:
        - {on: plate, at: [0 mm, 30 mm, 100 mm]}
        - {at: [0 mm, 30 mm, 0 mm]}
  markers:
    dot: {on: bar, at: [0 mm, 0 mm, 50 mm]}
experiments:
"""


@dataclass(frozen=True)
class Page:
    """A written page, and what it is of."""

    path: Path
    run: Path
    robot: Robot
    text: str
    data: Any

    @property
    def stated(self) -> float:
        """The stated error of the drawn points [m], with its last digit rounded up."""
        number, unit = re.search(r"drawn point from the twin: ([\d.e-]+) (\w+),", self.text).groups()  # type: ignore[union-attr]
        return 1.06 * float(number) * {"mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}[unit]

    def exact(self, tensions: np.ndarray) -> Any:
        """The twin's response, with shapes, to tensions (n, 2) [N]."""
        commands = {name: Command("tension", tensions[:, k]) for k, name in enumerate(self.data["model"]["cables"])}
        return simulate(self.robot, Protocol(commands), snapshots="samples", curve_tolerance=0.0)

    def points(self, tensions: np.ndarray) -> np.ndarray:
        """Where the twin's drawn points are (n, n_points, 3) [m]."""
        corners = self.exact(np.array([[0.0, 0.0], [axis[-1] for axis in self.data["model"]["axes"]]]))
        response = self.exact(tensions)
        return drawn(TwinView(self.robot, *corners.snapshots, response.tets), response.snapshots).points


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0), *capsys.readouterr()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Of a calibrated bar with two cables and a marker; the project has the name of a script."""
    folder = tmp_path_factory.mktemp("web")
    chance = np.random.default_rng(0)
    head, *lines = bench_csv().splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    noisy = [
        f"{t},{d},{f + 0.1 * chance.standard_normal()},{p + 0.3 * chance.standard_normal()}" for t, d, f, p in rows
    ]
    changes = ("name: a square bar", f'name: "{SCRIPT}"'), ("experiments:\n", TOO)
    project = write_project(folder, *changes, data="\n".join([head, *noisy]) + "\n")
    run, out = folder / "run", folder / "web"
    for command in (
        ["calibrate", project, "--out", run, "--no-report", "--no-mesh-error"],
        ["export", "web", run, "--out", out, "--pull", "front=12mm", "--pull", "left=0.6N", "--samples", 4],
    ):
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in command])
        assert not ended.value.code
    text = (out / "twin.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="twin-data">(.*?)</script>', text, re.DOTALL).group(1))  # type: ignore[union-attr]
    return Page(out / "twin.html", run, load_calibrated(run).robot, html.unescape(text), data)


@pytest.fixture
def random(page: Page) -> np.ndarray:
    return np.random.default_rng(4).uniform(size=(12, 2)) * [axis[-1] for axis in page.data["model"]["axes"]]


def in_page(seen: Seen, expression: str, argument: object = None) -> Any:
    return seen.page.evaluate(
        f"given => {{ const twin = document.querySelector('[data-twin]').twin; return {expression}; }}", argument
    )


@pytest.mark.slow
def test_javascript_is_python(page: Page, random: np.ndarray, look: Callable[..., Seen]) -> None:
    seen, read = look(page.path.as_uri()), GridModel(page.data["model"])
    ends = [axis[-1] for axis in read.axes]
    for front, left in [*random.tolist(), [0.0, 0.0], ends, [read.axes[0][1], 0.0]]:
        given = {"front": front, "left": left}
        ours, theirs = read.state(given), in_page(seen, "twin.model.state(given)", given)
        assert ours["plates"].keys() == theirs["plates"].keys() == {"plate"}
        for key in ("position", "quaternion"):
            np.testing.assert_allclose(
                theirs["plates"]["plate"][key], ours["plates"]["plate"][key], rtol=1e-9, atol=1e-12
            )
        assert theirs["shortenings"] == pytest.approx(ours["shortenings"], rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(theirs["compliance"], ours["compliance"], rtol=1e-9, atol=1e-12)
    assert in_page(seen, "twin.model.state({front: 0.1})") == in_page(seen, "twin.model.state({front: 0.1, left: 0})")
    outside = {"front": ends[0] * 1.001}, {"left": -1e-7}, {"left": 1234567.0}, {"right": 1.0}, {"front": float("nan")}
    for given in outside:
        with pytest.raises(ValueError, match=r"outside the model|no cable") as refused:
            read.state(given)
        refusal = "(() => { try { twin.model.state(given); } catch (error) { return error.message; } })()"
        assert in_page(seen, refusal, given) == str(refused.value)


@pytest.mark.slow
def test_the_chart_ends_at_the_largest_tension(page: Page, look: Callable[..., Seen]) -> None:
    """Whatever it is: rounding must not lead beyond the model."""
    seen, ends = look(page.path.as_uri()), np.random.default_rng(5).uniform(5.6, 10.0, 60).tolist()
    drawn_to = (
        "given.map((end) => { twin.model.axes[0][twin.model.axes[0].length - 1] = end; twin.plot(); return end; })"
    )
    assert in_page(seen, drawn_to, ends) == ends


@pytest.mark.slow
def test_the_shapes_are_the_twins_within_the_stated_error(
    page: Page, random: np.ndarray, look: Callable[..., Seen]
) -> None:
    seen, axes = look(page.path.as_uri()), page.data["model"]["axes"]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    for tensions, most in ((nodes, page.stated), (random, 2 * page.stated)):
        exact = page.points(tensions)
        shown = [in_page(seen, "Array.from(twin.shapes.at(given))", at) for at in tensions.tolist()]
        away = np.linalg.norm(np.reshape(shown, exact.shape) - exact, axis=2).max()
        assert away <= most < 1e-3 * np.ptp(exact, axis=0).max()


@pytest.mark.slow
def test_the_measures_and_their_bands_are_the_twins(page: Page, look: Callable[..., Seen]) -> None:
    """A band is 1.96 standard errors of E times the derivative by E, here by differences; slack has no effect."""
    seen, axes = look(page.path.as_uri()), page.data["model"]["axes"]
    at = [axes[0][2], axes[1][1]]
    shown = in_page(
        seen,
        "twin.measures.of(twin.model.state(given[0]), twin.shapes.at(given[1]))",
        [dict(zip(("front", "left"), at, strict=True)), at],
    )
    bands = in_page(seen, "twin.measures.bands(given)", at)
    estimate = softcal.load_run(page.run).headline.parameters["bar.youngs_modulus"]

    def measures(modulus: float) -> dict[str, float]:
        robot = softcal.with_parameters(page.robot, {"bar.youngs_modulus": modulus})
        tensions = {name: Command("tension", np.array([0.0, at[k]])) for k, name in enumerate(("front", "left"))}
        response = simulate(robot, Protocol(tensions), snapshots="samples", curve_tolerance=0.0)
        before, after = response.snapshots
        turn = before.plates["plate"][1].T @ after.plates["plate"][1]
        return {
            "plate.rotation": float(np.arccos(0.5 * (np.trace(turn) - 1.0))),
            "plate.displacement": float(np.linalg.norm(after.plates["plate"][0] - before.plates["plate"][0])),
            "dot.displacement": float(np.linalg.norm(after.markers["dot"] - before.markers["dot"])),
            "front.shortening": response.channels["front.shortening"][1],
            "left.shortening": response.channels["left.shortening"][1],
        }

    step = 1e-4 * estimate.value
    low, exact, high = (measures(estimate.value + sign * step) for sign in (-1, 0, 1))
    assert shown.keys() == bands.keys() == exact.keys() == set(page.data["measures"])
    assert estimate.standard_error is not None
    for name, value in exact.items():
        assert shown[name] == pytest.approx(value, rel=1e-5, abs=page.stated), name
        half = 1.959964 * estimate.standard_error * abs(high[name] - low[name]) / (2 * step)
        assert bands[name] == pytest.approx(half, rel=1e-3), name
    assert in_page(seen, "twin.measures.bands([0, 0])") == pytest.approx(dict.fromkeys(exact, 0.0), abs=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1400])
def test_the_body_follows_the_sliders(page: Page, look: Callable[..., Seen], width: int) -> None:
    seen = look(page.path.as_uri(), width=width)
    canvas, slider = seen.page.locator("canvas"), seen.page.locator("input[type=range]").first
    dot, value = seen.page.locator(".chart .now"), seen.page.locator(".slider output").first
    pixels, place, text = canvas.screenshot(), dot.get_attribute("cx"), value.inner_text()
    slider.focus()
    for _ in range(20):
        slider.press("ArrowRight")
    assert canvas.screenshot() != pixels
    assert dot.get_attribute("cx") != place
    assert value.inner_text() != text
    assert re.fullmatch(r"[\d.]+ N · [\d.]+ mm", slider.get_attribute("aria-valuetext") or "")
    # By its length: the tension is the one that the model has there.
    seen.page.get_by_label("shortening", exact=True).check()
    slider.press("ArrowLeft")
    front, left = in_page(seen, "twin.tensions")
    length = GridModel(page.data["model"]).state({"front": front, "left": left})["shortenings"]["front"]
    assert 1e3 * length == pytest.approx(float(slider.input_value()), rel=1e-6)
    pixels = canvas.screenshot()
    canvas.focus()
    canvas.press("ArrowLeft")
    assert canvas.screenshot() != pixels
    seen.page.get_by_label("Measure of the chart").select_option("dot.displacement")
    assert "displacement of dot [mm]" in (seen.page.locator(".chart").text_content() or "")
    assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
    assert complaints(seen) == []
    assert seen.requests == [page.path.as_uri()]
    assert seen.page.locator("h1").inner_text() == SCRIPT
    assert seen.page.title() == f"{SCRIPT}: the twin"


@pytest.mark.slow
def test_the_mouse_turns_and_enlarges_it_and_the_page_still_scrolls(page: Page, look: Callable[..., Seen]) -> None:
    seen = look(page.path.as_uri(), height=600)
    mouse, box = seen.page.mouse, seen.page.locator("canvas").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    mouse.move(x, y)
    mouse.wheel(0, 50)
    seen.wait_for(lambda: seen.page.evaluate("window.scrollY") > 0, "the page is not scrolled")
    assert in_page(seen, "twin.picture.closeness") == 1
    mouse.down()
    mouse.move(x + 40, y + 10)
    mouse.up()
    mouse.move(x - 40, y)
    assert in_page(seen, "[twin.picture.turned, twin.picture.tilted]") == pytest.approx([-0.32, 0.08])
    mouse.wheel(0, -100)
    seen.wait_for(lambda: in_page(seen, "twin.picture.closeness") > 1, "it is not enlarged")


@pytest.mark.slow
def test_the_numbers_follow_where_there_is_no_webgl(page: Page, look: Callable[..., Seen]) -> None:
    seen = look("about:blank")
    seen.page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    seen.page.goto(page.path.as_uri())
    assert "draws no WebGL" in seen.page.inner_text("figcaption")
    value, slider = seen.page.locator("[data-values] td.short").first, seen.page.locator("input[type=range]").first
    text = value.inner_text()
    slider.press("PageUp")
    assert value.inner_text() != text
    assert complaints(seen) == []


@pytest.mark.slow
def test_a_page_has_no_bands_where_none_are_known(
    page: Page, tmp_path: Path, capsys: pytest.CaptureFixture[str], look: Callable[..., Seen]
) -> None:
    for source, options, why in (
        (page.run.parent / "project.yaml", (), "There are no bands: the values are those of a project file"),
        (page.run, ("--set", "bar.youngs_modulus=2MPa"), "bar.youngs_modulus does not have the calibrated value."),
    ):
        out = tmp_path / f"out{len(options)}"
        pulls = ("--pull", "front=0.5N", "--samples", 3)
        code, said, _ = told(capsys, "export", "web", source, "--out", out, *pulls, *options)
        assert code == 0
        assert why in " ".join(said.split())
        seen = look((out / "twin.html").as_uri())
        assert why in seen.page.inner_text("main")
        assert in_page(seen, "twin.measures.bands([0.1])") == {}
        assert complaints(seen) == []


@pytest.mark.slow
def test_a_sweep_has_a_page_without_bands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sweep(tmp_path / "p")
    assert told(capsys, "sweep", tmp_path / "p" / "project.yaml", "--out", tmp_path / "run", "--no-report")[0] == 0
    code, said, _ = told(capsys, "export", "web", tmp_path / "run", "--out", tmp_path / "web", "--samples", 3)
    assert code == 0
    assert "There are no bands: a sweep has no intervals." in " ".join(said.split())


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1400])
def test_the_frame_of_a_report_is_pulled_by_a_slider(page: Page, look: Callable[..., Seen], width: int) -> None:
    """Its numbers are Python's, its shapes those of the load path; it asks for nothing, and is not printed."""
    made = write_report(page.run, page.run.parent / f"report{width}", figures=["overview"])
    seen = look(made.page.as_uri(), width=width)
    frame = seen.page.frames[1]
    frame.wait_for_function("document.querySelector('[data-twin]').twin")

    def in_frame(expression: str, argument: object = None) -> Any:
        return frame.evaluate(
            f"given => {{ const twin = document.querySelector('[data-twin]').twin; return {expression}; }}", argument
        )

    data = json.loads(frame.locator("#twin-data").text_content() or "")
    path, shapes = data["path"], data["shapes"]
    assert (path["name"], path["kind"]) == ("shortening of front", "shortening")
    assert path["measures"] == ["front.tension", "plate.rotation", "plate.displacement", "dot.displacement"]
    axis = path["axes"][0]
    read = GridModel({"cables": ["front"], "rows": [], "error": {}, "axes": path["axes"]})
    rest = np.frombuffer(base64.b64decode(shapes["rest"]), "<f4")
    modes = np.frombuffer(base64.b64decode(shapes["modes"]), "<i2").reshape(shapes["n_modes"], -1)
    run = softcal.load_run(page.run)
    response = furthest_response(run.project, run.headline)
    for place in [*np.linspace(axis[0], axis[-1], 7).tolist(), *axis]:
        shown = in_frame("twin.model.state({'shortening of front': given})", place)
        assert [*shown.values()] == pytest.approx(read.channels([place], path["nodes"]), rel=1e-9, abs=1e-12)
        points = np.array(in_frame("Array.from(twin.shapes.at(given))", [place]))
        assert points == pytest.approx(rest + read.channels([place], shapes["nodes"]) @ modes, abs=1e-7)
        if place in axis:
            (at,) = (one for one in response.snapshots if one.drive == place)
            assert shown["front.tension"] == pytest.approx(at.tensions["front"], rel=1e-9, abs=1e-12)
    seen.page.locator("iframe").scroll_into_view_if_needed()  # a frame out of sight draws nothing
    canvas, slider = frame.locator("canvas"), frame.locator("input[type=range]")
    pixels, number = canvas.screenshot(), frame.locator("[data-values] td.short").first.inner_text()
    slider.focus()
    for _ in range(20):
        slider.press("ArrowRight")
    assert canvas.screenshot() != pixels
    assert frame.locator("[data-values] td.short").first.inner_text() != number
    fits = "document.documentElement.scrollWidth <= innerWidth && document.documentElement.scrollHeight <= innerHeight"
    assert frame.evaluate(fits)
    assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
    assert complaints(seen) == []
    assert {one for one in seen.requests if not one.startswith("data:")} == {made.page.as_uri()}
    assert len(html.escape(made.page.read_text(encoding="utf-8"))) < 600_000
    assert "% of its largest" in seen.page.inner_text(".frame figcaption")
    seen.page.emulate_media(media="print")
    assert not seen.page.locator(".frame").is_visible()


@pytest.mark.slow
def test_what_makes_no_page_is_refused(page: Page, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, why in (
        ((tmp_path, "--out", tmp_path / "a"), "there is no run here"),
        ((page.run, "--out", page.path.parent), "the folder is not empty"),
        ((page.run, "--out", tmp_path / "b", "--pull", "frnt=8mm"), "no such cable"),
        ((page.run, "--out", tmp_path / "c", "--samples", 1), "too few samples"),
    ):
        code, _, error = told(capsys, "export", "web", *arguments)
        assert code == 2
        assert why in " ".join(error.split())
        assert not (tmp_path / arguments[2].name).exists() or arguments[2] == page.path.parent
        assert "Traceback" not in error
    assert page.path.stat().st_size > 0
    project = load(page.run.parent / "project.yaml")
    for run, why in ((tmp_path, "there is no run here"), (tmp_path / "not", "there is no run"), (3, "run: ")):
        with pytest.raises(InputError, match=why):
            write_export("web", ExportRequest(project, ["front=1mm"], run=run), tmp_path / "d")  # type: ignore[arg-type]
