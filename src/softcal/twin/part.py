"""Parts of a robot: all have a name, by which messages name their fields."""

from __future__ import annotations

from dataclasses import dataclass, replace

from softcal.declare import Checked
from softcal.errors import InputError
from softcal.limits import part_name_fault


@dataclass(frozen=True)
class NamedPart(Checked):
    """A part of a robot. name: first part of the names of its channels and parameters."""

    name: str

    def __post_init__(self) -> None:
        super().__post_init__()
        if fault := part_name_fault(self._own_name):
            raise InputError(replace(fault, where="name"))

    @property
    def _own_name(self) -> str:
        """The name without that of what it is a part of."""
        return self.name

    def _where(self, name: str) -> str:
        return f"{self.name}.{name}"
