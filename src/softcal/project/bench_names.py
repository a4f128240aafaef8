"""Check of the names in an experiment's section against the robot: cables, plates and markers, channels, settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from softcal.calibration.problem.experiment import Experiment, drive_faults, rig_parameters
from softcal.errors import Fault, ParameterError
from softcal.experiments.header import MASS
from softcal.experiments.orientation import QUATERNION
from softcal.experiments.table_format import ColumnSpec
from softcal.project.bench_schema import BenchFile, ExperimentSection
from softcal.project.document import Findings, KeyPath
from softcal.quantities import QUANTITIES, noise_in
from softcal.sensing.channel import carriers, channel_name, channel_unit, kinds, positions
from softcal.sensing.sensors.actuators import FLOW, TENSION, VOLUME
from softcal.sensing.sensors.pose import ANGLES
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import robot_parameters, unknown_name
from softcal.twin.robot import PointLoad, Robot


def check_names(
    section: ExperimentSection, parts: Mapping[str, list[str]] | None, path: KeyPath, findings: Findings
) -> None:
    """Check that the robot has every cable, plate and marker that the section names.

    Parameters
    ----------
    section
        Section of an experiment.
    parts
        Names of the robot's parts by kind, such as "cables"; None if unknown, since the robot has faults.
    path
        Key path of the section in the file, for faults.
    findings
        Collects the faults and warnings.
    """
    columns = [key for file in section.files for key in file.columns]
    if isinstance(section.drive, list):
        known = [as_prepared(key) for key in columns]
        for i, channel in enumerate(section.drive):
            if channel not in known:
                findings.unknown((*path, "drive", i), "channel among the columns", channel, known)
        named = [(name, channel_name(name)) for name in section.drive if name in known]
        of_twin = [(name, one if one.carrier else replace(one, carrier=section.cable or "")) for name, one in named]
        for fault in drive_faults(of_twin, ""):
            findings.add((*path, "drive"), fault.what, got=fault.got, allowed=fault.allowed)
    if isinstance(section.drive, str) and section.cable is None:
        allowed = "cable: NAME, or drive: [cable1.tension]"
        findings.add((*path, "drive"), "the driven cable is not specified", got=section.drive, allowed=allowed)
    of_cable = [key for key in columns if (kind := channel_name(key).kind).drives or kind.name == MASS]
    needs_cable = [key for key in of_cable if not channel_name(key).carrier]
    if section.cable is None and needs_cable:
        got = f"the channel {needs_cable[0]}, no cable"
        findings.add((*path, "cable"), "the pulled cable is not specified", got=got, allowed="cable: NAME")
    pulled = [key for key in of_cable if channel_name(key).carrier]
    if section.cable is None and section.drive is None and pulled and section.compare is None:
        findings.add(
            (*path, "drive"),
            "the drive of the twin is not specified",
            got=f"the channel {pulled[0]}, no drive",
            allowed=f"drive: [{as_prepared(pulled[0])}], or compare other channels",
        )
    if parts is None:
        return
    cables, plates, markers = (parts[kind] for kind in ("cables", "plates", "markers"))
    if section.cable is not None and section.cable not in cables:
        findings.unknown((*path, "cable"), "cable", section.cable, cables)
    if section.plate is not None and section.plate not in plates:
        findings.unknown((*path, "plate"), "plate", section.plate, plates)
    of_plate = (*(angle.name for angle in ANGLES), QUATERNION[0])
    short = [key for file in section.files for key in file.columns if key in of_plate]
    if section.plate is None and short:
        findings.add(
            (*path, "plate"),
            "the plate of the IMU is not specified",
            got=f"the channel {short[0]}, no plate",
            allowed=", ".join(plates) or "a plate of the robot",
        )
    for i, file in enumerate(section.files):
        where = (*path, "files", i)
        for marker in file.markers:
            if marker not in (*markers, *plates):
                findings.unknown((*where, "markers", marker), "marker or plate", marker, [*markers, *plates])
        for channel in file.columns:
            name = channel_name(channel)
            kinds_of = carriers(TENSION if name.kind.name == MASS else name.kind)
            known = [part for of in kinds_of for part in parts[of]]
            if name.carrier and kinds_of and name.carrier not in known:
                what = " or ".join(of.removesuffix("s") for of in kinds_of)
                findings.unknown((*where, "columns", channel), what, name.carrier, known)


def asked_of(file: BenchFile) -> dict[str, Any]:
    """The columns and rows to read from a file's table, as keywords of `read_layout` and `read_table`; standard
    deviations of markers are optional columns.
    """
    columns, optional = dict(file.columns), list[str]()
    for marker, name in file.markers.items():
        for here, there in zip(positions(marker), positions(name), strict=True):
            columns.setdefault(str(here), ColumnSpec(str(there)))
            deviation = str(here.deviation)
            if deviation not in columns:
                columns[deviation] = ColumnSpec(str(there.deviation))
                optional.append(deviation)
    where = {key: values[0] if len(values) == 1 else values for key, values in file.where.items()}
    return {"columns": columns, "optional": optional, "where": where}


def as_prepared(name: str) -> str:
    """A channel's name in the prepared record: of a hanging mass that of the tension, of a flow that of the volume."""
    one = channel_name(name)
    kind = {MASS: TENSION, FLOW.name: VOLUME}.get(one.kind.name)
    return name if kind is None else str(replace(one, kind=kind))


def channels_named(name: str, channels: Iterable[str]) -> list[str]:
    """Channels that a name stands for: the channel itself, the three of a marker, or those that match a pattern: of
    channels if it has a dot (`*.tension`), else of markers (`m*`).
    """

    def means(channel: str) -> bool:
        of = channel_name(channel)
        matched = channel if "." in name else of.point
        return channel == name or (matched != "" and not of.is_deviation and fnmatchcase(matched, name))

    return [channel for channel in channels if means(channel)]


def compared_channels(
    section: ExperimentSection, channels: Iterable[str], path: KeyPath, findings: Findings
) -> tuple[str, ...]:
    """The channels to compare; empty if the section names none.

    Parameters
    ----------
    section
        Section of an experiment.
    channels
        Channels of its record.
    path
        Key path of the section in the file, for faults.
    findings
        Collects the faults and warnings.
    """
    known = [channel for channel in channels if not channel_name(channel).is_deviation]
    found: dict[str, None] = {}
    for i, name in enumerate(section.compare or ()):
        named = channels_named(name, known)
        if not named:
            findings.unknown((*path, "compare", i), "channel or marker among the data", name, known)
        found.update(dict.fromkeys(named))
    return tuple(found)


def noise_of(
    given: Mapping[str, str | float], channels: Iterable[str] | None, path: KeyPath, findings: Findings
) -> dict[str, tuple[str, float]]:
    """Standard deviation [SI] by channel, with the key that states it.

    Parameters
    ----------
    given
        Standard deviation as written, by channel or kind of channel.
    channels
        Channels of the record; None if it has not been read.
    path
        Key path of the section in the file, for faults.
    findings
        Collects the faults and warnings.

    Raises
    ------
    ParameterError
        Never past this function: `findings` keeps it among the faults of the file.
    """
    sigmas: dict[str, tuple[str, float]] = {}
    for key, value in given.items():
        # A preparation step may make the channel of a name; a pattern, or a marker's name, means what the files have.
        named = channels_named(key, channels or ()) or ([key] if channel_unit(key) is not None else [])
        if not named:
            if channels is not None:
                findings.unknown((*path, key), "channel", key, [*kinds(), *channels])
            continue
        with findings.at((*path, key)):
            sigmas |= {name: (key, noise_in(channel_unit(name) or "1").read(value)) for name in named}
    return sigmas


def experiments_named(wanted: Iterable[str], known: Iterable[str]) -> list[str]:
    """Experiments that match names and patterns (`load52*`); a name without a match is kept as it is."""
    there = list(known)
    found = [name for want in wanted for name in [n for n in there if fnmatchcase(n, want)] or [want]]
    return list(dict.fromkeys(found))


def settings_of(
    given: Mapping[str, str | float], experiment: Experiment, robot: Robot, path: KeyPath, findings: Findings
) -> dict[str, float]:
    """Settings [SI] by the dotted name of a parameter; `weight.mass` becomes the force of the load `weight`.

    Parameters
    ----------
    given
        Values as written, by the name of a parameter.
    experiment
        The experiment.
    robot
        The robot.
    path
        Key path of the section in the file, for faults.
    findings
        Collects the faults and warnings.

    Raises
    ------
    ParameterError
        Never past this function: `findings` keeps it among the faults of the file.
    """
    known = robot_parameters(robot)
    rig = rig_parameters([experiment])
    every = {**known, **rig}
    settings: dict[str, float] = {}
    for name, value in given.items():
        with findings.at((*path, name)):
            owner, kind = parameter_name(name).owner, parameter_name(name).kind
            load = next((x for x in robot.loads if isinstance(x, PointLoad) and x.name == owner), None)
            if kind == MASS and load is not None:
                mass = QUANTITIES["mass"].read(value)
                g, along = float(np.linalg.norm(robot.gravity)), float(np.dot(robot.gravity, load.direction))
                if not g > 0 or along < (1 - 1e-6) * g:
                    got = f"a load in the direction {np.round(load.direction, 3).tolist()}" if g > 0 else "no gravity"
                    allowed = "a load whose direction is that of gravity, or its force"
                    raise ParameterError(Fault("a mass hangs along gravity", got=got, allowed=allowed))
                settings[f"{owner}.force"] = mass * g
                continue
            if name not in every:
                raise ParameterError(unknown_name(name, every))
            settings[name] = every[name].quantity.read(value)
    return settings
