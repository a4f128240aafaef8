"""Conclusions of a mesh study: shift of each parameter by the mesh, compared with its standard error."""

from __future__ import annotations

from softcal.analysis.mesh_study import LIMIT, Finer, MeshStudy
from softcal.calibration.results.digits import shown, with_unit
from softcal.calibration.statistics.estimate import Estimate, Remark, Tone
from softcal.calibration.statistics.noise import DRIFT
from softcal.units import format_quantity, readable_unit

_COUNTS = "by noise"
# Shifts in standard errors: hidden by noise up to the first, a warning from the second on.
HIDDEN, DECIDES = 1.0, 3.0
# Shifts over a parameter's range: negligible below the first; beyond the second, local derivatives are not valid.
_NEAR, _FAR = 1e-3, 0.3


def mesh_verdicts(study: MeshStudy) -> tuple[Remark, ...]:
    """One sentence per robot parameter, and advice if a refinement is needed."""
    best = study.best
    if best is None:
        why = " ".join(f"{one.name}: {one.failure}" for one in study.finer)
        return (Remark(f"The influence of the mesh is unknown: no finer mesh was simulated. {why}", "warning"),)
    found = [_verdict(label, study, best) for label in study.of_robot]
    if not found:
        found = [Remark("No parameter of the robot was free, so none is biased by the mesh.", "note")]
    if any(one.tone == "warning" for one in found):
        remedies: list[str] = []
        if any(element != study.element for element in study.elements):
            remedies.append(f"{study.element} elements")
        if study.elements:
            remedies.append("a finer mesh")
        if study.size.rod_elements:
            remedies.append("more elements along the rods")
        text = f"This error exceeds the noise: use {' or '.join(remedies)}, and calibrate again."
        found.append(Remark(text, "warning"))
    return tuple(found)


def shift_in_errors(estimate: Estimate, value: float) -> float | None:
    """Distance of another value from an estimate over its standard error by noise; None if it has none.

    Differences between experiments are not in it: the mesh's error is the same in all of them. Nor is the range that
    the bounds leave open, which is that of all errors together.
    """
    error = estimate.error_by("noise", DRIFT, "prior")
    return (value - estimate.value) / error if error else None


def shift_text(estimate: Estimate, value: float) -> str:
    """Distance of another value from an estimate, also in standard errors: "+1.4 MPa (12 s.e.)"."""
    unit, errors = readable_unit(estimate.value, estimate.unit), shift_in_errors(estimate, value)
    text = format_quantity(value - estimate.value, estimate.unit, unit, digits=2)
    text = text if value <= estimate.value else f"+{text}"
    return text if errors is None else f"{text} ({times_text(errors)} s.e.)"


def times_text(times: float) -> str:
    """A ratio without sign: "0.3", "12", "540"."""
    size = abs(times)
    return f"{size:.2g}" if size < 100.0 else f"{size:.0f}"


def reference_text(study: MeshStudy) -> str:
    """The reference discretisation in words."""
    best = study.best
    if best is None:
        return "nothing finer"
    return "at zero element size (extrapolated)" if best.name == LIMIT else f"with {best.what}"


def _verdict(label: str, study: MeshStudy, best: Finer) -> Remark:
    estimate, value = study.parameters[label], best.values[label]
    unit = readable_unit(estimate.value, estimate.unit)
    here, there = (with_unit(estimate, shown(estimate, v)) for v in (estimate.value, value))
    errors = shift_in_errors(estimate, value)
    if estimate.at_bound and abs(value - estimate.value) <= _NEAR * (estimate.upper - estimate.lower):
        text = f"{label} is at a bound, {here}, and is expected there on a finer mesh too."
        return Remark(text, "note")
    side = "low" if value > estimate.value else "high"
    change = abs(value - estimate.value)
    if change == 0.0:
        return Remark(f"The mesh does not shift {label}.", "good")
    if estimate.unit == "1" or value == 0.0:
        by = format_quantity(change, estimate.unit, unit, digits=2)
    else:
        by = f"{100.0 * change / abs(value):.2g} %"
    least = " or more" if label in best.at_bound and not estimate.at_bound else ""
    if errors is not None and abs(errors) <= HIDDEN:
        hidden = f"{times_text(errors)} times its standard error {_COUNTS}."
        return Remark(f"The mesh makes {label} too {side} by {by}{least}, {hidden}", "good")
    text = f"The mesh makes {label} too {side} by {by}{least}: {here}, where {there} is expected"
    text += f" {reference_text(study)}."
    if label in best.at_bound:
        text += " That value is a bound."
    if estimate.unit == "1" and change > _FAR * (estimate.upper - estimate.lower):
        text += " This is beyond the validity of local derivatives: only the direction is reliable."
    if errors is None:
        return Remark(f"{text} It has no standard error to compare with.", "note")
    size = abs(errors)
    tone: Tone = "warning" if size > DECIDES else "note"
    return Remark(f"{text} That is {times_text(size)} times its standard error {_COUNTS}.", tone)
