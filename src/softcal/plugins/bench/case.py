"""A benchmark case: a robot that was measured, a split of its samples, and what others have published on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from softcal.catalogue import Catalogue
from softcal.errors import Fault
from softcal.executors.executor import Executor
from softcal.plugins.bench.predictions import Predictions
from softcal.plugins.bench.record import CaseRecord
from softcal.twin.robot import Robot

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Published:
    """A row of the page that is not softcal's: what another method reached on the same samples.

    Attributes
    ----------
    method
        Its name.
    source
        Where the figures are from, and what they are.
    fit, predict
        Root mean square over all points and at the tip [m], None where not stated.
    note
        What else it found, such as a modulus.
    """

    method: str
    source: str
    fit: tuple[float | None, float | None] = (None, None)
    predict: tuple[float | None, float | None] = (None, None)
    note: str = ""


class BenchmarkCase(ABC):
    """A benchmark case. A new one is a class in a file of its own that registers itself, with data beside.

    Attributes
    ----------
    name, title
        Its name on the command line, and what it is.
    tip
        The point whose error is also stated alone; "" for none.
    length
        What errors are in per cent of [m].
    aligned
        Whether one translation per split is taken off before positions are compared, since the frame is unknown.
    source, licence
        Where the data are from, and under which licence.
    published
        What others reached.
    goal
        What is to be reached, in words; "" where nothing is stated.
    remarks
        What a reader of the scores must know, as sentences; "" where nothing.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    source: ClassVar[str]
    licence: ClassVar[str]
    length: ClassVar[float]
    tip: ClassVar[str] = ""
    aligned: ClassVar[bool] = False
    published: ClassVar[Sequence[Published]] = ()
    goal: ClassVar[str] = ""
    remarks: ClassVar[str] = ""

    @property
    def folder(self) -> Path:
        """Folder of the case with its README, licence and data."""
        return Path(__file__).parent / "data" / self.name

    @property
    def readme(self) -> Path:
        """Remarks on the data: frames, signs, unknown quantities."""
        return self.folder / "README.md"

    @abstractmethod
    def record(self, data: Path | None = None) -> CaseRecord:
        """The measured samples; data: further ones of the same robot in the layout of the case, to be predicted in
        the place of its own.

        Raises
        ------
        InputError
            Where the file is not in that layout.
        """

    @abstractmethod
    def run(
        self,
        data: Path | None = None,
        *,
        workers: int | Executor = 1,
        store: Path | None = None,
        resume: bool = False,
        progress: Progress,
    ) -> Predictions:
        """softcal's own predictions of all samples: fitted to those of the fit alone.

        Parameters
        ----------
        data
            File of further samples to predict in the place of the case's own; None for these.
        workers
            Number of processes, or an executor.
        store
            Run folder of the fit, new or empty; None for a fit without a folder.
        resume
            Go on with the fit in that folder.
        progress
            Called with a sentence on each stage.

        Raises
        ------
        SoftcalError
            Where a sample or the fit has no solution.
        """

    @abstractmethod
    def robot(self) -> Robot:
        """The robot, for its picture."""


def _faults(case: BenchmarkCase, known: Mapping[str, BenchmarkCase]) -> list[Fault]:
    """Faults of a case that is to be registered."""
    if not isinstance(case, BenchmarkCase):
        return [Fault("this is not a case", "case", repr(case)[:60], "an instance of a subclass of BenchmarkCase")]
    wanted = ("name", "title", "source", "licence", "length")
    missing = [name for name in wanted if not hasattr(case, name)]
    return [Fault("the case lacks something", type(case).__name__, allowed=name) for name in missing]


CASES: Catalogue[BenchmarkCase] = Catalogue("case", "softcal.cases", _faults, home="softcal.plugins.bench.cases")


def register_case(case: type[BenchmarkCase]) -> type[BenchmarkCase]:
    """Add a benchmark case; it decorates the class.

    Raises
    ------
    ParameterError
        Where another one has its name, or something is missing.
    """
    CASES.add(case())
    return case
