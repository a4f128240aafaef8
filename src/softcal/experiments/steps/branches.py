"""Load and unload branches of the cycles, and their average over the cycles on one grid of the coordinate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.driven import DrivenChannels, driven
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.noise import white_noise
from softcal.units import format_quantity

Branch = Literal["loading", "unloading", "mean"]

PULLEY_STEP = "correct_pulley_friction"
BRANCH_STEP = "take_branch"
BRANCH = Setting("choice", choices=("loading", "unloading", "mean"))

# Distance from the turning point [of the travel] within which a sample counts as dwell.
_DWELL = 0.002
# Share of the reversal of the pulleys' friction (as an exponent) from which a sample belongs to the unloading branch.
_REVERSED = 0.9


@dataclass(frozen=True)
class CycleRows:
    """Rows of one cycle in a dataset: `loading` up to the turning point, `unloading` from it on."""

    number: int
    loading: Ints
    unloading: Ints


def cycle_rows(dataset: Dataset, by: str | None = None) -> tuple[CycleRows, ...]:
    """The rows of every cycle by branch; a dataset without `find_cycles` is one cycle.

    Samples that dwell at the turning point belong to neither branch, except the turning points themselves. The turning
    point is that of the driven actuator's coordinate, or of its effort where the record has only that.

    Parameters
    ----------
    by
        A channel of the actuator; None: of the one that the record drives.

    Raises
    ------
    DatasetError
        If there is no such channel, or no cycle.
    """
    of = driven(dataset, by)
    along = of.rising(dataset, of.along(dataset.channels))
    cycle = np.zeros(dataset.n_samples) if dataset.cycle is None else dataset.cycle
    numbers = np.unique(cycle[cycle >= 0]).astype(int)
    if not numbers.size:
        raise DatasetError(Fault("no sample belongs to a cycle", where=dataset.name, attempt="find_cycles"))
    found: list[CycleRows] = []
    for number in numbers.tolist():
        rows = np.flatnonzero(cycle == number)
        travel = along[rows]
        dwell = _DWELL * float(np.ptp(travel)) + 3.0 * white_noise(travel)
        top = np.flatnonzero(travel >= travel.max() - dwell)
        found.append(CycleRows(number, rows[: top[0] + 1], rows[top[-1] :]))
    return tuple(found)


def curve(abscissa: Floats, ordinates: dict[str, Floats], n_bins: int) -> tuple[Floats, dict[str, Floats]]:
    """Means of the ordinates over bins of equal width of the abscissa, at the mean abscissa of each bin.

    Unbiased for a straight line, and increasing in the abscissa even if that is noisy.

    Parameters
    ----------
    abscissa
        The abscissa (n,).
    ordinates
        The ordinates (n,) by channel.
    n_bins
        Number of bins.
    """
    lower, upper = float(abscissa.min()), float(abscissa.max())
    if upper <= lower or n_bins < 2:
        return np.array([abscissa.mean()]), {key: np.array([v.mean()]) for key, v in ordinates.items()}
    places = np.minimum((n_bins * (abscissa - lower) / (upper - lower)).astype(int), n_bins - 1)
    counts = np.bincount(places, minlength=n_bins)
    filled = counts > 0

    def means(values: Floats) -> Floats:
        return np.bincount(places, weights=values, minlength=n_bins)[filled] / counts[filled]

    return means(abscissa), {key: means(values) for key, values in ordinates.items()}


@register_step(
    leaves_out="cycles", branch=BRANCH, n_samples=Setting("count"), by=Setting("channel", drives="coordinate")
)
def take_branch(
    dataset: Dataset, branch: Branch = "loading", *, n_samples: int | None = None, by: str | None = None
) -> Dataset:
    """One monotonic curve over an actuator's channel: a branch, or the mean of both, averaged over the cycles.

    Every channel except time is averaged over the cycles on a common grid of that channel; with two or more cycles, the
    scatter of a single cycle about the average becomes the channel's sigma. `mean` is midway between loading and
    unloading, an estimate of the equilibrium curve.

    Parameters
    ----------
    n_samples
        Points of the grid; None takes 200, or fewer if a branch has fewer samples.
    by
        The channel; None: the coordinate of the driven actuator, such as the shortening, or its effort where the record
        has only that.

    Raises
    ------
    DatasetError
        If a requested branch is missing, the cycles have no common range of that channel, or pulley friction was
        corrected for another branch.
    """
    if branch not in ("loading", "unloading", "mean"):
        raise DatasetError(
            Fault("no such branch", where=dataset.name, got=f"'{branch}'", allowed="loading, unloading, mean")
        )
    require_branch(dataset, branch)
    of = driven(dataset, by)
    along = by or of.along(dataset.channels)
    cycles = cycle_rows(dataset, by)
    wanted = ("loading", "unloading") if branch == "mean" else (branch,)
    part = {"loading": lambda cycle: cycle.loading, "unloading": lambda cycle: _let_go(dataset, of, cycle)}
    rows = [[part[one](cycle) for one in wanted] for cycle in cycles]
    smallest = min(len(part) for parts in rows for part in parts)
    if smallest < 2:
        raise DatasetError(
            Fault(
                f"the {' or the '.join(wanted)} branch is missing in a cycle",
                where=dataset.name,
                got=f"{smallest} sample(s)",
                allowed="two or more",
                attempt="another branch, or select_cycles",
            )
        )
    names = [key for key in dataset.channels if key not in ("time", along)]
    n_grid = min(200, smallest) if n_samples is None else n_samples
    sign, travel, ordinates = of.sign(dataset), of.rising(dataset, along), {key: dataset.values(key) for key in names}
    curves = [
        [curve(travel[part], {key: values[part] for key, values in ordinates.items()}, n_grid) for part in parts]
        for parts in rows
    ]
    lower = max(s[0] for parts in curves for s, _ in parts)
    upper = min(s[-1] for parts in curves for s, _ in parts)
    unit = dataset.channels[along].unit
    if upper <= lower:
        raise DatasetError(
            Fault(
                f"the cycles have no range of {along} in common",
                where=dataset.name,
                got=f"{format_quantity(sign * lower, unit)} to {format_quantity(sign * upper, unit)}",
            )
        )
    grid = np.linspace(lower, upper, n_grid)
    channels = {along: replace(dataset.channels[along], values=sign * grid)}
    for key in names:
        stack = np.array([np.mean([np.interp(grid, s, v[key]) for s, v in parts], axis=0) for parts in curves])
        sigma = dataset.channels[key].sigma
        if len(stack) > 1:
            sigma = float(np.sqrt(np.mean(np.var(stack, axis=0, ddof=1))))
        channels[key] = Channel(stack.mean(axis=0), dataset.channels[key].unit, sigma)
    numbers = [cycle.number for cycle in cycles]
    outcome = (
        f"{'mean of loading and unloading' if branch == 'mean' else branch} of {len(numbers)} cycle(s) "
        f"on {n_grid} points, {along} {format_quantity(sign * lower, unit)} to {format_quantity(sign * upper, unit)}"
    )
    if len(numbers) > 1:
        scatter = ", ".join(f"{k} {format_quantity(channels[k].sigma, channels[k].unit)}" for k in names)
        outcome += f"; scatter over the cycles: {scatter}"
    settings = {"branch": branch, "n_samples": n_grid, "cycles": numbers, "by": along}
    step = Step(BRANCH_STEP, settings, outcome)
    return replace(dataset, channels=channels, cycle=None, provenance=(*dataset.provenance, step))


def branch_of(dataset: Dataset) -> Branch | None:
    """The branch selected by `take_branch`; None if none was."""
    return next((step.settings["branch"] for step in dataset.provenance if step.name == BRANCH_STEP), None)


def require_branch(dataset: Dataset, branch: Branch) -> None:
    """Check that pulley friction, if it was corrected, was corrected for this branch.

    Raises
    ------
    DatasetError
        If it was corrected for another branch.
    """
    steps = [step for step in dataset.provenance if step.name == PULLEY_STEP and step.settings["exponent"] > 0.0]
    for step in steps:
        if step.settings["branch"] != branch:
            raise DatasetError(
                Fault(
                    "the friction of the pulleys has the opposite sign on this branch than in its correction",
                    where=dataset.name,
                    got=f"{PULLEY_STEP} for {step.settings['branch']}, take_branch: {branch}",
                    allowed="one branch for both",
                    attempt=f"'branch: {branch}' in {PULLEY_STEP}, or that step after take_branch",
                )
            )


def _let_go(dataset: Dataset, of: DrivenChannels, cycle: CycleRows) -> Ints:
    """Unloading rows, without those at the reversal where friction still has the sign of loading.

    The turning point belongs to loading. If pulley friction was corrected, the branch starts once the tension is below
    the loading branch by the reversal of that friction; if it never is, at the next row.
    """
    exponent = pulley_exponent(dataset)
    if exponent <= 0.0 or len(cycle.loading) < 2:
        return cycle.unloading[1:]
    travel, tension = dataset.values(of.along(dataset.channels)), dataset.values(of.effort)
    order = cycle.loading[np.argsort(travel[cycle.loading], kind="stable")]
    pulled = np.interp(travel[cycle.unloading], travel[order], tension[order])
    reversed_ = tension[cycle.unloading] <= np.exp(-2.0 * _REVERSED * exponent) * pulled
    return cycle.unloading[max(int(np.argmax(reversed_)), 1) :]


def pulley_exponent(dataset: Dataset) -> float:
    """mu times the wrap angle, summed over all pulleys whose friction was corrected."""
    return sum(float(step.settings["exponent"]) for step in dataset.provenance if step.name == PULLEY_STEP)
