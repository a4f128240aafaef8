"""A law of the project file at rest: it must be free of stress and energy there, and stable."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from softcal.materials.catalogue import LAWS
from softcal.materials.law import compile_law
from softcal.materials.stress_at import points, whole_energy, whole_stress
from softcal.project.document import Findings
from softcal.twin.robot import Body

AT_REST = 1e-9  # of the moduli: the largest stress that rounding leaves


def require_at_rest(body: Body, own: Collection[str], findings: Findings) -> None:
    """Record a law of the file that is not free of stress and energy at rest, or gives way there, at the constants of
    a body.
    """
    if body.law not in own:
        return
    law, path = LAWS[body.law], ("laws", body.law, "energy")
    values = tuple(body.parameters[name] for name in law.names)
    rest = points(np.eye(3)[None], body.direction)
    compiled = compile_law(law)
    shear, bulk = float(compiled.shear(*values)), float(compiled.bulk(*values))
    at = ", ".join(f"{name} {value:.4g}" for name, value in zip(law.names, values, strict=True))
    for what, value in (("shear modulus", shear), ("bulk modulus of the volumetric part", bulk)):
        if not value > 0.0:
            findings.add(path, f"the {what} at rest is not above zero", got=f"{value:.4g} Pa, at {at}")
            return
    stress = float(abs(whole_stress(compiled, rest, values, tangent=False).S).max())
    energy = float(whole_energy(compiled, rest, values)[0])
    if not stress <= AT_REST * (shear + bulk):
        findings.add(path, "the law is not free of stress at rest", got=f"{stress:.4g} Pa, at {at}", allowed="0 Pa")
    elif not abs(energy) <= AT_REST * (shear + bulk):
        got, attempt = f"{energy:.4g} J/m^3, at {at}", "the same energy, less this constant"
        findings.add(path, "the energy at rest is not zero", got=got, allowed="0 J/m^3", attempt=attempt)
