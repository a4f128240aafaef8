"""The pressure at which touching surfaces overlap by the contact's depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from softcal.materials.law import Law
from softcal.mechanics.term import Theta, part_theta
from softcal.units import format_quantity


@dataclass(frozen=True)
class ContactStiffness:
    """A pressure, or a factor times the mean modulus of some parts: then it follows their parameters.

    Attributes
    ----------
    factor
        The pressure [Pa]; with laws, a factor [-].
    laws
        Part -> its law, of which Young's modulus at small strain counts.
    """

    factor: float
    laws: Mapping[str, Law] = field(default_factory=dict[str, Law])

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names in theta of the parameters on which the pressure depends."""
        return tuple(f"{part}.{name}" for part, law in self.laws.items() for name in law.names)

    def at(self, theta: Theta) -> float:
        """The pressure [Pa] at parameters theta [SI]."""
        if not self.laws:
            return self.factor
        moduli = [law.youngs_modulus(part_theta(theta, part)) for part, law in self.laws.items()]
        return self.factor * sum(moduli) / len(moduli)

    def rates(self, theta: Theta) -> dict[str, float]:
        """The pressure's derivatives by its parameters at theta [SI]."""
        return {
            f"{part}.{name}": self.factor * rate / len(self.laws)
            for part, law in self.laws.items()
            for name, rate in law.youngs_modulus_rates(part_theta(theta, part)).items()
        }

    def in_words(self) -> str:
        """The pressure, for a table."""
        return f"{self.factor:g} times the modulus" if self.laws else format_quantity(self.factor, "Pa")
