"""The statement of a fleet as sentences."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence

from softcal.calibration.problem.parameters import Scale
from softcal.calibration.statistics.estimate import Remark
from softcal.plugins.fleet.factors import FactorEffect
from softcal.plugins.fleet.infill_law import INFILL
from softcal.plugins.fleet.population import Interval, Population
from softcal.plugins.fleet.specimen import Specimen
from softcal.plugins.fleet.statement import FleetStatement
from softcal.units import format_quantity, plain, readable_unit, rounded, unit_factor

_AS_RATIO = 0.2
_NAMED = 5
_DIGITS = re.compile(r"[\d.]+")
_FIRST = re.compile(r": |\. ")  # where the first statement of a warning ends


def fleet_sentences(specimens: Sequence[Specimen], found: FleetStatement) -> tuple[Remark, ...]:
    """Sentences on a fleet: failures, each parameter, the factors, the infill."""
    texts: list[Remark] = []
    failed = [one for one in specimens if one.state == "FAILED"]
    if failed:
        named = "; ".join(f"{one.name}: {one.reason.splitlines()[0]}" for one in failed[:_NAMED])
        more = "; …" if len(failed) > _NAMED else ""
        n = len(specimens)
        texts.append(Remark(f"{len(failed)} of {n} specimens failed, and do not count: {named}{more}", "warning"))
    done = [one for one in specimens if one.state == "DONE"]
    if warned := [one for one in done if one.warnings]:
        kinds: dict[str, list[tuple[str, str]]] = {}  # warnings may differ in their numbers
        for one in warned:
            for text in one.warnings:
                kinds.setdefault(_DIGITS.sub("", text), []).append((one.name, text))
        often = max(kinds.values(), key=len)
        name, text = often[0]
        said = f"{len(warned)} of {len(done)} calibrated specimens {'has' if len(warned) == 1 else 'have'} warnings"
        first = _FIRST.split(text)[0].rstrip(".")
        n = len(dict.fromkeys(name for name, _ in often))
        also = f", and the like of {n - 1} more" if n > 1 else ""
        texts.append(Remark(f"{said}: {first} ({name}){also}. specimens/NAME.json has all.", "warning"))
    if found.same_data:
        groups = "; ".join(map(_names, found.same_data[:_NAMED])) + ("; …" if len(found.same_data) > _NAMED else "")
        text = f"Specimens share data files but are counted separately: {groups}."
        texts.append(Remark(text, "warning"))
    if found.done < 2:
        what = "There is one specimen" if found.done else "No specimen was calibrated"
        texts.append(Remark(f"{what}: differences between specimens cannot be estimated.", "note"))
        return tuple(texts)
    for one in found.populations:
        texts += _population(one)
    texts += [
        Remark(f"{label}: no statement on the population of the specimens: {why}.", "warning")
        for label, why in found.unknown.items()
    ]
    texts += [sentence for one in found.effects if (sentence := _effect(one, found)) is not None]
    texts += [Remark(f"No comparison by {name}: {why}.", "note") for name, why in found.not_compared.items()]
    for one, other in found.not_apart:
        text = f"{other.capitalize()} determines {one} in this table: a difference by one can be one by the other."
        texts.append(Remark(text, "note"))
    for one in found.laws:
        exponent = value_text(one.exponent, one.exponent_interval, "1")
        text = (
            f"{one.label} = {value_text(one.bulk, one.bulk_interval, one.unit)} · φ^{exponent}: exponent "
            f"{ends_text(one.exponent_interval, '1', one.exponent)}, value of a solid print "
            f"{ends_text(one.bulk_interval, one.unit, one.bulk)}; specimens of one infill differ by "
            f"{spread_text(one.spread, 'log', one.unit, one.bulk)}."
        )
        if one.departs:
            chance = chance_text(one.misfit or 0.0)
            text += f" The moduli depart from this law by more than the specimens differ (chance {chance})."
        texts.append(Remark(text, "warning" if one.departs else "good"))
    texts += [
        Remark(f"The law of {label} against the infill cannot be fitted: {why}.", "note")
        for label, why in found.no_law.items()
    ]
    return tuple(texts)


def _names(names: Collection[str]) -> str:
    return ", ".join(list(names)[:_NAMED]) + (", …" if len(names) > _NAMED else "")


def spread_text(spread: float, scale: Scale, unit: str, value: float, *, as_ratio: bool = False) -> str:
    """Spread between specimens as text: in per cent, or a large one as a factor, on the log scale; else with its unit.

    Parameters
    ----------
    spread
        Standard deviation [unit]; on the log scale of the logarithm [-].
    scale
        Scale of the parameter: log or linear.
    unit
        SI unit.
    value
        Value of the parameter [unit], whose prefix of the unit is used.
    as_ratio
        Always as a factor on the log scale.
    """
    if scale != "log":
        return format_quantity(spread, unit, readable_unit(value, unit), digits=2)
    return f"a factor of {_ratio(spread)}" if as_ratio or spread >= _AS_RATIO else f"{plain(100 * spread, 2)} %"


def spread_of(one: Population) -> tuple[str, str]:
    """The spread of a population, and its interval with the unit once."""
    low, high = one.spread_interval
    is_ratio = one.scale == "log" and high >= _AS_RATIO
    ends = [spread_text(end, one.scale, one.unit, one.mean) for end in (low, high)]
    unit = ends[1].rpartition(" ")[2]
    told = f"{_ratio(low)} to {_ratio(high)}" if is_ratio else f"{ends[0].removesuffix(f' {unit}')} to {ends[1]}"
    return spread_text(one.spread, one.scale, one.unit, one.mean, as_ratio=is_ratio), told


def _ratio(spread: float) -> str:
    return f"{math.exp(spread):#.3g}".rstrip(".") if spread < math.log(1e4) else "more than 10000"


def value_text(value: float, interval: Interval, unit: str) -> str:
    """A value as text, to the digits of its interval, with its unit.

    Parameters
    ----------
    value
        The value [unit].
    interval
        The interval [unit].
    unit
        SI unit.
    """
    return _text((value,), interval, unit, value)


def ends_text(interval: Interval, unit: str, value: float) -> str:
    """An interval as text, such as "1.94 to 2.02 MPa", in the prefix of the unit that its value has.

    Parameters
    ----------
    interval
        The interval [unit].
    unit
        SI unit.
    value
        The value [unit].
    """
    return _text(interval, interval, unit, value)


def _text(values: Sequence[float], interval: Interval, unit: str, value: float) -> str:
    shown = readable_unit(value, unit)
    factor = unit_factor(shown, unit)
    half = 0.5 * (interval[1] - interval[0]) / factor
    text = " to ".join(rounded(number / factor, half, least=1) for number in values)
    return text if shown == "1" else f"{text} {shown}"


def chance_text(chance: float) -> str:
    """A probability: "0.03", "below 0.0001"."""
    return "below 0.0001" if chance < 1e-4 else plain(chance, 2)


def _population(one: Population) -> list[Remark]:
    mean = "geometric mean" if one.scale == "log" else "mean"
    text = (
        f"{one.label}: {mean} {value_text(one.mean, one.interval, one.unit)} "
        f"({ends_text(one.interval, one.unit, one.mean)}) of {one.n} specimens."
    )
    chance = f"chance {chance_text(one.chance)}"
    if one.differs:
        text += f" They differ by more than their errors ({chance}): {_spread(one)}."
    elif one.spread_interval[1] > 0.0:
        most = spread_text(one.spread_interval[1], one.scale, one.unit, one.mean)
        text += f" No difference between them is seen beyond their errors ({chance}); their spread is at most {most}."
    else:
        text += f" No difference between them is seen beyond their errors ({chance})."
    if one.is_pooled:
        text += " The errors depend on the value, so that all specimens count alike."
    if one.further is not None:
        text += f" A further specimen is expected at {ends_text(one.further, one.unit, one.mean)}."
    found = [Remark(text, "good" if one.differs or one.n > 2 else "note")]
    if one.left_out:
        named = _names(one.left_out)
        reasons = "; ".join(dict.fromkeys(one.left_out.values()))
        found.append(Remark(f"{one.label}: {named} left out ({reasons}).", "warning"))
    if one.without is not None:
        rest = one.without
        far = ", ".join(f"{o.name} ({format_quantity(o.value, one.unit, digits=3)})" for o in one.outliers)
        plural = len(one.outliers) > 1
        text = (
            f"{one.label}: {far} {'are' if plural else 'is'} not like the other specimens (chance "
            f"{chance_text(one.outliers[0].chance)}); without {'them' if plural else 'it'} the {mean} is "
            f"{value_text(rest.mean, rest.interval, rest.unit)} "
            f"({ends_text(rest.interval, rest.unit, rest.mean)})"
        )
        found.append(Remark(f"{text}, and {_spread(rest)}.", "warning"))
    return found


def _spread(one: Population) -> str:
    spread, ends = spread_of(one)
    return f"their spread is {spread} ({ends})"


def _effect(one: FactorEffect, found: FleetStatement) -> Remark | None:
    """Sentence on a factor with an effect, or on a factor without one if the specimens differ in the parameter."""
    of = next(p for p in found.populations if p.label == one.label)
    chance = f"chance {chance_text(one.chance)}"
    alike = "" if one.at_infill is None else f", at an infill of {level_text(one.at_infill, INFILL)}"
    about = "" if one.at_infill is None else " about the law"
    if one.differs:
        share = "" if one.explained is None else f", which is {plain(100 * one.explained, 2)} % of the variance{about}"
        groups = "; ".join(
            f"{level_text(g.level, one.factor)} {value_text(g.mean, g.interval, of.unit)} "
            f"({ends_text(g.interval, of.unit, g.mean)}, n = {g.n})"
            for g in one.groups[:_NAMED]
        )
        more = "; …" if len(one.groups) > _NAMED else ""
        return Remark(f"{one.label} differs by {one.factor}{alike} ({chance}){share}: {groups}{more}.", "good")
    if of.differs:
        return Remark(f"{one.label}: no difference by {one.factor} is seen{alike} ({chance}).", "note")
    return None


def level_text(level: str | float, factor: str) -> str:
    """The value of a factor."""
    if isinstance(level, str):
        return level
    return f"{plain(100 * level, 3)} %" if factor == INFILL else plain(level, 6)
