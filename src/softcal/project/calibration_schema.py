"""Schema of the `parameters`, `calibration` and `sweep` sections of a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer
from pydantic_core import InitErrorDetails

from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.problem.option import options_of
from softcal.calibration.problem.parameters import FreeParameter, Scale
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.search.settings import SearchSettings
from softcal.declare import listed, member_of
from softcal.errors import Fault, InputError
from softcal.limits import LIMITS
from softcal.project.section import Given, Section, numbered, read_quantities


class PriorSection(Section):
    """Prior knowledge of a parameter, counted by the likelihood loss."""

    mean: Given
    sd: Given


class ParameterSection(Section):
    """A free parameter: its bounds, whether every experiment or set-up has its own, and the parameters tied to its
    value.
    """

    of: Annotated[list[str], BeforeValidator(listed), Field(min_length=1)] | None = None
    bounds: tuple[Given, Given]
    scale: Scale = FreeParameter.scale
    per: Literal["experiment", "set_up"] | None = None
    start: Given | None = None
    prior: PriorSection | None = None


class UncertainSection(Section):
    """A parameter that is neither fitted nor exactly known: its standard deviation, and the parameters that share its
    error.
    """

    sd: Given
    of: Annotated[list[str], BeforeValidator(listed), Field(min_length=1)] | None = None
    per: Literal["experiment", "set_up"] | None = None


class CalibrationSection(Section):
    """Settings of the calibration. The options [SI] of all losses and methods are keys of the file, by their names."""

    loss: Annotated[str, member_of(LOSSES)] = "papers"
    options: Mapping[str, int | float] = Field(default_factory=dict)
    method: Annotated[str, member_of(OPTIMISERS)] = SearchSettings.method
    trials: Annotated[int, LIMITS["trials"]] | None = None
    seed: Annotated[int, LIMITS["seeds"]] = SearchSettings.seed
    fit: Literal["each", "joint", "both"] = "joint"
    hold_out: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    split: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    mesh_error: bool = True

    @classmethod
    def _allowed(cls, given: Mapping[str, Any]) -> set[str]:
        return super()._allowed(given) - {"options"} | set(options_of())

    @classmethod
    def _read(cls, given: Mapping[str, Any]) -> tuple[dict[str, Any], list[InitErrorDetails]]:
        kinds = {name: option.kind for name, option in options_of().items()}
        options, errors = read_quantities(given, kinds)
        defaults = {name: option.default for name, option in options_of().items()}
        return {**{k: v for k, v in given.items() if k not in kinds}, "options": {**defaults, **options}}, errors

    @model_serializer(mode="wrap")
    def _written(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The options among the keys, as a file has them."""
        written: dict[str, Any] = write(self)
        return {**written.pop("options"), **written}

    @property
    def search(self) -> SearchSettings:
        """Settings of a search; `mesh_error` applies to the result that is reported first."""
        options = {option.name: self.options[option.name] for option in OPTIMISERS[self.method].options}
        return SearchSettings(self.method, self.trials, self.seed, tuple(self.hold_out), options=options)


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
