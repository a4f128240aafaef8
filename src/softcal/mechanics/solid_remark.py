"""What must be known of a solid's law at the strains that it reached."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import doubled, full
from softcal.materials.drucker import is_stable
from softcal.materials.law import Law, compile_law
from softcal.materials.stress_at import Points, whole_stress


def remark(body: str, law: Law, at: Points, values: tuple[float, ...], volume: Floats) -> str:
    """Sentences with a blank before each, or "", on points with these volumes (n,) at the values of the constants."""
    told = ""
    if (ratio := _softened(law, at, values)) < 1.0:
        told = (
            f" Body {body} is compressed to {ratio:.2g} of its volume, where its law {law.name} softens: the pressure "
            "decreases with further compression."
        )
    if (share := _unstable(law, at, values, volume)) > 0.0:
        told += (
            f" In {100 * share:.2g} % of the volume of body {body} its law {law.name} is unstable: more strain takes "
            "less stress (Drucker)."
        )
    return told


def _softened(law: Law, at: Points, values: tuple[float, ...]) -> float:
    """The least volume ratio J < 1 at a point whose law softens in compression, d2psi/dJ2 < 0 along F -> J^(1/3) F; 1
    where there is none.
    """
    S, D = whole_stress(compile_law(law), at, values)
    C = np.einsum("nki,nkj->nij", at.F, at.F)
    dE = doubled(C)
    by_s = np.einsum("nij,nij->n", full(S), C)  # as F -> s F, at s = 1
    by_s_twice = by_s + np.einsum("na,nab,nb->n", dE, D, dE)
    gives_way = (by_s_twice < 2.0 * by_s) & (at.J < 1.0)
    return float(at.J[gives_way].min(initial=1.0))


def _unstable(law: Law, at: Points, values: tuple[float, ...], volume: Floats) -> float:
    """The share of the volume in which the law is unstable at the strain reached, the change of volume apart; of a law
    without a direction. A neo-Hookean one is stable everywhere.
    """
    if law.is_directed or compile_law(law).is_simple:
        return 0.0
    stretches = np.linalg.svd(at.F, compute_uv=False) / np.cbrt(at.J)[:, None]
    stable = is_stable(compile_law(law), values, stretches[:, 0], stretches[:, 1])
    return float(volume @ ~stable / volume.sum())
