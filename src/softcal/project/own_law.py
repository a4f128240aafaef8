"""Laws of a file at rest: they must be free of stress and energy there, and stable."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from unicodedata import normalize

from softcal.checks import Floats
from softcal.materials.at_rest import require_rest
from softcal.materials.catalogue import LAWS
from softcal.project.document import Findings
from softcal.project.law_schema import OwnLawSection, at_law, register_laws
from softcal.project.section import entries
from softcal.project.yaml_file import read_document


def require_at_rest(law: str, theta: Mapping[str, float], directions: Floats, findings: Findings) -> None:
    """Record a user's law with stress or energy at rest, or without stiffness there, and warn of one that is not
    proportional to its moduli, or has constants without effect; softcal's laws are not checked.

    Parameters
    ----------
    law
        Name of the law.
    theta
        Constants of a body or rod [SI].
    directions
        Its directions (1, 1 or 2, 3).
    findings
        Collects the faults and warnings.
    """
    if law in {one.name for one in LAWS.registered}:
        of = LAWS[law]
        with at_law(law, findings):
            require_rest(of, theta, directions)
            if not of.is_proportional(theta):
                findings.warn(
                    ("laws", law, "energy"),
                    "the energy is not proportional to its moduli and coefficients: a power of a modulus, or a number "
                    "in Pa, which has no unit here, is in it; state that number as a constant",
                )
            # As Python reads names: the Greek mu is that of the unit prefix.
            texts = normalize("NFKC", " ".join((of.distortional, of.bulk, *of.symbols.values())))
            for name in of.names:
                if normalize("NFKC", name) not in re.findall(r"\w+", texts):
                    findings.warn(("laws", law, "constants", name), "no expression has this constant: it has no effect")


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
