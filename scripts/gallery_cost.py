"""CPU seconds of the gallery's scripts, which `make docs` runs: kept beside the pages; their sum has a limit.

Scripts that have not changed are not run again: what they took when they were is what counts.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

MOST = 12 * 60.0  # [CPU s] of all scripts
FILE = "cpu-seconds.json"
_begun: dict[str, float] = {}


def clock(gallery: Mapping[str, Any], script: str, when: str) -> None:
    """Sphinx-gallery's `reset_modules`, called before and after every script.

    Parameters
    ----------
    gallery
        Settings of the gallery.
    script
        Path of the script.
    when
        "before" or "after".
    """
    if when == "before":
        _begun[script] = _spent()
    elif script in _begun:
        file = Path(gallery["src_dir"]) / "gallery" / FILE
        kept = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        kept[Path(script).name] = round(_spent() - _begun.pop(script), 2)
        file.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _spent() -> float:
    """CPU seconds of this process and of those that it waited for."""
    return sum(os.times()[:4])


def sentence(folder: Path, scripts: Path) -> tuple[str, bool]:
    """What the scripts take together, and whether that is more than it may be.

    Parameters
    ----------
    folder
        That of the gallery's pages.
    scripts
        That of its scripts.
    """
    file = folder / FILE
    kept = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    own = {path.name: kept[path.name] for path in scripts.glob("*/plot_*.py") if path.name in kept}
    total = sum(own.values())
    most = ", ".join(f"{name} {own[name]:.0f} s" for name in sorted(own, key=lambda name: -own[name])[:3])
    told = (
        f"The gallery's {len(own)} scripts take {total / 60:.1f} CPU minutes of at most {MOST / 60:.0f}; most: {most}."
    )
    return told, total > MOST
