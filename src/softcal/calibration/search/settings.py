"""The settings of a search: one object from the project file and the command line to the optimiser."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

from softcal.calibration.problem.option import Option
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import InputError, ParameterError, unknown
from softcal.limits import LIMITS


@displayed
@dataclass(frozen=True)
class SearchSettings(Checked):
    """The settings of a search.

    Attributes
    ----------
    method
        The optimiser's name: "least-squares" (exact sensitivities), "tpe" (Optuna, as paper A), "grid" (as paper B), or
        one that was registered.
    trials
        Budget: trials, of "least-squares" those of each start; grid points at most. The optimiser's own when None.
    seed
        Seed of the starts and of TPE. Everything else is deterministic.
    hold_out
        Experiments that are not fitted but predicted afterwards; see `softcal.calibration.search.hold_out`.
    batch
        Points asked for before the first of them is evaluated; the optimiser's own when None.
    options
        Option of the optimiser -> its value [SI]; its default where it is left out. Those of other optimisers are
        ignored.
    mesh_error
        Whether the intervals include the error of the mesh, by one more simulation on a finer one
        (`statistics/mesh_error.py`). It is no part of the search: a run can be resumed with it or without.
    """

    method: str = "least-squares"
    trials: Annotated[int, LIMITS["trials"]] | None = None
    seed: Annotated[int, LIMITS["seeds"]] = 1
    hold_out: tuple[str, ...] = ()
    batch: Annotated[int, LIMITS["trials"]] | None = None
    options: Mapping[str, float] = field(default_factory=dict[str, float])
    mesh_error: bool = False

    def changed(self, **changes: object) -> SearchSettings:
        """The settings with some of them, or options of an optimiser by their names, replaced."""
        own = {one.name for one in fields(self)}
        given: dict[str, Any] = {name: value for name, value in changes.items() if name in own}
        others: dict[str, Any] = {name: value for name, value in changes.items() if name not in own}
        return replace(self, **{**given, "options": {**self.options, **given.get("options", {}), **others}})

    def record(self) -> dict[str, Any]:
        """The `complete` settings as a run stores them and a result reports them."""
        recorded: dict[str, Any] = {name: getattr(self, name) for name in ("method", "trials", "seed")}
        recorded |= {**self.options, "batch": self.batch}
        if self.hold_out:
            recorded["hold_out"] = list(self.hold_out)
        return recorded

    def complete(self, *, trials: int, batch: int, options: Sequence[Option], known: Collection[str]) -> SearchSettings:
        """These settings with the optimiser's defaults filled in, and without the options of others.

        Parameters
        ----------
        trials, batch
            The optimiser's defaults.
        options, known
            The optimiser's options, and the names of those of all optimisers.

        Raises
        ------
        ParameterError
            For a number that makes no sense, or an option that no optimiser has.
        """
        budget = self.trials if self.trials is not None else trials
        allowed = [*(one.name for one in fields(self)), *(option.name for option in options)]
        faults = [
            unknown("there is no such setting of a search", name, name, allowed, got="")
            for name in self.options
            if name not in known
        ]
        values: dict[str, float] = {}
        for option in options:
            try:
                value = self.options.get(option.name, option.default)
                values[option.name] = option.kind.checked(value, where=option.name)
            except InputError as error:
                faults += error.faults
        if faults:
            raise ParameterError(faults)
        return replace(self, trials=budget, batch=self.batch if self.batch is not None else batch, options=values)
