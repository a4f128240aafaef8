"""The pieces of a project file in the documents that name an example in their first line are valid in it."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

import softcal

ROOT = Path(__file__).resolve().parents[2]
PIECE = re.compile(r"```yaml\n# (examples/\S+\.yaml)\n(.*?)```", re.DOTALL)
PIECES = {
    f"{page.stem}-{k}": found
    for page in sorted(ROOT.glob("docs/*.md"))
    for k, found in enumerate(PIECE.findall(page.read_text(encoding="utf-8")))
}


def with_piece(whole: Any, piece: Any) -> Any:
    """A project file with a piece of another: what both state is the piece's, and mappings of the rig as a whole."""
    if not (isinstance(whole, Mapping) and isinstance(piece, Mapping)):
        return piece
    parts = {key: with_piece(whole.get(key), value) for key, value in piece.items() if key != "rig"}
    return {**whole, **piece, **parts}


def test_every_piece_of_the_pages_of_contact_and_pulleys_is_tried() -> None:
    for page in ("touching", "pulleys"):
        text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        assert text.count("```yaml") == sum(one.startswith(page) for one in PIECES) > 2


@pytest.mark.parametrize(("example", "piece"), PIECES.values(), ids=PIECES)
def test_a_piece_is_valid_in_its_example(example: str, piece: str, tmp_path: Path) -> None:
    source, yaml = ROOT / example, YAML()
    folder = tmp_path / "example"
    shutil.copytree(source.parent, folder, ignore=shutil.ignore_patterns("runs"))
    changed = with_piece(yaml.load(source.read_text(encoding="utf-8")), yaml.load(piece))
    yaml.dump(changed, folder / source.name)
    assert softcal.load(folder / source.name).experiments
