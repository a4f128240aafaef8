"""An experiment's files and preparation steps, checked before any file is read."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from softcal.calibration.problem.rig import CommonRig
from softcal.errors import InputError
from softcal.experiments.header import raise_faults, read_layout
from softcal.experiments.prepare import PlannedStep, parse_steps
from softcal.experiments.steps.branches import PULLEY_STEP
from softcal.project.bench_names import as_prepared, asked_of, check_names, noise_of
from softcal.project.bench_schema import MOTION_CAPTURE, ONE_CLOCK, ExperimentSection
from softcal.project.document import Findings, KeyPath
from softcal.project.files import InputFiles


def plan_bench(
    name: str,
    section: ExperimentSection,
    rig: CommonRig,
    parts: Mapping[str, list[str]] | None,
    files: InputFiles,
    findings: Findings,
) -> tuple[PlannedStep, ...]:
    """Preparation of an experiment's data; steps with a fault, which goes to `findings`, are left out.

    Parameters
    ----------
    name
        Name in the project file.
    section
        Section of the experiment.
    rig
        The rig that all experiments share.
    parts
        Names of the robot's parts by kind, such as "cables"; None if unknown, since the robot has faults.
    files
        Finds and records the files that the project names.
    findings
        Collects the faults and warnings.
    """
    path: KeyPath = ("experiments", name)
    check_names(section, parts, path, findings)
    channels = [as_prepared(key) for file in section.files for key in file.columns]
    drives = section.drive if isinstance(section.drive, list) else []
    steps: list[PlannedStep | None] = []
    for i, step in enumerate(section.prepare):
        try:
            steps += parse_steps([step], where="", channels=channels, drives=drives)
        except InputError as error:
            steps.append(None)
            for fault in error.faults:
                keys = [key for key in re.sub(r"^\[0\]", "", fault.where).split(".") if key]
                where = findings.document.where((*path, "prepare", i, *keys))
                findings.faults.append(replace(fault, where=where))
    if rig.pulleys is not None and any(step is not None and step.name == PULLEY_STEP for step in steps):
        findings.add(
            (*path, "prepare"),
            "the pulleys' friction would be corrected twice",
            got=f"rig.pulleys and the step {PULLEY_STEP}",
            allowed="one of the two",
        )
    for i, file in enumerate(section.files):
        with findings.at((*path, "files", i, "path")):
            files.find(file.path, "data file")
    noise_of(section.noise, None, (*path, "noise"), findings)
    if len(section.files) == 1:
        if section.synchronise is not None:
            findings.add((*path, "synchronise"), "there is nothing to synchronise", got="one file")
    elif section.synchronise is None and section.label is None:
        findings.add(
            path,
            "the relation of the files' clocks is not specified",
            got=f"{len(section.files)} files and no key 'synchronise'",
            allowed=f"synchronise: {ONE_CLOCK}, or synchronise: {{max_lag: 5 s}} for a clock each, "
            "or label: the column that names each state",
        )
    return tuple(step for step in steps if step is not None)


def check_headers(name: str, section: ExperimentSection, files: InputFiles, findings: Findings) -> None:
    """Check that the existing tables of an experiment have the columns that it names; rows are not read.

    Parameters
    ----------
    name
        Name in the project file.
    section
        Section of the experiment.
    files
        Finds and records the files that the project names.
    findings
        Collects the faults and warnings.
    """
    for i, file in enumerate(section.files):
        with findings.at(("experiments", name, "files", i, "path")):
            path = files.find(file.path, "data file")
            if path.suffix.lower() == MOTION_CAPTURE:
                continue
            with findings.at(("experiments", name)):
                layout = read_layout(path, written=file, label=section.label, **asked_of(file))
                raise_faults(layout.faults, layout.unit_faults)
