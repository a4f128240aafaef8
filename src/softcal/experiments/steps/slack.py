"""Slack removal: the taut point, at which the effort rises from its floor, is fitted by two lines and subtracted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.driven import DrivenChannels, driven
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.branches import take_branch
from softcal.sensing.channel import in_a_word
from softcal.units import format_quantity

_MIN_SAMPLES = 3  # on the floor, and on the rising line


@dataclass(frozen=True)
class TautPoint:
    """The point at which an actuator begins to load the robot, such as a cable that becomes taut.

    With the signs of the record; units are those of the actuator's channels, of a cable m and N.

    Attributes
    ----------
    coordinate
        Coordinate there [SI].
    floor
        Effort before it [SI].
    stiffness
        Slope of the effort over the coordinate just after it [SI].
    rmse
        Misfit of the two lines [SI].
    """

    coordinate: float
    floor: float
    stiffness: float
    rmse: float


def find_slack(dataset: Dataset, threshold: float | None = None, by: str | None = None) -> TautPoint:
    """The taut point of the loading branch, averaged over the cycles.

    A constant (the floor) and a rising line that intersect at the taut point are fitted by least squares.

    Parameters
    ----------
    dataset
        The record.
    threshold
        Of the samples for the fit: how far [SI] they rise above the lowest effort; None: a quarter of its range.
    by
        A channel of the actuator; None: of the one that the record drives.

    Raises
    ------
    DatasetError
        If no floor is found, as when the record starts with a taut cable.
    """
    of = driven(dataset, by)
    sign, unit = of.sign(dataset), of.units[1]
    branch = take_branch(dataset, "loading", by=of.coordinate)
    travel, effort = sign * branch.values(of.coordinate), sign * branch.values(of.effort)
    base = float(np.min(effort))
    rise = 0.25 * float(np.ptp(effort)) if threshold is None else abs(threshold)
    above = np.flatnonzero(effort > base + rise)
    n_fit = int(above[above > int(np.argmin(effort))][0]) if above.size else len(effort)
    s, force = travel[:n_fit], effort[:n_fit]
    if n_fit < 2 * _MIN_SAMPLES:
        raise _no_floor(dataset, of, f"{n_fit} samples up to {format_quantity(sign * (base + rise), unit)}")

    def misfit(taut: float) -> float:
        return _two_lines(s, force, taut)[2]

    inner = s[_MIN_SAMPLES:-_MIN_SAMPLES] if n_fit > 2 * _MIN_SAMPLES else s[_MIN_SAMPLES - 1 : _MIN_SAMPLES + 1]
    best = int(np.argmin([misfit(taut) for taut in inner]))
    lower, upper = inner[max(best - 1, 0)], inner[min(best + 1, len(inner) - 1)]
    from scipy.optimize import minimize_scalar

    finest = 1e-9 if of.is_cable else 5e-8 * float(np.ptp(s))  # a nanometre is as fine for a cable of some cm
    refined: Any = minimize_scalar(misfit, bounds=(lower, upper), method="bounded", options={"xatol": finest})
    taut = min((float(refined.x), float(inner[best])), key=misfit)
    floor, stiffness, rmse = _two_lines(s, force, taut)
    if best == 0 or stiffness <= 0.0:
        at = format_quantity(sign * float(force[0]), unit)
        raise _no_floor(dataset, of, f"the {in_a_word(of.effort)} rises from its first sample, {at}")
    return TautPoint(sign * taut, sign * floor, stiffness, rmse)


@register_step(
    slack=Setting("of channel", channel_from="by", drives="coordinate"),
    threshold=Setting("of channel", channel_from="by", drives="effort", former="threshold_force"),
    subtract_floor=Setting("flag"),
    keep_slack_samples=Setting("flag"),
    by=Setting("channel", drives="coordinate"),
)
def remove_slack(
    dataset: Dataset,
    slack: float | None = None,
    *,
    threshold: float | None = None,
    subtract_floor: bool = False,
    keep_slack_samples: bool = False,
    by: str | None = None,
) -> Dataset:
    """The dataset with the coordinate measured from the taut point, without the samples before it.

    Parameters
    ----------
    slack
        Coordinate at the taut point [SI], such as the shortening; None finds it (`find_slack`).
    subtract_floor
        Subtract the floor from the effort, as an offset of the load cell or the gauge.
    keep_slack_samples
        Keep the samples before the taut point, at a negative shortening.
    by
        A channel of the actuator; None: of the one that the record drives.

    Raises
    ------
    DatasetError
        If no taut point is found, or no sample lies beyond it.
    """
    of = driven(dataset, by)
    (unit, effort_unit), travel = of.units, dataset.values(of.coordinate)
    found = find_slack(dataset, threshold, by) if slack is None or subtract_floor else None
    taut = slack if slack is not None else (found.coordinate if found is not None else 0.0)
    values = {of.coordinate: travel - taut}
    words = f"{of.coordinate} measured from the taut point at {format_quantity(taut, unit)}"
    if found is not None:
        words += (
            f"; {in_a_word(of.effort)} floor {format_quantity(found.floor, effort_unit)}, stiffness after it "
            f"{of.slope_in_words(found.stiffness)}, two lines fit to {format_quantity(found.rmse, effort_unit)}"
        )
        if subtract_floor:
            values[of.effort] = dataset.values(of.effort) - found.floor
            words += f"; floor subtracted from the {of.effort}"
    beyond = of.sign(dataset) * values[of.coordinate]
    kept = np.ones(dataset.n_samples, dtype=bool) if keep_slack_samples else beyond >= 0.0
    if not kept.any():
        raise DatasetError(
            Fault(
                "the whole record is slack",
                where=dataset.name,
                got=f"slack {format_quantity(taut, unit)}",
                allowed=f"less than {format_quantity(float(travel[np.argmax(beyond)]), unit)}",
            )
        )
    dropped = int(np.count_nonzero(~kept))
    settings = {
        "slack": taut,
        "threshold": threshold,
        "subtract_floor": subtract_floor,
        "keep_slack_samples": keep_slack_samples,
        "by": of.coordinate,
    }
    step = Step("remove_slack", settings, f"{words}; {dropped} samples before it removed")
    shifted = dataset.with_channels(step, **values)
    # One provenance step for both the shift and the removed rows.
    return replace(shifted.take(kept, step), provenance=shifted.provenance)


def _two_lines(s: Floats, force: Floats, taut: float) -> tuple[float, float, float]:
    """Floor, stiffness and root-mean-square misfit of a constant that becomes a rising line at `taut`."""
    matrix = np.column_stack([np.ones_like(s), np.maximum(s - taut, 0.0)])
    solution = np.linalg.lstsq(matrix, force, rcond=None)[0]
    rmse = float(np.sqrt(np.mean((matrix @ solution - force) ** 2)))
    return float(solution[0]), float(solution[1]), rmse


def _no_floor(dataset: Dataset, of: DrivenChannels, got: str) -> DatasetError:
    word = in_a_word(of.effort)
    begins = "the cable slack" if of.is_cable else f"a {word} that does not rise"
    free = "slack" if of.is_cable else of.kinds[0].offset[0] if of.kinds[0].offset else ""
    return DatasetError(
        Fault(
            f"no floor of the {word} before {'the cable is taut' if of.is_cable else 'it rises'}",
            where=dataset.name,
            got=got,
            allowed=f"a loading branch that begins with {begins}",
            attempt="remove_slack with the slack given"
            + (f", or make the {free} a parameter of the calibration" if free else ""),
        )
    )
