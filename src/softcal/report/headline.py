"""The result that a report shows first, a calibration or a sweep, in the words of its kind and with what it gained."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from softcal.analysis.nominal import Nominal
from softcal.analysis.sweep import ALL, BestCell, ErrorSection, best_cells, section_errors, sections
from softcal.calibration.results.result import ExperimentFit, SearchResult, SweepResult
from softcal.report.content import ReportContent
from softcal.report.format import (
    joined,
    material_kinds,
    method_label,
    ordered_parameters,
    parameter_label,
    parameters_in_words,
    result_label,
)
from softcal.twin.parameter_name import parameter_name

_FEW = 4  # parameters that are all named


@dataclass(frozen=True)
class Gain:
    """Error of a section [its unit] at the nominal values (None if they could not be simulated) and at tuned ones.

    best: for a sweep, the cell with the least error of the section.
    """

    section: ErrorSection
    nominal: float | None
    tuned: float
    best: BestCell | None = None


@dataclass(frozen=True)
class Headline(ABC):
    """The headline result of a report.

    Attributes
    ----------
    content
        The report's.
    kind
        What the run was, a noun.
    tuned
        What its values are called beside the nominal ones.
    twin
        What the robot at its values is called.
    comparison, gains_title
        Headings of the page's section, and of its table, that compare them.
    """

    content: ReportContent
    kind: ClassVar[str]
    tuned: ClassVar[str]
    twin: ClassVar[str]
    comparison: ClassVar[str]
    gains_title: ClassVar[str]

    @property
    def label(self) -> str:
        """Sentence with the name of the result among the report's results; "" where there can be only one."""
        return ""

    @property
    @abstractmethod
    def subject(self) -> str:
        """Sentence on the work that was done."""

    @property
    def lead(self) -> str:
        """Text before the values in the summary."""
        return ""

    @abstractmethod
    def gains(self, known: Nominal) -> list[Gain]:
        """The gain of all sections together over the nominal values, then that of each section."""


@dataclass(frozen=True)
class CalibrationHeadline(Headline):
    """A calibration, beside which there may be others."""

    result: SearchResult
    kind = "calibration"
    tuned = "calibrated"
    twin = "the calibrated twin"
    comparison = gains_title = "Nominal and calibrated"

    @property
    def label(self) -> str:
        return f"{result_label(self.content.headline)}."

    @property
    def subject(self) -> str:
        result, names = self.result, list(self.result.experiments)
        fitted = f"jointly to {len(names)} experiments" if len(names) > 1 else f"to {joined(names)}"
        others = len(self.content.results) - 1
        more = f" {others} further calibration{'s' * (others > 1)} below." if others else ""
        return f"{self._parameters} fitted {fitted} by {method_label(result.method)}.{more}"

    @property
    def _parameters(self) -> str:
        """The fitted parameters in words: the constants of the material, and how many others, if these are many."""
        names, kinds = ordered_parameters({"": self.result}), material_kinds([self.result])
        of_material = [name for name in names if parameter_name(name).kind in kinds]
        others = len(names) - len(of_material)
        if len(names) <= _FEW or not of_material or len(of_material) > _FEW or not others:
            return parameters_in_words(names, list(self.result.experiments))
        labels = [parameter_label(name, names) for name in of_material]
        return joined([*labels, f"{others} further parameter{'s' * (others > 1)}"])

    def gains(self, known: Nominal) -> list[Gain]:
        """Gains of the markers alone: the loss also contains every other channel."""
        fits = self.result.experiments
        found = {name: {point: distance.rms for point, distance in fit.distances.items()} for name, fit in fits.items()}
        before = section_errors(self.result, {name: known.errors[name] for name in found if name in known.errors})
        after = section_errors(self.result, found)
        placed = [section for section in sections(self.result) if section.name in after]
        each = [Gain(section, before.get(section.name), after[section.name]) for section in placed]
        whole = _pooled(fits.values())
        if len(placed) > 1 and whole is not None:
            nominal = _pooled(fit for name, fit in known.fits.items() if name in found)
            return [Gain(ErrorSection(ALL, "m", placed[0].length), nominal, whole), *each]
        return each


@dataclass(frozen=True)
class SweepHeadline(Headline):
    """A sweep, whose values are those of its best cell."""

    result: SweepResult
    kind = "sweep"
    tuned = "best cell"
    twin = "the twin at the sweep's best cell"
    comparison = "The sweep"
    gains_title = "The best cell for each section"

    @property
    def subject(self) -> str:
        names, n = list(self.result.experiments), len(self.result.trials)
        parameters = parameters_in_words(self.result.parameters, names)
        return f"{parameters} swept over {n} cells, judged by {joined(names)}."

    @property
    def lead(self) -> str:
        return f"the best of {len(self.result.trials)} cells, "

    def gains(self, known: Nominal) -> list[Gain]:
        return [Gain(best.section, best.nominal, best.error, best) for best in best_cells(self.result, known)]


def headline(content: ReportContent) -> Headline:
    """The headline of a report's content."""
    match content.headline_result:
        case SweepResult() as result:
            return SweepHeadline(content, result)
        case result:
            return CalibrationHeadline(content, result)


def _pooled(fits: Iterable[ExperimentFit]) -> float | None:
    """Root mean square distance of all markers in all experiments [m]."""
    parts = [distance for fit in fits for distance in fit.distances.values()]
    n = sum(part.n for part in parts)
    return math.sqrt(sum(part.n * part.rms**2 for part in parts) / n) if n else None
