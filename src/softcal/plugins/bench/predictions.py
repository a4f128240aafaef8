"""Predictions as a table that any program can write, and what can be wrong with it.

    # evaluations: 12
    # wall: 31 s
    sample,tip.x [mm],tip.y [mm],tip.z [mm],band.tip.x [mm]
    m1_u005,22.7,48.5,-363.8,4.1

A row for each sample, in any order; a column, with its unit, for each channel of the record; optional columns
`band.CHANNEL` with half the width of a 95 % band, and lines that begin with `#` for the cost of the fit.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.csv_text import csv_text, plain
from softcal.declare import shown
from softcal.errors import DatasetError, Fault, SoftcalError, nearest
from softcal.experiments.columns import number_in
from softcal.experiments.text_file import open_text
from softcal.plugins.bench.record import PREDICT, SPLITS, CaseRecord, Split
from softcal.units import format_quantity, parse_quantity

SAMPLE, BAND = "sample", "band."
SHOWN = 4  # names of many in a message
MOST_STRANGE = 100  # columns, or rows, that the case does not have
SHORT, LONGEST_NAME, MOST_DIGITS = 40, 255, 15  # characters of a name in a message, and of a method's; of a count
LARGEST = 1e15  # [SI], of a value


@dataclass(frozen=True)
class Predictions:
    """Predicted channels of some samples.

    Attributes
    ----------
    samples
        Their names (n,).
    channels
        Channel -> values (n,) [SI].
    bands
        Channel -> half the width (n,) [SI] of the 95 % band of a further measurement.
    method
        What predicted.
    evaluations, wall_s
        How often the fit simulated all samples to fit, and its wall time [s]; None where unknown.
    parameters
        What was identified, in words by name.
    """

    samples: tuple[str, ...]
    channels: Mapping[str, Floats]
    bands: Mapping[str, Floats] = field(default_factory=dict[str, Floats])
    method: str = ""
    evaluations: int | None = None
    wall_s: float | None = None
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])

    def rows(self, samples: Iterable[str]) -> np.ndarray:
        """The rows of samples."""
        place = {sample: i for i, sample in enumerate(self.samples)}
        return np.array([place[sample] for sample in samples], dtype=np.int64)

    def has(self, record: CaseRecord, split: Split) -> bool:
        """Whether every sample of a split is predicted."""
        return set(np.array(record.samples)[record.of(split)]) <= set(self.samples)

    def positions(self, point: str) -> Floats:
        """Predicted positions of a point (n, 3) [m]."""
        return np.stack([self.channels[f"{point}.{axis}"] for axis in "xyz"], axis=1)

    def text(self, units: Mapping[str, str]) -> str:
        """The table as CSV [SI]."""
        told = {"method": self.method, "evaluations": self.evaluations}
        told["wall"] = None if self.wall_s is None else f"{self.wall_s:.3g} s"
        lines = [f"# {key}: {value}\n" for key, value in told.items() if value not in (None, "")]
        lines += [f"# {name} = {value}\n" for name, value in self.parameters.items()]
        columns = {**self.channels, **{f"{BAND}{name}": band for name, band in self.bands.items()}}
        header = [SAMPLE, *(f"{name} [{units[name.removeprefix(BAND)]}]" for name in columns)]
        cells = ([f"{value:.9g}" if np.isfinite(value) else "" for value in values] for values in columns.values())
        rows = zip(self.samples, *cells, strict=True)
        return "".join(lines) + csv_text(header, rows)


def read_predictions(path: Path, record: CaseRecord, method: str = "", *, aligned: bool = False) -> Predictions:
    """Predictions of a record from a file.

    Parameters
    ----------
    path
        Table with a row for each sample and a column for each channel.
    record
        Samples and channels of the case.
    method
        Name of the method; "" for that in the file, or the file's own.
    aligned
        The score takes the mean error off the positions, so that their origin does not count.

    Raises
    ------
    StorageError
        Where it cannot be read.
    DatasetError
        With everything that is wrong with it: missing, unknown or repeated samples or columns, units, values that are
        no numbers, positions in another unit or frame.
    """
    comments: list[str] = []
    rows = _rows(path, record, comments)
    facts: dict[str, str] = {}
    parameters: dict[str, str] = {}
    for line in comments:
        if match := re.match(r"#\s*([\w.\[\]]+)\s*([:=])(.*)", line):
            (facts if match[2] == ":" else parameters)[match[1]] = match[3].strip()
    if not rows:
        raise DatasetError(Fault("the table is empty", str(path), allowed=_layout(record)))
    faults: list[Fault] = []
    columns = _columns([cell.strip() for cell in rows[0]], record, str(path), faults)
    samples = [row[0].strip() for row in rows[1:]]
    where = str(path)
    known, given = set(record.samples), set(samples)
    if twice := [name for name, count in Counter(samples).items() if count > 1]:
        faults.append(Fault(f"{len(twice)} sample(s) occur more than once", where, _some(twice), "one row each"))
    if unknown := [name for name in dict.fromkeys(samples) if name not in known]:
        attempt = nearest(unknown[0], record.samples)
        faults.append(Fault(f"the case has no such sample ({len(unknown)})", where, _some(unknown), attempt=attempt))
    for split in SPLITS:
        of_split = np.array(record.samples)[record.of(split)].tolist()
        missing = [name for name in of_split if name not in given]
        if missing and (split == PREDICT or len(missing) < len(of_split)):
            whole = "" if split == PREDICT else ", or none of them"
            faults.append(
                Fault(
                    f"{len(missing)} of {len(of_split)} samples to {split} are missing",
                    where,
                    _some(missing),
                    f"every sample to {split}{whole}",
                )
            )
    if uneven := [row[0].strip() for row in rows[1:] if len(row) != len(rows[0])]:
        allowed = f"{len(rows[0])} cells, as the header; a decimal point, not a comma"
        faults.append(Fault(f"{len(uneven)} row(s) have more or fewer cells", str(path), _some(uneven), allowed))
    wanted = {sample: i for i, sample in enumerate(record.samples)}
    needed = {
        name: np.array(
            [bool(np.isfinite(held[wanted[one]])) if one in wanted else False for one in samples], dtype=bool
        )
        for name, held in record.channels.items()
    }
    values = {
        name: _values(rows, place, scale, name, needed, str(path), faults) for name, (place, scale) in columns.items()
    }
    evaluations, text = None, facts.get("evaluations")
    if text is not None and text.isdecimal() and len(text) <= MOST_DIGITS:
        evaluations = int(text)
    elif text is not None:
        faults.append(Fault("the number of evaluations is no whole number", str(path), shown(text), "such as 12"))
    wall = _seconds(facts.get("wall"), str(path), faults)
    name = method or facts.get("method") or path.stem
    texts = [("the name of the method", name)]
    texts += [("the name of a parameter", text) for text in parameters]
    texts += [("the value of a parameter", text) for text in parameters.values()]
    faults += [
        Fault(f"{what} is too long", str(path), f"{len(text)} characters", f"{LONGEST_NAME}")
        for what, text in texts
        if len(text) > LONGEST_NAME
    ]
    if not name.isprintable():
        allowed = "characters that can be seen"
        faults.append(Fault("this cannot be the name of a method", str(path), shown(name), allowed, "--method NAME"))
    if not faults:
        channels = {name: held for name, held in values.items() if not name.startswith(BAND)}
        bands = {name.removeprefix(BAND): held for name, held in values.items() if name.startswith(BAND)}
        found = Predictions(tuple(samples), channels, bands, name, evaluations, wall, parameters)
        faults += require_matching(record, found, str(path), aligned=aligned)
        if not faults:
            return found
    raise DatasetError(faults)


def _rows(path: Path, record: CaseRecord, comments: list[str]) -> list[list[str]]:
    """The rows that are not empty, no more and no longer than there can be; comments: to which those are added."""

    def lines() -> Iterator[str]:
        for _, block in open_text(path).blocks():
            for line in block:
                if line.startswith("#"):
                    comments.append(line)
                    require("comments", len(comments), MOST_STRANGE + 2 * len(record.samples))
                elif line:
                    yield line

    def require(what: str, n: int, most: int) -> None:
        if n > most:
            raise DatasetError(Fault(f"the table has too many {what}", str(path), f"{n}", f"{most}; {_layout(record)}"))

    rows: list[list[str]] = []
    try:
        for row in csv.reader(lines()):
            require("columns", len(row), MOST_STRANGE + 2 * len(record.channels))
            if any(row):
                rows.append([plain(cell) for cell in row])
                require("rows", len(rows), MOST_STRANGE + 2 * len(record.samples))
    except csv.Error as error:
        raise DatasetError(
            Fault("the table cannot be cut into cells", str(path), str(error), _layout(record))
        ) from None
    return rows


def require_matching(record: CaseRecord, found: Predictions, where: str, *, aligned: bool = False) -> list[Fault]:
    """The faults of predictions whose positions are in another unit or frame than the record's.

    Parameters
    ----------
    record
        Measured positions.
    found
        Predicted ones.
    where
        File of the predictions, for the faults.
    aligned
        See `read_predictions`.
    """
    chosen = [sample for sample, fit in zip(record.samples, record.is_fit, strict=True) if not fit]
    chosen = [sample for sample in chosen if sample in set(found.samples)]
    measured = np.array([record.samples.index(sample) for sample in chosen], dtype=np.int64)
    rows = found.rows(chosen)
    if not record.points or len(rows) == 0:
        return []
    was = np.concatenate([record.positions(point)[measured] for point in record.points])
    now = np.concatenate([found.positions(point)[rows] for point in record.points])
    known = np.isfinite(was).all(axis=1)
    return frame_faults(was[known], now[known], where, aligned=aligned, moves=len(rows) > 1)


def _layout(record: CaseRecord) -> str:
    return f"the columns {SAMPLE}, " + ", ".join(f"{name} [{unit}]" for name, unit in record.units.items())


def _columns(header: list[str], record: CaseRecord, where: str, faults: list[Fault]) -> dict[str, tuple[int, float]]:
    """Channel, or band -> its column and the size of its unit [SI]."""
    if header[0] != SAMPLE:
        faults.append(Fault("the first column must name the samples", where, shown(header[0]), f"'{SAMPLE}'"))
    found: dict[str, tuple[int, float]] = {}
    for place, cell in enumerate(header[1:], start=1):
        match = re.fullmatch(r"(.+?)\s*\[(.+)\]", cell)
        name, unit = (match[1], match[2]) if match else (cell, "")
        channel = name.removeprefix(BAND)
        if channel not in record.channels:
            attempt = nearest(channel, record.channels)
            faults.append(Fault("the case has no such channel", where, shown(cell), _layout(record), attempt))
            continue
        if name in found:
            faults.append(Fault("the column occurs twice", where, shown(cell), "one of each"))
        try:
            found[name] = (place, parse_quantity(f"1 {unit}", record.units[channel], where=where))
        except SoftcalError:
            allowed = f"'{name} [{record.units[channel]}]', or another unit of the same dimension"
            faults.append(Fault("the unit of the column is missing or wrong", where, shown(cell), allowed))
    known = {re.sub(r"\s*\[.+\]$", "", cell) for cell in header[1:]}
    missing = [name for name in record.channels if name not in known]
    if missing:
        faults.append(Fault(f"{len(missing)} column(s) are missing", where, _some(missing), _layout(record)))
    return found


def _values(
    rows: list[list[str]],
    place: int,
    scale: float,
    name: str,
    needed: Mapping[str, np.ndarray],
    where: str,
    faults: list[Fault],
) -> Floats:
    """A column [SI]. needed: channel -> the rows that were measured; elsewhere, and in a band, a cell may be empty."""
    found = np.full(len(rows) - 1, np.nan)
    wrong: list[str] = []
    for i, row in enumerate(rows[1:]):
        cell = row[place].strip() if place < len(row) else ""
        if not cell and (name.startswith(BAND) or not needed[name][i]):
            continue
        found[i] = scale * number_in(cell)
        if not abs(found[i]) <= LARGEST or (name.startswith(BAND) and found[i] < 0.0):
            wrong.append(f"{row[0].strip()[:SHORT]}: '{cell[:SHORT]}'")
    if wrong:
        allowed = f"a number up to {LARGEST:g} in SI" + (", not negative" if name.startswith(BAND) else "")
        faults.append(Fault(f"{len(wrong)} value(s) of {name} are no allowed number", where, _some(wrong), allowed))
    return found


def _seconds(text: str | None, where: str, faults: list[Fault]) -> float | None:
    if text is None:
        return None
    with suppress(SoftcalError):
        if (seconds := parse_quantity(text, "s", where=where)) >= 0.0:
            return seconds
    faults.append(Fault("this is no wall time", where, shown(text), "such as '31 s'"))
    return None


def _some(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(name[: 3 * SHORT] for name in names[:SHOWN]) + more


LARGE_TURN = np.deg2rad(25.0)
BETTER = 3.0  # times smaller must the residual be in the other frame
FAR = 0.2  # of the positions' extent: errors smaller than this are errors of a prediction
SCALES = {1e3: "mm written as m", 1e-3: "m written as mm", 1e2: "cm written as m", 1e-2: "m written as cm"}


def frame_faults(
    measured: Floats, predicted: Floats, where: str, *, aligned: bool = False, moves: bool = True
) -> list[Fault]:
    """Faults of predicted positions that are in another unit or frame than the measured ones.

    A similarity (Umeyama, 1991) is fitted between the two. It is a fault only where it is unmistakable: the positions
    agree far better after a rotation by a large angle, or a change of scale by a power of ten.

    Parameters
    ----------
    measured, predicted
        Positions (n, 3) [m].
    where
        File of the predictions.
    aligned
        See `read_predictions`.
    moves
        Whether they are of several samples: of one alone, a motion of all points is an error of the prediction.
    """
    extent = float(np.linalg.norm(np.ptp(measured, axis=0)))
    near = predicted - (predicted - measured).mean(axis=0) if aligned else predicted
    off = float(np.sqrt(np.mean(np.sum((near - measured) ** 2, axis=1))))
    if len(measured) < 3 or extent == 0.0 or off < FAR * extent:
        return []
    got = f"positions that are {format_quantity(off, 'm', digits=3)} off, over an extent of "
    got += format_quantity(extent, "m", digits=3)
    size = float(np.sqrt(np.mean(np.sum(predicted**2, axis=1)) / np.mean(np.sum(measured**2, axis=1))))
    if size == 0.0:
        return [Fault("the predicted positions are all at the origin", where, got, "a prediction of each sample")]
    for scale, mistake in SCALES.items():
        if abs(np.log10(size / scale)) < 0.25:
            return [Fault("the positions are in another unit", where, got, "the unit of the header", mistake)]
    if not moves:
        return []
    was, now = measured - measured.mean(axis=0), predicted - predicted.mean(axis=0)
    U, _, Vt = np.linalg.svd(was.T @ now)
    rotation = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    angle = float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    shifted = float(np.sqrt(np.mean(np.sum((now - was) ** 2, axis=1))))
    turned = float(np.sqrt(np.mean(np.sum((now @ rotation.T - was) ** 2, axis=1))))
    if angle > LARGE_TURN and BETTER * turned < shifted:
        got += f"; turned by {np.rad2deg(angle):.0f} deg they agree to {format_quantity(turned, 'm', digits=3)}"
        return [Fault("the positions are in another frame", where, got, "the frame of the case; see its README")]
    if BETTER * shifted < off:
        got += f"; moved they agree to {format_quantity(shifted, 'm', digits=3)}"
        return [Fault("the positions are from another origin", where, got, "the frame of the case; see its README")]
    return []
