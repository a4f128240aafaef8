"""SOFA as a replacement of softcal's statics: the same robot and protocol, run to rest in SOFA's processes.

The engine has `simulate`'s signature. SOFA has no derivatives: they are forward differences, since states at rest are
accurate to five digits and more, and a least-squares search needs some ten times three simulations where TPE needs a
thousand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import ParameterError
from softcal.export.engine import left_out_by
from softcal.plugins.sofa.install import Sofa, find_sofa
from softcal.plugins.sofa.process import ProcessOutcome, run_states
from softcal.plugins.sofa.response import SofaSamples, along_one_cable, row_by_row, shapes
from softcal.plugins.sofa.robot import (
    LinearRobot,
    command_faults_of_sofa,
    element_faults,
    linear_robot,
    scene_commands,
    scene_faults,
)
from softcal.plugins.sofa.settings import SofaSettings
from softcal.twin.build import Twin, twin_of
from softcal.twin.parameters import robot_parameters, unknown_name, with_parameters
from softcal.twin.protocol import Command, Protocol, command_faults
from softcal.twin.response import Derivatives, Response, by_column
from softcal.twin.robot import Robot
from softcal.twin.sensors import channel_units

STEP = 2e-2  # finite-difference step over a parameter's value, or over its distance from an excluded limit
STEPS_FROM_ZERO = {"kg/m^3": 10.0, "kg": 1e-3, "N": 1e-3}
COMMAND_STEPS = {"tension": 1e-2, "shortening": 1e-4, "pressure": 1e2, "angle": 1e-2}  # [N], [m], [Pa], [rad]


@dataclass(frozen=True)
class SofaEngine:
    """SOFA as a simulator.

    For one driven cable, at most `states` shortenings or tensions are run to rest, and the samples are interpolated by
    a cubic spline; with several driven actuators, a chamber or a drive, every sample is run to rest.
    """

    sofa: Sofa
    settings: SofaSettings = field(default_factory=SofaSettings)

    def require(self, robot: Robot) -> None:
        """Check that SOFA supports a robot.

        Raises
        ------
        ParameterError
            For friction and stretch of cables, and elements and laws that SOFA lacks.
        """
        if faults := [*scene_faults(robot), *element_faults(robot)]:
            raise ParameterError(faults)

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        """The response at rest without contact, else as that of `simulate`; `n_factorisations` counts SOFA's steps.

        Raises
        ------
        ParameterError
            For a robot or a value that SOFA does not support, an unknown parameter or cable, or a command that no cable
            can follow.
        MeshError
            For a robot that cannot be built.
        """
        robot = with_parameters(robot, theta or {})
        known = robot_parameters(robot)
        commanded = protocol.drives
        self.require(robot)
        faults = command_faults(robot, protocol) + command_faults_of_sofa(protocol)
        faults += [unknown_name(n, {**known, **commanded}) for n in sensitivities if n not in {**known, **commanded}]
        if faults:
            raise ParameterError(faults)
        remarks = "" if robot.contact is None else left_out_by("SOFA")
        run = _EngineRun(self, protocol, linear_robot(robot), remarks)
        return run.response(sensitivities, snapshots)


def sofa_engine(settings: SofaSettings | None = None) -> SofaEngine:
    """The engine of the SOFA that SOFA_ROOT names.

    Raises
    ------
    InputError
        If there is none, or it has no SoftRobots.
    """
    return SofaEngine(find_sofa(), settings or SofaSettings())


@dataclass
class _EngineRun:
    """One protocol on one robot, and on its variants for finite differences."""

    engine: SofaEngine
    protocol: Protocol
    linear: LinearRobot
    remarks: str = ""
    steps: int = 0

    @property
    def driven(self) -> list[str]:
        commands = self.protocol.commands.items()
        return [n for n, command in commands if command.control == "shortening" or np.any(command.values != 0.0)]

    @property
    def cable(self) -> str:
        """The driven actuator, if it is the only one and a cable; else ""."""
        alone = self.driven[0] if len(self.driven) == 1 else ""
        return alone if alone in {cable.name for cable in self.linear.robot.cables} else ""

    def response(self, sensitivities: Sequence[str], snapshots: bool) -> Response:
        robot = self.linear.robot
        twin = twin_of(robot)
        outcome = self._outcome(self.linear, self.protocol, shapes=snapshots)
        seen = self._samples(twin, self.protocol, outcome)
        n_samples = self.protocol.n_samples
        succeeded = not outcome.failure and len(seen.values) == n_samples
        by_name: dict[str, Floats] = {}
        failure = outcome.failure
        if succeeded:
            for name in sensitivities:
                by_name[name], failure = self._derivative(name, seen)
                if failure:
                    succeeded, by_name = False, {}
                    failure = f"No derivative by {name}: {failure}"
                    break
        status = f"SOFA: {failure}."
        if succeeded:
            n_states, shortest = len(outcome.records), min(record["dt"] for record in outcome.records)
            status = f"Solved by SOFA: {n_states} states at rest, {self.steps} steps, the shortest of {shortest:g} s."
            if seen.error > 0.0:
                status += f" Samples: cubic spline, with an error of about {seen.error:.1g} of the largest value."
            elif np.isnan(seen.error):
                status += " Samples: a spline through too few states to estimate its error."
            status = f"{status} {self.remarks}".rstrip()
        units = channel_units(twin)
        return Response(
            channels=by_column(units, seen.values),
            units=units,
            status=status,
            succeeded=succeeded,
            n_factorisations=self.steps,
            sensitivities=Derivatives(tuple(units), tuple(by_name), np.stack(list(by_name.values()), axis=-1))
            if by_name
            else Derivatives(),
            slopes={} if seen.slopes is None else by_column(units, seen.slopes),
            snapshots=shapes(twin, self.protocol, outcome.records, self._states(robot, self.protocol))
            if snapshots
            else (),
            tets=twin.tets if snapshots else {},
            walls=twin.walls if snapshots else {},
            remarks=self.remarks,
        )

    def _along(self, protocol: Protocol) -> Floats:
        """Ascending commands of the driven cable that are run to rest."""
        command = protocol.commands[self.cable]
        # Zero tension is the first state anyway; zero shortening need not be slack.
        unique = np.unique(command.values if command.control == "shortening" else command.values[command.values > 0.0])
        if len(unique) <= self.engine.settings.states:
            return unique
        return np.linspace(unique[0], unique[-1], self.engine.settings.states)

    def _states(self, robot: Robot, protocol: Protocol) -> list[Mapping[str, float]]:
        if not self.driven:
            return []
        if self.cable:
            return [{self.cable: float(value)} for value in self._along(protocol)]
        commands = {name: command for name, command in protocol.commands.items() if name in self.driven}
        own = scene_commands(robot, replace(protocol, commands=commands)).commands
        return [{name: float(one.values[i]) for name, one in own.items()} for i in range(protocol.n_samples)]

    def _outcome(self, linear: LinearRobot, protocol: Protocol, *, shapes: bool = False) -> ProcessOutcome:
        engine, states = self.engine, self._states(linear.robot, protocol)
        outcome = run_states(engine.sofa, linear, protocol, states, engine.settings, shapes=shapes)
        self.steps += outcome.steps
        return outcome

    def _samples(self, twin: Twin, protocol: Protocol, outcome: ProcessOutcome) -> SofaSamples:
        if not outcome.records:
            return SofaSamples(np.zeros((0, len(channel_units(twin)))), None)
        if not self.driven:
            row = row_by_row(twin, Protocol({}), [outcome.records[0]] * 2).values
            return SofaSamples(np.repeat(row, protocol.n_samples, axis=0), None)
        if self.cable:
            return along_one_cable(twin, protocol, self.cable, self._along(protocol), outcome.records)
        return row_by_row(twin, protocol, outcome.records)

    def _derivative(self, name: str, seen: SofaSamples) -> tuple[Floats, str]:
        """Derivatives of every sample's channels by a parameter or a command; and why there are none, or ""."""
        known = robot_parameters(self.linear.robot)
        linear, protocol = self.linear, self.protocol
        if name in known:
            value, upper = known[name].value, known[name].ceiling
            step = -STEP * min(abs(value), upper - value) if value else STEPS_FROM_ZERO.get(known[name].unit, STEP)
            linear = replace(linear, robot=with_parameters(linear.robot, {name: value + step}))
        else:
            cable = protocol.drives[name]
            if cable == self.cable and seen.slopes is not None:
                return seen.slopes, ""
            if cable not in self.driven:
                return np.zeros_like(seen.values), ""
            command = protocol.commands[cable]
            step = COMMAND_STEPS[command.control]
            moved = Command(command.control, command.values + step)
            protocol = Protocol({**protocol.commands, cable: moved})
        outcome = self._outcome(linear, protocol)
        if outcome.failure:
            return np.zeros_like(seen.values), outcome.failure
        there = self._samples(twin_of(linear.robot), protocol, outcome)
        if len(there.values) < len(seen.values):
            return np.zeros_like(seen.values), "not every sample was reached"
        return (there.values - seen.values) / step, ""
