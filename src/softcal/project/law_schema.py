"""`laws:` of a project file: an elastic law of the user's own, by the text of its energy."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from softcal.errors import Fault, InputError
from softcal.materials.catalogue import LAWS
from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.project.document import Findings
from softcal.project.section import Section
from softcal.quantities import quantity

# Kind of quantity of a constant -> a value that is typical of soft prints, to check the law with.
KINDS = {"modulus": 1e6, "coefficient": 1e4, "ratio": 1.0, "positive ratio": 2.0, "Poisson's ratio": 0.45}
# The invariants of the deformation without its change of volume.
ISOCHORIC = {"I1_bar": "J**(-2/3)*I1", "I2_bar": "J**(-4/3)*I2"}


class OwnLawSection(Section):
    """A law: its energy, the kinds of its constants, abbreviations, and its volumetric part kappa/2 g(J)^2."""

    energy: str
    constants: Mapping[str, Annotated[str, Field(min_length=1)]]
    symbols: Mapping[str, str] = Field(default_factory=dict)
    bulk: str = "kappa"
    volumetric_strain: str = "J - 1"
    reference: str = "the project file"

    def _check(self) -> None:
        faults = [
            Fault("a constant cannot be of this kind", f"constants.{name}", f"'{kind}'", ", ".join(KINDS))
            for name, kind in self.constants.items()
            if kind not in KINDS
        ]
        faults += [
            Fault("this stands for an invariant", f"{key}.{name}", name, attempt="another name")
            for key, names in (("constants", self.constants), ("symbols", self.symbols))
            for name in ISOCHORIC.keys() & names.keys()
        ]
        if faults:
            raise InputError(faults)

    def law(self, name: str) -> Law:
        """The law of this name."""
        parameters = [
            Parameter(key, key, key, quantity(kind), typical=KINDS[kind]) for key, kind in self.constants.items()
        ]
        used = {key: text for key, text in ISOCHORIC.items() if key in self.energy or key in str(self.symbols)}
        return Law(
            name=name,
            parameters=tuple(parameters),
            symbols={**used, **self.symbols},
            distortional=self.energy,
            volumetric_strain=self.volumetric_strain,
            bulk=self.bulk,
            reference=self.reference,
        )


def register_laws(sections: Mapping[str, OwnLawSection], findings: Findings) -> None:
    """Make the laws of a file known; faults go to `findings`."""
    for name, section in sections.items():
        with at_law(name, findings):
            LAWS.add(section.law(name))


@contextmanager
def at_law(name: str, findings: Findings) -> Generator[None]:
    """Context that records the faults of an `InputError`, each at the key of its law."""
    try:
        yield
    except InputError as error:
        for fault in error.faults:
            # Such as "law stiffening, symbols.a"; what a file calls energy is the law's distortional one.
            key = fault.where.removeprefix(f"law {name}, ").replace("distortional", "energy")
            path = key.split(".") if key.partition(".")[0] in OwnLawSection.model_fields else ()
            findings.take(("laws", name, *path), [replace(fault, where="" if path else fault.where)])
