"""Write the table of docs/versions.md: whether all that softcal needs at run time has wheels, by system and Python.

All requirements of pyproject.toml with its extras are resolved from wheels alone by `uv` (`pip install uv`), which
reads all markers for the other system, as pip cannot; what has no wheel is left out and named.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from packaging.requirements import Requirement

from scripts.sizes import PYTHONS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "versions.md"
START, END = "<!-- table of wheels: python -m scripts.wheel_table -->\n", "<!-- end of the table -->\n"
# Name -> uv's name, and what markers say there.
SYSTEMS: dict[str, tuple[str, dict[str, str]]] = {
    "Linux x86-64": ("x86_64-manylinux_2_28", {"platform_system": "Linux", "platform_machine": "x86_64"}),
    "Linux ARM": ("aarch64-manylinux_2_28", {"platform_system": "Linux", "platform_machine": "aarch64"}),
    "macOS ARM": ("aarch64-apple-darwin", {"platform_system": "Darwin", "platform_machine": "arm64"}),
    "Windows x86-64": ("x86_64-pc-windows-msvc", {"platform_system": "Windows", "platform_machine": "AMD64"}),
}


def requirements(markers: dict[str, str], python: str) -> list[str]:
    """What softcal and its extras need on a system, without markers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [line for name, lines in project["optional-dependencies"].items() if name != "all" for line in lines]
    found: list[str] = []
    for one in map(Requirement, [*project["dependencies"], *extras]):
        if one.marker is None or one.marker.evaluate({**markers, "python_version": python}):
            found.append(f"{one.name}{one.specifier}")
    return sorted(set(found), key=str.lower)


def resolved(needed: Sequence[str], platform: str, python: str) -> tuple[int, str]:
    """How many packages would be installed from wheels; or 0, and what uv says."""
    command = [
        "uv", "pip", "compile", "-", "--quiet", "--no-header", "--no-annotate", "--only-binary", ":all:",
        "--python-platform", platform, "--python-version", python,
    ]  # fmt: skip
    done = subprocess.run(command, check=False, capture_output=True, text=True, input="\n".join(needed))
    return (len(done.stdout.splitlines()), "") if done.returncode == 0 else (0, done.stderr)


def cell(system: str, python: str) -> str:
    """How many packages are needed, without those of softcal's own requirements that have no wheel; or what uv says."""
    platform, markers = SYSTEMS[system]
    needed = requirements(markers, python)
    missing: list[str] = []
    while True:
        n_packages, said = resolved(needed, platform, python)
        if n_packages:
            return f"{n_packages}, not {', '.join(missing)}" if missing else f"all {n_packages}"
        named = [
            one for one in needed if re.search(rf"Because {re.escape(Requirement(one).name)}[^\w ]\S* has no", said)
        ]
        if not named:
            return said
        missing += sorted({f"`{Requirement(one).name}`" for one in named})
        needed = [one for one in needed if one not in named]


def table() -> str:
    head = ["system", *(f"Python {python}" for python in PYTHONS)]
    rows = [head, ["---"] * len(head)]
    for system in SYSTEMS:
        rows.append([system, *(cell(system, python) for python in PYTHONS)])
        sys.stderr.write(f"{' | '.join(rows[-1])}\n")
    day = datetime.now(UTC).date().isoformat()
    return "".join(f"| {' | '.join(row)} |\n" for row in rows) + f"\nResolved on {day}.\n"


def main() -> None:
    text = table()  # minutes, in which the page may be edited
    before, _, after = PAGE.read_text(encoding="utf-8").partition(START)
    PAGE.write_text(before + START + text + END + after.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    main()
