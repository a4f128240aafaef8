"""The part of a project file that states a material by its coupon tests, with priors for further bodies.

Three or more specimens of one kind of test show how far specimens differ. The constants of a further body of that
material are then expected around the joint values, with a standard deviation by the scatter between the specimens and
the error of their mean: the prior of a free parameter.
"""

from __future__ import annotations

from softcal.calibration.results.digits import NORMAL_95
from softcal.plugins.coupons.comparison import LawComparison
from softcal.plugins.coupons.law_fit import LawFit
from softcal.plugins.coupons.tables import modulus_texts
from softcal.project.yaml_file import yaml_text
from softcal.units import format_quantity, plain

ENOUGH = 3  # specimens of one kind of test
_DIGITS = 6
_REACH = 5.0  # half-width of the bounds over the standard deviation


def material_block(fit: LawFit, comparison: LawComparison, body: str) -> str:
    """Lines of a project file with a body's law, its constants, and priors for them where the scatter between specimens
    is known.

    Parameters
    ----------
    fit
        Fitted constants of the law.
    comparison
        Fits of all laws, with the coupons.
    body
        Name of the body.
    """
    block: dict[str, object] = {"law": fit.law.name}
    for parameter in (*fit.law.parameters, *fit.constants.history.parameters):
        block[parameter.name] = _value(fit.theta[parameter.name], parameter.quantity.unit)
    if fit.constants.parts:
        block["history"] = list(fit.constants.parts)
    at = fit.small_strain
    E, ends = modulus_texts(at)
    G = format_quantity(at.shear_modulus, "Pa", digits=3)
    tests = [coupon.test for coupon in comparison.coupons]
    shown = ", ".join(f"{tests.count(x)} {x} test{'s' * (tests.count(x) > 1)}" for x in dict.fromkeys(tests))
    lines = [
        f"# By softcal coupon, from {shown}. Poisson's ratio is stated, not measured.",
        f"# Keys of robot.bodies.{body}:",
        yaml_text(block).rstrip(),
        f"# At small strain E {E}{f' ({ends})' if ends else ''}, nu {plain(at.poissons_ratio, 4)},",
        f"# G = {at.formula} = {G}.",
        f"# A rod (robot.rods.{body}) takes the law and its constants as well, and uses this E and nu at any strain.",
    ]
    found = priors(fit, comparison)
    lines.append("")
    if not found:
        return "\n".join([*lines, f"# {no_prior(comparison)}"]) + "\n"
    parameters: dict[str, object] = {}
    for parameter in fit.constants.fitted:
        if parameter.name not in found:
            continue
        mean, sd = found[parameter.name]
        unit, quantity = parameter.quantity.unit, parameter.quantity
        low, high = mean - _REACH * sd, mean + _REACH * sd
        if quantity.lower >= 0.0:
            low = max(low, mean / 10.0)
        bounds = [_value(x, unit) for x in (low, min(high, quantity.upper))]
        prior = {"mean": _value(mean, unit), "sd": _value(sd, unit, digits=3)}
        parameters[f"{body}.{parameter.name}"] = {"bounds": bounds, "prior": prior}
    lines += [
        "# And this, where the constants are free or uncertain, one of a further body of this material:",
        yaml_text({"parameters": parameters}, levels=2).rstrip(),
    ]
    return "\n".join(lines) + "\n"


def _value(value: float, unit: str, digits: int = _DIGITS) -> str | float:
    """A value as a project file has it: a text with a unit, or a bare number."""
    text = format_quantity(value, unit, digits=digits)
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError:
        return text


def priors(fit: LawFit, comparison: LawComparison) -> dict[str, tuple[float, float]]:
    """Constant -> mean and standard deviation [SI] expected of a further body; empty with too few specimens."""
    if _most_specimens(comparison) < ENOUGH:
        return {}
    found: dict[str, tuple[float, float]] = {}
    for name, spread in fit.statistics.spreads.items():
        if spread.next_interval is not None:
            low, high = spread.next_interval
            found[name] = (fit.theta[name], (high - low) / (2.0 * NORMAL_95))
    return found


def no_prior(comparison: LawComparison) -> str:
    """Reason why there is no prior."""
    n = _most_specimens(comparison)
    if n < ENOUGH:
        specimens = f"{n} specimen{'s' * (n > 1)} of one kind of test"
        return f"No prior: {specimens}; how far specimens differ is seen from {ENOUGH} on."
    return "No prior: the specimens alone do not determine the constants."


def _most_specimens(comparison: LawComparison) -> int:
    tests = [coupon.test for coupon in comparison.coupons]
    return max(tests.count(test) for test in tests)
