"""Stiffness against infill over a fleet: E = E_bulk phi^gamma (paper A, Eq. 5) with a spread between specimens."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.mixed_effects import mixed_effects
from softcal.calibration.statistics.random_effects import DIFFERS
from softcal.checks import Floats
from softcal.plugins.fleet.population import Comparable, Interval
from softcal.plugins.fleet.specimen import Specimen

INFILL = "infill"
FEWEST_LEVELS = 3
FEWEST_SPECIMENS = 5


@dataclass(frozen=True)
class InfillLaw:
    """The law of one modulus.

    Attributes
    ----------
    label, unit
        The parameter and its SI unit.
    exponent, exponent_interval
        gamma [-].
    bulk, bulk_interval
        E_bulk [unit], the law's value at an infill of one.
    spread, spread_interval
        Standard deviation of the logarithm between specimens of one infill [-].
    misfit
        Probability that the means at each infill depart from the law as much where it is true; None where no infill
        has two specimens, or all lie on three infills or fewer than that.
    line
        Infills (50,), the law there [unit], and the ends of its 95 % band, as rows (4, 50).
    """

    label: str
    unit: str
    exponent: float
    exponent_interval: Interval
    bulk: float
    bulk_interval: Interval
    spread: float
    spread_interval: Interval
    misfit: float | None
    line: tuple[tuple[float, ...], ...]

    @property
    def departs(self) -> bool:
        """True if the moduli depart from the law by more than the specimens differ."""
        return self.misfit is not None and self.misfit < DIFFERS


def log_infill(specimens: Sequence[Specimen]) -> dict[str, float]:
    """Specimen -> logarithm of its infill, where the table has one."""
    held = {one.name: one.factors.get(INFILL) for one in specimens}
    return {name: math.log(phi) for name, phi in held.items() if isinstance(phi, float)}


def infill_laws(
    compared: Sequence[Comparable], specimens: Sequence[Specimen]
) -> tuple[tuple[InfillLaw, ...], dict[str, str]]:
    """Law of every modulus [Pa] that is searched by its logarithm, and reasons why others have none, by modulus ("E" if
    there is no modulus). Moduli that cannot be compared are left out of both.
    """
    phi = log_infill(specimens)
    if not phi:
        return (), {}
    moduli = [one for one in compared if _is_modulus(one)]
    found: list[InfillLaw] = []
    searched = any(_is_modulus(e) for one in specimens for e in one.parameters.values())
    why: dict[str, str] = {} if searched else {"E": "no modulus is searched by its logarithm"}
    for one in moduli:
        own = one.only(np.array([name in phi for name in one.names], dtype=bool))
        levels = len({phi[name] for name in own.names})
        if levels < FEWEST_LEVELS:
            why[one.label] = f"the specimens have {levels} different infill{'s' * (levels != 1)}, and it takes three"
        elif len(own.names) < FEWEST_SPECIMENS:
            why[one.label] = f"there are {len(own.names)} specimens, and it takes five"
        else:
            found.append(_law(own, phi))
    return tuple(found), why


def _is_modulus(one: Comparable | Estimate) -> bool:
    return one.unit == "Pa" and one.scale == "log"


def _law(one: Comparable, phi: Mapping[str, float]) -> InfillLaw:
    from softcal.calibration.statistics.intervals import student

    x = np.array([phi[name] for name in one.names])
    fit = mixed_effects(one.values, one.variances, _design(x))
    (low, high), exponent = fit.intervals.tolist()
    at = np.linspace(x.min(), 0.0, 50)
    t = float(student(np.array(float(fit.dof))))
    middle, error = np.array([fit.at(row) for row in _design(at)]).T
    misfit, levels = None, np.unique(x)
    if len(x) >= len(levels) + 2:  # the means against a line through them: each infill but two has a step of its own
        steps = np.array([[float(here == level) for level in levels[1:-1]] for here in x])
        wide = mixed_effects(one.values, one.variances, np.column_stack([_design(x), steps]))
        misfit = wide.chance(np.eye(len(levels))[2:])
    return InfillLaw(
        label=one.label,
        unit=one.unit,
        exponent=float(fit.beta[1]),
        exponent_interval=(exponent[0], exponent[1]),
        bulk=math.exp(float(fit.beta[0])),
        bulk_interval=(math.exp(low), math.exp(high)),
        spread=fit.spread,
        spread_interval=fit.spread_interval,
        misfit=misfit,
        line=(
            tuple(np.exp(at).tolist()),
            *(tuple(np.exp(middle + side * t * error).tolist()) for side in (0.0, -1.0, 1.0)),
        ),
    )


def _design(x: Floats) -> Floats:
    return np.column_stack([np.ones_like(x), x])
