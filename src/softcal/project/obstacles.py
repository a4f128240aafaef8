"""A file of obstacles: half-spaces, spheres and boxes by name, with units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from softcal.declare import require_one
from softcal.errors import ProjectFileError
from softcal.geometry.obstacle import BoxObstacle, HalfSpace, Obstacle, SphereObstacle
from softcal.limits import part_name_fault
from softcal.project.document import Findings
from softcal.project.section import Section, entries
from softcal.project.yaml_file import read_document

KEY = "obstacles"
EXAMPLE = "table: {half_space: {point: [0 mm, 0 mm, -10 mm], normal: [0, 0, 1]}}"


class ObstacleSection(Section):
    """An obstacle: one shape."""

    half_space: HalfSpace | None = None
    sphere: SphereObstacle | None = None
    box: BoxObstacle | None = None

    def _check(self) -> None:
        require_one(self, ("half_space", "sphere", "box"), "an obstacle has one shape", nothing="none",
                    allowed="half_space, sphere or box")  # fmt: skip

    @property
    def shape(self) -> Obstacle | None:
        """The obstacle that is present."""
        return self.half_space or self.sphere or self.box


def read_obstacles(path: Path) -> Mapping[str, Obstacle]:
    """The obstacles of a YAML file, by name.

    Raises
    ------
    ProjectFileError
        With everything that is wrong in the file.
    StorageError
        Where the file cannot be read.
    """
    document = read_document(path, "file of obstacles", KEY, "see the documentation's page on commands for a pose")
    findings = Findings(document)
    for key in document.data:
        if key != KEY:
            findings.add((key,), "unknown key", got=f"'{key}'", allowed=KEY)
    sections = entries(ObstacleSection, KEY, document, findings)
    if not document.mapping(KEY) and not findings.faults:
        findings.add((), "there are no obstacles", allowed=f"{KEY}: entries such as {EXAMPLE}")
    for name in document.mapping(KEY):
        if fault := part_name_fault(str(name)):
            findings.faults.append(replace(fault, where=document.where((KEY, str(name)))))
    if findings.faults:
        raise ProjectFileError(findings.faults)
    return {name: shape for name, one in sections.items() if (shape := one.shape) is not None}
