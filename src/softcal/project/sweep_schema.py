"""What may stand in the `sweep` section of a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field

from softcal.project.section import Given, Section, listed


def _entries(value: object) -> object:
    """One value or range as a list of it; a bare number too."""
    return [value] if isinstance(value, int | float) and not isinstance(value, bool) else listed(value)


class SweepSection(Section):
    """A grid over parameters: the values of each, and the experiments that it is judged by (all by default)."""

    over: Annotated[
        Mapping[str, Annotated[list[Given], BeforeValidator(_entries), Field(min_length=1)]], Field(min_length=1)
    ]
    experiments: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
