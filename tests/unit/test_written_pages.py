"""Pages of the documents with numbers that commands write, between marks."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import contact, mesh_table, neck_shape, reduced
from benchmarks.written_page import page_values, written_page

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(path for path in (ROOT / "docs").glob("*.md") if "<!--{" in path.read_text(encoding="utf-8"))


def test_thirteen_pages_have_numbers_of_commands() -> None:
    assert len(PAGES) == 13


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
    # A line that begins with a comment is HTML to Markdown, up to its end: links and code in it are shown raw.
    assert not re.findall(r"^<!--\{[^}]+\}-->.+", text, re.MULTILINE)


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


def rows_of(table: str) -> list[list[str]]:
    """The cells of a Markdown table, without its header."""
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()[2:]]


def test_the_mesh_table_is_written_as_it_is_from_its_own_rows() -> None:
    """Numbers that follow from others are those of the page, up to the digits that the page does not have."""
    told = page_values((page := mesh_table.PAGE).read_text(encoding="utf-8"))
    kinds = {kind.name: kind for kind in mesh_table.KINDS}

    def row(kind: mesh_table.Kind, tets: str, unknowns: str, force: str, pitch: str, seconds: str) -> mesh_table.Row:
        counts = (int(number.replace(",", "")) for number in (tets, unknowns))
        return mesh_table.Row(kind, *counts, float(force[:-2]), float(pitch[:-1]), float(seconds), 0)

    linear = [row(mesh_table.LINEAR, c[3], "0", *c[4:]) for c in rows_of(told["linear"])]
    every = [row(kinds[c[0]], *c[1:4], *c[6:]) for c in rows_of(told["locking-free"])]
    families = [[one for one in every if one.kind is kind] for kind in mesh_table.KINDS]
    written = mesh_table.values(linear, families)
    assert {**written, "machine": ""}.keys() == told.keys()
    rounded = {"pitch": told["pitch"], "meaning": told["meaning"]}  # from digits that the page does not have
    assert written_page(page, {**written, **rounded, "machine": told["machine"]}) == page.read_text(encoding="utf-8")
    for own, present in zip(rows_of(written["meaning"]), rows_of(told["meaning"]), strict=True):
        assert own[:2] == present[:2]
        assert abs(float(own[2][:-2]) - float(present[2][:-2])) <= 1.0
        assert abs(float(own[3]) - float(present[3])) < 0.011


@pytest.mark.slow
def test_the_page_of_contact_has_a_mark_for_all_that_is_written() -> None:
    found = contact.Found([["contact"] + ["1"] * 11], 0.006, 0.0, 0.014, "13.9")
    told = page_values(contact.PAGE.read_text(encoding="utf-8"))
    each = [f"{element}{shape}" for element in contact.ELEMENTS for shape in ("", ", former")]
    written = {**contact.values(dict.fromkeys(each, found)), "tets": "", "E": "", "ratio": "", "former tets": ""}
    assert written.keys() == told.keys()
    assert written["P2P1 differs"] == told["P2P1 differs"] == "14.0 mm"
    assert written["P1"].splitlines()[0] == told["P1"].splitlines()[0]


def test_the_page_of_the_necks_shape_has_a_mark_for_all_that_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a line in the place of every curve of the twin."""
    pulled = np.linspace(0.0, neck_shape.FARTHEST, 125)

    def line(shape: neck_shape.Neck, lever: float, *_: object, **__: object) -> neck_shape.Curve:
        tension = 1e8 * shape.outer_diameter**4 / lever**2 * pulled
        return neck_shape.Curve(pulled, tension, np.degrees(pulled / lever))

    monkeypatch.setattr(neck_shape, "curve", line)
    monkeypatch.setattr(neck_shape, "fitted", lambda twin: [neck_shape.Fit(3e6, 1e-3, 0.1)] * 3)
    monkeypatch.setattr(neck_shape, "MESHES", ((2000, 10, 6),))
    written = neck_shape.values()
    told = page_values(neck_shape.PAGE.read_text(encoding="utf-8"))
    assert written.keys() == told.keys()
    for name in ("bench", "meshes", "forces", "changes", "moduli"):
        assert written[name].splitlines()[0] == told[name].splitlines()[0]
        rows, present = rows_of(written[name]), rows_of(told[name])
        assert [row[0] for row in rows] == [row[0] for row in present[: len(rows)]]
        assert len(rows) == len(present) or name == "meshes"
    assert [row[:3] for row in rows_of(written["bench"])] == [row[:3] for row in rows_of(told["bench"])]


@pytest.mark.long  # a reduced model is built
def test_the_page_of_exports_has_the_rows_that_its_benchmark_measures(monkeypatch: pytest.MonkeyPatch) -> None:
    case, *_ = reduced.cases()
    monkeypatch.setattr(reduced, "cases", lambda: [case])
    monkeypatch.setattr(reduced, "pages", lambda: iter([["the neck", "1 cable", "64", "0.01 mm", "0.45 MB", "99 s"]]))
    section = reduced.measure(quick=True)
    share, built, *_ = section.goals
    assert share.met
    assert built.met
    values = page_values(reduced.written(section))
    (row,) = values["models"].splitlines()[2:]
    assert row.startswith(f"| {case.name} | 64 | ")
    assert values["pages"].splitlines()[2:] == ["| the neck | 1 cable | 64 | 0.01 mm | 0.45 MB | 99 s |"]
