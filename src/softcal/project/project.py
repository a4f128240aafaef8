"""load(path): a project file, its meshes and its bench data as one frozen Project, or every fault in them at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.declare import as_annotated, checked_arguments
from softcal.display import displayed
from softcal.errors import InputError
from softcal.materials.catalogue import LAWS
from softcal.project.document import Entry
from softcal.project.files import InputFiles
from softcal.project.sections import read_sections
from softcal.project.yaml_file import read_document

if TYPE_CHECKING:
    from softcal.analysis.candidate import Candidate
    from softcal.calibration.problem.experiment import Experiment
    from softcal.calibration.problem.parameters import SearchSpace
    from softcal.calibration.problem.uncertain import UncertainParameter
    from softcal.checks import Ints
    from softcal.declare import Declared
    from softcal.errors import Fault
    from softcal.experiments.dataset import Dataset
    from softcal.geometry.mesh import TetMesh
    from softcal.geometry.quality import MeshReport
    from softcal.materials.infill import PrintInfill
    from softcal.project.calibration_schema import CalibrationSection, SweepSection
    from softcal.twin.parameters import ParameterInfo
    from softcal.twin.robot import Robot
    from softcal.twin.time_settings import TimeSettings


@displayed
@dataclass(frozen=True)
class Project:
    """The contents of a project file; numbers in SI.

    Attributes
    ----------
    path, name
        The file, and the project's name.
    robot
        The robot, its dead loads included.
    experiments, records, corrected
        By experiment: the experiment; its record as read; every sample after the corrections, before any were chosen
        (None where there is no such record).
    space
        The free parameters; None where none is free.
    uncertain
        Parameters that are not fitted, with their standard deviations.
    tied
        Name of a common value -> names or patterns of the parameters tied to it.
    calibration, sweep, dynamics, engines
        The settings of these sections; sweep is None where the file has none; engines are those that it states.
    candidates
        Tests that could be made next.
    print_infill
        Infill of the print, or None where not given.
    held
        Parameters fixed from outside -> value [SI].
    changes
        Entries that stand in the place of those of the file, by dotted key.
    hashes
        SHA-256 of the project file and of every file it names, by path as written.
    inputs
        Paths of the files, by path as written.
    generated
        Body -> the mesh that Gmsh made of it, before its placement.
    qualities
        Body -> report on its mesh.
    regions
        Body -> region -> node numbers (n,).
    warnings
        Values that are allowed but probably mistakes.
    """

    path: Path
    name: str
    robot: Robot
    experiments: Mapping[str, Experiment]
    records: Mapping[str, Dataset]
    corrected: Mapping[str, Dataset | None]
    space: SearchSpace | None
    uncertain: tuple[UncertainParameter, ...]
    tied: Mapping[str, tuple[str, ...]]
    calibration: CalibrationSection
    candidates: tuple[Candidate, ...]
    sweep: SweepSection | None
    dynamics: TimeSettings
    engines: Mapping[str, Declared]
    print_infill: PrintInfill | None
    held: Mapping[str, float]
    changes: Mapping[str, object]
    hashes: Mapping[str, str]
    inputs: Mapping[str, Path]
    generated: Mapping[str, TetMesh]
    qualities: Mapping[str, MeshReport]
    regions: Mapping[str, Mapping[str, Ints]]
    warnings: tuple[Fault, ...]

    @property
    def parameters(self) -> dict[str, ParameterInfo]:
        """Every parameter by dotted name, of the robot and of the rig, with its present value."""
        from softcal.calibration.problem.experiment import rig_parameters
        from softcal.twin.parameters import robot_parameters

        return {**robot_parameters(self.robot), **rig_parameters(self.experiments.values())}

    def _repr_html_(self) -> str:
        """Parts, experiments with their samples and channels, parameters with their bounds or values, warnings."""
        from softcal.display import pictures_of
        from softcal.html_text import heading, html_table, paragraph, picture
        from softcal.units import format_quantity, format_range

        robot = self.robot
        counts = {
            "body": len(robot.bodies),
            "rod": len(robot.rods),
            "plate": len(robot.plates),
            "cable": len(robot.cables),
            "actuator": len(robot.actuators),
        }
        named = {"body": "bodies"}
        parts = [f"{n} {kind if n == 1 else named.get(kind, f'{kind}s')}" for kind, n in counts.items() if n]
        experiments = [
            [name, one.dataset.n_samples, ", ".join(one.drives) or "–", ", ".join(one.compared)]
            for name, one in self.experiments.items()
        ]
        known = self.parameters
        free = () if self.space is None else self.space.parameters
        rows = [
            [p.label, format_range(p.lower, p.upper, unit), p.scale]
            for p in free
            for unit in [known[p.targets[0]].unit if p.targets[0] in known else "1"]
        ]
        held = [[name, format_quantity(value, known[name].unit)] for name, value in self.held.items() if name in known]
        found = [heading(self.name), paragraph(", ".join(parts))]
        found += [html_table(["experiment", "samples", "driven", "compared"], experiments)] if experiments else []
        found += [html_table(["free parameter", "bounds", "scale"], rows)] if rows else []
        found += [html_table(["fixed parameter", "value"], held)] if held else []
        found += [paragraph(f"Warning: {warning}") for warning in self.warnings]
        return "".join([*found, *(picture(png, "robot") for png in pictures_of(self.robot))])


ProjectSource = Project | str | Path


def project_of(source: ProjectSource) -> Project:
    """The project itself, or that of a project file.

    Raises
    ------
    InputError
        For anything else, and as `load`.
    """
    return source if isinstance(source, Project) else load(as_annotated(source, ProjectSource, "project"))


@checked_arguments
def load(
    path: str | Path,
    *,
    values: Mapping[str, str | float] | None = None,
    copies: Mapping[str, str] | None = None,
    changes: Mapping[str, object] | None = None,
) -> Project:
    """Read and check a project file and everything it names.

    Parameters
    ----------
    path
        The project file; paths in it are relative to its folder.
    values
        Parameters to fix, by dotted name: text with a unit (`{"neck.youngs_modulus": "2.3 MPa"}`) or numbers in SI.
        They replace the file's values, and are no longer free.
    copies
        For runs: copies of all files that the project names, path as written -> path relative to the project file.
    changes
        Entries in the place of those of the file, by dotted key: `{"experiments.pull.files[0].path": "p07.csv"}`; a
        `softcal.project.document.Entry` says where it was written.

    Raises
    ------
    ProjectFileError
        With every fault of the file, its meshes and its data: file, line, key, what was found, what is allowed.
    ParameterError
        For `values` that do not fit.
    StorageError
        Where the project file cannot be read.
    """
    document = read_document(Path(path))
    path = Path(path).absolute()  # also where the present folder is changed later
    given = {key: one if isinstance(one, Entry) else Entry(one) for key, one in (changes or {}).items()}
    document = document.changed(given)
    files = InputFiles(path.parent, copies)
    known = set(LAWS)
    try:
        sections = read_sections(document, files)
        # Meshes and data are read only now: a mistake in the file is reported at once.
        from softcal.project.building import build_project

        return build_project(path, document, sections, files, dict(values or {}))
    except InputError:
        for name in set(LAWS) - known:  # those of this file, which can then be mended and read again
            LAWS.remove(name)
        raise
