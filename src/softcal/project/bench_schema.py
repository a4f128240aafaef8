"""Schema of the `experiments` section of a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from softcal.calibration.frame import Frame
from softcal.calibration.rig import Rig
from softcal.declare import Reading
from softcal.errors import Fault, InputError
from softcal.experiments.synchronise import CommonMotion
from softcal.limits import LIMITS
from softcal.project.section import Given, Section, numbered
from softcal.quantities import Angle, Factor, Slack, TensionOffset

ONE_CLOCK = "one clock"
MOTION_CAPTURE = ".c3d"
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class ColumnSection(Section):
    """Column of a channel in a file; the unit may be omitted where the file names it."""

    name: str
    unit: str | None = None
    scale: Factor = 1.0


def _named(value: object) -> object:
    """Names as a mapping of each to itself."""
    return {str(name): name for name in value} if isinstance(value, list) else value


def _separating(value: str) -> str:
    if len(value) != 1 or value.isalnum() or value in "\"'.+-_\r\n" or not (value.isprintable() or value == "\t"):
        raise InputError(
            Fault("this cannot separate columns", got=repr(value), allowed='one character, such as ",", ";" or "\\t"')
        )
    return value


class FileSection(Section):
    """One bench file.

    markers: marker or plate of the robot -> the beginning of its columns' names in the file (`m4` for `m4.x`); in a
    .c3d file, its label.
    """

    path: str
    columns: Mapping[str, ColumnSection] = Field(default_factory=dict)
    markers: Annotated[Mapping[str, str], BeforeValidator(_named)] = Field(default_factory=dict)
    where: Mapping[str, Annotated[list[Given], BeforeValidator(numbered), Field(min_length=1)]] = Field(
        default_factory=dict
    )
    delimiter: Annotated[str, Reading(_separating, "after")] | None = None
    decimal: Literal[".", ","] | None = None
    header_row: Annotated[int, LIMITS["lines before the data"]] | None = None
    units_row: Annotated[int, LIMITS["lines before the data"]] | None = None
    skip_rows: Annotated[int, LIMITS["rows to skip"]] = 0
    skip_footer: Annotated[int, LIMITS["rows to skip"]] = 0
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    rest_samples: Annotated[int, LIMITS["samples"]] = 10

    def _check(self) -> None:
        if not self.columns and not self.markers:
            raise InputError(Fault("nothing is read from the file", allowed="columns, markers, or both"))
        extra = sorted(self.model_fields_set - {"path", "markers"})
        if extra and self.path.lower().endswith(MOTION_CAPTURE):
            raise InputError(
                Fault("a .c3d file is not a table", got=", ".join(extra), allowed="path, and markers with their labels")
            )


def _step(value: object) -> object:
    if not isinstance(value, (str, dict)):
        raise InputError(
            Fault("this is not a preparation step", got=repr(value), allowed="a name, or a name with settings")
        )
    return value


def _clock_kind(data: Any) -> str:
    return "one" if isinstance(data, str) else "two"


Synchronise = Annotated[
    Annotated[Literal["one clock"], Tag("one")] | Annotated[CommonMotion, Tag("two")],
    Discriminator(_clock_kind),
]


def _drive(value: object) -> object:
    if value in (None, "shortening", "tension") or (isinstance(value, list) and all(isinstance(v, str) for v in value)):
        return value
    allowed = "shortening or tension, of the cable; or a list of channels such as [cable1.tension, cable6.tension]"
    raise InputError(Fault("there is no such choice", got=repr(value), allowed=allowed))


class ExperimentSection(Section):
    """One bench test: what was pulled, what was recorded, and how the data are prepared for comparison."""

    cable: str | None = None
    plate: str | None = None
    drive: Annotated[Literal["shortening", "tension"] | list[str] | None, Reading(_drive, "instead")] = None
    compare: Annotated[list[str], Field(min_length=1)] | None = None
    set_up: str = ""
    files: Annotated[list[FileSection], Field(min_length=1), LIMITS["files of an experiment"]]
    label: str | None = None
    synchronise: Synchronise | None = None
    prepare: list[Annotated[str | Mapping[str, Any], Reading(_step, "instead")]] = Field(default_factory=list)
    noise: Mapping[str, Given] = Field(default_factory=dict)
    slack: Slack = Rig.slack
    tension_offset: TensionOffset = Rig.tension_offset
    pitch_offset: Angle = 0.0
    roll_offset: Angle = 0.0
    frame: Frame | None = None
    settings: Mapping[str, Given] = Field(default_factory=dict)
