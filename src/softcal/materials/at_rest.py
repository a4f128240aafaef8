"""A law at rest: it must be free of stress and energy there, and stable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import permutations

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, InputError
from softcal.materials.law import SOME_STRETCHES, STRETCHES, Law, compile_law
from softcal.materials.stress_at import Deformation, points, volumetric, whole_energy

AT_REST = 1e-9  # of the moduli: the largest stress that rounding leaves


def require_rest(law: Law, theta: Mapping[str, float] | None = None, directions: Floats | None = None) -> None:
    """Refuse a law that is not at rest without strain.

    Parameters
    ----------
    law
        The law.
    theta
        Its constants [SI]; None: typical ones.
    directions
        Unit vectors (1, 1 or 2, 3) of a law that has directions; None: any.

    Raises
    ------
    InputError
        Where it is not free of stress and energy there, gives way, or has derivatives that are not finite.
    """
    given = {one.name: one.typical for one in law.parameters} if theta is None else theta
    values = tuple(np.float64(given[name]) for name in law.names)
    along = np.eye(3)[None] if directions is None else directions
    at = ", ".join(f"{name} {value:.4g}" for name, value in zip(law.names, values, strict=True))
    with np.errstate(all="ignore"):
        if fault := _fault_at_rest(law, values, at, along):
            raise InputError(replace(fault, where=f"law {law.name}, distortional"))


def _fault_at_rest(law: Law, values: tuple[float, ...], at: str, directions: Floats) -> Fault | None:
    compiled = compile_law(law)
    shear, factor, bulk = (float(of(*values)) for of in (compiled.shear, compiled.bulk, compiled.compressed))
    for what, value in (("shear modulus", shear), ("factor bulk", factor), ("bulk modulus", bulk)):
        if not 0.0 < value < np.inf:
            return Fault(f"the {what} at rest is not above zero", got=f"{value:.4g} Pa, at {at}")
    rest = Deformation(compiled, points(np.eye(3)[None], directions))
    S, D = rest.stress(values, volumetric(compiled, rest.at.J, factor))
    stress, energy = float(abs(S).max()), float(whole_energy(compiled, rest.at, values)[0])
    if not stress <= AT_REST * (shear + bulk):
        return Fault("the law is not free of stress at rest", got=f"{stress:.4g} Pa, at {at}", allowed="0 Pa")
    if not abs(energy) <= AT_REST * (shear + bulk):
        got, attempt = f"{energy:.4g} J/m^3, at {at}", "the same energy, less this constant"
        return Fault("the energy at rest is not zero", got=got, allowed="0 J/m^3", attempt=attempt)
    if not all(np.isfinite(one).all() for one in (D, rest.energy_by_parameters(values))):
        return Fault("the law has a derivative at rest that is not a finite number", got=f"at {at}")
    if law.variables == STRETCHES:
        found = [float(compiled.energy(*order, *values)) for order in permutations(SOME_STRETCHES)]
        if not np.ptp(found) <= AT_REST * np.abs(found).max():
            what, allowed = "the energy changes where the stretches change places", "one that is symmetric in them"
            return Fault(what, got=f"{min(found):.4g} and {max(found):.4g} J/m^3, at {at}", allowed=allowed)
    return None
