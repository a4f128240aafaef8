"""Pages of the documents with numbers that commands write, between marks."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from benchmarks.written_page import page_values, written_page

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(path for path in (ROOT / "docs").glob("*.md") if "<!--{" in path.read_text(encoding="utf-8"))


def test_eight_pages_have_numbers_of_commands() -> None:
    assert len(PAGES) == 8


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_names_its_command_and_has_every_mark_closed(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    command = re.search(r"numbers between marks are written by `python -m ([\w.]+)`", text)
    assert command is not None
    assert importlib.util.find_spec(command[1]) is not None
    assert text.count("<!--{") == text.count("<!--/-->") == len(re.findall(r"<!--\{[^}]+\}-->[^<]+(?:<!--/-->)", text))
    values = page_values(text)
    assert all(values.values())
    assert written_page(page, values) == text  # a name at several places has one value


def test_only_what_is_between_marks_changes(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- a remark --> <!--{one}-->1<!--/--> of <!--{two words}-->2<!--/-->, not {one}\n\n"
                    "<!--{table}-->\n\n| a |\n|---|\n\n<!--/-->\n", encoding="utf-8")  # fmt: skip
    assert page_values(page.read_text()) == {"one": "1", "two words": "2", "table": "| a |\n|---|"}
    made = written_page(page, {"one": "7 \\1", "two words": "{{x}}", "table": "| b |\n|---|"})
    assert made == (
        "<!-- a remark --> <!--{one}-->7 \\1<!--/--> of <!--{two words}-->{{x}}<!--/-->, not {one}\n\n"
        "<!--{table}-->\n\n| b |\n|---|\n\n<!--/-->\n"
    )


def test_a_page_has_a_value_for_every_mark_and_a_mark_for_every_value(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!--{one}-->1<!--/--> of <!--{two words}-->2<!--/-->\n", encoding="utf-8")
    for values, said in (({"one": "1"}, "two words"), ({"one": "1", "two words": "2", "three": "3"}, "three")):
        with pytest.raises(KeyError, match=rf"page\.md: {said}'"):
            written_page(page, values)


def test_the_neck_of_the_first_page_is_as_the_export_draws_it_now() -> None:
    """Else `softcal calibrate examples/neck/project.yaml` and `softcal export web` of its run write a new one."""
    page = (ROOT / "docs" / "_static" / "neck.html").read_text(encoding="utf-8")
    for name in ("twin.js", "twin.css"):
        part = (ROOT / "src" / "softcal" / "report" / "templates" / name).read_text(encoding="utf-8").strip()
        assert part in page, name
