"""From the project's `experiments` and `rig` sections to Experiments: files read, clocks matched, data prepared."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from softcal.calibration.experiment import Experiment, Pulleys, Rig
from softcal.errors import Fault, InputError
from softcal.experiments.corrections import correct_pulley_friction
from softcal.experiments.dataset import Dataset
from softcal.experiments.merge import merge_on_one_clock
from softcal.experiments.names import CHANNEL_UNITS
from softcal.experiments.noise import set_noise
from softcal.experiments.plausibility import check_plausible
from softcal.experiments.prepare import PlannedStep, parse_steps
from softcal.experiments.read import ColumnSpec, read_table
from softcal.experiments.synchronise import synchronise
from softcal.project.bench_schema import ONE_CLOCK, ExperimentSection, FileSection, RigSection
from softcal.project.document import Findings, KeyPath
from softcal.project.files import InputFiles
from softcal.project.robot_schema import RobotSection
from softcal.units import parse_quantity

# From these steps on, the dataset no longer holds every cycle.
CHOOSING = ("select_cycles", "take_branch")
PULLEY_STEP = "correct_pulley_friction"


@dataclass(frozen=True)
class Bench:
    """An experiment with the records it came from.

    record: as read, on one clock; cycles: every cycle after the corrections and before a choice among them, or None
    where no cycles were looked for.
    """

    experiment: Experiment
    record: Dataset
    cycles: Dataset | None


def build_bench(
    name: str,
    section: ExperimentSection,
    rig: RigSection,
    robot: RobotSection | None,
    files: InputFiles,
    findings: Findings,
) -> Bench | None:
    """One experiment, or None where something of it is wrong; every fault goes to `findings`."""
    path: KeyPath = ("experiments", name)
    n_faults = len(findings.faults)
    _check_names(section, robot, path, findings)
    steps = [_planned(step, (*path, "prepare", i), findings) for i, step in enumerate(section.prepare)]
    noise = _noise(section.noise, (*path, "noise"), findings)
    if rig.pulleys is not None and any(step is not None and step.name == PULLEY_STEP for step in steps):
        findings.add(
            (*path, "prepare"),
            "the pulleys' friction would be taken off twice",
            got=f"rig.pulleys and the step {PULLEY_STEP}",
            allowed="one of the two",
        )
    records = [_read(name, file, (*path, "files", i), files, findings) for i, file in enumerate(section.files)]
    record = _joined(section, [r for r in records if r is not None], path, findings)
    if record is None or None in records or None in steps:
        return None
    for sentence in check_plausible(record):
        findings.warn(path, sentence.removeprefix(f"{record.name}: "))
    prepared = _Prepared(record)
    if rig.pulleys is not None and "tension" in record.channels:
        with findings.at(("rig", "pulleys")):
            pulleys = rig.pulleys
            prepared.now = correct_pulley_friction(record, pulleys.count, pulleys.friction_coefficient, pulleys.wrap)
    for i, step in enumerate(steps):
        key = next(iter(section.prepare[i])) if isinstance(section.prepare[i], Mapping) else None
        with findings.at((*path, "prepare", i, key) if key else (*path, "prepare", i)):
            if step is not None and len(findings.faults) == n_faults:
                prepared.apply(step)
    for channel, sigma in noise.items():
        with findings.at((*path, "noise", channel)):
            prepared.now = set_noise(prepared.now, channel, sigma)
    with findings.at(path):
        if len(findings.faults) == n_faults:
            experiment = Experiment(
                name=name,
                dataset=prepared.now,
                cable=section.cable,
                plate=section.plate or "",
                drive=section.drive,
                compared=tuple(section.compare or ()),
                rig=_rig(section, rig),
            )
            return Bench(experiment, record, prepared.cycles)
    return None


@dataclass
class _Prepared:
    """A dataset on its way through the steps, and what it was while it still held every cycle."""

    now: Dataset
    cycles: Dataset | None = None
    chosen: bool = False

    def apply(self, step: PlannedStep) -> None:
        self.chosen = self.chosen or step.name in CHOOSING
        self.now = step.apply(self.now)
        if not self.chosen and self.now.cycle is not None:
            self.cycles = self.now


def _check_names(section: ExperimentSection, robot: RobotSection | None, path: KeyPath, findings: Findings) -> None:
    if robot is None:
        return
    cables, plates = robot.names("cables"), robot.names("plates")
    if section.cable not in cables:
        findings.unknown((*path, "cable"), "cable", section.cable, cables)
    if section.plate is not None and section.plate not in plates:
        findings.unknown((*path, "plate"), "plate", section.plate, plates)
    angles = [key for file in section.files for key in file.columns if key in ("pitch", "roll", "yaw", "qw")]
    if section.plate is None and angles:
        findings.add(
            (*path, "plate"),
            "it is not said which plate carries the IMU",
            got=f"the channel {angles[0]}, no plate",
            allowed=", ".join(plates) or "a plate of the robot",
        )


def _read(name: str, file: FileSection, path: KeyPath, files: InputFiles, findings: Findings) -> Dataset | None:
    columns = {key: ColumnSpec(column.name, column.unit, column.scale) for key, column in file.columns.items()}
    with findings.at((*path, "path")):
        found = files.find(file.path, "data file")
        with findings.at(path):
            return read_table(
                found,
                columns,
                name=name,
                delimiter=file.delimiter,
                decimal=file.decimal,
                header_row=file.header_row,
                units_row=file.units_row,
                skip_rows=file.skip_rows,
                skip_footer=file.skip_footer,
                where=file.where,
                axes=file.axes,
                rest_samples=file.rest_samples,
            )
    return None


def _joined(section: ExperimentSection, records: list[Dataset], path: KeyPath, findings: Findings) -> Dataset | None:
    """One record of all files: by their one clock, or by cross-correlation of what moves in both."""
    told = section.synchronise
    if len(section.files) == 1:
        if told is not None:
            findings.add((*path, "synchronise"), "there is nothing to synchronise", got="one file")
        return records[0] if records else None
    if told is None:
        findings.add(
            path,
            "it is not said how the clocks of the files are related",
            got=f"{len(section.files)} files and no key 'synchronise'",
            allowed=f"synchronise: {ONE_CLOCK}, or synchronise: {{max_lag: 5 s}} for a clock each",
        )
        return None
    if len(records) < len(section.files):
        return None
    joined = records[0]
    with findings.at((*path, "synchronise")):
        for i, other in enumerate(records[1:], start=2):
            other = replace(other, name=f"file {i} of {other.name}")
            if told == ONE_CLOCK:
                joined = merge_on_one_clock(joined, other)
            else:
                joined = synchronise(joined, other, **told.settings())
        return joined
    return None


def _planned(step: str | Mapping[str, Any], path: KeyPath, findings: Findings) -> PlannedStep | None:
    """A preparation step with its settings in SI; a fault of it is placed at the setting."""
    try:
        return parse_steps([step], where="")[0]
    except InputError as error:
        for fault in error.faults:
            keys = [key for key in re.sub(r"^\[0\]", "", fault.where).split(".") if key]
            findings.faults.append(replace(fault, where=findings.document.where((*path, *keys))))
        return None


def _noise(given: Mapping[str, str | float], path: KeyPath, findings: Findings) -> dict[str, float]:
    sigmas: dict[str, float] = {}
    for channel, value in given.items():
        if channel not in CHANNEL_UNITS:
            findings.unknown((*path, channel), "channel", channel, CHANNEL_UNITS)
            continue
        with findings.at((*path, channel)):
            sigmas[channel] = parse_quantity(value, CHANNEL_UNITS[channel])
            if sigmas[channel] <= 0:
                raise InputError(Fault("a noise must be above zero", got=str(value)))
    return sigmas


def _rig(section: ExperimentSection, rig: RigSection) -> Rig:
    angles = {"pitch": section.pitch_offset, "roll": section.roll_offset}
    pulleys = rig.pulleys
    return Rig(
        slack=section.slack,
        tension_offset=section.tension_offset,
        angle_offsets={angle: value for angle, value in angles.items() if value},
        pulleys=None if pulleys is None else Pulleys(pulleys.count, pulleys.wrap, pulleys.friction_coefficient),
    )
