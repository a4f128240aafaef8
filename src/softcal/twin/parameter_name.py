"""The name of a parameter: its owner, its kind, and the experiment that has a value of its own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParameterName:
    """The parts of a parameter's name: `front.slack[20mm]` is the `slack` of `front` in the experiment `20mm`."""

    owner: str
    kind: str
    experiment: str = ""

    @property
    def part(self) -> str:
        """The part of the robot or of the rig that it belongs to: `bar` of `bar.core.youngs_modulus`."""
        return self.owner.partition(".")[0]

    @property
    def base(self) -> str:
        """The dotted name without the experiment."""
        return f"{self.owner}.{self.kind}" if self.owner else self.kind


def parameter_name(name: str) -> ParameterName:
    """Parse a parameter's name."""
    base, _, experiment = name.partition("[")
    owner, _, kind = base.rpartition(".")
    return ParameterName(owner, kind, experiment.removesuffix("]"))
