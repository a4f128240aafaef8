"""Remarks on a solid's law at the strains of a solution: softening in compression, instability."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import doubled, full
from softcal.materials.drucker import is_stable
from softcal.materials.law import Law, compile_law
from softcal.materials.stress_at import Points, whole_stress


def remark(body: str, law: Law, at: Points, values: tuple[float, ...], volume: Floats) -> str:
    """Sentences on a law that softens in compression or is unstable; a blank before each, or "".

    Parameters
    ----------
    body
        Name of the body.
    law
        Its law.
    at
        Deformation at the quadrature points (n,).
    values
        The law's constants [SI].
    volume
        Volumes of the points (n,) [m^3].
    """
    sentences, compiled = "", compile_law(law)
    # It softens where d2psi/dJ2 < 0 along F -> J^(1/3) F: by s, as F -> s F, at s = 1.
    S, D = whole_stress(compiled, at, values)
    C = np.einsum("nki,nkj->nij", at.F, at.F)
    dE = doubled(C)
    by_s = np.einsum("nij,nij->n", full(S), C)
    by_s_twice = by_s + np.einsum("na,nab,nb->n", dE, D, dE)
    softens = (by_s_twice < 2.0 * by_s) & (at.J < 1.0)
    if (ratio := float(at.J[softens].min(initial=1.0))) < 1.0:
        sentences = (
            f" Body {body} is compressed to {ratio:.2g} of its volume, where its law {law.name} softens: the pressure "
            "decreases with further compression."
        )
    if law.is_directed or compiled.is_simple:  # a neo-Hookean law is stable everywhere
        return sentences
    # By the strain without its change of volume.
    stretches = np.linalg.svd(at.F, compute_uv=False) / np.cbrt(at.J)[:, None]
    stable = is_stable(compiled, values, stretches[:, 0], stretches[:, 1])
    if (share := float(volume @ ~stable / volume.sum())) > 0.0:
        sentences += (
            f" In {100 * share:.2g} % of the volume of body {body} its law {law.name} is unstable: more strain takes "
            "less stress (Drucker)."
        )
    return sentences
