"""What every search promises: it asks for points and is told what came of them. It never simulates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from softcal.calibration.problem import Evaluation


@dataclass(frozen=True)
class Proposal:
    """A point to be evaluated: its number in the search, and theta [SI] by label."""

    number: int
    theta: Mapping[str, float]


class Optimiser(ABC):
    """A search by ask and tell.

    The same seed and the same answers give the same questions, however many workers find the answers: `ask` gives a
    whole generation, and the generation is told in the order of its numbers before the next is asked for. So a search
    resumes by being told again what it was told before.
    """

    name: str
    needs_jacobian: bool

    @abstractmethod
    def ask(self) -> tuple[Proposal, ...]:
        """The next generation; empty when the search is over."""

    @abstractmethod
    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        """What came of a proposal; a failed simulation is told like any other."""

    @property
    @abstractmethod
    def total(self) -> int:
        """How many proposals there will be, or at most."""

    @property
    @abstractmethod
    def status(self) -> str:
        """How the search stands or how it ended, as a sentence."""

    @property
    def converged(self) -> bool | None:
        """Whether the best point is a minimum of the loss; None of a search that looks for none."""
        return None
