"""The figures that the report of a run has drawn, as files beside it: which there are, and the bytes of one."""

from __future__ import annotations

import html
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from softcal.plugins.watch.reading import MOST_BYTES, Unreadable, clean, inside
from softcal.regular_file import own_file, read_own

FIGURES = "figures"
MOST = 200  # that are shown
_FIRST = ("overview", "specimens", "infill", "error", "trajectory", "loops", "places", "distances", "twin", "nominal")
_HEAD = 2000  # bytes of an SVG in which its title is
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class DrawnFigure:
    """A figure of a report: the name of its file, when that was changed [ns], and its title."""

    name: str
    changed: int
    title: str


def report_figures(folder: Path) -> tuple[DrawnFigure, ...]:
    """The figures that a report has beside it, the fit first; SVGs of a folder could hold scripts, so PNGs alone.

    Raises
    ------
    Unreadable
        Where the system refuses to look.
    """
    try:
        names = os.listdir(folder / FIGURES)
    except (FileNotFoundError, NotADirectoryError):
        return ()
    except OSError as error:
        raise Unreadable(f"{FIGURES} cannot be read: {(error.strerror or 'the system refuses it').lower()}.") from error
    # A report writes each figure in both formats; other pictures may be anybody's.
    stems = {name.removesuffix(".svg") for name in names if name.endswith(".svg")}
    own = sorted(
        (n for n in names if n.endswith(".png") and n[:-4] in stems and n.isprintable()),
        key=lambda name: (next((k for k, first in enumerate(_FIRST) if name.startswith(first)), len(_FIRST)), name),
    )
    found: list[DrawnFigure] = []
    for name in own[:MOST]:
        path = figure_file(folder, name)
        if path is not None:
            found.append(DrawnFigure(name, path.stat().st_mtime_ns, _title(folder, name)))
    return tuple(found)


def figure_file(folder: Path, name: str) -> Path | None:
    """The file of a figure, which lies itself in the folder's figures; None where there is none.

    Raises
    ------
    Unreadable
        See `inside`.
    """
    if Path(name).name != name or not name.endswith(".png"):
        return None
    path = inside(folder, f"{FIGURES}/{name}")
    return path if path == folder.resolve() / FIGURES / name else None


def figure_bytes(folder: Path, name: str) -> bytes:
    """A figure's PNG; empty where there is none, or the file is no PNG."""
    try:
        path = figure_file(folder, name)
        data = b"" if path is None else read_own(path, MOST_BYTES)
    except (Unreadable, OSError):
        return b""
    return data if data.startswith(_PNG) else b""


def _title(folder: Path, name: str) -> str:
    """The title in the figure's SVG, or the file's name in words where that has none."""
    svg = f"{name.removesuffix('.png')}.svg"
    with suppress(Unreadable, OSError):
        path = inside(folder, f"{FIGURES}/{svg}")
        if path is not None and path == folder.resolve() / FIGURES / svg:
            with open(path, "rb", opener=own_file) as file:
                head = file.read(_HEAD).decode("utf-8", "replace")
            if found := re.search(r"<title>([^<]+)</title>", head):
                return clean(html.unescape(found[1]), 120)
    words = clean(name[:-4].replace("-", " "), 120)
    return f"{words[:1].upper()}{words[1:]}"
