"""What may stand in the `parameters` and `calibration` sections of a project file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from softcal.calibration.optimiser import OPTIMISERS
from softcal.calibration.settings import SearchSettings
from softcal.declare import listed
from softcal.limits import LIMITS
from softcal.project.section import Given, Section, member_of
from softcal.quantities import PositiveRatio


class PriorSection(Section):
    """What is known of a parameter beforehand, counted by the likelihood loss."""

    mean: Given
    sd: Given


class ParameterSection(Section):
    """A free parameter: its bounds, whether every experiment or set-up has its own, what is tied to have its value."""

    of: Annotated[list[str], BeforeValidator(listed), Field(min_length=1)] | None = None
    bounds: tuple[Given, Given]
    scale: Literal["linear", "log"] = "linear"
    per: Literal["experiment", "set_up"] | None = None
    start: Given | None = None
    prior: PriorSection | None = None


class CalibrationSection(Section):
    """How the free parameters are looked for."""

    loss: Literal["papers", "likelihood", "distance"] = "papers"
    alpha: PositiveRatio = 0.3
    beta: PositiveRatio = 1.0
    method: Annotated[str, member_of(OPTIMISERS)] = SearchSettings.method
    trials: Annotated[int, LIMITS["trials"]] | None = None
    starts: Annotated[int, LIMITS["starts"]] = SearchSettings.starts
    seed: Annotated[int, LIMITS["seeds"]] = 1
    fit: Literal["each", "joint", "both"] = "joint"
    hold_out: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    split: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)

    @property
    def search(self) -> SearchSettings:
        """What decides the course of the search."""
        return SearchSettings(self.method, self.trials, self.seed, self.starts, tuple(self.hold_out))
