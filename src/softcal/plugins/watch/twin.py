"""The twin at the best trial: simulated in a process of its own, when the best changed, and never for long."""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from softcal.plugins.watch.reading import clean, finite, numbers
from softcal.plugins.watch.run_reader import CALIBRATIONS
from softcal.plugins.watch.watched import WatchedSearch
from softcal.processes import run_module

SHARE = 0.1  # of a core, at most: none is begun before its last one has taken no more of the time
SHORTEST = 5.0  # [s] of rest
PATIENCE = 600.0  # [s] for one simulation
MOST_SHAPES = 8  # that are kept


@dataclass(frozen=True)
class FitPicture:
    """A figure of the measured and the simulated values, as a PNG, with its caption."""

    caption: str
    png: bytes

    @cached_property
    def name(self) -> str:
        """Name by which the page requests the figure."""
        return _name(self.png)


@dataclass(frozen=True)
class TwinShape:
    """The twin at a trial.

    Attributes
    ----------
    trial
        Number of the trial; None for the values of the result.
    title
        What is pulled, or the experiment.
    largest
        The largest displacement from rest [m], top of the colours.
    glb
        The shape as a GLB file; empty where there is none.
    trouble
        A sentence on why there is no shape, or "".
    fits
        Figures of the fit at this trial.
    missing
        Sentences on experiments that are not drawn, or "".
    """

    trial: int | None
    title: str
    largest: float
    glb: bytes
    trouble: str
    fits: tuple[FitPicture, ...] = ()
    missing: str = ""

    @cached_property
    def name(self) -> str:
        """Name by which the page requests the shape."""
        return _name(self.glb)


@dataclass(frozen=True)
class ParameterFacts:
    """SI units by parameter, and bounds of the free ones."""

    units: Mapping[str, str] = field(default_factory=dict[str, str])
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])


class TwinKeeper:
    """Simulates what pages ask for, one at a time; close it at the end."""

    def __init__(self, folder: Path, now: Callable[[], float] = time.monotonic) -> None:
        self._folder, self._now = folder, now
        self._lock = threading.Lock()
        self._shapes: dict[str, tuple[object, TwinShape]] = {}
        self._facts: dict[str, ParameterFacts] = {}
        self._busy = False
        self._rest_until = 0.0
        self._ended = threading.Event()

    def shape(self, search: WatchedSearch) -> TwinShape | None:
        """The last shape of a search, or None."""
        held = self._shapes.get(search.place)
        return None if held is None else held[1]

    def facts(self, search: WatchedSearch) -> ParameterFacts:
        """Units and bounds of the search's parameters; empty before the first simulation."""
        return self._facts.get(run_of(search), ParameterFacts())

    def shapes(self) -> list[TwinShape]:
        """Every shape that is kept."""
        return [shape for _, shape in list(self._shapes.values())]

    @property
    def is_busy(self) -> bool:
        return self._busy

    def want(self, search: WatchedSearch, *, ended: bool) -> None:
        """Ask for the twin at the best of a search; returns at once. ended: without a rest before it."""
        best = search.best
        key = None if best is None else best.number
        known = self._shapes.get(search.place)
        if (known is not None and known[0] == key) or (best is None and run_of(search) in self._facts):
            return
        if best is None and not (self._folder / run_of(search)).is_dir():
            return
        with self._lock:
            if self._busy or self._ended.is_set() or (self._now() < self._rest_until and not ended):
                return
            self._busy = True
        threading.Thread(target=self._make, args=(search, key), daemon=True).start()

    def close(self) -> None:
        """Begin no simulation any more; the one that runs ends with this process."""
        self._ended.set()

    def _make(self, search: WatchedSearch, key: object) -> None:
        began, cpu = self._now(), None
        try:
            answer, glb = simulated_twin(self._folder, search)
            cpu = finite(answer.get("cpu"))
            units, bounds = answer.get("units"), answer.get("bounds")
            if isinstance(units, Mapping) and units:
                ends = {clean(name): tuple(pair) for name, pair in (bounds or {}).items() if len(pair) == 2}
                self._facts[run_of(search)] = ParameterFacts({clean(n): clean(u) for n, u in units.items()}, ends)
            if search.best is not None or answer.get("trouble"):
                shape = TwinShape(
                    None if search.best is None else search.best.number,
                    clean(answer.get("title"), 300),
                    finite(answer.get("largest")) or 0.0,
                    glb,
                    clean(answer.get("trouble")),
                    answer.get("fits", ()),
                    clean(answer.get("missing")),
                )
                while len(self._shapes) >= MOST_SHAPES and search.place not in self._shapes:
                    self._shapes.pop(next(iter(self._shapes)))
                self._shapes[search.place] = (key, shape)
        finally:
            now = self._now()
            # One that waited for a processor took less of it than of the time.
            self._rest_until = max(now + SHORTEST, began + (now - began if cpu is None else cpu) / SHARE)
            self._busy = False


def simulated_twin(folder: Path, search: WatchedSearch, patience: float = PATIENCE) -> tuple[dict[str, Any], bytes]:
    """The answer of the process of `twin_worker`, with its `fits`, and the GLB file, empty where there is none.

    Parameters
    ----------
    folder
        The run.
    search
        The calibration whose best trial is simulated.
    patience
        Limit [s] of the process.
    """
    best = search.best
    run_folder = (folder / run_of(search)).resolve()
    if not run_folder.is_relative_to(folder.resolve()):
        return {"trouble": "The run lies outside the folder that is shown; there is no picture of it."}, b""
    request = {
        "folder": str(run_folder),
        "label": search.place.rpartition("/")[2],
        "theta": None if best is None else numbers(best.theta),
    }
    with tempfile.TemporaryDirectory(prefix="softcal-watch-") as place:
        path = Path(place, "twin.glb")
        try:
            done = run_module(
                "softcal.plugins.watch.twin_worker", str(path), timeout=patience, told=json.dumps(request)
            )
        except subprocess.TimeoutExpired:
            return {"trouble": f"The simulation for the picture took longer than {patience:g} s."}, b""
        except OSError as error:
            return {"trouble": f"The simulation for the picture could not be started: {error.strerror}."}, b""
        try:
            answer = json.loads(done.stdout.strip().rpartition("\n")[2])
        except ValueError:
            lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
            return {
                "trouble": f"The simulation for the picture ended: {clean(lines[-1] if lines else 'no reason', 300)}."
            }, b""
        captions = answer.get("captions") or []
        answer["fits"] = tuple(
            FitPicture(clean(one), path.with_name(f"fit-{k}.png").read_bytes()) for k, one in enumerate(captions)
        )
        return answer, path.read_bytes() if path.is_file() else b""


def run_of(search: WatchedSearch) -> str:
    """Folder of the run that a search belongs to, relative to the folder that is watched."""
    before, found, _ = f"/{search.place}".rpartition(f"/{CALIBRATIONS}/")
    return (before if found else f"/{search.place}").removeprefix("/") or "."


def _name(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]
