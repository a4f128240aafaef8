"""Sentences on coupon tests and the laws fitted to them: the recommended law and the reason, and doubts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softcal.calibration.statistics.estimate import Remark
from softcal.calibration.statistics.sensitivity import ONE_EXPERIMENT, not_included
from softcal.plugins.coupons.comparison import ComparedLaw, LawComparison
from softcal.plugins.coupons.fitted_material import PredictedCoupon
from softcal.plugins.coupons.tables import modulus_texts, percent
from softcal.report.format import joined
from softcal.units import format_quantity, plain

HOLDS = 0.8
"""A 95 % band that holds less of a test than this is too narrow for it: the rows of a test are not independent."""


def verdict(found: LawComparison) -> str:
    """Sentence on the recommended law, and the reason."""
    chosen = found.recommended
    sizes = ", ".join(f"{plain(size, 3)} {mode}" for mode, size in found.laws[0].fit.stability.measured.items())
    up_to = f"up to strains of the size measured (stretches of {sizes})"
    if chosen is None:
        return f"No law is recommended: none is stable {up_to}, with constants that the tests determine."
    return (
        f"Recommended: {with_history(chosen)}, stable {up_to}. Where {found.kept_out} is predicted by the others its "
        f"error is {percent(chosen.held_out_error, 1)}, nearly the least of the stable laws with constants that the "
        "tests determine, and it has the fewest constants of those."
    )


def moduli(one: ComparedLaw) -> str:
    """The moduli of a law at small strain, and what its constants have to do with them."""
    at = one.fit.small_strain
    E, ends = modulus_texts(at)
    G = format_quantity(at.shear_modulus, "Pa", digits=3)
    long_after = " after a long time" if one.fit.constants.parts else ""
    return (
        f"At small strain{long_after} {one.name} has E = {E}{f' ({ends})' if ends else ''} and "
        f"ν = {plain(at.poissons_ratio, 4)}, which is stated: its shear modulus is {at.formula} = {G}. "
        "Rods use these moduli at any strain."
    )


def with_history(one: ComparedLaw) -> str:
    """A law with its history: "yeoh with maxwell-2"."""
    return " with ".join([one.name, *[joined(one.fit.constants.parts)] * bool(one.fit.constants.parts)])


def warnings(found: LawComparison, predicted: Sequence[PredictedCoupon]) -> list[str]:
    """Remarks before the numbers: on the shown law, and on bands that do not contain a further test."""
    one, said = found.shown, list[str]()
    stability, estimates = one.fit.stability, one.fit.estimates
    if not stability.is_stable:
        ends = [
            f"{mode} tension from a stretch of {plain(end, 3)}" if end > 1.0 else f"{mode} tension from rest on"
            for mode, end in stability.limits.items()
            if end is not None and end <= stability.measured[mode]
        ]
        where = joined(ends) if ends else "a measured state"
        text = f"{one.name} is unstable within strains of the size measured: in {where}."
        said.append(f"{text} A simulation may give way there.")
    for names, why in (
        ([name for name, e in estimates.items() if e.at_bound], "at the bound of the search"),
        ([name for name, e in estimates.items() if e.interval is None and not e.at_bound], "without an interval"),
    ):
        if names:
            said.append(f"The tests do not determine {joined(names)} of {one.name}: {why}.")
    missed = [p for p in predicted if p.is_measured and p.inside < HOLDS]
    if missed:
        shares = joined(f"{percent(p.inside, 0)} of {p.coupon.name}" for p in missed)
        said.append(f"The 95 % band is too narrow for tests that were not fitted: it holds {shares}.")
    return said


def conclusions(found: LawComparison, predicted: Sequence[PredictedCoupon]) -> list[Remark]:
    """On the stability, on laws that are nearer and not recommended, on the specimens, and on each prediction; warnings
    first.
    """
    said: list[Remark] = []
    one = found.shown
    stability = one.fit.stability
    if stability.is_stable:
        ends = [f"{plain(end, 3)} in {mode}" for mode, end in stability.limits.items() if end is not None]
        if ends:
            beyond = f"beyond strains of the size measured: from a stretch of {joined(ends)} tension"
            text = f"{one.name} gives way only {beyond}."
        else:
            text = f"up to a stretch of {plain(stability.reach, 3)}, the largest that was looked at"
            text = f"{one.name} is stable in {joined(stability.limits)} tension {text}."
        said.append(Remark(text, "good"))
    nearer: list[str] = []
    for other in found.laws:
        if found.recommended is not None and other.held_out_error < found.recommended.held_out_error:
            why = " and ".join(other.doubts) or f"{len(other.fit.values)} constants for nearly the same error"
            nearer.append(f"{other.name} ({percent(other.held_out_error, 1)}, {why})")
    if nearer:
        text = f"Nearer on what was held out, and not recommended: {joined(nearer)}."
        said.append(Remark(text, "note"))
    material, n = one.fit.material, len(found.coupons)
    if material.covariance is None:
        text = f"{one.name} has no 95 % bands: not all of its constants have intervals."
        said.append(Remark(text, "warning"))
    elif names := [name for name, sd in zip(material.constants.names, material.spread, strict=True) if sd > 0.0]:
        said.append(Remark(f"The tests differ, in {joined(names)}: the 95 % bands include how far.", "good"))
    else:
        text = "One test does not show how far specimens differ: the 95 % bands may be too narrow for another specimen."
        if n > 1:
            text = (
                f"The {n} tests do not show how far specimens differ: the 95 % bands do not include it, and may be too "
                "narrow for another specimen."
            )
        said.append(Remark(text, "warning"))
    said.append(Remark(moduli(one), "note"))
    for p in predicted:
        if p.is_measured:
            text = f"{p.coupon.name}, which was not fitted, is predicted with an NMAD of {percent(p.nmad, 2)}"
            holds = np.isfinite(p.inside)
            text += f"; the 95 % band holds {percent(p.inside, 0)} of its stresses." if holds else "; it has no band."
            if math.isfinite(p.factor) and math.isfinite(p.nmad_by_factor):
                better = f"the NMAD would be {percent(p.nmad_by_factor, 2)}"
                text += f" With the predicted stresses times {plain(p.factor, 3)} {better}."
            said.append(Remark(text, "good" if holds and p.inside >= HOLDS else "warning"))
    of_robots = ONE_EXPERIMENT, not_included(())
    said += [note for note in one.fit.statistics.notes if note.text not in of_robots]
    return sorted(said, key=lambda sentence: sentence.tone != "warning")
