"""What may stand in the `parameters`, `calibration` and `print` sections of a project file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from softcal.project.section import Given, Positive, Pressure, Ratio, Section, listed


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
    alpha: Annotated[Ratio, Positive] = 0.3
    beta: Annotated[Ratio, Positive] = 1.0
    method: Literal["least-squares", "tpe", "grid"] = "least-squares"
    trials: Annotated[int, Positive] | None = None
    starts: Annotated[int, Positive] = 3
    seed: Annotated[int, Field(ge=0)] = 1
    fit: Literal["each", "joint", "both"] = "joint"
    hold_out: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    split: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)


class PrintSection(Section):
    """What is known of the print, for the plausibility band E_bulk * infill**exponent."""

    bulk_youngs_modulus: tuple[Pressure, Pressure]
    infill: Ratio
    exponent: tuple[Ratio, Ratio]
