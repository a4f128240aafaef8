"""The settings of a search: one object from the project file and the command line to the optimiser."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from softcal.errors import Fault, ParameterError, nearest


@dataclass(frozen=True)
class SearchSettings:
    """The settings of a search.

    Attributes
    ----------
    method
        The optimiser's name: "least-squares" (exact sensitivities), "tpe" (Optuna, as paper A), "grid" (as paper B), or
        one that was registered.
    trials
        Budget: trials, grid points at most, or trajectories of each start of "least-squares". The optimiser's own when
        None.
    seed
        Of the starts and of TPE. Everything else is deterministic.
    starts
        Local searches of "least-squares": the first from the parameters' start, the others from a Latin hypercube, in
        case the first ends in a minimum that is not the lowest. Each costs one trajectory where its model predicts no
        minimum that is lower by a hundredth, and none where the first has fitted the measurements exactly.
    hold_out
        Experiments that are not fitted but predicted afterwards; see `softcal.calibration.hold_out`.
    batch
        Points asked for before the first of them is evaluated; the optimiser's own when None.
    """

    method: str = "least-squares"
    trials: int | None = None
    seed: int = 0
    starts: int = 3
    hold_out: tuple[str, ...] = ()
    batch: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "hold_out", tuple(self.hold_out))

    def changed(self, **changes: object) -> SearchSettings:
        """The settings with some of them replaced.

        Raises
        ------
        ParameterError
            For a name that no setting has.
        """
        known = [one.name for one in fields(self)]
        faults = [
            Fault("there is no such setting of a search", name, allowed=", ".join(known), attempt=nearest(name, known))
            for name in changes
            if name not in known
        ]
        if faults:
            raise ParameterError(faults)
        given: dict[str, Any] = changes
        return replace(self, **given)

    def record(self) -> dict[str, Any]:
        """The `complete` settings as a run stores them and a result reports them."""
        recorded: dict[str, Any] = {
            name: getattr(self, name) for name in ("method", "trials", "seed", "starts", "batch")
        }
        if self.hold_out:
            recorded["hold_out"] = list(self.hold_out)
        return recorded

    def complete(self, *, trials: int, batch: int, heeded: frozenset[str]) -> SearchSettings:
        """These settings with the optimiser's defaults filled in, and without those that it does not use.

        Raises
        ------
        ParameterError
            For a number that makes no sense.
        """
        budget = self.trials if self.trials is not None else trials
        faults: list[Fault] = []
        if budget < 1:
            faults.append(Fault("there must be a trial", "trials", got=str(budget), allowed="1 or more"))
        if self.starts < 1:
            faults.append(Fault("there must be a start", "starts", got=str(self.starts), allowed="1 or more"))
        if not 0 <= self.seed < 2**32:
            faults.append(Fault("the seed is out of range", "seed", got=str(self.seed), allowed="0 to 4294967295"))
        if faults:
            raise ParameterError(faults)
        return replace(
            self,
            trials=budget,
            starts=self.starts if "starts" in heeded else 1,
            batch=self.batch if self.batch is not None else batch,
        )
