"""A report printed to PDF by a real browser."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from browser.conftest import CHROMIUM, PATIENCE
from report_example import example_content

from softcal.report.figure import report_pictures
from softcal.report.html import render_page


def run(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE / 1000).stdout


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
@pytest.mark.skipif(not shutil.which("pdfimages"), reason="poppler-utils are not installed")
def test_every_figure_and_all_that_is_folded_is_printed(tmp_path: Path) -> None:
    content = example_content(n_trials=20)
    # As PNG, since an SVG becomes lines of the PDF, which nothing counts.
    pictures = [replace(one, shown="png") for one in report_pictures(content)]
    page, pdf = tmp_path / "report.html", tmp_path / "report.pdf"
    page.write_text(render_page(content, pictures), encoding="utf-8")
    run(str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", f"--print-to-pdf={pdf}", page.as_uri())
    rows = [line.split() for line in run("pdfimages", "-list", str(pdf)).splitlines()[2:]]
    # Pictures that are the same by the byte are one object.
    assert len({row[10] for row in rows if row[2] == "image"}) == len({one.png for one in pictures}) > 10
    text = re.sub(r"\s+", "", run("pdftotext", str(pdf), "-"))
    for step in next(iter(content.experiments.values())).prepared.provenance:
        assert re.sub(r"\s+", "", step.outcome) in text, step.outcome
