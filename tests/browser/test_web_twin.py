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
from numpy.polynomial import chebyshev
from project_case import bench_csv, write_project
from sweep_case import write_sweep
from test_chambers import PROJECT as CHAMBER
from test_chambers import box
from test_drives import project as write_drive

import softcal
from softcal import ExportRequest, InputError, load, write_export
from softcal.cli import main
from softcal.export.reduced import evaluator_of
from softcal.export.reduced_model import ReducedModel
from softcal.geometry.write import write_mesh
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

    @property
    def model(self) -> ReducedModel:
        return read_of(self.data)

    @property
    def ends(self) -> list[float]:
        return self.model.most.tolist()

    def exact(self, tensions: np.ndarray) -> Any:
        """The twin's response, with shapes, to tensions (n, 2) [N]."""
        commands = {name: Command("tension", tensions[:, k]) for k, name in enumerate(self.model.inputs)}
        return simulate(self.robot, Protocol(commands), snapshots="samples", curve_tolerance=0.0)

    def points(self, tensions: np.ndarray) -> np.ndarray:
        """Where the twin's drawn points are (n, n_points, 3) [m]."""
        corners = self.exact(np.array([[0.0, 0.0], self.ends]))
        response = self.exact(tensions)
        return drawn(TwinView(self.robot, *corners.snapshots, response.tets), response.snapshots).points


def read_of(data: dict[str, Any]) -> ReducedModel:
    """The evaluator of a page's model in Python."""
    return evaluator_of({**data["model"], "rows": [], "error": {}})


def data_of(path: Path) -> Any:
    return json.loads(re.search(r'id="twin-data">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)[1])  # type: ignore[index]


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
        ["export", "web", run, "--out", out, "--reach", "front=12mm,left=0.6N", "--samples", 60],
    ):
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in command])
        assert not ended.value.code
    text = (out / "twin.html").read_text(encoding="utf-8")
    return Page(out / "twin.html", run, load_calibrated(run).robot, html.unescape(text), data_of(out / "twin.html"))


@pytest.fixture
def random(page: Page) -> np.ndarray:
    return np.random.default_rng(4).uniform(size=(12, 2)) * page.ends


def in_page(seen: Seen, expression: str, argument: object = None) -> Any:
    return seen.page.evaluate(
        f"given => {{ const twin = document.querySelector('[data-twin]').twin; return {expression}; }}", argument
    )


def same_in_page(seen: Seen, read: ReducedModel, given: dict[str, float]) -> None:
    """JavaScript's state is Python's."""
    ours, theirs = read.state(given), in_page(seen, "twin.model.state(given)", given)
    close = {"rtol": 1e-9, "atol": 1e-12}
    assert ours["plates"].keys() == theirs["plates"].keys()
    for name, pose in ours["plates"].items():
        for key in ("position", "quaternion"):
            np.testing.assert_allclose(theirs["plates"][name][key], pose[key], **close)
    for name, place in ours["markers"].items():
        np.testing.assert_allclose(theirs["markers"][name], place, **close)
    assert theirs["coordinates"] == pytest.approx(ours["coordinates"], rel=1e-9, abs=1e-12)
    channels = read.read(given, read.channels)[0]
    np.testing.assert_allclose([theirs["channels"][name] for name in read.channels], channels, **close)
    bands = ours.get("bands", {})
    assert bands.keys() == theirs["bands"].keys()
    for name, half in bands.items():  # of a band of zero the square is
        assert theirs["bands"][name] ** 2 == pytest.approx(half**2, rel=1e-9, abs=1e-15), name


@pytest.mark.slow
def test_javascript_is_python(page: Page, random: np.ndarray, look: Callable[..., Seen]) -> None:
    seen, read = look(page.path.as_uri()), page.model
    ends = page.ends
    for at in [*random.tolist(), [0.0, 0.0], ends, [ends[0], 0.0]]:
        same_in_page(seen, read, dict(zip(("front", "left"), at, strict=True)))
    assert in_page(seen, "twin.model.state({front: 0.1})") == in_page(seen, "twin.model.state({front: 0.1, left: 0})")
    outside = {"front": ends[0] * 1.001}, {"left": -1e-7}, {"left": 1234567.0}, {"right": 1.0}, {"front": float("nan")}
    for given in outside:
        with pytest.raises(ValueError, match=r"outside the model|no input") as refused:
            read.state(given)
        refusal = "(() => { try { twin.model.state(given); } catch (error) { return error.message; } })()"
        assert in_page(seen, refusal, given) == str(refused.value)


@pytest.mark.slow
def test_the_chart_ends_at_the_largest_tension(page: Page, look: Callable[..., Seen]) -> None:
    """Whatever it is: rounding must not lead beyond the model."""
    seen, ends = look(page.path.as_uri()), np.random.default_rng(5).uniform(5.6, 10.0, 60).tolist()
    assert in_page(seen, "given.map((end) => { twin.inputs[0].most = end; twin.plot(); return end; })", ends) == ends


@pytest.mark.slow
def test_the_shapes_are_the_twins_within_the_stated_error(
    page: Page, random: np.ndarray, look: Callable[..., Seen]
) -> None:
    seen, exact = look(page.path.as_uri()), page.points(random)
    shown = [in_page(seen, "Array.from(twin.shapes.at(given))", at) for at in random.tolist()]
    away = np.linalg.norm(np.reshape(shown, exact.shape) - exact, axis=2).max()
    assert away <= 2 * page.stated < 2e-3 * np.ptp(exact, axis=0).max()
    assert in_page(seen, "twin.data.view.largest") == pytest.approx(np.ptp(exact, axis=0).max(), rel=0.3)


@pytest.mark.slow
def test_the_measures_and_their_bands_are_the_twins(page: Page, look: Callable[..., Seen]) -> None:
    """A band is 1.96 standard errors of E times the derivative by E, here by differences; slack has no effect."""
    seen, at = look(page.path.as_uri()), (0.6 * np.array(page.ends)).tolist()
    state = in_page(seen, "twin.model.state(given)", dict(zip(("front", "left"), at, strict=True)))
    estimate = softcal.load_run(page.run).headline.parameters["bar.youngs_modulus"]

    def channels(modulus: float) -> dict[str, float]:
        robot = softcal.with_parameters(page.robot, {"bar.youngs_modulus": modulus})
        tensions = {name: Command("tension", np.array([at[k]])) for k, name in enumerate(("front", "left"))}
        response = simulate(robot, Protocol(tensions), curve_tolerance=0.0)
        return {name: float(response.channels[name][0]) for name in page.data["measures"]}

    step = 1e-4 * estimate.value
    low, exact, high = (channels(estimate.value + sign * step) for sign in (-1, 0, 1))
    assert {"plate.x", "plate.pitch", "dot.x", "front.shortening", "left.shortening"} <= exact.keys()
    assert page.data["first"] == "plate.pitch"
    assert estimate.standard_error is not None
    for name, value in exact.items():
        assert state["channels"][name] == pytest.approx(value, rel=1e-3, abs=page.stated), name
        half = 1.959964 * estimate.standard_error * abs(high[name] - low[name]) / (2 * step)
        assert state["bands"][name] == pytest.approx(half, rel=1e-2, abs=1e-6), name


@dataclass(frozen=True)
class Driven:
    """A project of an actuator of another kind, its range, and what a slider of it says."""

    write: Callable[[Path], Path]
    reach: str
    names: tuple[str, str]
    says: str


def chamber_project(folder: Path) -> Path:
    write_mesh(box().bodies[0].mesh, folder / "box.msh")
    text = CHAMBER.partition("experiments:")[0]
    (folder / "project.yaml").write_text(text, encoding="utf-8")
    return folder / "project.yaml"


def drive_project(folder: Path) -> Path:
    write_drive(folder)
    return folder / "project.yaml"


DRIVEN = {
    "chamber": Driven(chamber_project, "main=-5kPa..20kPa", ("pressure", "volume"), r"[\d.−]+ kPa · [\d.−]+ ml"),
    "drive": Driven(drive_project, "servo=-0.4rad..0.4rad", ("torque", "angle"), r"[\d.−]+ N mm · [\d.−]+°"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", DRIVEN)
def test_any_actuator_has_its_slider_in_its_own_units(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], look: Callable[..., Seen]
) -> None:
    one = DRIVEN[kind]
    out = tmp_path / "out"
    arguments = ("export", "web", one.write(tmp_path), "--out", out, "--reach", one.reach, "--samples", 24)
    code, said, _ = told(capsys, *arguments)
    assert code == 0, said
    seen, data = look((out / "twin.html").as_uri()), data_of(out / "twin.html")
    (name,) = (entry["name"] for entry in data["model"]["inputs"])
    read = read_of(data)
    for share in (0.0, 0.3, 1.0):
        same_in_page(seen, read, {name: float(read.least[0] + share * (read.most[0] - read.least[0]))})
    slider = seen.page.locator("input[type=range]")
    assert re.fullmatch(one.says, slider.get_attribute("aria-valuetext") or "")
    assert seen.page.locator(".kinds label").all_inner_texts() == [f" {kind}" for kind in one.names]
    pixels = seen.page.locator("canvas").screenshot()
    seen.page.get_by_label(one.names[1], exact=True).check()
    slider.press("PageDown")
    assert seen.page.locator("canvas").screenshot() != pixels
    (at,) = in_page(seen, "twin.at")
    channel = f"{name}.{one.names[1]}"
    there = read.state({name: at})["coordinates"][channel]
    assert there * data["units"][channel][1] == pytest.approx(float(slider.input_value()), rel=1e-6)
    assert "tension" not in seen.page.inner_text(".controls")
    has_wall = any(part["opacity"] < 1.0 for part in data["parts"] if "triangles" in part)
    assert has_wall == (kind == "chamber")
    assert complaints(seen) == []


@pytest.mark.slow
def test_a_parameter_is_an_input(tmp_path: Path, capsys: pytest.CaptureFixture[str], look: Callable[..., Seen]) -> None:
    reach = "front=4N,bar.youngs_modulus=1MPa..3MPa"
    arguments = ("export", "web", write_project(tmp_path), "--out", tmp_path / "out", "--reach", reach, "--samples", 24)
    assert told(capsys, *arguments)[0] == 0
    seen = look((tmp_path / "out" / "twin.html").as_uri())
    title, slider = seen.page.locator(".slider span").nth(1), seen.page.locator("input[type=range]").nth(1)
    assert title.inner_text() == "youngs modulus of bar"
    before = in_page(seen, "twin.state(twin.at).channels")["plate.pitch"]
    slider.press("PageDown")
    assert re.fullmatch(r"[\d.]+ MPa", slider.get_attribute("aria-valuetext") or "")
    assert in_page(seen, "twin.state(twin.at).channels")["plate.pitch"] > before
    assert complaints(seen) == []


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
    front, left = in_page(seen, "twin.at")
    length = page.model.state({"front": front, "left": left})["coordinates"]["front.shortening"]
    assert 1e3 * length == pytest.approx(float(slider.input_value()), rel=1e-6)
    pixels = canvas.screenshot()
    canvas.focus()
    canvas.press("ArrowLeft")
    assert canvas.screenshot() != pixels
    seen.page.get_by_label("Measure of the chart").select_option("dot.x")
    assert "x of dot [mm]" in (seen.page.locator(".chart").text_content() or "")
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
        pulls = ("--reach", "front=0.5N", "--samples", 10)
        code, said, _ = told(capsys, "export", "web", source, "--out", out, *pulls, *options)
        assert code == 0
        assert why in " ".join(said.split())
        seen = look((out / "twin.html").as_uri())
        assert why in seen.page.inner_text("main")
        assert in_page(seen, "twin.model.state({front: 0.1}).bands") == {}
        assert complaints(seen) == []


@pytest.mark.slow
def test_a_sweep_has_a_page_without_bands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sweep(tmp_path / "p")
    assert told(capsys, "sweep", tmp_path / "p" / "project.yaml", "--out", tmp_path / "run", "--no-report")[0] == 0
    code, said, _ = told(capsys, "export", "web", tmp_path / "run", "--out", tmp_path / "web", "--samples", 20)
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
    shapes, read = data["shapes"], read_of(data)
    assert data["inputs"] == [["front.shortening"]]
    assert data["efforts"] == ["front.tension"]
    assert {"front.tension", "plate.x", "plate.pitch", "dot.x"} <= set(data["measures"])
    rest = np.frombuffer(base64.b64decode(shapes["rest"]), "<f4")
    modes = np.frombuffer(base64.b64decode(shapes["modes"]), "<i2").reshape(shapes["n_modes"], -1)
    run = softcal.load_run(page.run)
    response = furthest_response(run.project, run.headline)
    largest = max(one.efforts["front"] for one in response.snapshots)
    half, middle = 0.5 * (read.most[0] - read.least[0]), 0.5 * (read.most[0] + read.least[0])
    nodes = [one.drive for one in response.snapshots]
    for place in [*np.linspace(read.least[0], read.most[0], 7).tolist(), *nodes]:
        shown = in_frame("twin.model.state({front: given})", place)["coordinates"]
        assert shown == pytest.approx(read.state({"front": place})["coordinates"], rel=1e-9, abs=1e-12)
        points = np.array(in_frame("Array.from(twin.shapes.at(given))", [place]))
        shares = chebyshev.chebval((place - middle) / half, np.array(shapes["coefficients"]))
        assert points == pytest.approx(rest + shares @ modes, abs=1e-7)
        if place in nodes:
            at = response.snapshots[nodes.index(place)]
            assert shown["front.tension"] == pytest.approx(at.efforts["front"], abs=1e-4 * largest)
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
        ((page.run, "--out", tmp_path / "b", "--reach", "frnt=8mm"), "no such cable or parameter"),
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
            write_export("web", ExportRequest(project, run=run), tmp_path / "d", reach="front=1mm")  # type: ignore[arg-type]
