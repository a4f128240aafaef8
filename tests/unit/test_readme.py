"""The documents keep up with the code: names in the example, commands, links."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import softcal

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
