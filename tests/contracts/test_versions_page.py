"""docs/versions.md has the table of wheels in the form that its script writes, for the systems and Pythons of today."""

from __future__ import annotations

import re

import pytest

from scripts.sizes import PYTHONS
from scripts.wheel_table import END, PAGE, START, SYSTEMS, requirements

TEXT = PAGE.read_text(encoding="utf-8")


def test_the_table_has_every_system_and_every_python() -> None:
    between = TEXT.partition(START)[2].partition(END)[0]
    head, _, *rows = [line.strip("| ").split(" | ") for line in between.splitlines() if line.startswith("|")]
    assert head == ["system", *(f"Python {python}" for python in PYTHONS)]
    assert [system for system, *_ in rows] == list(SYSTEMS)
    for _, *cells in rows:
        assert len(cells) == len(PYTHONS)
        assert all(re.fullmatch(r"all [1-9]\d+|[1-9]\d+, not (`[\w.-]+`(, )?)+", one) for one in cells)
    assert re.search(r"Resolved on \d{4}-\d\d-\d\d\.", between)


def test_the_page_names_no_host_of_packages() -> None:
    assert {host for host in re.findall(r"https?://([^/)\s]+)", TEXT)} <= {"semver.org"}


@pytest.mark.parametrize(("system", "mkl"), [(one, "x86-64" in one) for one in SYSTEMS])
def test_mkl_is_asked_for_on_x86_alone(system: str, mkl: bool) -> None:
    needed = requirements(SYSTEMS[system][1], "3.13")
    assert any(one.startswith("pypardiso") for one in needed) is mkl
    assert "gmsh>=4.12" in needed
