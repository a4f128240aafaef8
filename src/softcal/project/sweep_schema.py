"""Schema of the `sweep` section of a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field

from softcal.declare import listed
from softcal.errors import Fault, InputError
from softcal.project.section import Given, Section, numbered


class SweepSection(Section):
    """A grid over parameters: the values of each, and the experiments that it is judged by (all by default).

    show: configurations of the twin to draw side by side, by name; omitted parameters are nominal.
    """

    over: Annotated[
        Mapping[str, Annotated[list[Given], BeforeValidator(numbered), Field(min_length=1)]], Field(min_length=1)
    ]
    experiments: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    show: Mapping[str, Mapping[str, Given]] = Field(default_factory=dict)

    def _check(self) -> None:
        for name, values in self.show.items():
            others = [key for key in values if key not in self.over]
            if others:
                got, allowed = f"{', '.join(others)} in {name}", ", ".join(self.over)
                raise InputError(
                    Fault("a configuration to show has a parameter that is not swept", got=got, allowed=allowed)
                )
