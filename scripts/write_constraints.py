"""Write constraints.txt: the versions of all that softcal, its extras and its tools need, as they are installed here.

They hold for the Python with which they were tested; another one takes what pyproject.toml allows.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

from scripts.check_licences import needed_by

ROOT = Path(__file__).parents[1]
CONSTRAINTS = ROOT / "constraints.txt"
SOFTCAL = "softcal[all]"


def roots() -> list[str]:
    """What is installed by `make test`: softcal with its extras, and the tools of the group `dev`."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]
    return [SOFTCAL, *groups["dev"]]


def constraints(versions: Iterable[tuple[str, str]], python: str) -> str:
    """The text of constraints for one minor version of Python."""
    head = f"# Tested with Python {python}, written by `make constraints`; others take what pyproject.toml allows.\n"
    return head + "".join(f'{name}=={version} ; python_version == "{python}"\n' for name, version in versions)


def main() -> None:
    tree = needed_by(*roots())
    del tree["softcal"]
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    text = constraints(((name, package.version) for name, package in tree.items()), python)
    CONSTRAINTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
