"""A finger is set up by clicks, in a real browser."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from browser.conftest import Seen, Server
from browser.test_watch_page import complaints, elsewhere

from scripts.new_picture import click_finger
from softcal.project.project import load

pytestmark = pytest.mark.slow  # half a minute
FINGER = Path(__file__).parents[2] / "examples" / "finger"
WIDE = {390: 844, 1400: 1000}


@pytest.mark.long
def test_a_finger_is_set_up_by_clicks(tmp_path: Path, serve: Callable[..., Server], look: Callable[..., Seen]):
    for one in (FINGER / "finger.stl", *FINGER.glob("data/*.csv")):
        shutil.copy(one, tmp_path)
    seen = look(serve(tmp_path, "--port", "0", name="new").address, width=1400)
    page = seen.page
    click_finger(page)
    assert "experiment pull_10mm" in seen.fact("findings")
    # The noise of one test, and what the load cell drifts: a fault as long as there is no unit.
    noise = page.get_by_label("noise of tension (sd)").locator("visible=true")
    assert noise.count() == 2
    assert noise.first.input_value() == "0.05 N"
    noise.first.fill("0.02 N")
    drift = page.get_by_label("drift of tension in a test (sd)")
    drift.fill("10")
    page.get_by_text("tension_drift").locator("visible=true").first.wait_for()
    seen.wait_for(lambda: "unit is missing" in seen.fact("findings"), "a fault of the drift")
    drift.fill("10 mN")
    seen.wait_for(lambda: "experiment pull_10mm" in seen.fact("findings"), "no fault")
    assert not page.get_by_label("drift of roll in a test (sd)").is_visible()
    # A second cable, by the points that are typed: one of the tests is its.
    choice = page.locator('[data-choice="Cable that is pulled"]')
    assert not choice.first.is_visible()
    page.get_by_role("button", name="Another cable").click()
    page.get_by_label("Its name").fill("back")
    page.locator(".sc-code textarea").fill("-4.5, 0, 83.5\n-4.5, 0, 0.5\n-4.5, 0, -9.5")
    seen.wait_for(lambda: "    back:\n" in seen.fact("file"), "the second cable is in the file")
    assert seen.fact("file").count("cable: cable\n") == 2
    choice.first.click()
    page.get_by_role("option", name="back").click()
    seen.wait_for(lambda: "cable back" in seen.fact("findings"), "the second cable is checked")
    assert "back.slack: {bounds" in seen.fact("file")
    page.get_by_text("Write project.yaml").click()
    seen.wait_for(lambda: "is written" in seen.fact("written"), "the file is written")
    assert (tmp_path / "project.yaml").read_text() == seen.fact("file").rstrip("\n") + "\n"
    project = load(tmp_path / "project.yaml")
    assert {name: one.cable for name, one in project.experiments.items()} == {"pull_10mm": "back", "pull_7mm": "cable"}
    first, *_, last = (via.at[2] for via in project.robot.cables[0].via_points)
    assert (first, last) == pytest.approx((0.0835, -0.0095))  # to the fixed face, which was picked after the bore
    assert len(project.robot.cables[0].via_points) > 19  # with those that are added in the bore
    sigmas = {name: one.dataset.channels["tension"].sigma for name, one in project.experiments.items()}
    assert sigmas == {"pull_10mm": 0.02, "pull_7mm": 0.05}
    assert {one.name: one.sd for one in project.uncertain}["back.tension_drift"] == 0.01
    page.get_by_text("Write project.yaml").click()
    seen.wait_for(lambda: "was not replaced" in seen.fact("written"), "nothing is overwritten")
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert complaints(seen) == []
    assert elsewhere(seen) == []
    assert sorted(one.name for one in tmp_path.iterdir()) == [
        "finger.stl",
        "project.yaml",
        "pull-10mm.csv",
        "pull-7mm.csv",
    ]


def test_files_are_dropped_onto_an_empty_folder_s_page(
    tmp_path: Path, serve: Callable[..., Server], look: Callable[..., Seen]
):
    for width, height in WIDE.items():
        seen = look(serve(tmp_path, "--port", "0", name="new").address, width=width, height=height)
        seen.page.get_by_text("No table is in the folder yet").wait_for()
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
        assert complaints(seen) == []
    drop = """async text => {
      const data = new DataTransfer();
      data.items.add(new File([text], 'pull.csv'));
      document.dispatchEvent(new DragEvent('drop', {dataTransfer: data, bubbles: true, cancelable: true}));
    }"""
    text = (FINGER / "data" / "pull-7mm.csv").read_text()
    seen.page.evaluate(drop, text)
    seen.page.get_by_text("pull.csv was copied into the folder").wait_for()
    assert (tmp_path / "pull.csv").read_text() == text
    seen.page.locator(".sc-test").wait_for()
    seen.page.evaluate(drop, "other")
    seen.page.get_by_text("was not replaced").wait_for()
    assert (tmp_path / "pull.csv").read_text() == text
