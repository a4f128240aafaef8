"""Merging two records of one test: on one clock, or by the labels of their states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.units import format_quantity

GAP = 10  # times the median step of a record, beyond which nothing is interpolated


def merge_on_one_clock(first: Dataset, second: Dataset) -> Dataset:
    """The first record with the channels of the second interpolated at its times, where the second covers them.

    Raises
    ------
    DatasetError
        If a record has no time, both have the same channel, or they have no common span of time.
    """
    where = f"{first.name} and {second.name}"
    shared = [key for key in second.channels if key in first.channels and key != "time"]
    if shared:
        raise DatasetError(Fault("both records have the same channel", where, ", ".join(shared)))
    time, other = first.values("time"), second.values("time")
    inside = covered(time, other)
    if not len(inside):
        spans = [" to ".join(format_quantity(float(t), "s") for t in (x.min(), x.max())) for x in (time, other)]
        raise DatasetError(
            Fault(
                "the records share no span of time", where, " and ".join(spans), attempt="synchronise, for two clocks"
            )
        )
    added = {
        key: replace(channel, values=np.interp(time[inside], other, channel.values))
        for key, channel in second.channels.items()
        if key != "time"
    }
    outcome = f"{', '.join(added)} interpolated at {len(inside)} of {first.n_samples} samples"
    step = Step("merge_on_one_clock", {"with": second.name}, outcome)
    both = replace(first, provenance=(*first.provenance, *second.provenance)).take(inside, step)
    return replace(both, channels={**both.channels, **added})


def covered(times: Floats, others: Floats) -> Ints:
    """Which times another record covers: not those beyond its ends, or in a gap of it.

    Parameters
    ----------
    times
        Ascending times [s].
    others
        Those of the other record, on the same clock [s].
    """
    after = np.searchsorted(others, times).clip(max=len(others) - 1)
    before = (np.searchsorted(others, times, side="right") - 1).clip(min=0)
    steps = np.diff(others)
    longest = GAP * np.median(steps[steps > 0.0]) if (steps > 0.0).any() else 0.0
    inside = (times >= others[0]) & (times <= others[-1])
    return np.flatnonzero(inside & (others[after] - others[before] <= longest))


def merge_on_labels(first: Dataset, second: Dataset) -> Dataset:
    """The first record with the channels of the second at the states of equal label; other states of the second are
    omitted.

    Raises
    ------
    DatasetError
        If both have the same channel, or the second lacks states of the first (all are named).
    """
    where = f"{first.name} and {second.name}"
    shared = [key for key in second.channels if key in first.channels]
    faults = [Fault("both records have the same channel", where, ", ".join(shared))] if shared else []
    place = {label: row for row, label in enumerate(second.labels)}
    absent = [label for label in first.labels if label not in place]
    if absent:
        shown = ", ".join(f"'{label}'" for label in second.labels[:10]) + (", …" if len(second.labels) > 10 else "")
        got = ", ".join(f"'{label}'" for label in absent)
        faults.append(Fault(f"{len(absent)} state(s) of the first file are not in the other", where, got, shown))
    if faults:
        raise DatasetError(faults)
    rows = np.array([place[label] for label in first.labels])
    added = {key: replace(channel, values=channel.values[rows]) for key, channel in second.channels.items()}
    outcome = f"{', '.join(added)} at {len(rows)} of {second.n_samples} states"
    step = Step("merge_on_labels", {"with": second.name}, outcome)
    return replace(
        first,
        channels={**first.channels, **added},
        provenance=(*first.provenance, *second.provenance, step),
    )
