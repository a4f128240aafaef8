"""The fixed markers of a bench: one marker, several at unknown places, or those of a base file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from softcal.checks import is_number
from softcal.errors import Fault, InputError, ProjectFileError
from softcal.geometry.pose import Pose
from softcal.project.document import Findings
from softcal.project.section import Section, validated
from softcal.project.yaml_file import read_document
from softcal.quantities import Angle, Point, Size

FORMAT = 1

Turn = tuple[Angle, Angle, Angle]


@dataclass(frozen=True)
class Base:
    """The fixed markers: poses in the base's frame, markers without a known pose, and sizes that differ [m]."""

    placed: Mapping[int, Pose]
    companions: tuple[int, ...] = ()
    sizes: Mapping[int, float] = field(default_factory=dict[int, float])


class BaseMarkerSection(Section):
    """Pose and size of a marker of the base."""

    at: Point
    rotation_vector: Turn = (0.0, 0.0, 0.0)
    size: Size | None = None


def read_base(text: str) -> Base:
    """The base from `0`, from `0,5,6` (the first defines the frame, the others are fixed to it) or from a file.

    Raises
    ------
    InputError
        Where the text is neither, or names a marker twice.
    ProjectFileError
        With everything that is wrong in the file.
    StorageError
        Where the file cannot be read.
    """
    if all(is_number(part.strip()) for part in text.split(",")):
        numbers = [int(part) for part in text.split(",")]
        twice = sorted({number for number in numbers if numbers.count(number) > 1})
        if twice:
            raise InputError([Fault(f"marker {number} is named twice", "--base", f"'{text}'") for number in twice])
        return Base({numbers[0]: Pose.of()}, tuple(numbers[1:]))
    if not text.lower().endswith((".yaml", ".yml")):
        raise InputError(
            Fault(
                "this is not a base",
                "--base",
                f"'{text}'",
                "a marker's number (0), several (0,5,6), or a file with their layout (base.yaml)",
            )
        )
    document = read_document(Path(text), "base file", "base, markers", "see the documentation's page on markers")
    findings = Findings(document)
    for key in document.data:
        if key not in ("base", "markers"):
            findings.add((key,), "unknown key", got=f"'{key}'", allowed="base, markers")
    if document.data.get("base") != FORMAT:
        got = repr(document.data.get("base"))[:60]
        findings.add(("base",), "the format is not known", got=got, allowed=f"base: {FORMAT}")
    sections: dict[int, BaseMarkerSection] = {}
    given = document.data.get("markers")
    example = "0: {at: [0 mm, 0 mm, 0 mm]}"
    if not isinstance(given, dict) or not given:
        findings.add(("markers",), "there are no markers", got=repr(given)[:60], allowed=f"entries such as {example}")
    else:
        for key, data in given.items():
            if not is_number(str(key)):
                findings.add(("markers", key), "not the number of a marker", got=f"'{key}'", allowed=example)
                continue
            section = validated(BaseMarkerSection, data, ("markers", key), findings)
            if section is not None:
                sections[int(key)] = section
    findings.raise_if_any()
    if not sections:
        raise ProjectFileError(Fault("the base file is incomplete", document.name))
    return Base(
        {marker: Pose.of(section.rotation_vector, section.at) for marker, section in sections.items()},
        (),
        {marker: section.size for marker, section in sections.items() if section.size is not None},
    )
