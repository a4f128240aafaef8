"""What every script of the gallery keeps; `make docs` runs them all, and ends where one fails."""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
import tomllib
from pathlib import Path

import pytest

import softcal
from scripts import gallery_cost

GALLERY = Path(__file__).parents[2] / "gallery"
SCRIPTS = sorted(GALLERY.glob("*/plot_*.py"))
BUILT = GALLERY.parent / "docs" / "gallery" / gallery_cost.FILE
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


def test_what_the_scripts_take_is_summed_and_too_much_is_said(tmp_path: Path) -> None:
    """Of scripts that are there; of one that was not run again, what it took when it was."""
    pages = tmp_path / "gallery"
    pages.mkdir()
    settings = {"src_dir": str(tmp_path)}
    for script in SCRIPTS[:2]:
        gallery_cost.clock(settings, str(script), "before")
        sum(range(3_000_000))
        gallery_cost.clock(settings, str(script), "after")
    file = pages / gallery_cost.FILE
    took = json.loads(file.read_text(encoding="utf-8"))
    assert took.keys() == {script.name for script in SCRIPTS[:2]}
    assert all(0.01 < seconds < 10.0 for seconds in took.values())
    file.write_text(json.dumps({**took, SCRIPTS[2].name: 719.0, "plot_gone.py": 500.0}), encoding="utf-8")
    said, is_too_much = gallery_cost.sentence(pages, GALLERY)
    assert said.startswith("The gallery's 3 scripts take 12.0 CPU minutes of at most 12; most: " + SCRIPTS[2].name)
    assert not is_too_much
    file.write_text(json.dumps({**took, SCRIPTS[2].name: 721.0}), encoding="utf-8")
    assert gallery_cost.sentence(pages, GALLERY)[1]


@pytest.mark.skipif(not BUILT.is_file(), reason="the site is not built")
def test_the_gallery_as_it_was_built_is_within_its_time() -> None:
    said, is_too_much = gallery_cost.sentence(BUILT.parent, GALLERY)
    assert not is_too_much, said


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
