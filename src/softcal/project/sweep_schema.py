"""What may stand in the `sweep` section of a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field

from softcal.project.section import Given, Section, listed, numbered


class SweepSection(Section):
    """A grid over parameters: the values of each, and the experiments that it is judged by (all by default)."""

    over: Annotated[
        Mapping[str, Annotated[list[Given], BeforeValidator(numbered), Field(min_length=1)]], Field(min_length=1)
    ]
    experiments: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
