"""Load-unload cycles: detection, classification as first, preconditioning or stable, and selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.driven import DrivenChannels, driven
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.branches import curve, cycle_rows
from softcal.experiments.steps.noise import white_noise
from softcal.sensing.channel import in_a_word
from softcal.units import format_quantity

CycleClass = Literal["first", "preconditioning", "stable"]

# A cycle ends if the force returns to the usual floor within this share of the peak; otherwise it is incomplete.
_RETURN_TOLERANCE = 0.15
# Share of the travel within which the crosshead counts as at rest between two cycles.
_REST_TOLERANCE = 0.002
_CURVE_BINS = 40
_LOWER_FORCE_LIMIT = 0.1  # [N], at which testing machines reverse; other efforts have no such habit


@dataclass(frozen=True)
class CycleChange:
    """Change from the previous cycle: peak of the effort [SI], and changes of peak and loading curve over that peak."""

    number: int
    peak: float
    peak_change: float
    curve_change: float

    @property
    def change(self) -> float:
        """The larger of the two changes [-]."""
        return max(self.peak_change, self.curve_change)


@register_step(
    lower_limit=Setting("of channel", channel_from="by", drives="effort", former="lower_force_limit"),
    prominence=Setting("share"),
    by=Setting("channel", drives="effort"),
)
def find_cycles(
    dataset: Dataset, lower_limit: float | None = None, *, prominence: float = 0.25, by: str | None = None
) -> Dataset:
    """The dataset with the load-unload cycle number of every sample (-1 outside any).

    A cycle is a peak of the effort, such as tension or pressure, with a return on either side to the lower limit, or to
    the floor that the effort actually returns to if drift or friction keep it above. Between two cycles the return of
    the coordinate, such as the crosshead's, belongs to the previous cycle, its advance to the next, and its rest to
    none. Incomplete cycles are omitted.

    Parameters
    ----------
    lower_limit
        Effort at which the machine reverses [SI]; None: 0.1 N of a force, 0 of other efforts.
    prominence
        Least height of a peak, as a share of the range of the effort.
    by
        A channel of the actuator; None: of the one that the record drives.

    Raises
    ------
    DatasetError
        If no complete cycle is found.
    """
    from scipy.ndimage import uniform_filter1d

    of = driven(dataset, by)
    sign, unit = of.sign(dataset), of.units[1]
    effort = of.rising(dataset, of.effort)
    limit = lower_limit if lower_limit is not None else _LOWER_FORCE_LIMIT if unit == "N" else 0.0
    limit = limit if sign > 0.0 else abs(limit)
    peaks = _peaks(effort, prominence)
    if not peaks.size:
        raise _no_cycle(dataset, of, limit)
    smooth = uniform_filter1d(effort, max(1, len(effort) // (200 * len(peaks))))
    noise = white_noise(effort)
    edges = [0, *peaks.tolist(), len(effort) - 1]
    valleys = [slice(a, b + 1) for a, b in pairwise(edges)]
    floors = np.array([smooth[valley].min() for valley in valleys])
    usual = float(np.median(floors[1:-1])) if len(floors) > 2 else float(floors.min())
    returned = np.maximum(limit, usual) + _RETURN_TOLERANCE * (smooth[peaks] - usual)
    cycle = np.full(len(effort), -1.0)
    bounds: list[tuple[int, int]] = []
    for k, peak in enumerate(peaks):
        if floors[k] > returned[k] or floors[k + 1] > returned[k]:
            continue
        margin = 3 * noise + 0.01 * (smooth[peak] - usual)
        before = smooth[valleys[k]] > max(limit, floors[k] + margin)
        after = smooth[valleys[k + 1]] > max(limit, floors[k + 1] + margin)
        start = valleys[k].start + (np.flatnonzero(~before)[-1] if not before.all() else 0)
        end = valleys[k + 1].start + (np.flatnonzero(~after)[0] if not after.all() else len(after) - 1)
        bounds.append((int(start), int(end)))
    if not bounds:
        raise _no_cycle(dataset, of, limit)
    if of.coordinate in dataset.channels:
        bounds = _with_ways_out_and_back(of.rising(dataset, of.coordinate), bounds)
    for number, (start, end) in enumerate(bounds):
        cycle[start : end + 1] = number
    heights = [float(smooth[start : end + 1].max()) for start, end in bounds]
    ends = (min(heights), max(heights), float(floors.min()), float(max(floors[1:-1], default=floors.min())))
    low, high, least, most = (format_quantity(sign * end, unit) for end in ends)
    returns = f"the {in_a_word(of.effort)} returns to {least} to {most}"
    outcome = f"{len(bounds)} whole cycle(s), peaks {low} to {high}, {returns}"
    if len(bounds) < len(peaks):
        outcome += f"; {len(peaks) - len(bounds)} cut short and left out"
    settings = {"lower_limit": limit, "prominence": prominence, "by": of.effort}
    return replace(dataset, cycle=cycle, provenance=(*dataset.provenance, Step("find_cycles", settings, outcome)))


def cycle_changes(dataset: Dataset) -> tuple[CycleChange, ...]:
    """Peak of every cycle, and the change of the peak and loading curve from the previous cycle (NaN for the first).

    The curves are compared over their common range of the coordinate; both changes are shares of the previous peak.
    Peaks are those of the effort with the sign of the loading.
    """
    of = driven(dataset)
    along, effort = of.rising(dataset, of.along(dataset.channels)), of.rising(dataset, of.effort)
    changes: list[CycleChange] = []
    before: tuple[float, Floats, Floats] | None = None
    for cycle in cycle_rows(dataset):
        s, values = curve(along[cycle.loading], {of.effort: effort[cycle.loading]}, _CURVE_BINS)
        force = values[of.effort]
        peak = float(force.max())
        if before is None:
            changes.append(CycleChange(cycle.number, peak, np.nan, np.nan))
        else:
            old_peak, old_s, old_force = before
            grid = np.linspace(max(s[0], old_s[0]), min(s[-1], old_s[-1]), _CURVE_BINS)
            gap = np.interp(grid, s, force) - np.interp(grid, old_s, old_force)
            rms = float(np.sqrt(np.mean(gap**2)))
            changes.append(CycleChange(cycle.number, peak, abs(peak - old_peak) / old_peak, rms / old_peak))
        before = peak, s, force
    return tuple(changes)


@register_step(threshold=Setting("positive ratio"))
def classify_cycles(dataset: Dataset, threshold: float = 0.02) -> Dataset:
    """The dataset with classified cycles, stored in the provenance, from which `select_cycles` reads them.

    The first cycle is `first`. The cycles after it are `preconditioning` up to the last that changed by more than
    `threshold` [share of the peak] in peak or loading curve from the previous cycle; later ones are `stable`.
    """
    changes = cycle_changes(dataset)
    unsettled = [change.number for change in changes[1:] if change.change > threshold]
    last_unsettled = unsettled[-1] if unsettled else changes[0].number
    classes: dict[int, CycleClass] = {change.number: "preconditioning" for change in changes}
    classes.update({change.number: "stable" for change in changes if change.number > last_unsettled})
    classes[changes[0].number] = "first"
    stable = [number for number, kind in classes.items() if kind == "stable"]
    preconditioning = [number for number, kind in classes.items() if kind == "preconditioning"]
    first = changes[0]
    of = driven(dataset)
    sign, unit = of.sign(dataset), of.units[1]
    words = [f"first cycle: number {first.number}, peak {format_quantity(sign * first.peak, unit)}"]
    if len(changes) > 1:
        words[0] += f", from which the next one differs by {changes[1].change:.1%} of the peak"
    if preconditioning:
        words.append(f"preconditioning: {_numbers(preconditioning)}")
    if stable:
        largest = max(change.change for change in changes if classes[change.number] == "stable")
        peak = float(np.mean([change.peak for change in changes if classes[change.number] == "stable"]))
        words.append(
            f"stable: {_numbers(stable)}, peak {format_quantity(sign * peak, unit)}, change from cycle to cycle at "
            f"most {largest:.1%} of the peak (threshold {threshold:.1%})"
        )
    else:
        words.append(f"none is stable: the last cycle still changed by more than {threshold:.1%} of the peak")
    settings = {"threshold": threshold, "classes": {str(number): kind for number, kind in classes.items()}}
    step = Step("classify_cycles", settings, "; ".join(words))
    return replace(dataset, provenance=(*dataset.provenance, step))


@register_step(leaves_out="cycles", which=Setting("cycles", choices=("stable", "first", "preconditioning", "all")))
def select_cycles(
    dataset: Dataset, which: Literal["stable", "first", "preconditioning", "all"] | Sequence[int] = "stable"
) -> Dataset:
    """The samples of some cycles: of a class (`classify_cycles`), of all, or of the numbers given (0 is the first).

    Raises
    ------
    DatasetError
        Where the cycles were not looked for or classified before, or none is of that kind.
    """
    if dataset.cycle is None:
        raise DatasetError(
            Fault("the cycles have not been determined", where=dataset.name, attempt="find_cycles before select_cycles")
        )
    there = [int(number) for number in np.unique(dataset.cycle[dataset.cycle >= 0])]
    if which == "all":
        numbers = there
    elif isinstance(which, str):
        classified = [step for step in dataset.provenance if step.name == "classify_cycles"]
        if not classified:
            raise DatasetError(
                Fault(
                    "the cycles have not been classified",
                    where=dataset.name,
                    got=f"which: {which}",
                    attempt="classify_cycles before select_cycles",
                )
            )
        classes: dict[str, str] = classified[-1].settings["classes"]
        numbers = [number for number in there if classes.get(str(number)) == which]
        if not numbers:
            raise DatasetError(
                Fault(
                    f"no cycle is of the kind '{which}'",
                    where=dataset.name,
                    got=classified[-1].outcome,
                    allowed="first, preconditioning, stable, all, or a list of numbers",
                    attempt="a larger threshold of classify_cycles",
                )
            )
    else:
        numbers = sorted({int(number) for number in which})
        unknown = [number for number in numbers if number not in there]
        if unknown or not numbers:
            raise DatasetError(
                Fault(
                    "no such cycle", where=dataset.name, got=_numbers(unknown) or "no number", allowed=_numbers(there)
                )
            )
    mask = np.isin(dataset.cycle, numbers)
    outcome = f"{len(numbers)} of {len(there)} cycles kept ({_numbers(numbers)}), {int(mask.sum())} samples"
    settings = {"which": which if isinstance(which, str) else numbers}
    return dataset.take(mask, Step("select_cycles", settings, outcome))


def _peaks(effort: Floats, prominence: float) -> Ints:
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks

    span = float(np.ptp(effort))
    # Twice: the first pass counts the peaks, so that the second can smooth by a small share of a cycle.
    smooth = effort
    peaks = np.empty(0, dtype=np.int64)
    for _ in range(2):
        peaks = find_peaks(smooth, prominence=max(prominence * span, 1e-12))[0]
        smooth = uniform_filter1d(effort, max(1, len(effort) // (200 * max(len(peaks), 1))))
    # Two equal samples of a dwell are one peak, not two.
    distinct: list[int] = []
    for peak in peaks.tolist():
        if distinct and smooth[distinct[-1] : peak + 1].min() > smooth[peak] - prominence * span:
            continue
        distinct.append(peak)
    return np.array(distinct, dtype=np.int64)


def _with_ways_out_and_back(travel: Floats, bounds: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Bounds extended over the slack travel: to the lowest coordinate after a cycle, and from it before the next."""
    starts = [start for start, _ in bounds]
    ends = [end for _, end in bounds]
    gaps = [(0, starts[0]), *zip(ends[:-1], starts[1:], strict=True), (ends[-1], len(travel) - 1)]
    tolerance = _REST_TOLERANCE * float(np.ptp(travel)) + 3 * white_noise(travel)
    for k, (a, b) in enumerate(gaps):
        if b <= a:
            continue
        gap = travel[a : b + 1]
        resting = np.flatnonzero(gap <= gap.min() + tolerance)
        if k > 0:
            ends[k - 1] = a + int(resting[0])
        if k < len(bounds):
            starts[k] = max(a + int(resting[-1]), ends[k - 1] + 1 if k > 0 else 0)
    return list(zip(starts, ends, strict=True))


def _no_cycle(dataset: Dataset, of: DrivenChannels, limit: float) -> DatasetError:
    effort, unit, word = dataset.values(of.effort), of.units[1], in_a_word(of.effort)
    return DatasetError(
        Fault(
            "no whole load-unload cycle was found",
            where=dataset.name,
            got=f"{of.effort} {format_quantity(float(effort.min()), unit)} to "
            f"{format_quantity(float(effort.max()), unit)}",
            allowed=f"a rise and a return to the lower {word} limit {format_quantity(limit, unit)}",
            attempt="a higher lower_limit, or no cycle steps for a record of one branch",
        )
    )


def _numbers(numbers: Sequence[int]) -> str:
    """Numbers as text: "0, 2 to 7"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)
