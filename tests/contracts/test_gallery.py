"""What every script of the gallery keeps; `make docs` runs them all, and ends where one fails."""

from __future__ import annotations

import ast
import io
import tokenize
from pathlib import Path

import pytest

import softcal

GALLERY = Path(__file__).parents[2] / "gallery"
SCRIPTS = sorted(GALLERY.glob("*/plot_*.py"))
LEAST, MOST = 20, 60  # lines of code
NO_CODE = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def lines_of_code(text: str) -> int:
    """Lines that are neither empty, comments, nor the text at the top."""
    first = ast.parse(text).body[0].end_lineno or 1
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    held = (range(one.start[0], one.end[0] + 1) for one in tokens if one.type not in NO_CODE)
    return len({line for lines in held for line in lines if line > first})


def test_there_is_one_for_each_question() -> None:
    assert len(SCRIPTS) >= 25
    assert all((path.parent / "GALLERY_HEADER.rst").is_file() for path in SCRIPTS)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_it_is_short_says_what_it_shows_and_checks_its_numbers(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    title, line, *about = (ast.get_docstring(tree) or "").splitlines()
    assert line == "=" * len(title)
    assert len(" ".join(about)) > 100
    assert LEAST <= lines_of_code(text) <= MOST
    nodes = list(ast.walk(tree))
    assert sum(isinstance(node, ast.Assert) for node in nodes) >= 1
    called = {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}
    assert "print" in called
    assert any(".plot" in name or "plt." in name for name in called), "a picture"


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_it_has_public_names_alone(path: Path) -> None:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    imported = [one.name for node in nodes if isinstance(node, ast.Import) for one in node.names]
    parts = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    assert [name for name in imported + parts if name.startswith("softcal")] == ["softcal"]
    names = {
        node.attr
        for node in nodes
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "softcal"
    }
    assert names
    assert names <= set(dir(softcal))
