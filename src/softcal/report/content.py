"""Content of a report: results, data, shapes, loss landscapes. Frozen; numbers in SI; nothing here draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from softcal.analysis.importance import ImportanceStudy
from softcal.analysis.mesh_study import MeshStudy
from softcal.analysis.record import RecordFit
from softcal.analysis.workspace import Workspace
from softcal.calibration.results.result import CalibrationResult, SearchResult, SweepResult
from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown
from softcal.experiments.dataset import Dataset
from softcal.materials.infill import PrintInfill
from softcal.report.compared import Compared
from softcal.report.twin_view import EquilibriumShapes, TwinFrame, TwinView

R = TypeVar("R", bound=SearchResult)
JOINT = "joint"


@dataclass(frozen=True)
class ExperimentContent:
    """One experiment: the record, and the samples that were compared.

    Attributes
    ----------
    raw
        The record as read.
    corrected
        All samples after the corrections (pulleys, zero), with their cycles if cycles were searched, before any
        selection; None if not available, then `raw` is drawn beneath the branch.
    prepared
        The samples that were compared.
    drive
        The measured channel that drove the twin, the first of several; "" if none did.
    """

    name: str
    raw: Dataset
    prepared: Dataset
    corrected: Dataset | None = None
    drive: str = "shortening"


@dataclass(frozen=True)
class Landscape:
    """A loss over a rectangular grid of two parameters.

    Attributes
    ----------
    x, y
        The axes [SI units of the parameters], ascending.
    loss
        The calibration's loss (len(y), len(x)).
    failed
        1 where the twin could not be simulated (loss ignored), same shape; None if all cells were simulated.
    """

    x_name: str
    y_name: str
    x: Floats
    y: Floats
    loss: Floats
    failed: Ints | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", frozen_floats(self.x, name=self.x_name, shape=(None,)))
        object.__setattr__(self, "y", frozen_floats(self.y, name=self.y_name, shape=(None,)))
        shape = (len(self.y), len(self.x))
        object.__setattr__(self, "loss", frozen_floats(self.loss, name="loss of the landscape", shape=shape))
        if self.failed is not None:
            failed = frozen_ints(self.failed, name="failed points of the landscape", shape=shape)
            object.__setattr__(self, "failed", failed)


@displayed
@dataclass(frozen=True)
class ReportContent:
    """The content of a report: results, measurements, shapes; figures draw from it.

    A simulated channel without a measured one (pitch without an IMU) belongs in `ExperimentFit.simulated`.

    Attributes
    ----------
    results
        Label -> result of each calibration, one per experiment as in paper A and/or "joint", or of a sweep. The label
        is shown; `SearchResult.experiments` lists the fitted experiments.
    experiments
        Name -> data.
    headline
        Label of the result shown first; "" takes "joint", else the first.
    landscapes
        Label of a calibration -> loss over two parameters; without one, the trials are drawn.
    compared
        Reference values that the headline is compared with.
    mesh_study
        Mesh study of one of the results.
    mesh_note
        Why an existing mesh study is not shown.
    importance
        Sobol indices over the bounds of one of the results.
    importance_note
        Of which result they are, or why an existing study is not shown.
    workspace
        Workspace of the twin at the values of one of the results.
    workspace_note
        Why an existing workspace is not shown.
    frame
        The twin along its pull, to be moved by a slider; None where nothing is pulled.
    equilibria
        Shapes of the headline's calibration, if positions were compared.
    records
        Label of a calibration -> experiment -> its twin over the whole record, if compared.
    """

    project_name: str
    results: Mapping[str, SearchResult]
    experiments: Mapping[str, ExperimentContent]
    twin: TwinView | None = None
    frame: TwinFrame | None = None
    equilibria: EquilibriumShapes | None = None
    landscapes: Mapping[str, Landscape] = field(default_factory=dict)
    records: Mapping[str, Mapping[str, RecordFit]] = field(default_factory=dict[str, Mapping[str, RecordFit]])
    compared: Compared | None = None
    mesh_study: MeshStudy | None = None
    mesh_note: str = ""
    importance: ImportanceStudy | None = None
    importance_note: str = ""
    workspace: Workspace | None = None
    workspace_note: str = ""
    print_infill: PrintInfill | None = None
    headline: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    hashes: Mapping[str, str] = field(default_factory=dict)
    created: str = ""

    def __post_init__(self) -> None:
        for name in ("results", "experiments", "landscapes", "records", "versions", "hashes"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        faults: list[Fault] = []
        if not self.results:
            faults.append(Fault("a report needs at least one calibration result", where=self.project_name))
        faults += [
            Fault(
                "the fit names an experiment without data", where=label, got=name, allowed=", ".join(self.experiments)
            )
            for label, result in self.results.items()
            for name in result.experiments
            if name not in self.experiments
        ]
        faults += [
            unknown(f"{what} of a calibration that does not exist", "", label, self.results)
            for what, labels in (
                ("a landscape", self.landscapes),
                ("whole records", self.records),
                ("the headline", [self.headline] * bool(self.headline)),
            )
            for label in labels
            if label not in self.results
        ]
        if faults:
            raise InputError(faults)
        if not self.headline:
            object.__setattr__(self, "headline", first_label(self.results))

    @property
    def samples(self) -> dict[str, Dataset]:
        """The compared samples by experiment."""
        return {name: experiment.prepared for name, experiment in self.experiments.items()}

    @property
    def recorded(self) -> dict[str, Dataset]:
        """The record of each experiment with its times, corrected where that is available."""
        return {name: experiment.corrected or experiment.raw for name, experiment in self.experiments.items()}

    @property
    def headline_result(self) -> SearchResult:
        """The result shown first."""
        return self.results[self.headline]

    @property
    def judged(self) -> Mapping[str, SearchResult]:
        """The results that are judged: the headline, or all fits if each experiment was fitted by itself."""
        return judged(self.results, self.headline)

    @property
    def calibrations(self) -> Mapping[str, CalibrationResult]:
        """The results that are calibrations."""
        return {label: one for label, one in self.results.items() if isinstance(one, CalibrationResult)}

    @property
    def sweeps(self) -> Mapping[str, SweepResult]:
        """The results that are sweeps."""
        return {label: one for label, one in self.results.items() if isinstance(one, SweepResult)}


def first_label(results: Mapping[str, SearchResult]) -> str:
    """Label of the result that is shown first: the joint one, else the first."""
    return JOINT if JOINT in results else next(iter(results))


def judged(results: Mapping[str, R], first: str) -> dict[str, R]:
    """The result shown first if it is of several experiments; else all results of one."""
    if len(results[first].experiments) > 1:
        return {first: results[first]}
    return {label: one for label, one in results.items() if len(one.experiments) == 1}
