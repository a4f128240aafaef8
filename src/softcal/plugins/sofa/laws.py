"""SOFA's laws: softcal's with the same energy, by SOFA's name of the material."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

MATERIALS: Mapping[str, str] = {
    "neo-hooke": "NeoHookean",
    "stable-neo-hooke": "StableNeoHookean",
    "stvenant-kirchhoff": "StVenantKirchhoff",
    "sofa-mooney-rivlin": "MooneyRivlin",
    "sofa-ogden": "Ogden",
    "sofa-arruda-boyce": "ArrudaBoyce",
}


def material(law: str, theta: Mapping[str, float]) -> dict[str, Any]:
    """A body's law in the scene's parameters, at softcal's constants theta [SI]; law: one of `MATERIALS`.

    The constants are E and nu, of which the scene makes mu and Lame's lambda, or those of SOFA's ParameterSet.
    """
    name = MATERIALS[law]
    if name == "Ogden":
        own = [theta["mu1"] * theta["alpha1"], theta["alpha1"], theta["bulk_modulus"]]
    elif name == "MooneyRivlin":
        own = [theta["C10"], theta["C01"], theta["bulk_modulus"]]
    elif name == "ArrudaBoyce":
        own = [theta["chain_modulus"], theta["bulk_modulus"]]
    else:
        return {"material": name, **{key: theta[key] for key in ("youngs_modulus", "poissons_ratio")}}
    return {"material": name, "constants": own}
