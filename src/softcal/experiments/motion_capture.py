"""Motion capture: the markers of a .c3d file as channels of a Dataset."""

from __future__ import annotations

import hashlib
import io
import struct
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault, StorageError, unknown
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.units import unit_factor

_MAGIC = 80  # second byte of every .c3d file
# Exceptions of the package for truncated or inconsistent files.
_BROKEN = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, NameError, TypeError,
    ValueError, struct.error,
)  # fmt: skip
_FARTHEST = 1e3  # [m] from the laboratory's origin
_LARGEST = 2**29  # bytes of a file; an hour of forty markers at 100 Hz has 0.3 GB


def read_c3d(path: str | Path, markers: Mapping[str, str], *, name: str = "") -> Dataset:
    """Read markers of a .c3d file: `time` [s] from the first frame, and `<marker>.x`, `.y`, `.z` [m] of each.

    Parameters
    ----------
    path
        The file.
    markers
        Marker of the robot -> its label in the file, without surrounding blanks.
    name
        Name of the dataset; default: the file's stem.

    A sample with a negative residual (hidden marker) is NaN. The unit is the file's (POINT:UNITS).

    Raises
    ------
    DatasetError
        With all faults: not a .c3d file, no points, frames or rate, or an unknown label (the nearest one is suggested).
    UnitError
        If the file has no unit of length.
    StorageError
        Where the file cannot be read.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            raw = file.read(_LARGEST + 1)
    except OSError as error:
        raise StorageError(
            Fault("the data file cannot be read", where=str(path), got=error.strerror or str(error))
        ) from error
    if len(raw) > _LARGEST:
        raise DatasetError(Fault("the .c3d file is too large", str(path), allowed=f"{_LARGEST} bytes"))
    if len(raw) < 512 or raw[1] != _MAGIC:
        start = f"{len(raw)} bytes that begin with {raw[:4].hex(' ')}" if raw else "an empty file"
        raise DatasetError(Fault("not a .c3d file", str(path), start, "512 bytes or more, the second of them 50"))
    try:
        labels, unit, rate, frames = _parse(raw)
    except _BROKEN as error:
        raise DatasetError(
            Fault("the .c3d file is damaged", str(path), str(error) or type(error).__name__, "an undamaged file")
        ) from error
    faults: list[Fault] = []
    if not frames.shape[1] or not labels:
        faults.append(Fault("the file has no points", str(path), f"{frames.shape[1]} points, {len(labels)} labels"))
    if not len(frames):
        faults.append(Fault("the file has no frames", str(path), allowed="at least one frame of points"))
    if not 0 < rate < np.inf:
        faults.append(Fault("the file has no frame rate", f"{path}, POINT:RATE", f"{rate:g} Hz", "above 0 Hz"))
    if faults:
        raise DatasetError(faults)
    factor = unit_factor(unit, "m", where=f"{path}, POINT:UNITS")
    where = f"{path}, POINT:LABELS"
    known = ", ".join(f"'{label}'" for label in labels)
    counts = Counter(labels)
    if not markers:
        faults.append(Fault("no marker is requested", where, allowed=known))
    for label in dict.fromkeys(wanted.strip() for wanted in markers.values()):
        if not counts[label]:
            faults.append(unknown("no point has this label", where, label, labels))
        elif counts[label] > 1:
            faults.append(Fault("two points have this label", where, f"'{label}'", "labels that differ"))
    if faults:
        raise DatasetError(faults)
    columns = {marker: labels.index(label.strip()) for marker, label in markers.items()}
    positions = np.where(frames[:, :, 3:4] < 0, np.nan, frames[:, :, :3]) * factor
    wanted = positions[:, list(columns.values())]
    far = np.abs(wanted).max(initial=0.0, where=~np.isnan(wanted))
    if far > _FARTHEST:
        raise DatasetError(Fault("a marker is out of reach", str(path), f"{far:g} m", f"at most {_FARTHEST:g} m"))
    channels = {"time": Channel(np.arange(len(frames)) / rate, "s")}
    for marker, column in columns.items():
        for axis, letter in enumerate("xyz"):
            channels[f"{marker}.{letter}"] = Channel(positions[:, column, axis], "m")
    settings = {"file": path.name, "sha256": hashlib.sha256(raw).hexdigest(), "markers": dict(markers)}
    missing = {marker: int(np.isnan(positions[:, column, 0]).sum()) for marker, column in columns.items()}
    unseen = ", ".join(f"{marker} in {n}" for marker, n in missing.items() if n)
    outcome = f"{len(frames)} frames of {len(columns)} markers at {rate:g} Hz, in {unit}"
    outcome += f"; not seen: {unseen} frames" if unseen else ""
    return Dataset(name or path.stem, channels, (Step("read_c3d", settings, outcome),))


def _parse(raw: bytes) -> tuple[list[str], str, float, Floats]:
    """Labels, unit, rate [Hz], and the frames (n, n_points, 5): position, residual, cameras."""
    import c3d

    with warnings.catch_warnings():
        # Its warnings (no analogue channels, no descriptions) do not concern markers.
        warnings.simplefilter("ignore")
        reader: Any = c3d.Reader(io.BytesIO(raw))
        found = [points for _, points, _ in reader.read_frames()]
    if found and len(found) < reader.frame_count:
        raise ValueError(f"it ends after {len(found)} of {reader.frame_count} frames")
    frames = np.array(found, dtype=np.float64).reshape(len(found), -1, 5)
    parameter = reader.get("POINT:UNITS")
    unit = "" if parameter is None else str(parameter.string_value).strip("\0 ")
    labels: list[str] = []
    number = 1  # with more than 255 points they continue in POINT:LABELS2, …
    while (parameter := reader.get("POINT:LABELS" if number == 1 else f"POINT:LABELS{number}")) is not None:
        labels += [str(label).strip("\0 ") for label in np.ravel(parameter.string_array)]
        number += 1
    return labels, unit, float(reader.point_rate), frames
