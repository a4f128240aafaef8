"""Laws of a file at rest: they must be free of stress and energy there, and stable."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.materials.catalogue import LAWS
from softcal.materials.components import NO_DIRECTION
from softcal.materials.law import Law, compile_law
from softcal.materials.stress_at import points, whole_energy, whole_stress
from softcal.project.document import Findings
from softcal.project.law_schema import OwnLawSection, register_laws
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
    path = ("laws", law.name, "energy")
    values = tuple(theta[name] for name in law.names)
    rest = points(np.eye(3)[None], direction)
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
