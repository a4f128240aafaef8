"""Write src/softcal/materials/law_sources.json: the functions of softcal's own laws, as SymPy differentiates them."""

from __future__ import annotations

import json

from softcal.materials.catalogue import LAWS
from softcal.materials.law import LAW_SOURCES, Law, fingerprint, law_source, with_least_shift


def own_laws() -> list[Law]:
    """softcal's own laws, each as it is and with a history."""
    added = LAWS.registered
    return [each for law in LAWS.values() if law not in added for each in (law, with_least_shift(law))]


def main() -> None:
    sources = {fingerprint(law): law_source(law) for law in own_laws()}
    LAW_SOURCES.write_text(json.dumps(sources, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
