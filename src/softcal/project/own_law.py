"""Laws of a file at rest: they must be free of stress and energy there, and stable."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from softcal.checks import Floats
from softcal.materials.at_rest import require_rest
from softcal.materials.catalogue import LAWS
from softcal.project.document import Findings
from softcal.project.law_schema import OwnLawSection, at_law, register_laws
from softcal.project.section import entries
from softcal.project.yaml_file import read_document


def require_at_rest(law: str, theta: Mapping[str, float], direction: Floats, findings: Findings) -> None:
    """Record a user's law with stress or energy at rest, or without stiffness there; softcal's laws are not checked.

    Parameters
    ----------
    law
        Name of the law.
    theta
        Constants of a body or rod [SI].
    direction
        Build direction (3,).
    findings
        Collects the faults and warnings.
    """
    if law in {one.name for one in LAWS.registered}:
        with at_law(law, findings):
            require_rest(LAWS[law], theta, direction)


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
            with at_law(name, findings):
                require_rest(LAWS[name])
    findings.raise_if_any()
