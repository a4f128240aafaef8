"""Plausibility check of bench data: warnings on values that are unlikely for a soft robot, never errors."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.driven import driven_whole
from softcal.experiments.header import column_unit
from softcal.experiments.steps.branches import curve
from softcal.experiments.table import is_unit_of, split_header
from softcal.sensing.channel import channel_name
from softcal.sensing.sensors.actuators import PRESSURE
from softcal.units import format_quantity, unit_factor

_MAX_SPEED = 1.0  # [m/s]
_MIN_ANGLE = 1e-3  # [rad]
_BINS = 20
_REPEATED = 0.1  # share of rows that may repeat the one before, as at a standstill that is coarsely resolved
_CHANCE = 2  # distinct values, which two tests may well have in common
_ATMOSPHERE = 101_325.0  # [Pa]
_ATMOSPHERIC = 0.05  # of it, within which a record of an absolute pressure begins
_STILL = 5  # rows of the same value at the end of a channel's range, or of a part that is there twice: fewer are chance
_SCATTER = 6.0  # standard errors by which the mean of some bins may differ from another's without a trend
_FLOOR = 0.1  # share of the effort's range that still counts as slack


def check_plausible(dataset: Dataset) -> tuple[str, ...]:
    """One sentence for each suspected wrong unit, sign or column; empty if there is none."""
    warnings: list[str] = []
    # Units in names of columns that are none to the reader, such as [x1000 N] or "Force as kN".
    for step in dataset.provenance:
        for key, column in (step.settings.get("columns") or {}).items() if step.name == "read_table" else ():
            si_unit = column_unit(key) or "1"
            name, in_brackets = split_header(column["header"])
            words = re.findall(r"[^\W\d_][^\W_]*|[µ°]\w*", f"{name} {in_brackets or ''}")[1:]
            units = {word for word in words if word.casefold() != "in" and is_unit_of(word, si_unit)}
            if si_unit == "1" or is_unit_of(in_brackets or "", si_unit) or not units:
                continue
            if isinstance(column["scale"], str):  # of a sensor that writes another quantity
                continue
            factor = unit_factor(column["unit"], si_unit)
            agree = any(np.isclose(unit_factor(unit, si_unit), factor, rtol=1e-9) for unit in units)
            if not agree or any(unit in (in_brackets or "") for unit in units):
                another = "does its name say another unit? Then state that one"
                warnings.append(f"the column '{column['header']}' is read in {column['unit']}: {another}")
        units = dict[str, dict[str, str]]()
        for key, column in (step.settings.get("columns") or {}).items() if step.name == "read_table" else ():
            if (name := channel_name(key)).kind.axis is not None and column["scale"] == 1:
                units.setdefault(name.carrier, {})[key] = column["unit"]
        for of in units.values():
            if len(set(of.values())) > 1:
                read = ", ".join(f"{key} in {unit}" for key, unit in of.items())
                warnings.append(f"coordinates of one point are read in different units, {read}: is a header wrong?")
    warnings += _stiffness(dataset)
    for key, measured in dataset.channels.items():
        kind = channel_name(key).kind
        largest = float(np.abs(measured.values[np.isfinite(measured.values)]).max(initial=0.0))
        if largest > kind.most:
            unit, factor = ("deg", np.degrees(1.0)) if kind.unit == "rad" else (kind.unit, 1.0)
            reached = f"reaches {factor * largest:.3g} {unit}, above {factor * kind.most:g} {unit}"
            warnings.append(f"{key} {reached}: {kind.mistake}?")
    known = {key: one.values for key, one in dataset.channels.items() if np.isfinite(one.values).any()}
    if {"pitch", "shortening"} <= known.keys():
        swing, travel = (float(np.nanmax(known[key]) - np.nanmin(known[key])) for key in ("pitch", "shortening"))
        if travel > 5e-3 and swing == 0.0:
            warnings.append("the pitch never changes: is it the right column?")
        elif travel > 5e-3 and swing < _MIN_ANGLE:
            warnings.append(
                f"pitch swings by {np.degrees(swing):.3g} deg over {travel * 1000:.3g} mm of shortening: rad read as "
                "deg, or the wrong axis of the IMU?"
            )
    if {"time", "shortening"} <= dataset.channels.keys() and dataset.n_samples >= 3:
        time = dataset.values("time")
        moving = np.diff(time) > 0.0
        speeds = np.abs(np.diff(dataset.values("shortening"))[moving] / np.diff(time)[moving])
        if not moving.any():
            warnings.append("time never advances: is it the right column?")
        elif (speed := float(np.max(speeds, initial=0.0, where=np.isfinite(speeds)))) > _MAX_SPEED:
            limit = f"above {_MAX_SPEED:g} m/s: time in min or ms?"
            warnings.append(f"the crosshead moves at {speed:.3g} m/s, {limit}")
    # Rows written more than once would count as measurements of their own.
    table = np.column_stack([channel.values for channel in dataset.channels.values()])
    repeats = int(np.sum(np.all(table[1:] == table[:-1], axis=1)))
    if repeats > _REPEATED * dataset.n_samples:
        warnings.append(
            f"{repeats} of {dataset.n_samples} rows repeat the one before in every channel. Each counts as an "
            "independent measurement, so standard errors are too small if rows were written more than once."
        )
    else:
        parts = np.column_stack([table[k:][: max(len(table) - _STILL + 1, 0)] for k in range(_STILL)])
        again = len(parts) - len(np.unique(parts, axis=0))
        if again > _REPEATED * dataset.n_samples:
            warnings.append(
                f"{again + _STILL - 1} of {dataset.n_samples} rows repeat earlier ones in every channel, in their "
                "order: is a part of the record in the file twice? Each row counts as an independent measurement."
            )
    warnings += [] if warnings else _limits(dataset)
    return tuple(f"{dataset.name}: {warning}" for warning in warnings)


def _limits(dataset: Dataset) -> list[str]:
    """A sentence for each channel that stays at its largest excursion, but zero, while the robot is moved on."""
    of = driven_whole(dataset)
    if of is None or of.coordinate not in dataset.channels:
        return []
    coordinate, found = dataset.values(of.coordinate), list[str]()
    for key, channel in dataset.channels.items():
        values = channel.values
        far = values[int(np.argmax(np.abs(values - values[0])))]
        if key in ("time", of.coordinate) or not np.all(np.isfinite(values)) or far in (0.0, values[0]):
            continue
        ends = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1], [True]]))
        runs = [slice(*pair) for pair in itertools.pairwise(ends.tolist())]
        lengths = [run.stop - run.start for run in runs]
        at = max(range(len(runs)), key=lambda k: (values[runs[k]][0] == far, lengths[k]))
        # Of coarse readings, and of a slack cable at the start, other values are repeated as often.
        others = max((n for k, n in enumerate(lengths) if k not in (0, at)), default=0)
        n, moved = lengths[at], float(np.ptp(coordinate[runs[at]]))
        if n >= max(_STILL, 3 * others) and moved > _FLOOR * float(np.ptp(coordinate)):
            unit, factor = ("deg", np.degrees(1.0)) if channel.unit == "rad" else (channel.unit, 1.0)
            found.append(
                f"{key} stays at {factor * far:.4g} {unit} over {n} rows while {of.coordinate} changes: has the "
                "instrument reached its limit? The step window leaves such rows out"
            )
    return found


def suspected_zeros(prepared: Dataset) -> tuple[str, ...]:
    """One sentence for each channel of a prepared record whose zero is elsewhere: a pressure that begins at that of the
    atmosphere, a shortening that begins farther out than it moves, where the cable does not yet pull.
    """
    pressures = {key: one.values for key, one in prepared.channels.items() if channel_name(key).kind == PRESSURE}
    text = "{0} begins at {1}: is it absolute? zero: {{channel: {0}, by: 101.325 kPa}} takes the atmosphere's off"
    said = [
        text.format(key, format_quantity(values[0], "Pa"))
        for key, values in pressures.items()
        if abs(values[0] / _ATMOSPHERE - 1.0) < _ATMOSPHERIC and np.ptp(values) > 0.0
    ]
    of = driven_whole(prepared)
    if of is not None and of.is_cable and np.isfinite(prepared.values(of.effort)[0]):
        travel, tension = prepared.values(of.coordinate), prepared.values(of.effort)
        if abs(travel[0]) > np.ptp(travel) > 0.0 and abs(tension[0]) < _FLOOR * np.nanmax(np.abs(tension)):
            begin, moved = (format_quantity(float(size), "m", digits=3) for size in (travel[0], np.ptp(travel)))
            said.append(
                f"{of.coordinate} begins at {begin}, and moves by {moved}, while {of.effort} begins near zero: does "
                f"the machine count from elsewhere? zero: {{channel: {of.coordinate}, by: first}} takes that off"
            )
    return tuple(said)


def copies(datasets: Mapping[str, Dataset], compared: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Test -> an earlier one with the same measured values in every sample of the same compared channels.

    compared: test -> names of the channels of its dataset that are compared with the twin.
    """
    first: dict[tuple[tuple[str, ...], bytes], str] = {}
    found: dict[str, str] = {}
    for name, dataset in datasets.items():
        channels = tuple(sorted(compared[name]))
        table = np.array([dataset.values(channel) for channel in channels])
        if len(np.unique(table[np.isfinite(table)])) > _CHANCE:
            earlier = first.setdefault((channels, table.tobytes()), name)
            if earlier != name:
                found[name] = earlier
    return found


def _stiffness(dataset: Dataset) -> list[str]:
    of = driven_whole(dataset)
    if of is None:
        return []
    known = np.logical_and(*(np.isfinite(dataset.values(name)) for name in of.names))
    if not known.any():
        return []
    dataset = dataset.take(known, Step("known"))
    coordinate, effort = of.rising(dataset, of.coordinate), of.rising(dataset, of.effort)
    if dataset.n_samples == 1:
        needed = f"a stiffness needs two or more, at different {of.kinds[0].name}s"
        return [f"the record has one sample, and {needed}: do where or skip_rows leave out too many?"]
    for name, values in ((of.coordinate, coordinate), (of.effort, effort)):
        if np.ptp(values) <= 0.0:
            return [f"{name} never changes: is it the right column?"]
    s, means = curve(coordinate, {of.effort: effort}, _BINS)
    force = means[of.effort]
    if len(s) < 2:
        return []
    taut = force[1:] > force.min() + _FLOOR * np.ptp(force)
    if not taut.any():
        measured, unit = dataset.values(of.effort), of.units[1]
        ends = f"{measured.min():.3g} to {measured.max():.3g} {unit}"
        return [f"{of.effort} does not rise with {of.coordinate} ({ends}): is it the right column?"]
    in_order = effort[np.argsort(coordinate, kind="stable")]
    change = np.diff(in_order)  # a few large ones, as where a cable becomes taut, are no scatter
    scatter = 1.4826 * float(np.median(np.abs(change - np.median(change)))) / np.sqrt(2.0)
    if of.is_cable and np.ptp(force) < _SCATTER * scatter / np.sqrt(len(effort) / len(s)):
        return [
            f"{of.effort} changes with {of.coordinate} by no more than its scatter of {scatter:.3g} {of.units[1]} "
            "explains: is the cable taut in this record?"
        ]
    median = float(np.median((np.diff(force) / np.diff(s))[taut]))
    (coordinate_kind, effort_kind), shown = of.kinds, of.slope_in_words(median)
    lower, upper = effort_kind.slope or (0.0, np.inf)
    average = float(np.mean(effort))
    if of.is_cable and (median < 0.0 or average < -0.1 * float(np.max(np.abs(effort)))):
        return [
            f"tension is {average:.3g} N on average and changes by {median:.3g} N/m with "
            f"shortening: does the machine write tension or displacement negative (scale: -1)?"
        ]
    if median < 0.0:
        falls = f"{of.effort} falls as {of.coordinate} rises, by {shown} (median)"
        return [f"{falls}: is one of the two written with the other sign (scale: -1)?"]
    if lower <= median <= upper:
        return []
    if of.is_cable:
        guess = "displacement in m" if median > upper else "displacement in um"
        force_guess = "force in N read as kN" if median > upper else "force in kN read as N"
        return [
            f"the stiffness dT/dd is {median:.3g} N/m (median), expected {lower:g} to {upper:g} N/m: "
            f"force in kN or displacement in m by mistake ({force_guess}, or {guess} read as mm)?"
        ]
    rises = f"{of.effort} rises by {shown} of {of.coordinate} (median)"
    ends = " to ".join(of.slope_in_words(end) for end in (lower, upper))
    mistakes = f"{effort_kind.mistake}, or {coordinate_kind.mistake}, or the reverse"
    return [f"{rises}, expected {ends}: a wrong unit of one of the two ({mistakes})?"]
