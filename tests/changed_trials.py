"""The trials and the records of a run folder, changed on disk by somebody who means it: without their digests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def change_trials(folder: Path, change: Callable[[dict[str, Any]], object], *, only: int | None = None) -> None:
    """Change the entry of every trial in Optuna's journal, or of one, and write it back."""
    path = folder / "optuna.journal"
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    trials = [entry for entry in entries if "user_attrs" in entry]
    assert trials
    for entry in trials:
        entry["user_attrs"].pop("sha256", None)
        if only in (None, entry["user_attrs"]["number"]):
            change(entry)
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))


def undigested(document: dict[str, Any]) -> dict[str, Any]:
    """A record without its digest and those of its tables."""
    return {key: value for key, value in document.items() if key not in ("sha256", "tables")}


def undigest(path: Path) -> None:
    """Take the digests out of the record in a file."""
    path.write_text(json.dumps(undigested(json.loads(path.read_text()))))
