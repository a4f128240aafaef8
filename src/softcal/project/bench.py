"""From the project's `experiments` and `rig` sections to Experiments: files read, clocks matched, data prepared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.frame import Frame
from softcal.calibration.problem.observation import slack_faults
from softcal.calibration.problem.rig import CommonRig, Rig
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.header import MASS
from softcal.experiments.merge import merge_on_labels, merge_on_one_clock
from softcal.experiments.motion_capture import read_c3d
from softcal.experiments.orientation import QUATERNION
from softcal.experiments.plausibility import check_plausible, suspected_zeros
from softcal.experiments.prepare import PlannedStep
from softcal.experiments.read import read_table
from softcal.experiments.step import STEPS
from softcal.experiments.steps.branches import BRANCH_STEP
from softcal.experiments.steps.noise import NOISE_STEPS, set_noise
from softcal.experiments.steps.pulleys import correct_pulley_friction
from softcal.experiments.synchronise import clock_warning, synchronise
from softcal.experiments.table_format import TableFormat
from softcal.project.bench_names import (
    as_prepared,
    asked_of,
    compared_channels,
    noise_of,
    settings_of,
)
from softcal.project.bench_schema import MOTION_CAPTURE, ONE_CLOCK, ExperimentSection
from softcal.project.document import Findings, KeyPath
from softcal.project.files import InputFiles
from softcal.sensing.channel import channel_name, of_kind
from softcal.sensing.sensors.actuators import FLOW, TENSION
from softcal.twin.robot import Robot


@dataclass(frozen=True)
class Bench:
    """An experiment with its records.

    record: as read, on one clock; corrected: every sample after the corrections, with cycle numbers if cycles were
    detected, before a branch, cycles or a window were selected; None without a selection, or without times.
    """

    experiment: Experiment
    record: Dataset
    corrected: Dataset | None


def build_bench(
    name: str,
    section: ExperimentSection,
    rig: CommonRig,
    steps: Sequence[PlannedStep],
    files: InputFiles,
    findings: Findings,
    built: Robot | None = None,
) -> Bench | None:
    """One experiment; None with a fault, which goes to `findings`.

    Parameters
    ----------
    name
        Name in the project file.
    section
        Its section of the file.
    rig
        The rig that all experiments share.
    steps
        Preparation of its data.
    files
        Finds and records the files that the project names.
    findings
        Collects the faults and warnings.
    built
        The robot; None if the robot has faults.
    """
    path: KeyPath = ("experiments", name)
    n_faults = len(findings.faults)
    records = [_read(name, section, i, files, findings) for i in range(len(section.files))]
    record = _joined(section, [r for r in records if r is not None], path, findings)
    if record is None or None in records:
        return None
    channels = [as_prepared(name) for name in record.channels]
    noise = noise_of(section.noise, channels, (*path, "noise"), findings)
    compared = compared_channels(section, channels, path, findings)
    record = _with_tensions(record, built, path, findings)
    if sentence := clock_warning(record):
        findings.warn((*path, "synchronise"), sentence)
    for sentence in check_plausible(record):
        findings.warn(path, sentence.removeprefix(f"{record.name}: "))
    prepared = _Prepared(record)
    if rig.pulleys is not None and not rig.pulleys.friction_memory and of_kind(TENSION, record.channels):
        with findings.at(("rig", "pulleys")):
            pulleys = rig.pulleys
            branches = (planned.settings.get("branch", "loading") for planned in steps if planned.name == BRANCH_STEP)
            prepared.now = correct_pulley_friction(
                record, pulleys.count, pulleys.friction_coefficient, pulleys.wrap, next(branches, "loading")
            )
    for i, step in enumerate(steps):
        key = next(iter(section.prepare[i])) if isinstance(section.prepare[i], Mapping) else None
        with findings.at((*path, "prepare", i, key) if key else (*path, "prepare", i)):
            if len(findings.faults) == n_faults:
                prepared.apply(step)
    for sentence in suspected_zeros(prepared.now):
        findings.warn(path, sentence)
    for channel in of_kind(FLOW, prepared.now.channels) if len(findings.faults) == n_faults else ():
        what, attempt = "a flow is no channel of the twin", f"integrate_flow in prepare, for {as_prepared(channel)}"
        findings.add((*path, "prepare"), what, got=channel, attempt=attempt)
    for channel, (key, sigma) in noise.items():
        if key == channel and compared and channel not in compared:
            findings.warn((*path, "noise", key), "this channel is not compared: its noise is not used")
        if any(step.name in NOISE_STEPS and step.settings.get("channel") == channel for step in steps):
            allowed = "a step in prepare, or noise"
            findings.add((*path, "noise", key), "the noise of a channel is stated twice", got=channel, allowed=allowed)
        with findings.at((*path, "noise", key)):
            prepared.now = set_noise(prepared.now, channel, sigma)
    with findings.at(path):
        if len(findings.faults) == n_faults:
            dataset = _without_the_unseen(prepared.now, path, findings)
            angles = {"pitch": section.pitch_offset, "roll": section.roll_offset}
            experiment = Experiment(
                name=name,
                dataset=dataset,
                cable=section.cable or "",
                plate=section.plate or "",
                drive=tuple(section.drive) if isinstance(section.drive, list) else section.drive or "shortening",
                compared=tuple(channel for channel in compared if channel in dataset.channels),
                rig=Rig(
                    slack=section.slack,
                    backlash=section.backlash,
                    tension_offset=section.tension_offset,
                    angle_offsets={angle: value for angle, value in angles.items() if value},
                    frame=section.frame or Frame(),
                    **vars(rig),
                ),
                set_up=section.set_up,
            )
            findings.faults += [
                replace(f, where=findings.document.where((*path, "slack"))) for f in slack_faults(experiment)
            ]
            if section.frame is not None and not experiment.points:
                got = ", ".join(experiment.compared)
                findings.add(
                    (*path, "frame"), "a frame needs positions that are compared", got=got, allowed="such as m4.x"
                )
            if built is not None:
                settings = settings_of(section.settings, experiment, built, (*path, "settings"), findings)
                experiment = replace(experiment, settings=settings)
            return Bench(experiment, record, prepared.corrected)
    return None


def _without_the_unseen(data: Dataset, path: KeyPath, findings: Findings) -> Dataset:
    """The dataset without channels that have no value in any row; a warning names them."""
    empty = {name for name in data.incomplete if np.isnan(data.values(name)).all()}
    gone = dict.fromkeys(
        (channel_name(name).point or name) for name in sorted(empty) if not channel_name(name).is_deviation
    )
    for name in gone:
        findings.warn(path, f"{name} was not measured in any row: it is left out")
    seen = {name: channel for name, channel in data.channels.items() if name not in empty}
    return replace(data, channels=seen) if seen else data


def _with_tensions(record: Dataset, robot: Robot | None, path: KeyPath, findings: Findings) -> Dataset:
    """The record with the weights of masses that hang from cables as tensions."""
    hanging = [name for name in record.channels if channel_name(name).kind.name == MASS]
    if not hanging or robot is None:
        return record
    g = float(np.linalg.norm(robot.gravity))
    if not g > 0:
        findings.add(path, "a mass hangs, but there is no gravity", got=hanging[0], allowed="gravity in the robot")
        return record
    channels: dict[str, Channel] = {}
    for name, channel in record.channels.items():
        if name in hanging:
            channels[as_prepared(name)] = Channel(channel.values * g, "N", channel.sigma * g)
        else:
            channels[name] = channel
    step = Step("weigh", {"gravity": g}, f"{', '.join(hanging)}: the tensions are weights under {g:.5g} m/s^2")
    return replace(record, channels=channels, provenance=(*record.provenance, step))


@dataclass
class _Prepared:
    """A dataset during its preparation, and its last version with every sample or cycle."""

    now: Dataset
    corrected: Dataset | None = None
    chosen: bool = False

    def apply(self, step: PlannedStep) -> None:
        leaves_out = STEPS[step.name].leaves_out
        self.chosen = self.chosen or leaves_out == "cycles"  # after a window, cycles may still be found in the rest
        if leaves_out and self.corrected is None and "time" in self.now.channels:
            self.corrected = self.now
        self.now = step.apply(self.now)
        if not self.chosen and self.now.cycle is not None:
            self.corrected = self.now


def _read(name: str, section: ExperimentSection, i: int, files: InputFiles, findings: Findings) -> Dataset | None:
    file, path = section.files[i], ("experiments", name, "files", i)
    with findings.at((*path, "path")):
        found = files.find(file.path, "data file")
        with findings.at(path):
            if tuple(file.axes) != TableFormat.axes and not file.columns.keys() & {*QUATERNION}:
                what, attempt = "axes turn quaternions alone, and no column is of one", "scale: -1, for an angle"
                findings.add((*path, "axes"), what, got=", ".join(file.axes), attempt=attempt)
            if found.suffix.lower() == MOTION_CAPTURE:
                return read_c3d(found, file.markers, name=name)
            drives = section.drive if isinstance(section.drive, list) else [section.drive or "shortening"]
            complete = [key for key in file.columns if as_prepared(key) in drives and "." not in key]
            return read_table(found, written=file, name=name, label=section.label, complete=complete, **asked_of(file))
    return None


def _joined(section: ExperimentSection, records: list[Dataset], path: KeyPath, findings: Findings) -> Dataset | None:
    """One record of all files: joined by the labels of their rows, by one clock, or by cross-correlation of a motion in
    both.
    """
    motion = section.synchronise
    if len(section.files) == 1:
        return records[0] if records else None
    if len(records) < len(section.files):
        return None
    joined = records[0]
    with findings.at((*path, "synchronise") if motion is not None else (*path, "label")):
        for i, other in enumerate(records[1:], start=2):
            other = replace(other, name=f"file {i} of {other.name}")
            if motion is None:
                joined = merge_on_labels(joined, other)
            elif motion == ONE_CLOCK:
                joined = merge_on_one_clock(joined, other)
            else:
                joined = synchronise(joined, other, motion)
        return joined
    return None
