"""Print what softcal and each of its extras bring into an environment: packages, and megabytes on disk.

The files of an extra's packages that softcal alone does not need; `all` has some of them once.
"""

from __future__ import annotations

import sys
from importlib.metadata import Distribution, distribution
from pathlib import Path

from scripts.check_licences import needed_by


def megabytes(package: Distribution) -> float:
    """Of the files that a package installs."""
    paths = [Path(str(file.locate())) for file in package.files or ()]
    return sum(path.lstat().st_size for path in paths if path.is_file() and not path.is_symlink()) / 1e6


def main() -> None:
    alone = needed_by("softcal")
    sys.stdout.write(f"{'(none)':<12}{len(alone) - 1:>4} packages {sum(map(megabytes, alone.values())):>7.0f} MB\n")
    for extra in distribution("softcal").metadata.get_all("Provides-Extra") or ():
        more = [package for name, package in needed_by(f"softcal[{extra}]").items() if name not in alone]
        sys.stdout.write(f"{extra:<12}{len(more):>4} packages {sum(map(megabytes, more)):>7.0f} MB\n")


if __name__ == "__main__":
    main()
