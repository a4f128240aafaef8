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
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.branches import curve, cycle_rows
from softcal.experiments.steps.noise import white_noise
from softcal.units import format_quantity

CycleClass = Literal["first", "preconditioning", "stable"]

# A cycle ends if the force returns to the usual floor within this share of the peak; otherwise it is incomplete.
_RETURN_TOLERANCE = 0.15
# Share of the travel within which the crosshead counts as at rest between two cycles.
_REST_TOLERANCE = 0.002
_CURVE_BINS = 40


@dataclass(frozen=True)
class CycleChange:
    """Change from the previous cycle: peak tension [N], and changes of peak and loading curve over that peak."""

    number: int
    peak: float
    peak_change: float
    curve_change: float

    @property
    def change(self) -> float:
        """The larger of the two changes [-]."""
        return max(self.peak_change, self.curve_change)


@register_step(lower_force_limit=Setting("force"), prominence=Setting("share"))
def find_cycles(dataset: Dataset, lower_force_limit: float = 0.1, *, prominence: float = 0.25) -> Dataset:
    """The dataset with the load-unload cycle number of every sample (-1 outside any).

    A cycle is a peak of tension with a return on either side to the lower force limit, or to the floor that the force
    actually returns to if drift or friction keep it above. Between two cycles the crosshead's return belongs to the
    previous cycle, its advance to the next, and its rest to none. Incomplete cycles are omitted.

    Parameters
    ----------
    lower_force_limit
        Tension at which the machine reverses [N].
    prominence
        Least height of a peak, as a share of the range of the tension.

    Raises
    ------
    DatasetError
        If no complete cycle is found.
    """
    from scipy.ndimage import uniform_filter1d

    tension = dataset.values("tension")
    peaks = _peaks(tension, prominence)
    if not peaks.size:
        raise _no_cycle(dataset, tension, lower_force_limit)
    smooth = uniform_filter1d(tension, max(1, len(tension) // (200 * len(peaks))))
    noise = white_noise(tension)
    edges = [0, *peaks.tolist(), len(tension) - 1]
    valleys = [slice(a, b + 1) for a, b in pairwise(edges)]
    floors = np.array([smooth[valley].min() for valley in valleys])
    usual = float(np.median(floors[1:-1])) if len(floors) > 2 else float(floors.min())
    returned = np.maximum(lower_force_limit, usual) + _RETURN_TOLERANCE * (smooth[peaks] - usual)
    cycle = np.full(len(tension), -1.0)
    bounds: list[tuple[int, int]] = []
    for k, peak in enumerate(peaks):
        if floors[k] > returned[k] or floors[k + 1] > returned[k]:
            continue
        margin = 3 * noise + 0.01 * (smooth[peak] - usual)
        before = smooth[valleys[k]] > max(lower_force_limit, floors[k] + margin)
        after = smooth[valleys[k + 1]] > max(lower_force_limit, floors[k + 1] + margin)
        start = valleys[k].start + (np.flatnonzero(~before)[-1] if not before.all() else 0)
        end = valleys[k + 1].start + (np.flatnonzero(~after)[0] if not after.all() else len(after) - 1)
        bounds.append((int(start), int(end)))
    if not bounds:
        raise _no_cycle(dataset, tension, lower_force_limit)
    if "shortening" in dataset.channels:
        bounds = _with_ways_out_and_back(dataset.values("shortening"), bounds)
    for number, (start, end) in enumerate(bounds):
        cycle[start : end + 1] = number
    heights = [float(smooth[start : end + 1].max()) for start, end in bounds]
    outcome = (
        f"{len(bounds)} whole cycle(s), peaks {format_quantity(min(heights), 'N')} to "
        f"{format_quantity(max(heights), 'N')}, the force returns to {format_quantity(float(floors.min()), 'N')}"
        f" to {format_quantity(float(max(floors[1:-1], default=floors.min())), 'N')}"
    )
    if len(bounds) < len(peaks):
        outcome += f"; {len(peaks) - len(bounds)} cut short and left out"
    settings = {"lower_force_limit": lower_force_limit, "prominence": prominence}
    return replace(dataset, cycle=cycle, provenance=(*dataset.provenance, Step("find_cycles", settings, outcome)))


def cycle_changes(dataset: Dataset) -> tuple[CycleChange, ...]:
    """Peak of every cycle, and the change of the peak and loading curve from the previous cycle (NaN for the first).

    The curves are compared over their common range of shortening; both changes are shares of the previous peak.
    """
    shortening, tension = dataset.values("shortening"), dataset.values("tension")
    changes: list[CycleChange] = []
    before: tuple[float, Floats, Floats] | None = None
    for cycle in cycle_rows(dataset):
        s, values = curve(shortening[cycle.loading], {"tension": tension[cycle.loading]}, _CURVE_BINS)
        force = values["tension"]
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
    words = [f"first cycle: number {first.number}, peak {format_quantity(first.peak, 'N')}"]
    if len(changes) > 1:
        words[0] += f", from which the next one differs by {changes[1].change:.1%} of the peak"
    if preconditioning:
        words.append(f"preconditioning: {_numbers(preconditioning)}")
    if stable:
        largest = max(change.change for change in changes if classes[change.number] == "stable")
        peak = float(np.mean([change.peak for change in changes if classes[change.number] == "stable"]))
        words.append(
            f"stable: {_numbers(stable)}, peak {format_quantity(peak, 'N')}, change from cycle to cycle at most "
            f"{largest:.1%} of the peak (threshold {threshold:.1%})"
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
            Fault("the cycles have not been looked for", where=dataset.name, attempt="find_cycles before select_cycles")
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


def _peaks(tension: Floats, prominence: float) -> Ints:
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks

    span = float(np.ptp(tension))
    # Twice: the first pass counts the peaks, so that the second can smooth by a small share of a cycle.
    smooth = tension
    peaks = np.empty(0, dtype=np.int64)
    for _ in range(2):
        peaks = find_peaks(smooth, prominence=max(prominence * span, 1e-12))[0]
        smooth = uniform_filter1d(tension, max(1, len(tension) // (200 * max(len(peaks), 1))))
    # Two equal samples of a dwell are one peak, not two.
    distinct: list[int] = []
    for peak in peaks.tolist():
        if distinct and smooth[distinct[-1] : peak + 1].min() > smooth[peak] - prominence * span:
            continue
        distinct.append(peak)
    return np.array(distinct, dtype=np.int64)


def _with_ways_out_and_back(shortening: Floats, bounds: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Bounds extended over the slack travel: to the lowest shortening after a cycle, and from it before the next."""
    starts = [start for start, _ in bounds]
    ends = [end for _, end in bounds]
    gaps = [(0, starts[0]), *zip(ends[:-1], starts[1:], strict=True), (ends[-1], len(shortening) - 1)]
    tolerance = _REST_TOLERANCE * float(np.ptp(shortening)) + 3 * white_noise(shortening)
    for k, (a, b) in enumerate(gaps):
        if b <= a:
            continue
        gap = shortening[a : b + 1]
        resting = np.flatnonzero(gap <= gap.min() + tolerance)
        if k > 0:
            ends[k - 1] = a + int(resting[0])
        if k < len(bounds):
            starts[k] = max(a + int(resting[-1]), ends[k - 1] + 1 if k > 0 else 0)
    return list(zip(starts, ends, strict=True))


def _no_cycle(dataset: Dataset, tension: Floats, lower_force_limit: float) -> DatasetError:
    return DatasetError(
        Fault(
            "no whole load-unload cycle was found",
            where=dataset.name,
            got=f"tension {format_quantity(float(tension.min()), 'N')} to {format_quantity(float(tension.max()), 'N')}",
            allowed=f"a rise and a return to the lower force limit {format_quantity(lower_force_limit, 'N')}",
            attempt="a higher lower_force_limit, or no cycle steps for a record of one branch",
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
