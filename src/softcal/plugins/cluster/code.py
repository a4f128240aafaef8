"""softcal's own source as a hash, so that machines with different copies are not mixed."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import softcal


@cache
def code_hash() -> str:
    """The first twelve characters of the SHA-256 of all modules of this installation, in the order of their names."""
    home = Path(softcal.__file__).parent
    found = hashlib.sha256()
    for path in sorted(home.rglob("*.py")):
        found.update(path.relative_to(home).as_posix().encode())
        found.update(path.read_bytes())
    return found.hexdigest()[:12]
