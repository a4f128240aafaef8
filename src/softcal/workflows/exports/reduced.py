"""For a controller; see `softcal.export.reduced`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.errors import Fault, ParameterError, UnitError
from softcal.workflows.export import ExportOption, ExportRequest, register_export

if TYPE_CHECKING:
    from softcal.export.reduced import Reach
    from softcal.twin.robot import Robot

SAMPLES = {1: 33, 2: 9, 3: 7}  # number of cables -> nodes along each


@register_export(
    "model.json",
    "reduced_model.py",
    "README.txt",
    pulled=False,
    reach=ExportOption(
        str, "Largest pull of the cables: 8N, or 40mm with one cable; or for each: front=8N,left=40mm.", "VALUE"
    ),
    cables=ExportOption(str, "One to three cables, by default all: front,left.", "NAMES"),
    samples=ExportOption(int, "Nodes along each cable; by default 33, 9 or 7.", "N"),
)
def reduced(
    request: ExportRequest, folder: Path, reach: str, cables: str = "", samples: int | None = None
) -> list[Path]:
    """For a controller: tensions to poses, shortenings and compliance, as JSON with a self-contained evaluator.

    Parameters
    ----------
    request
        The project, and observers.
    folder
        Of the model.
    reach
        Largest pull of the cables, `8N`, or of each, `front=8N,left=40mm`.
    cables
        Names of one to three cables; by default all.
    samples
        Nodes along each cable; by default 33, 9 or 7.
    """
    from softcal.export.reduced import reduced as reduced_model
    from softcal.export.reduced import write_reduced

    request.stage("Simulating the nodes of the model, and points between them")
    robot = request.project.robot
    reaches = _reaches(robot, reach, [name.strip() for name in cables.split(",") if name.strip()])
    model = reduced_model(robot, reaches, samples or SAMPLES.get(len(reaches), 2), tell=request.warn)
    written = write_reduced(model, folder)
    request.note(written[-1].read_text(encoding="utf-8"))
    return written


def _reaches(robot: Robot, text: str, cables: Sequence[str]) -> dict[str, Reach]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    of_each = dict((name.strip(), value.strip()) for name, sign, value in (p.partition("=") for p in parts) if sign)
    if not of_each and len(parts) == 1:
        of_each = dict.fromkeys(cables or [cable.name for cable in robot.cables], parts[0])
    elif len(of_each) != len(parts) or (cables and set(cables) != set(of_each)):
        allowed = "one reach for all the cables (8N), or one for each of them (front=8N,left=40mm)"
        raise ParameterError(Fault("the reach is not defined for each cable", "--reach", f"'{text}'", allowed))
    return {name: _reach(value) for name, value in of_each.items()}


def _reach(text: str) -> Reach:
    from softcal.export.reduced import Reach
    from softcal.quantities import QUANTITIES

    try:
        return Reach(QUANTITIES["shortening"].read(text), "m")
    except UnitError:
        return Reach(QUANTITIES["tension"].read(text, where="--reach"), "N")
