"""Slack removal: the taut point, at which the force rises from its floor, is fitted by two lines and subtracted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.branches import take_branch
from softcal.units import format_quantity

_MIN_SAMPLES = 3  # on the floor, and on the rising line


@dataclass(frozen=True)
class TautPoint:
    """The point at which the cable becomes taut.

    Attributes
    ----------
    shortening
        Shortening there [m].
    floor
        Force before it [N].
    stiffness
        Stiffness just after it [N/m].
    rmse
        Misfit of the two lines [N].
    """

    shortening: float
    floor: float
    stiffness: float
    rmse: float


def find_slack(dataset: Dataset, threshold_force: float | None = None) -> TautPoint:
    """The taut point of the loading branch, averaged over the cycles.

    A constant (the floor) and a rising line that intersect at the taut point are fitted by least squares to the samples
    up to `threshold_force` [N] above the lowest force; None takes a quarter of the force's range.

    Raises
    ------
    DatasetError
        If no floor is found, as when the record starts with a taut cable.
    """
    branch = take_branch(dataset, "loading")
    shortening, tension = branch.values("shortening"), branch.values("tension")
    base = float(np.min(tension))
    rise = 0.25 * float(np.ptp(tension)) if threshold_force is None else threshold_force
    above = np.flatnonzero(tension > base + rise)
    n_fit = int(above[above > int(np.argmin(tension))][0]) if above.size else len(tension)
    s, force = shortening[:n_fit], tension[:n_fit]
    if n_fit < 2 * _MIN_SAMPLES:
        raise _no_floor(dataset, f"{n_fit} samples below {format_quantity(base + rise, 'N')}")

    def misfit(taut: float) -> float:
        return _two_lines(s, force, taut)[2]

    inner = s[_MIN_SAMPLES:-_MIN_SAMPLES] if n_fit > 2 * _MIN_SAMPLES else s[_MIN_SAMPLES - 1 : _MIN_SAMPLES + 1]
    best = int(np.argmin([misfit(taut) for taut in inner]))
    lower, upper = inner[max(best - 1, 0)], inner[min(best + 1, len(inner) - 1)]
    from scipy.optimize import minimize_scalar

    refined: Any = minimize_scalar(misfit, bounds=(lower, upper), method="bounded", options={"xatol": 1e-9})
    taut = min((float(refined.x), float(inner[best])), key=misfit)
    floor, stiffness, rmse = _two_lines(s, force, taut)
    if best == 0 or stiffness <= 0.0:
        raise _no_floor(dataset, f"the force rises from its first sample, {format_quantity(float(force[0]), 'N')}")
    return TautPoint(taut, floor, stiffness, rmse)


@register_step(
    slack=Setting("slack"),
    threshold_force=Setting("force"),
    subtract_floor=Setting("flag"),
    keep_slack_samples=Setting("flag"),
)
def remove_slack(
    dataset: Dataset,
    slack: float | None = None,
    *,
    threshold_force: float | None = None,
    subtract_floor: bool = False,
    keep_slack_samples: bool = False,
) -> Dataset:
    """The dataset with the shortening measured from the taut point, without the samples before it.

    Parameters
    ----------
    slack
        Shortening at the taut point [m]; None finds it (`find_slack`).
    subtract_floor
        Subtract the force floor from the tension, as an offset of the load cell.
    keep_slack_samples
        Keep the samples before the taut point, at negative shortening.

    Raises
    ------
    DatasetError
        If no taut point is found, or no sample lies beyond it.
    """
    found = find_slack(dataset, threshold_force) if slack is None or subtract_floor else None
    taut = slack if slack is not None else (found.shortening if found is not None else 0.0)
    values = {"shortening": dataset.values("shortening") - taut}
    words = f"shortening measured from the taut point at {format_quantity(taut, 'm')}"
    if found is not None:
        words += (
            f"; force floor {format_quantity(found.floor, 'N')}, stiffness after it "
            f"{found.stiffness / 1000.0:.4g} N/mm, two lines fit to {format_quantity(found.rmse, 'N')}"
        )
        if subtract_floor:
            values["tension"] = dataset.values("tension") - found.floor
            words += "; floor subtracted from the tension"
    kept = np.ones(dataset.n_samples, dtype=bool) if keep_slack_samples else values["shortening"] >= 0.0
    if not kept.any():
        raise DatasetError(
            Fault(
                "the whole record is slack",
                where=dataset.name,
                got=f"slack {format_quantity(taut, 'm')}",
                allowed=f"less than {format_quantity(float(dataset.values('shortening').max()), 'm')}",
            )
        )
    dropped = int(np.count_nonzero(~kept))
    settings = {
        "slack": taut,
        "threshold_force": threshold_force,
        "subtract_floor": subtract_floor,
        "keep_slack_samples": keep_slack_samples,
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


def _no_floor(dataset: Dataset, got: str) -> DatasetError:
    return DatasetError(
        Fault(
            "no floor of the force before the cable is taut",
            where=dataset.name,
            got=got,
            allowed="a loading branch that begins with the cable slack",
            attempt="remove_slack with the slack given, or make the slack a parameter of the calibration",
        )
    )
