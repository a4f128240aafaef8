"""The documents keep up with the code: names in the example, commands, links."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import softcal
from softcal.materials.catalogue import LAWS
from softcal.project.sections import SECTIONS

DOCUMENTS = ("README.md", "CONTRIBUTING.md", "VISION.md", "SECURITY.md")
DOCUMENTS += tuple(f"docs/{page}.md" for page in ("index", "python", "cad", "security"))


def test_the_python_example_uses_public_names(repository: Path):
    blocks = re.findall(r"```python\n(.*?)```", (repository / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    for block in blocks:
        nodes = [node for node in ast.walk(ast.parse(block)) if isinstance(node, ast.Attribute)]
        used = {node.attr for node in nodes if isinstance(node.value, ast.Name) and node.value.id == "softcal"}
        assert used
        assert used <= set(dir(softcal))


def test_the_parts_of_the_site_have_every_page(repository: Path):
    parts = ("start.md", "how-to.md", "explanation.md", "reference.md")
    text = "".join((repository / "docs" / part).read_text(encoding="utf-8") for part in parts)
    pages = {path.name for path in (repository / "docs").glob("*.md")} - {"index.md", *parts}
    assert {page for page in pages if f"]({page})" not in text} == set()


def test_the_number_of_laws_is_that_of_the_catalogue(repository: Path):
    told = {"README.md": r"(\d+) \[laws\]", "docs/comparison.md": r"^\| laws \| (\d+),"}
    for document, pattern in told.items():
        (number,) = re.findall(pattern, (repository / document).read_text(encoding="utf-8"), re.MULTILINE)
        assert int(number) == len(LAWS) - len(LAWS.registered), document


def test_every_script_of_the_gallery_is_listed(repository: Path):
    text = (repository / "docs" / "how-to.md").read_text(encoding="utf-8")
    scripts = {path.relative_to(repository).as_posix() for path in repository.glob("gallery/*/plot_*.py")}
    assert {path for path in scripts if f"](../{path})" not in text} == set()


def test_what_is_not_released_is_not_installed_by_its_name(repository: Path):
    versions = (repository / "docs" / "versions.md").read_text(encoding="utf-8")
    pages = [path for place in ("README.md", "docs/*.md", "examples/*/README.md") for path in repository.glob(place)]
    told = [path.name for path in pages if re.search(r"pip install '?softcal", path.read_text(encoding="utf-8"))]
    assert not told or "Nothing has been released yet" not in versions


def test_the_top_of_the_project_file_is_listed(repository: Path):
    table = (repository / "docs" / "project-file.md").read_text(encoding="utf-8").split("## laws")[0]
    assert set(re.findall(r"^\| `(\w+)(?:: 1)?` \|", table, re.MULTILINE)) == set(SECTIONS)
    assert all(f"`{folder.name}`" in table for folder in (repository / "src/softcal/templates").iterdir())


def test_the_make_targets_exist(repository: Path):
    makefile = (repository / "Makefile").read_text(encoding="utf-8")
    for document in DOCUMENTS:
        text = (repository / document).read_text(encoding="utf-8")
        for target in re.findall(r"(?:`|^    )make ([a-z-]+)", text, re.MULTILINE):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{document}: make {target}"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(repository: Path, document: str):
    text = (repository / document).read_text(encoding="utf-8")
    broken = [
        link
        for link in re.findall(r"\]\((?!https?:)([^)#]+)", text)
        if not ((repository / document).parent / link).exists()
    ]
    assert not broken
