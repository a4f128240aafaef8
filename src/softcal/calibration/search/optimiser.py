"""The interface of every search: `ask` gives points, `tell` takes their evaluations. A search never simulates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from softcal.calibration.problem.option import FAMILIES, Option, option_faults, options_of
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.search.settings import SearchSettings
from softcal.catalogue import Catalogue
from softcal.display import displayed
from softcal.errors import Fault


@displayed
@dataclass(frozen=True)
class Proposal:
    """A point to be evaluated: its number in the search, and theta [SI] by label."""

    number: int
    theta: Mapping[str, float]


@displayed
class Optimiser(ABC):
    """A search by ask and tell.

    The same seed and the same answers give the same questions, for any number of workers: `ask` gives a whole
    generation, which is passed to `tell` in the order of its numbers before the next `ask`. So a search is resumed by
    passing it the recorded evaluations again.

    Attributes
    ----------
    name
        The `method` of project files and options.
    title
        Its name in reports.
    default_trials
        Default budget of trials.
    needs_jacobian
        Whether evaluations come with their derivatives.
    statistics
        The statistics of the parameters at the end: "sensitivity", the standard errors, intervals and shares that
        follow from the jacobian at the best point, or "fanova", each one's share in the variance of the losses of all
        trials.
    options
        What project files can give it, beside the settings that every search has.
    batch
        Points that it gives before the evaluation of the first is needed, where that decides its course: as many
        workers can share it.
    grows
        Whether a run can be resumed with another number of trials.
    expected
        Typical number of evaluations, fewest and most; None where it uses all of its budget.
    in_parallel
        Whether workers share its evaluations by default.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    default_trials: ClassVar[int]
    needs_jacobian: ClassVar[bool] = False
    statistics: ClassVar[Literal["sensitivity", "fanova"]] = "fanova"
    options: ClassVar[tuple[Option, ...]] = ()
    batch: ClassVar[int] = 1
    grows: ClassVar[bool] = True
    expected: ClassVar[tuple[int, int] | None] = None
    in_parallel: ClassVar[bool] = True

    @classmethod
    @abstractmethod
    def begin(cls, problem: Problem, settings: SearchSettings) -> Optimiser:
        """A search in the problem's space; the settings are complete: trials, batch and every option are numbers."""

    @classmethod
    def settled(cls, settings: SearchSettings) -> SearchSettings:
        """The settings made complete.

        Raises
        ------
        ParameterError
            For a number that makes no sense, or an option that no method has.
        """
        return settings.complete(
            trials=cls.default_trials, batch=cls.batch, options=cls.options, known=options_of(OPTIMISERS)
        )

    @abstractmethod
    def ask(self) -> tuple[Proposal, ...]:
        """The next generation; empty when the search is over."""

    @abstractmethod
    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        """Record the evaluation of a proposal; a failed simulation is recorded like any other."""

    @property
    @abstractmethod
    def total(self) -> int:
        """The number of proposals, or its upper limit."""

    @property
    @abstractmethod
    def status(self) -> str:
        """State of the search, or how it ended, as a sentence."""

    @property
    def converged(self) -> bool | None:
        """Whether the best point is a minimum of the loss; None for a search that looks for none."""
        return None


def _faults(optimiser: type[Optimiser], known: Mapping[str, type[Optimiser]]) -> list[Fault]:
    """Faults of a class that is to be registered."""
    if not (isinstance(optimiser, type) and issubclass(optimiser, Optimiser)):
        return [Fault("this is not an optimiser", "method", repr(optimiser)[:60], "a subclass of softcal.Optimiser")]
    where = f"optimiser {optimiser.__name__}"
    missing = [name for name in ("name", "title", "default_trials") if not hasattr(optimiser, name)]
    missing += sorted(optimiser.__abstractmethods__)
    faults = [Fault("the optimiser lacks something", where, allowed=f"'{name}' must be there") for name in missing]
    if optimiser.statistics == "sensitivity" and not optimiser.needs_jacobian:
        what = "statistics by sensitivity need the jacobian"
        faults.append(Fault(what, where, attempt="needs_jacobian = True, or statistics = 'fanova'"))
    return [*faults, *option_faults(optimiser, "method", where, known)]


OPTIMISERS: Catalogue[type[Optimiser]] = Catalogue(
    "method", "softcal.optimisers", _faults, home="softcal.calibration.search.optimisers"
)

FAMILIES["method"] = OPTIMISERS
register_optimiser = OPTIMISERS.registrar(
    "register_optimiser", "Add an optimiser: project files, `--method`, results and reports then accept its name."
)
