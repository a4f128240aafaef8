"""Laws of a file at rest: they must be free of stress and energy there, and stable."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, InputError
from softcal.materials.catalogue import LAWS
from softcal.materials.components import NO_DIRECTION
from softcal.materials.law import SOME_STRETCHES, STRETCHES, Law, compile_law
from softcal.materials.stress_at import Deformation, points, volumetric, whole_energy
from softcal.project.document import Findings
from softcal.project.law_schema import OwnLawSection, at_law, register_laws
from softcal.project.section import entries
from softcal.project.yaml_file import read_document

AT_REST = 1e-9  # of the moduli: the largest stress that rounding leaves


def require_at_rest(
    law: str, theta: Mapping[str, float], direction: Floats, own: Collection[str], findings: Findings
) -> None:
    """Record a law that is not free of stress and energy at rest, or gives way there, at the constants theta [SI] of a
    body or rod; own: the laws of the file, which alone are looked at.
    """
    if law in own:
        _check_at_rest(LAWS[law], theta, direction, findings)


def read_laws(path: Path) -> None:
    """Make the laws of a file known, from its block `laws:`, as a project file has one.

    Raises
    ------
    ProjectFileError
        With everything that is wrong with them; each is checked at rest with typical constants.
    StorageError
        Where the file cannot be read.
    """
    document = read_document(path, "file of laws", "laws: {NAME: {energy: …, constants: …}}", "docs/project-file.md")
    findings = Findings(document)
    laws = entries(OwnLawSection, "laws", document, findings)
    if not document.mapping("laws"):
        findings.add((), "the file has no laws", got=", ".join(document.data), allowed="laws: {NAME: {energy: …}}")
    register_laws(laws, findings)
    for name in laws:
        if name in LAWS:
            _check_at_rest(LAWS[name], {p.name: p.typical for p in LAWS[name].parameters}, NO_DIRECTION, findings)
    findings.raise_if_any()


def _check_at_rest(law: Law, theta: Mapping[str, float], direction: Floats, findings: Findings) -> None:
    values = tuple(np.float64(theta[name]) for name in law.names)
    at = ", ".join(f"{name} {value:.4g}" for name, value in zip(law.names, values, strict=True))
    with at_law(law.name, findings), np.errstate(all="ignore"):
        if fault := _fault_at_rest(law, values, at, direction):
            raise InputError(replace(fault, where=f"law {law.name}, distortional"))


def _fault_at_rest(law: Law, values: tuple[float, ...], at: str, direction: Floats) -> Fault | None:
    compiled = compile_law(law)
    shear, factor, bulk = (float(of(*values)) for of in (compiled.shear, compiled.bulk, compiled.compressed))
    for what, value in (("shear modulus", shear), ("factor bulk", factor), ("bulk modulus", bulk)):
        if not 0.0 < value < np.inf:
            return Fault(f"the {what} at rest is not above zero", got=f"{value:.4g} Pa, at {at}")
    rest = Deformation(compiled, points(np.eye(3)[None], direction))
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
