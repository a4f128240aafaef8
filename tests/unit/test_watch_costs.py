"""What the benchmark of the page makes of its windows."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

psutil = pytest.importorskip("psutil", reason="the benchmark of the page needs it")

from benchmarks.watch import ALONE, LOOKED_AT, SERVED, Shown, Spent, Window, difference, page, rates, row, spent  # noqa: E402


def windows(kind: str, *trials: int, page: float = 0.1, browser: float = 0.0) -> list[Window]:
    return [Window(kind, 10.0, n, Spent(page, 0.5, browser, 90.0 + n)) for n in trials]


def test_the_trials_in_a_second_are_told_from_the_slowest_window_to_the_fastest():
    assert rates(windows(SERVED, 105, 95, 50, 40)) == "4.00 to 10.50"


def test_a_row_has_the_largest_memory_and_shares_of_a_core():
    assert row("x", windows(SERVED, 1, 3)) == ["x", "93 MB", "1.0 %", "5.0 %", "–"]
    assert row("x", windows(LOOKED_AT, 1, browser=6.0))[-1] == "60.0 %"


def test_the_page_has_every_number():
    beside = [*windows(ALONE, 20, 22), *windows(SERVED, 20, 21), *windows(LOOKED_AT, 10, 11, browser=5.0)]
    finished = [*windows(SERVED, 0), *windows(LOOKED_AT, 0, browser=5.0)]
    text = re.sub(r"<!--.*?-->", "", page(finished, 3.21, beside, "0.3"))
    for said in (
        "load 0.3",
        "3.2 s of processor",
        "did 2.00 to 2.20 trials in a second by itself, 2.00 to 2.10 with",
        "and 1.00 to 1.10 with a browser",
        "finished run, page served | 90 MB",
    ):
        assert said in text, said


def test_what_a_process_and_its_children_spend_is_told_apart():
    own = psutil.Process(os.getpid())
    before = spent(Shown(own, None))
    subprocess.run([sys.executable, "-S", "-c", "sum(range(3_000_000))"], check=True)
    now = difference(before, spent(Shown(own, None)))
    assert now.twin > now.page
    assert now.memory > 10.0
    assert now.browser == 0.0
