"""A fleet's folder: each specimen by its record once it is finished, by its run folder while it is in work."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from softcal.calibration.search.live import LIVE
from softcal.plugins.fleet.folder import FLEET, SPECIMENS
from softcal.plugins.watch.live import LiveSign, moment, read_live
from softcal.plugins.watch.reading import Unreadable, clean, finite, inside, read_record, told
from softcal.plugins.watch.report_figures import DrawnFigure, report_figures
from softcal.plugins.watch.watched import WatchedRun, WatchedSearch, watched_result

MOST = 20000  # specimens
REPORT = "report.html"
ReadSearch = Callable[[str, str], WatchedSearch]
"""Reads the search of a run in the folder: its label, and the place of the run."""


class FleetReader:
    """Reads a fleet's folder again and again; a specimen that is finished is read once, until its record is another.

    place: of the fleet, relative to the folder that is watched, where it is one of several; "" where it is that folder.
    """

    def __init__(self, folder: Path, place: str = "") -> None:
        self._folder, self._place = folder, place
        self._known: dict[str, tuple[int, WatchedSearch]] = {}

    def read(self, record: Mapping[str, Any], name: str, in_work: ReadSearch) -> WatchedRun:
        """The fleet of a folder.

        Parameters
        ----------
        record
            Content of its `fleet.json`.
        name
            Name of the folder.
        in_work
            Reads the run of a specimen that is not finished.
        """
        faults: list[str] = []
        live = self._live(faults)
        found = self._specimens(record, live, in_work, faults)
        report, figures = "", tuple[DrawnFigure, ...]()
        try:
            if "statement" in record and inside(self._folder, self._at(REPORT)) is not None:
                report, figures = REPORT, report_figures(self._folder)
        except Unreadable as error:
            faults.append(str(error))
        created = moment(record.get("created"))
        return WatchedRun(name, "fleet", found, created, report, figures=figures, live=live, unreadable=tuple(faults))

    def specimens(self, record: Mapping[str, Any], in_work: ReadSearch, faults: list[str]) -> tuple[WatchedSearch, ...]:
        """The specimens of a fleet.

        Parameters
        ----------
        record, in_work
            See `read`.
        faults
            Takes a sentence on each one that cannot be read.
        """
        return self._specimens(record, self._live(faults), in_work, faults)

    def _at(self, name: str) -> str:
        return f"{self._place}/{name}" if self._place else name

    def _live(self, faults: list[str]) -> LiveSign | None:
        return told(faults, lambda: read_live(self._folder, self._at(LIVE)))

    def _specimens(
        self, record: Mapping[str, Any], live: LiveSign | None, in_work: ReadSearch, faults: list[str]
    ) -> tuple[WatchedSearch, ...]:
        listed = record.get("specimens")
        names = [one for one in (listed if isinstance(listed, list) else []) if isinstance(one, str)][:MOST]
        found: list[WatchedSearch] = []
        for specimen in names:
            if not specimen or "/" in specimen or "\0" in specimen or specimen == "..":
                faults.append(f"{self._at(FLEET)} names a specimen that cannot be one: {clean(specimen, 60)!r}.")
                continue
            place = self._at(f"{SPECIMENS}/{specimen}")
            label = clean(f"{self._place}: {specimen}" if self._place else specimen, 200)
            try:
                found.append(self._finished(label, place) or _open(in_work(label, place), live))
            except Unreadable as error:
                faults.append(str(error))
        return tuple(found)

    def _finished(self, label: str, folder: str) -> WatchedSearch | None:
        place = f"{folder}.json"
        path = inside(self._folder, place)
        if path is None:
            return None
        changed = path.stat().st_mtime_ns
        if place in self._known and self._known[place][0] == changed:
            return self._known[place][1]
        record = read_record(self._folder, place) or {}
        failed = record.get("state") != "DONE"
        search = WatchedSearch(
            label,
            folder,
            result=None if failed else watched_result({**record, "notes": record.get("warnings")}, place),
            ended=datetime.fromtimestamp(changed / 1e9, UTC),
            seconds=finite(record.get("seconds")) or 0.0,
            failure=(clean(record.get("reason")) or "No reason is recorded.") if failed else "",
        )
        self._known[place] = changed, search
        return search


def _open(search: WatchedSearch, fleet: LiveSign | None) -> WatchedSearch:
    """A specimen without a record: from the end of its search to its record, the fleet's process works on it."""
    live = search.live
    if (
        live is not None
        and live.ended
        and live.updated
        and fleet is not None
        and fleet.began is not None
        and (
            live.updated >= fleet.began  # a sign since the fleet began, or was resumed
        )
    ):
        live = replace(live, pid=fleet.pid, host=fleet.host, updated=fleet.updated, ended=fleet.ended)
    return replace(search, live=live, is_open=True)
