"""Laws compared on coupon tests, and the one that is recommended."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.results.digits import value_text
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import CalibrationError, Fault, ParameterError
from softcal.html_text import summary
from softcal.materials.catalogue import LAWS
from softcal.materials.histories import history_of
from softcal.materials.inelastic import History
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import POISSONS_RATIO, FreeConstants, free_constants
from softcal.plugins.coupons.held_out import folds, held_out_errors, joint_error
from softcal.plugins.coupons.law_fit import LawFit, fit_law
from softcal.quantities import PoissonsRatio, PositiveRatio
from softcal.units import format_quantity

REACH = 1.5
"""Default stretch up to which stability is looked at, over the largest of the tests."""
NEARLY = 1.1
"""Laws whose error on tests held out is at most so many times the least count as equally good."""
_SAME = 1e-6  # of the root mean square of the stresses


@displayed
@dataclass(frozen=True)
class ComparedLaw:
    """A fitted law, and its errors on tests held out.

    Attributes
    ----------
    fit
        The fit to all tests.
    held_out
        What was held out -> root-mean-square error over the root mean square of the stresses of its kind [-]; infinite
        where the law's energy does not exist there.
    """

    fit: LawFit
    held_out: Mapping[str, float]

    @property
    def name(self) -> str:
        """The law's name."""
        return self.fit.law.name

    @property
    def doubts(self) -> list[str]:
        """The reason why the law is not recommended."""
        return ["unstable"] * (not self.fit.stability.is_stable) + ["not determined"] * (not self.fit.is_determined)

    @property
    def held_out_error(self) -> float:
        """Root mean square over what was held out [-]."""
        return joint_error(list(self.held_out.values()))


@displayed
@dataclass(frozen=True)
class LawComparison:
    """Laws fitted to the same tests.

    Attributes
    ----------
    coupons
        The tests.
    laws
        The laws, by their error on tests held out.
    same_as
        Law that was left out -> the law that has the same stresses in an incompressible body.
    left_out
        Law that cannot be fitted -> why, a sentence.
    poissons_ratio
        That of the body, which is stated [-].
    history
        What the material does beyond each law: names of `softcal.materials.histories`.
    """

    coupons: tuple[Coupon, ...]
    laws: tuple[ComparedLaw, ...]
    same_as: Mapping[str, str]
    left_out: Mapping[str, str]
    poissons_ratio: float
    history: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        rows: list[list[str]] = []
        for one in self.laws:
            E = format_quantity(one.fit.small_strain.youngs_modulus, "Pa", digits=3)
            constants = ", ".join(f"{name} = {value_text(e)}" for name, e in one.fit.estimates.items())
            errors = (f"{100 * error:.1f} %" for error in (one.fit.error, one.held_out_error))
            rows.append([one.name, *errors, E, constants, ", ".join(one.doubts)])
        header = ["law", "error", "held out", "E at small strain", "constants", "doubts"]
        chosen = "none" if self.recommended is None else self.recommended.name
        return summary(f"{len(self.coupons)} tests; recommended: {chosen}", header, rows)

    @property
    def recommended(self) -> ComparedLaw | None:
        """Of the stable laws with constants that the tests determine, and with nearly the least error on tests held
        out, the one with the fewest constants.
        """
        fits = [one for one in self.laws if one.fit.stability.is_stable and one.fit.is_determined]
        stable = [one for one in fits if math.isfinite(one.held_out_error)]
        least = min((one.held_out_error for one in stable), default=0.0)
        good = [one for one in stable if one.held_out_error <= NEARLY * least]
        return min(good, key=lambda one: (len(one.fit.values), one.held_out_error), default=None)

    @property
    def shown(self) -> ComparedLaw:
        """The recommended law, or the one with the least error on tests held out."""
        return self.recommended or self.laws[0]

    @property
    def kept_out(self) -> str:
        """The tests that were held out in turn, in words."""
        has_history = bool(self.history)
        names = [fold.name for fold in folds(self.coupons, has_history=has_history)]
        tests = {coupon.test for coupon in self.coupons}
        if has_history and len(self.coupons) > 1:
            return f"each of {len(names)} tests"
        return "each kind of test" if len(tests) > 1 else f"each of {len(names)} blocks of neighbouring rows"


@checked_arguments
def compare_laws(
    coupons: Sequence[Coupon],
    laws: Sequence[str] = (),
    *,
    history: Sequence[str] = (),
    poissons_ratio: PoissonsRatio = POISSONS_RATIO,
    reach: PositiveRatio | None = None,
    doing: Callable[[str], None] = lambda _: None,
) -> LawComparison:
    """Fit laws to coupon tests and compare them.

    Parameters
    ----------
    laws
        Names; none: every law that has an incompressible form and no direction.
    history
        What the material does beyond each law, names of parts; the rows of each test are then a way.
    poissons_ratio
        That of the body [-]; tests of incompressible coupons do not determine it.
    reach
        The stretch up to which stability is looked at [-]; default: 1.5 times the largest of the tests.
    doing
        Called with what is being done.

    Raises
    ------
    ParameterError
        For an unknown law, or a named one that cannot be fitted; for an unknown part of a history, and one that needs
        the times of a test without them. All faults at once.
    CalibrationError
        Where no law can be fitted.
    """
    if not coupons:
        raise ParameterError(Fault("there are none", "coupons", allowed="one test or more"))
    reach = REACH * max(coupon.largest_stretch for coupon in coupons) if reach is None else reach
    # The constants of every law that can be fitted, and why others cannot: a fault where they are named.
    faults = [LAWS.unknown(name, "--law") for name in laws if name not in LAWS]
    try:
        history_of(history, "--history")
    except ParameterError as error:
        raise ParameterError([*faults, *error.faults]) from None
    constants: list[FreeConstants] = []
    left_out: dict[str, str] = {}
    for name in dict.fromkeys(laws or LAWS):
        if name not in LAWS:
            continue
        try:
            constants.append(free_constants(LAWS[name], poissons_ratio, history))
        except ParameterError as error:
            faults += error.faults if laws else []
            left_out[name] = error.faults[0].what
    if faults:
        raise ParameterError(faults)
    coupons = [one if history or one.time is not None else one.along_strain() for one in coupons]
    require_times(coupons, history_of(history))
    found: list[ComparedLaw] = []
    same_as: dict[str, str] = {}
    for one in constants:
        name = one.law.name
        doing(f"fitting {name}")
        try:
            fit = fit_law(one, coupons, reach)
        except CalibrationError as error:
            left_out[name] = str(error)
            continue
        twin = next((other.name for other in found if _are_same(fit, other.fit)), "")
        if twin:
            same_as[name] = twin
            continue
        doing(f"predicting tests held out by {name}")
        found.append(ComparedLaw(fit, held_out_errors(fit, coupons)))
    if not found:
        raise CalibrationError(" ".join(["No law can be fitted.", *left_out.values()]))
    ranked = tuple(sorted(found, key=lambda one: one.held_out_error))
    return LawComparison(tuple(coupons), ranked, same_as, left_out, poissons_ratio, tuple(history))


def require_times(coupons: Sequence[Coupon], history: History) -> None:
    """Check that tests have times where a history needs them.

    Raises
    ------
    ParameterError
        With every test that has none.
    """
    if not any(part.needs_time for part in history.parts):
        return
    faults = [
        Fault(
            "this history needs the times of the rows",
            f"{one.test} test of '{one.name}'",
            "no column 'time'",
            "a column 'time [s]', from rest on",
        )
        for one in coupons
        if one.time is None
    ]
    if faults:
        raise ParameterError(faults)


def _are_same(one: LawFit, other: LawFit) -> bool:
    """Whether two laws of as many constants predict the same stresses."""
    if len(one.values) != len(other.values):
        return False
    apart = [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(one.predicted, other.predicted, strict=True)]
    return max(apart) < _SAME


def require_apart(coupons: Sequence[Coupon]) -> None:
    """Check that no two tests of a kind are of one specimen.

    Raises
    ------
    ParameterError
        With every specimen that is doubled.
    """
    names = [(coupon.test, coupon.name) for coupon in coupons]
    faults = [
        Fault(
            f"two {test} tests are of one specimen",
            got=f"'{name}'",
            attempt="files of different names, or a column 'specimen'",
        )
        for test, name in dict.fromkeys(names)
        if names.count((test, name)) > 1
    ]
    if faults:
        raise ParameterError(faults)
