"""Write docs/new.png: the page of `softcal new` with the finger of examples/finger, set up by clicks.

Needs the extra `watch`, playwright and a Chromium; takes a minute.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from scripts.watch_picture import DRAWN_BY_SOFTWARE, reduce

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "new.png"
FINGER = ROOT / "examples" / "finger"
# Places of the wall of the finger's channel [pixels], seen from above: it is a few of them wide.
IN_CHANNEL = ((30, 6), (28, 8), (26, 10), (32, 6), (24, 12), (30, 10))


def click_finger(page: Any) -> None:
    """Pick the plate's face, the channel, and the fixed face of the finger, and take its tables as tests.

    Raises
    ------
    RuntimeError
        Where a click picked something else.
    """
    said = page.locator('[data-fact="said"]')
    said.get_by_text("16 × 14 × 84 mm").wait_for()
    canvas = page.locator("canvas").bounding_box()
    x, y = canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2

    def mode(name: str) -> None:
        page.get_by_role("button", name=name, exact=True).click()

    def turn(across: float, down: float) -> None:
        """Turn the part by a drag of so many pixels; downwards shows it from above."""
        mode("turn")
        page.mouse.move(x - 200, y)
        page.mouse.down()
        page.mouse.move(x - 200 + across, y + down, steps=8)
        page.mouse.up()
        page.wait_for_timeout(600)

    def pick(what: str, places: tuple[tuple[float, float], ...], expected: str) -> None:
        mode(what)
        for dx, dy in places:
            before = said.inner_text()
            page.mouse.click(x + dx, y + dy)
            for _ in range(100):
                page.wait_for_timeout(100)
                if said.inner_text() not in (before, "Following the bore …"):
                    break
            if expected in said.inner_text():
                return
        raise RuntimeError(f"{what}: {said.inner_text()}")

    turn(0, 200)
    pick("face of the plate", ((-15, 0),), "in the plane through (0, 0, 84) mm")
    pick("bore of the cable", IN_CHANNEL, "in 9 stretches")
    turn(0, -430)
    pick("fixed face", ((-15, 0),), "in the plane through (0, 0, 0) mm")
    turn(60, 120)
    for table in page.locator(".sc-test").all():
        table.click()
    for box in page.get_by_text("This is a test").all():
        box.click()
    page.locator('[data-fact="file"]').get_by_text("pull_7mm").wait_for()
    page.locator('[data-fact="state"]').get_by_text("No fault.").wait_for()


def main() -> None:
    """Serve the page for a copy of the finger's files, click, take the picture."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as place, sync_playwright() as playwright:
        folder = Path(place, "my-robot")
        folder.mkdir()
        for one in (FINGER / "finger.stl", *FINGER.glob("data/*.csv")):
            shutil.copy(one, folder)
        command = [sys.executable, "-m", "softcal", "new", str(folder), "--no-browser", "--port", "0"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "HOME": place})
        try:
            address = server.stdout.readline().split()[1]  # type: ignore[union-attr]
            shown = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=DRAWN_BY_SOFTWARE)
            page = shown.new_page(viewport={"width": 1240, "height": 900})
            page.set_default_timeout(120_000)
            page.goto(address)
            click_finger(page)
            # The last click has begun another check.
            page.wait_for_timeout(3000)
            page.locator('[data-fact="state"]').get_by_text("No fault.").wait_for()
            page.evaluate("window.scrollTo(0, 0)")
            below = page.locator('[data-fact="file"]').bounding_box()
            clip = {"x": 0, "y": 0, "width": 1240, "height": below["y"] + 320}
            page.screenshot(path=PICTURE, clip=clip, full_page=True)
            shown.close()
        finally:
            server.terminate()
            server.wait()
    reduce(PICTURE)


if __name__ == "__main__":
    main()
