"""Schema of the `experiments` section of a project file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from softcal.calibration.problem.frame import Frame
from softcal.calibration.problem.rig import Rig
from softcal.declare import Reading
from softcal.errors import Fault, InputError
from softcal.experiments.synchronise import CommonMotion
from softcal.experiments.table_format import ColumnSpec, TableFormat
from softcal.limits import LIMITS
from softcal.project.section import Given, Section, numbered
from softcal.quantities import Angle, Clearance, Slack, TensionOffset

ONE_CLOCK = "one clock"
MOTION_CAPTURE = ".c3d"


@dataclass(frozen=True, kw_only=True)
class BenchFile(TableFormat):
    """One bench file, and the columns and rows to read.

    markers: marker or plate of the robot -> the beginning of its columns' names in the file (`m4` for `m4.x`); in a
    .c3d file, its label. A list of names stands for names that are the same in both.
    """

    path: str
    columns: Mapping[str, ColumnSpec] = field(default_factory=dict[str, ColumnSpec])
    markers: Annotated[
        Mapping[str, str],
        Reading(lambda value: {str(name): name for name in value} if isinstance(value, list) else value),
    ] = field(default_factory=dict[str, str])
    where: Mapping[str, Annotated[list[Given], Reading(numbered), Field(min_length=1)]] = field(
        default_factory=dict[str, list[Given]]
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.columns and not self.markers:
            raise InputError(Fault("nothing is read from the file", allowed="columns, markers, or both"))
        of_a_table = [one for one in fields(self) if one.name not in ("path", "markers")]
        extra = sorted(one.name for one in of_a_table if getattr(self, one.name) not in (one.default, {}))
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


Synchronise = Annotated[
    Annotated[Literal["one clock"], Tag("one")] | Annotated[CommonMotion, Tag("two")],
    Discriminator(lambda data: "one" if isinstance(data, str) else "two"),
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
    files: Annotated[list[BenchFile], Field(min_length=1), LIMITS["files of an experiment"].entries]
    label: str | None = None
    synchronise: Synchronise | None = None
    prepare: list[Annotated[str | Mapping[str, Any], Reading(_step, "instead")]] = Field(default_factory=list)
    noise: Mapping[str, Given] = Field(default_factory=dict)
    slack: Slack = Rig.slack
    backlash: Clearance | None = Rig.backlash
    tension_offset: TensionOffset = Rig.tension_offset
    pitch_offset: Angle = 0.0
    roll_offset: Angle = 0.0
    frame: Frame | None = None
    settings: Mapping[str, Given] = Field(default_factory=dict)
