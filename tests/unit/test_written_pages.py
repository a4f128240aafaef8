"""Pages of the documents that commands write are the texts they are written from, with the places filled."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.written_page import written_page

ROOT = Path(__file__).resolve().parents[2]
NAMED = {"coverage": "uncertainty"}  # the others' pages have the names of their texts
TEXTS = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.md") if "{{" in path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", TEXTS)
def test_a_page_is_its_text_with_the_places_filled(name: str) -> None:
    text = (ROOT / "benchmarks" / f"{name}.md").read_text(encoding="utf-8")
    page = (ROOT / "docs" / f"{NAMED.get(name, name).replace('_', '-')}.md").read_text(encoding="utf-8")
    parts = re.split(r"\{\{.*?\}\}", text)
    at = 0
    for part in parts:  # so that a difference is told by the part that is not there
        assert part in page[at:]
        at = page.index(part, at) + len(part)
    assert re.fullmatch(".+?".join(map(re.escape, parts)), page, flags=re.DOTALL)
    assert f"edit benchmarks/{name}.md instead" in page


def test_a_text_has_a_value_for_every_place_and_a_place_for_every_value(tmp_path: Path) -> None:
    text = tmp_path / "text.md"
    text.write_text("{{one}} of {{two words}}, not {one}\n", encoding="utf-8")
    assert written_page(text, {"one": "{{1}}", "two words": "2"}) == "{{1}} of 2, not {one}\n"
    for values, told in (({"one": "1"}, "two words"), ({"one": "1", "two words": "2", "three": "3"}, "three")):
        with pytest.raises(KeyError, match=rf"text\.md: {told}'"):
            written_page(text, values)
