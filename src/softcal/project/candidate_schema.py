"""Schema of the `candidates` section of a project file: tests that could be made next."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field

from softcal.analysis.candidate import Candidate, controls_of
from softcal.analysis.default_candidates import like_by_default
from softcal.calibration.problem.experiment import Experiment
from softcal.declare import listed
from softcal.errors import Fault, InputError
from softcal.limits import LIMITS
from softcal.project.bench_names import settings_of
from softcal.project.document import Findings, KeyPath
from softcal.project.section import Given, Section
from softcal.quantities import QUANTITIES, noise_in
from softcal.sensing.channel import channel_unit, positions
from softcal.twin.robot import Robot


class CandidateSection(Section):
    """A candidate test: like an experiment, by default that of its kind of actuator with the largest effort, except for
    the keys present.

    shortening, tension, volume, pressure, angle, torque: how far the actuator is driven, by one of its two. measure:
    channels, markers or plates, besides those of the experiment. noise: of those channels and of others.
    """

    like: str = ""
    actuator: str = ""
    shortening: Annotated[float, QUANTITIES["shortening"]] | None = None
    tension: Annotated[float, QUANTITIES["tension"]] | None = None
    volume: Annotated[float, QUANTITIES["pumped volume"]] | None = None
    pressure: Annotated[float, QUANTITIES["gauge pressure"]] | None = None
    angle: Annotated[float, QUANTITIES["angle"]] | None = None
    torque: Annotated[float, QUANTITIES["moment"]] | None = None
    samples: Annotated[int, LIMITS["samples"]] | None = None
    measure: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    noise: Mapping[str, Given] = Field(default_factory=dict)
    settings: Mapping[str, Given] = Field(default_factory=dict)
    repeats: Annotated[int, LIMITS["repeats"]] = 1

    @property
    def reach(self) -> dict[str, float]:
        """The largest command [SI] of the test, by the stated control."""
        controls = ("shortening", "tension", "volume", "pressure", "angle", "torque")
        return {control: value for control in controls if (value := getattr(self, control)) is not None}

    def _check(self) -> None:
        if len(self.reach) > 1:
            allowed = "one of them, such as shortening: 40 mm, or tension: 8 N"
            raise InputError(Fault("a candidate is driven in two ways", "", " and ".join(self.reach), allowed))


def build_candidates(
    sections: Mapping[str, CandidateSection], experiments: Mapping[str, Experiment], robot: Robot, findings: Findings
) -> tuple[Candidate, ...]:
    """Candidate tests with their names resolved; every fault goes to `findings`.

    Parameters
    ----------
    sections
        Section of each candidate.
    experiments
        The project's experiments by name.
    robot
        The robot.
    findings
        Collects the faults and warnings.
    """
    found: list[Candidate] = []
    for name, section in sections.items():
        path: KeyPath = ("candidates", name)
        if not experiments:
            findings.add(path, "there is no experiment that the candidate could be like", allowed="experiments: …")
            continue
        if section.like and section.like not in experiments:
            findings.unknown((*path, "like"), "experiment", section.like, experiments)
        known = {part.name: part for part in robot.commandable}
        if section.actuator and section.actuator not in known:
            findings.unknown((*path, "actuator"), robot.actuator_word, section.actuator, known)
        control, reach = next(iter(section.reach.items()), ("", None))
        of_actuator = known[section.actuator].controls if section.actuator in known else ()
        default = like_by_default([*experiments.values()], of_actuator, [control])
        like = experiments.get(section.like, default)
        if control and control not in (controls := controls_of(like)):
            findings.unknown((*path, control), "control", control, controls)
        noise = {
            channel: (key, value)
            for key, value in section.noise.items()
            for channel in _channels([key], robot, (*path, "noise", key), findings)
        }
        sigmas: dict[str, float] = {}
        for channel, (key, value) in noise.items():
            with findings.at((*path, "noise", key)):
                sigmas[channel] = noise_in(channel_unit(channel) or "1").read(value)
        found.append(
            Candidate(
                name=name,
                like=section.like,
                actuator=section.actuator,
                control=control,
                reach=reach,
                samples=section.samples or 0,
                measured=tuple(_channels(section.measure, robot, (*path, "measure"), findings)),
                noise=sigmas,
                settings=settings_of(section.settings, like, robot, (*path, "settings"), findings),
                repeats=section.repeats,
            )
        )
    return tuple(found)


def _channels(names: Iterable[str], robot: Robot, path: KeyPath, findings: Findings) -> list[str]:
    """Channels by name; a marker or plate stands for its three channels."""
    points = [part.name for part in (*robot.markers, *robot.plates)]
    found: list[str] = []
    for name in names:
        if channel_unit(name) is not None:
            found.append(name)
        elif name in points:
            found += map(str, positions(name))
        else:
            findings.unknown(path, "channel, marker or plate", name, points)
    return found
