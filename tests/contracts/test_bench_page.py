"""The page of the benchmark: tables that any method's name leaves whole, and docs/benchmark.md as the cases have it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from softcal.errors import StorageError
from softcal.plugins.bench import page
from softcal.plugins.bench.case import CASES, BenchmarkCase
from softcal.plugins.bench.page import INTRODUCTION, write_page

PAGE = Path(__file__).parents[2] / "docs" / "benchmark.md"


def cells(row: str) -> list[str]:
    """The cells of a row of a Markdown table."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


def section(name: str) -> str:
    """The section of docs/benchmark.md on a case."""
    text = PAGE.read_text(encoding="utf-8")
    return text[text.index(f"## {name}: ") :].partition("\n## ")[0]


def row_of(name: str, method: str) -> list[str]:
    return next(cells(row) for row in section(name).splitlines() if row.startswith(f"| {method} |"))


def test_a_bar_in_what_a_file_says_leaves_the_table_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softcal.plugins.bench.page._pictures", lambda case, found: {})
    kept = {"case": "beam", "method": "mine | yours", "evaluations": 3, "wall_s": 1.0, "parameters": {"E": "1 | 2"}}
    (tmp_path / "score.json").write_text(json.dumps({**kept, "splits": {}}), encoding="utf-8")
    write_page(tmp_path, tmp_path / "page.md")
    table = [row for row in (tmp_path / "page.md").read_text(encoding="utf-8").splitlines() if row.startswith("|")]
    assert {len(cells(row)) for row in table} == {8}
    assert any("mine \\| yours" in row for row in table)


@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: case.name)
def test_the_page_says_what_the_case_says(case: BenchmarkCase) -> None:
    text = section(case.name)
    assert f"Data: {case.source} ({case.licence})." in text
    assert case.remarks in text
    assert case.goal in text
    for row in case.published:
        told = row_of(case.name, row.method)
        assert row.source in told[-1]
        assert row.note in told[-1]
        assert (told[2] == "–") == (row.predict == (None, None))
    assert PAGE.read_text(encoding="utf-8").startswith(INTRODUCTION)


@pytest.mark.parametrize("name", ["sorosim-steel", "sorosim-tpu"])
def test_a_mean_is_not_beside_root_mean_squares(name: str) -> None:
    """Of the rivals' tips only the means are known; softcal's own is told beside them in the last column."""
    rows = [row_of(name, row.method) for row in CASES[name].published]
    assert all(row[2] == row[3] == "–" for row in rows)
    assert all(row[-1].startswith("tip: mean ") for row in [*rows, row_of(name, "**softcal**")])


def test_what_is_said_of_opencrs_score_is_what_the_score_is() -> None:
    case = CASES["opencr-v4"]
    own, rival = row_of(case.name, "**softcal**"), row_of(case.name, case.published[0].method)
    reached, other = (float(row[2].split(" / ")[1]) for row in (own, rival))
    lowest = float(re.findall(r"([\d.]+) mm", case.goal)[0])
    assert reached > lowest
    assert f"The goal of {lowest} mm is missed" in case.remarks
    assert (
        f"It leaves {100 * (1.0 - reached / other):.0f} % less than its rival, and {own[4]}, not 95 %," in case.remarks
    )


def test_the_readme_has_the_errors_of_the_page() -> None:
    text = " ".join((PAGE.parents[1] / "README.md").read_text(encoding="utf-8").split())
    told = re.findall(r"within ([\d.]+) mm \(its authors' model: ([\d.]+) mm\)", text)
    expected = [
        tuple(f"{float(row_of(case, method)[2].split(' / ')[0]):.1f}" for method in ("**softcal**", rival))
        for case, rival in (("tentacle", "SoRoMoX"), ("opencr-v4", "OpenCR-MuJoCo"))
    ]
    assert told == expected == [("9.6", "17.4"), ("5.7", "9.4")]


def test_markup_of_a_table_from_elsewhere_is_shown_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softcal.plugins.bench.page._pictures", lambda case, found: {})
    method, value = "<script>alert(1)</script> [x](javascript:a) `b` **c**\n# d", "<img src=x onerror=a> ![y](z)"
    kept = {"case": "beam", "method": method, "evaluations": 3, "wall_s": 1.0, "parameters": {"_E_": value}}
    (tmp_path / "score.json").write_text(json.dumps({**kept, "splits": {}}), encoding="utf-8")
    write_page(tmp_path, tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    shown = r"&lt;script&gt;alert(1)&lt;/script&gt; \[x\](javascript:a) \`b\` \*\*c\*\* # d"
    assert f"| **{shown}** |" in text
    assert rf"{shown} found: \_E\_ &lt;img src=x onerror=a&gt; !\[y\](z)." in text


def test_a_score_of_more_bytes_than_any_has_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "score.json").write_text("{" + " " * 20 + "}")
    monkeypatch.setattr(page, "MOST_BYTES", 20)
    with pytest.raises(StorageError, match=r"the score cannot be read; got more than 20 bytes"):
        page.read_scores(tmp_path)
