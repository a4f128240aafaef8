"""What every script of the gallery keeps; `make docs` runs them all, and ends where one fails."""

from __future__ import annotations

import ast
import io
import re
import tokenize
import tomllib
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


def test_the_notebooks_install_the_extras_that_the_scripts_need() -> None:
    """All but two, which no script mentions."""
    root = GALLERY.parent
    (extras,) = re.findall(r"/content/softcal\[([a-z,]+)\]", (root / "docs" / "conf.py").read_text(encoding="utf-8"))
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    left_out = set(project["optional-dependencies"]) - set(extras.split(","))
    assert left_out == {"cluster", "watch", "all"}
    text = "".join(path.read_text(encoding="utf-8") for path in SCRIPTS)
    assert not re.search("dask|slurm|softcal watch|softcal new", text)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_of_any_folder_finds_the_files_of_its_script(path: Path) -> None:
    """In Colab all run in the first folder of the gallery."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    for text in texts:
        assert not text.startswith("../") or (GALLERY / "1-robots" / text).resolve().exists(), text
    assert "__file__" not in path.read_text(encoding="utf-8")


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
