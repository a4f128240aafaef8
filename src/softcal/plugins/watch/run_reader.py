"""A reader of a run's folder during the run: it only reads, again and again, and reports unreadable files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import TypeGuard

from softcal.calibration.results.store import RECORD, RESULT
from softcal.calibration.results.trial_journal import JOURNAL
from softcal.calibration.search.live import LIVE
from softcal.plugins.watch.fleet_reader import FLEET, SPECIMENS, FleetReader
from softcal.plugins.watch.live import moment, read_live
from softcal.plugins.watch.reading import clean, count, inside, numbers, read_record, told
from softcal.plugins.watch.report_figures import report_figures
from softcal.plugins.watch.trials import TrialReader
from softcal.plugins.watch.watched import (
    WatchedRun,
    WatchedScore,
    WatchedSearch,
    watched_result,
    watched_score,
)

SCORE, REPORT = "score.json", "report.html"
CALIBRATIONS = "calibrations"
MOST_SEARCHES = 2000  # of a folder


class RunReader:
    """Reads one folder; `read` gives what is there now."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._trials: dict[str, TrialReader] = {}
        self._fleets: dict[str, FleetReader] = {}
        self._known: dict[str, tuple[object, WatchedSearch]] = {}

    def read(self) -> WatchedRun:
        """The run as it stands; never raises for what is in the folder."""
        faults: list[str] = []
        name = clean(self.folder.resolve().name, 200)
        fleet = told(faults, lambda: read_record(self.folder, FLEET))
        if fleet is not None:
            return self._fleet("").read(fleet, name, self._run_of)
        record = told(faults, lambda: read_record(self.folder, RECORD)) or {}
        labels = record.get("calibrations")
        searches: list[WatchedSearch] = []
        if isinstance(labels, list):
            for label in labels[:MOST_SEARCHES]:
                if not _is_label(label):
                    faults.append(f"{RECORD} names a calibration that cannot be one: {clean(label, 60)!r}.")
                    continue
                searches.append(self._search(label, f"{CALIBRATIONS}/{label}"))
            report = REPORT if told(faults, lambda: inside(self.folder, REPORT)) is not None else ""
            return WatchedRun(
                clean(record.get("project"), 200) or name,
                "sweep" if labels == ["sweep"] else "calibration",
                tuple(searches),
                moment(record.get("created")),
                report,
                told(faults, lambda: report_figures(self.folder)) or () if report else (),
                unreadable=tuple(faults),
                values=numbers(record.get("values")),
            )
        if "identity" in record:  # one calibration's own folder
            return WatchedRun(name, "calibration", (self._search(name, ""),), unreadable=tuple(faults))
        # Runs and scores in the folder itself, or runs, fleets and scores in folders in it.
        scores: list[WatchedScore] = []
        try:
            folders = sorted(one.name for one in self.folder.iterdir() if one.is_dir() and not one.is_symlink())
        except OSError:
            folders = []
        for place in ("", *folders):
            score = told(faults, lambda place=place: read_record(self.folder, _joined(place, SCORE)))
            if score is not None:
                scores.append(watched_score(score))
            fleet = told(faults, lambda place=place: read_record(self.folder, _joined(place, FLEET)))
            if fleet is not None:
                searches += self._fleet(place).specimens(fleet, self._run_of, faults)
            record = (
                None
                if not place
                else told(faults, lambda place=place: read_record(self.folder, _joined(place, RECORD)))
            )
            if record is None:
                continue
            inner = record.get("calibrations")
            if isinstance(inner, list):
                labels = [one for one in inner if _is_label(one)]
                searches += [
                    self._search(f"{place}: {one}" if len(labels) > 1 else place, f"{place}/{CALIBRATIONS}/{one}")
                    for one in labels
                ]
            elif "identity" in record:
                searches.append(self._search(place, place))
            if len(searches) >= MOST_SEARCHES:
                break
        kind = "runs" if searches else "benchmark" if scores else ""
        return WatchedRun(name, kind, tuple(searches), scores=tuple(scores), unreadable=tuple(faults))

    def _fleet(self, place: str) -> FleetReader:
        return self._fleets.setdefault(place, FleetReader(self.folder, place))

    def whole(self, search: WatchedSearch) -> WatchedSearch:
        """A finished specimen of a fleet with its trials; any other search as it is."""
        if search.trials or "/" not in search.place or search.place.split("/")[-2] != SPECIMENS:
            return search
        found = self._run_of(search.label, search.place)
        result = search.result or found.result
        return replace(found, result=result, failure=search.failure, is_open=search.is_open)

    def _run_of(self, label: str, place: str) -> WatchedSearch:
        """The search of a run in the folder, its joint one where it has several."""
        record = told([], lambda: read_record(self.folder, _joined(place, RECORD))) or {}
        inner = record.get("calibrations")
        labels = [one for one in (inner if isinstance(inner, list) else []) if _is_label(one)]
        if not labels:
            return WatchedSearch(label, place)
        return self._search(label, f"{place}/{CALIBRATIONS}/{labels[-1]}")

    def _search(self, label: str, place: str) -> WatchedSearch:
        """One search; nothing is read again of one whose files are the same."""
        faults: list[str] = []
        result_path = told(faults, lambda: inside(self.folder, _joined(place, RESULT)))
        live = told(faults, lambda: read_live(self.folder, _joined(place, LIVE)))
        journal = told(faults, lambda: inside(self.folder, _joined(place, JOURNAL)))
        stamp = (_stamp(result_path), _stamp(journal), live)
        if place in self._known and self._known[place][0] == stamp and not faults:
            return self._known[place][1]
        record = told(faults, lambda: read_record(self.folder, _joined(place, RECORD))) or {}
        settings = record.get("settings")
        settings = settings if isinstance(settings, Mapping) else {}
        reader = self._trials.setdefault(place, TrialReader(self.folder, _joined(place, JOURNAL)))
        trials = told(faults, reader.read) or ()
        found = told(faults, lambda: read_record(self.folder, _joined(place, RESULT)))
        result = None if found is None else told(faults, lambda: watched_result(found, _joined(place, RESULT)))
        total = live.total if live is not None and live.total else count(settings.get("trials"))
        search = WatchedSearch(
            clean(label, 200),
            place,
            clean(settings.get("method"), 100),
            trials,
            total,
            live,
            result,
            _when(journal),
            _when(result_path),
            reader.seconds,
            unreadable=tuple(faults),
        )
        self._known[place] = (stamp, search)
        return search


def _is_label(label: object) -> TypeGuard[str]:
    """Whether a label names a folder within that of the calibrations, and no folder elsewhere."""
    return (
        isinstance(label, str)
        and len(PurePosixPath(label).parts) == 1
        and label not in ("..", "/")
        and "\0" not in label
    )


def _stamp(path: Path | None) -> tuple[int, int]:
    """Time of a file's last change [ns], and its size; zeros where there is no file."""
    try:
        about = None if path is None else path.stat()
    except OSError:
        about = None
    return (0, 0) if about is None else (about.st_mtime_ns, about.st_size)


def _when(path: Path | None) -> datetime | None:
    changed, _ = _stamp(path)
    return datetime.fromtimestamp(changed / 1e9, UTC) if changed else None


def _joined(place: str, name: str) -> str:
    return f"{place}/{name}" if place else name
