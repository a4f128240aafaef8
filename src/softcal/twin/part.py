"""Parts of a robot: all have a name, by which messages name their fields."""

from __future__ import annotations

from dataclasses import dataclass

from softcal.declare import Checked


@dataclass(frozen=True)
class NamedPart(Checked):
    """A part of a robot. name: first part of the names of its channels and parameters."""

    name: str

    def _where(self, name: str) -> str:
        return f"{self.name}.{name}"
