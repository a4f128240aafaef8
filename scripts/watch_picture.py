"""Write docs/watch.png: the page of `softcal watch` in a browser, while the neck of examples/neck is calibrated.

Needs the extra `watch`, playwright and a Chromium; takes two minutes.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "watch.png"
ENOUGH = 40  # trials of the joint fit
SOFTCAL = [sys.executable, "-m", "softcal"]
DRAWN_BY_SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> None:
    """Calibrate, watch, take the picture, end both."""
    from playwright.sync_api import sync_playwright

    project = ROOT / "examples" / "neck" / "project.yaml"
    browser = shutil.which("chromium")
    with tempfile.TemporaryDirectory() as place, sync_playwright() as playwright:
        run = Path(place, "neck")
        fit = ["--method", "tpe", "--fit", "joint", "--trials", "200", "--workers", "2", "--no-report"]
        search = subprocess.Popen(
            [*SOFTCAL, "calibrate", str(project), *fit, "--out", str(run)], stderr=subprocess.DEVNULL
        )
        page = subprocess.Popen(
            [*SOFTCAL, "watch", str(run), "--wait", "--no-browser", "--port", "0"], stdout=subprocess.PIPE, text=True
        )
        try:
            address = page.stdout.readline().split()[1]
            shown = playwright.chromium.launch(executable_path=browser, args=DRAWN_BY_SOFTWARE)
            view = shown.new_page(viewport={"width": 1240, "height": 900})
            view.goto(address)
            while not _ready(view.inner_text("body")):
                if search.poll() is not None:
                    raise SystemExit("the calibration ended before the picture was taken")
                time.sleep(0.5)
            view.wait_for_timeout(3000)
            view.screenshot(path=PICTURE, full_page=True)
            shown.close()
        finally:
            for process in (search, page):
                process.terminate()
                process.wait()
    reduce(PICTURE)


def _ready(text: str) -> bool:
    """Whether enough trials are done, and the twin at the best of them is there."""
    done = re.search(r"(\d+) of at most", text)
    return bool(done) and int(done.group(1)) >= ENOUGH and "Displacement from rest" in text and "drawn next" not in text


def reduce(path: Path) -> None:
    """Write a picture with fewer colours, thin lines' among them: a quarter of the bytes."""
    from PIL import Image

    with Image.open(path) as picture:
        picture.convert("RGB").quantize(200, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


if __name__ == "__main__":
    main()
