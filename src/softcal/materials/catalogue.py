"""The laws there are, by name."""

from __future__ import annotations

from collections.abc import Mapping

from softcal.materials.law import Law
from softcal.materials.neo_hooke import NEO_HOOKE, NEO_HOOKE_ISOCHORIC

LAWS: Mapping[str, Law] = {law.name: law for law in (NEO_HOOKE, NEO_HOOKE_ISOCHORIC)}
