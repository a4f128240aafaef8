"""For a controller; see `softcal.export.reduced`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from softcal.errors import Fault, ParameterError, UnitError, unknown
from softcal.workflows.export import ExportOption, ExportRequest, register_export
from softcal.workflows.run_band import RunBand

if TYPE_CHECKING:
    from softcal.export.reduced import ReducedModelFit, Span
    from softcal.twin.robot import Robot

REACH = ExportOption(
    str,
    "Range of all efforts, 8N, or of each input: front=8N,left=40mm,grip=-5kPa..40kPa,tip.mass=0g..200g; "
    "by default that of the experiments.",
    "VALUE",
)
SAMPLES = ExportOption(int, "Equilibria to solve; by default 64 for each input.", "N")


@register_export(
    "model.json",
    "reduced_model.py",
    "reduced_model.c",
    "README.txt",
    pulled=False,
    reach=REACH,
    samples=SAMPLES,
)
def reduced(request: ExportRequest, folder: Path, reach: str | None = None, samples: int | None = None) -> list[Path]:
    """For a controller: efforts, and loads, to poses and derivatives, and poses to efforts, in Python and C.

    Parameters
    ----------
    request
        The project, and observers.
    folder
        Folder of the model.
    reach
        Largest effort of all actuators, `8N`, or ranges of inputs: of actuators by effort or coordinate, from 0 where
        the lower end is not stated, and of parameters of the robot, `front=8N,left=40mm,tip.mass=0g..200g`; by default
        what the experiments command.
    samples
        Equilibria that are solved; by default 64 for each input.
    """
    from softcal.export.reduced import write_reduced

    fit, band = reduced_fit(request, reach, samples)
    written = write_reduced(fit, folder, band.told)
    request.note(written[-1].read_text(encoding="utf-8"))
    return written


def reduced_fit(
    request: ExportRequest, reach: str | None, samples: int | None, **options: Any
) -> tuple[ReducedModelFit, RunBand]:
    """The reduced model that is asked for, with the bands of its run.

    Parameters
    ----------
    request
        The project, and observers.
    reach, samples
        As of the export.
    **options
        Of `softcal.export.reduced.reduced`.
    """
    from softcal.export.reduced import Bands
    from softcal.export.reduced import reduced as reduced_model

    robot = request.project.robot
    spans = _commanded(request) if reach is None else _spans(robot, reach)
    band = RunBand.of(request)
    bands = Bands([*band.steps], band.width) if band.steps else None
    request.stage("Simulating the samples of the model, and random states for its error")
    return reduced_model(robot, spans, samples, tell=request.warn, bands=bands, **options), band


def _commanded(request: ExportRequest) -> dict[str, Span]:
    """The range of each actuator's commands in the experiments, of the kind of its first one, and zero."""
    from softcal.export.reduced import Span
    from softcal.sensing.channel import kinds

    found: dict[str, Span] = {}
    for case in request.cases().values():
        for name, command in case.protocol.commands.items():
            unit, ends = kinds()[command.control].unit, [0.0, *command.values.tolist()]
            so_far = found.get(name, Span(0.0, 0.0, unit))
            if so_far.unit == unit:
                found[name] = Span(min(so_far.least, *ends), max(so_far.most, *ends), unit)
    return {name: span for name, span in found.items() if span.least < span.most}


def _spans(robot: Robot, text: str) -> dict[str, Span]:
    """The range of each input.

    Raises
    ------
    ParameterError
        With all faults of the text.
    """
    parts = [part.strip() for part in text.split(",") if part.strip()]
    pairs = [(name.strip(), value.strip()) for name, sign, value in (p.partition("=") for p in parts) if sign]
    of_each = dict(pairs)
    if not of_each and len(parts) == 1:
        of_each = dict.fromkeys([part.name for part in robot.commandable], parts[0])
    elif len(of_each) != len(parts):
        what = "an input has two ranges" if len(pairs) == len(parts) else "a range has no name of an input"
        allowed = f"one range for all {robot.actuator_word}s (8N), or one for each input (front=8N,left=40mm)"
        raise ParameterError(Fault(what, "--reach", f"'{text}'", allowed))
    found, faults = dict[str, "Span"](), list[Fault]()
    for name, value in of_each.items():
        try:
            found[name] = _span(robot, name, value)
        except (ParameterError, UnitError) as error:
            faults += error.faults
    if faults:
        raise ParameterError(faults)
    return found


def _span(robot: Robot, name: str, text: str) -> Span:
    from softcal.export.reduced import Span
    from softcal.twin.parameters import robot_parameters
    from softcal.units import parse_quantity

    low, dots, high = text.partition("..")
    ends = (low, high) if dots else ("0", text)
    where = f"--reach {name}"
    part, parameters = {one.name: one for one in robot.commandable}.get(name), robot_parameters(robot)
    if part is None and name not in parameters:
        what = f"there is no such {robot.actuator_word} or parameter"
        raise ParameterError(unknown(what, "--reach", name, [*(one.name for one in robot.commandable), *parameters]))
    if part is None and not dots:
        raise ParameterError(Fault("the range of a parameter has two ends", where, f"'{text}'", "such as 0g..200g"))
    units = [kind.unit for kind in part.channels] if part is not None else [parameters[name].unit]
    for unit in units[:-1]:  # an actuator's coordinate
        try:
            return Span(parse_quantity(ends[0], unit), parse_quantity(ends[1], unit), unit)
        except UnitError:
            continue
    least, most = (parse_quantity(end, units[-1], where=where) for end in ends)
    return Span(least, most, units[-1])
