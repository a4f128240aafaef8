"""Modules of a user's own, written for a test and imported as a script would import them."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from softcal.catalogue import Catalogue


def imported(path: Path, text: str) -> ModuleType:
    """The module that a text is."""
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextmanager
def brought(
    family: Catalogue[Any], value: str, group: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Any]:
    """The member of this name that a package brings by an entry point ("module:attribute") of a group."""
    entry_point(family, value, group, monkeypatch)
    try:
        yield family.named(name)
    finally:
        family.remove(name)


def entry_point(family: Catalogue[Any], value: str, group: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the family find this entry point alone, as it is asked next."""
    point = EntryPoint("brought", value, group)
    monkeypatch.setattr("softcal.catalogue.entry_points", lambda group: [point] if group == point.group else [])
    monkeypatch.setattr(family, "_asked", False)
