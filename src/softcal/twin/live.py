"""A twin that holds its state and moves from commands to commands, for whoever drives it in a loop."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, wraps
from typing import Annotated, Any, Concatenate, NoReturn, ParamSpec, TypeVar, runtime_checkable
from typing import Protocol as Shape

import numpy as np

from softcal.checks import Floats, ReadOnly
from softcal.declare import FixedMapping, OrInfinite, as_annotated, checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, InputError, ParameterError, SimulationError, unknown
from softcal.geometry.obstacle import Obstacle
from softcal.limits import LIMITS
from softcal.mechanics.actuator import ActuatorLimits
from softcal.mechanics.cable import cables_of
from softcal.mechanics.compliance import compliances
from softcal.mechanics.inertia import Inertia
from softcal.mechanics.march import Reached, Target
from softcal.mechanics.neighbours import STEP, Neighbours
from softcal.mechanics.node import by_parameters
from softcal.mechanics.small_motions import galerkin, pole_rates, poles_of, rates_along, small_motions
from softcal.mechanics.stability import is_stable
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.mechanics.warm_steps import WarmSteps
from softcal.sensing.channel import ChannelName, channel_name, kinds
from softcal.twin.build import Twin, build_twin, twin_of
from softcal.twin.channels import STIFFNESS, stiffness_units
from softcal.twin.clearance import Clearances
from softcal.twin.crossings import crossed_at
from softcal.twin.drawn_out import drawn_out, drawn_out_at
from softcal.twin.linear_system import LinearSystem
from softcal.twin.masses import no_mass, robot_inertia
from softcal.twin.parameters import parameter_values, robot_parameters, unknown_name, with_parameters, with_shape
from softcal.twin.protocol import Command, Protocol, command_faults, controls_at
from softcal.twin.response import Snapshot
from softcal.twin.robot import Control, Robot
from softcal.twin.sensors import angle_columns, channel_units, sense, sense_rates
from softcal.twin.simulate import statics_faults
from softcal.twin.start import UNDER_LOADS, instability, loaded, slack_line, snapshot
from softcal.twin.time_settings import TimeSettings
from softcal.units import format_quantity

DEFAULT = TimeSettings()
PARAMETER_STEP = 1e-6  # of a value, on either side for derivatives of M, C and K


@runtime_checkable
class HasRobot(Shape):
    """A project, or a run with its calibrated values: both have a robot."""

    @property
    def robot(self) -> Robot: ...


@displayed
@dataclass(frozen=True)
class Jacobian(ReadOnly):
    """Derivatives of channels, in SI.

    Attributes
    ----------
    channels
        Names of the rows.
    names
        Names of the columns: commands such as `front.shortening`, or parameters.
    values
        The derivatives (n_channels, n_names).
    """

    channels: tuple[str, ...]
    names: tuple[str, ...]
    values: Floats

    def __getitem__(self, entry: tuple[str, str]) -> float:
        """One derivative, by channel and name.

        Raises
        ------
        InputError
            For a channel or a name that there is not.
        """
        channel, name = as_annotated(entry, tuple[str, str], "entry")
        return float(self.of([channel])[0, _number(name, self.names, "by this there is no derivative")])

    def of(self, channels: Sequence[str]) -> Floats:
        """The rows of some channels (n, n_names), in their order.

        Raises
        ------
        InputError
            For a channel that there is not.
        """
        names = as_annotated(channels, Sequence[str], "channels")
        return self.values[[_number(name, self.channels, "there is no such channel") for name in names]]


def _number(name: str, names: Sequence[str], what: str) -> int:
    """The number of a row or column."""
    if name not in names:
        raise ParameterError(unknown(what, "", name, names))
    return names.index(name)


@displayed
@dataclass(frozen=True, eq=False)
class LiveState:
    """An equilibrium of a live twin.

    Attributes
    ----------
    commands
        Actuator -> its command there, such as a shortening [m] or tension [N].
    channels
        Channel -> value [SI], as of `Response.channels`.
    succeeded
        Whether the commands were reached; if not, this is the last equilibrium, where the twin stays.
    status
        How the step ended, in sentences.
    n_iterations
        Iterations with a kept factorisation; 0 where the load path to the commands had to be followed.
    n_factorisations
        Factorisations of the step.
    snaps
        Whether the robot snapped or buckled on the way to it.
    """

    commands: Mapping[str, float]
    channels: Mapping[str, float]
    succeeded: bool
    status: str
    n_iterations: int
    n_factorisations: int
    snaps: bool
    _place: _Place = field(repr=False)

    def by_commands(self) -> Jacobian:
        """Derivatives of the channels by the commands of all driven actuators.

        Of the twin's present state to 1e-7, by the kept factorisation; of another state, or where that factorisation
        is too far off, exact, at the cost of a factorisation.

        Of a robot that remembers: by the commands of this state alone, from the state before it.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        return self._place.by_commands()

    def by_parameters(self, *names: str) -> Jacobian:
        """Exact derivatives of the channels by parameters of the robot, at the cost of one factorisation.

        Raises
        ------
        ParameterError
            For a parameter that the robot does not have, or, where it remembers, that is not among the sensitivities of
            its live twin.
        SimulationError
            Where the tangent is singular.
        """
        return self._place.by_parameters(as_annotated(names, tuple[str, ...], "names"))

    def stiffnesses(self, *names: str) -> Mapping[str, float]:
        """Stiffnesses such as `tip.x_stiffness` [SI]: of a plate's channel the force or moment on it by which the
        channel changes, of an actuator's coordinate such as `front.shortening_stiffness` the effort, per unit, all
        other commands staying; 0 of a slack cable.

        Raises
        ------
        ParameterError
            For what has no stiffness, see `LiveTwin.stiffness_units`.
        SimulationError
            Where it is not defined, as with friction or a memory, or the tangent is singular.
        """
        named = as_annotated(names, tuple[str, ...], "names")
        return FixedMapping(zip(named, self._place.stiffnesses(named)[0].tolist(), strict=True))

    def stiffnesses_by_commands(self, *names: str) -> Jacobian:
        """Derivatives of stiffnesses by the commands, by differences of the tangent along the exact ways of the
        unknowns: right to about 1e-7.

        Raises
        ------
        ParameterError, SimulationError
            See `stiffnesses`.
        """
        named = as_annotated(names, tuple[str, ...], "names")
        return Jacobian(named, *self._place.stiffnesses(named, rates=True)[1:])

    @checked_arguments
    def clearances(self, obstacles: Mapping[str, Obstacle]) -> Clearances:
        """Distances of the robot's surface from obstacles: of its bodies, rods and discs, not of its cables.

        Parameters
        ----------
        obstacles
            The obstacles by name.
        """
        return self._place.clearances(obstacles)

    def clearances_by_commands(self, near: Clearances) -> Jacobian:
        """Exact derivatives of the distances `near` of this state by the commands, in their order; the channels are
        the obstacles.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        return self._place.clearance_rates(near)

    @property
    def is_stable(self) -> bool:
        """Whether it is a stable equilibrium, at the cost of one factorisation, which derivatives share.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        return self._place.is_stable()

    @property
    def crossed(self) -> str:
        """The sentence on bodies that pass through themselves or each other here, as of `warnings`; or ""."""
        return self._place.crossed().strip()

    @checked_arguments
    def linearised(
        self,
        modes: Annotated[int, LIMITS["modes"]] = 6,
        settings: TimeSettings = DEFAULT,
        parameters: Sequence[str] = (),
    ) -> LinearSystem:
        """The linear system of small motions about this equilibrium; see `softcal.linearise`.

        Parameters
        ----------
        modes
            Number of modes, beside which the static response to each input is exact.
        settings
            Settings of the time integration, of which the damping and the choice of the mass matrix count.
        parameters
            Parameters of the robot by which M, C, K and the poles get derivatives.

        Raises
        ------
        ParameterError
            For too many modes, a robot without mass, or a parameter that it does not have.
        SimulationError
            Where the commands were not reached, or there is no linear form: friction, memory, an unstable equilibrium.
        """
        if not self.succeeded:
            raise SimulationError(self.status)
        return self._place.linearised(self, modes, settings, tuple(parameters))

    @cached_property
    def shape(self) -> Snapshot:
        """The shape: positions of every body's points, cables, plates, rods and markers."""
        return self._place.shape(self.commands)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the shape, a sentence each: crossings, cables drawn out, laws beyond their stability."""
        return self._place.warnings()


P = ParamSpec("P")
R = TypeVar("R")


def _in_turn(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
    """The method, which waits for those that other threads call: a twin and its states have one factorisation."""

    @wraps(method)
    def alone(self: Any, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._steps.turn:
            return method(self, *args, **kwargs)

    return alone


class _InOneProcess:
    """Base of what has a factorisation, which is neither copied nor pickled."""

    def __reduce__(self) -> NoReturn:
        attempt = "a LiveTwin of the same robot there; of a state, its channels"
        raise InputError(Fault("a live twin cannot be copied or sent to another process", attempt=attempt))


@displayed
class LiveTwin(_InOneProcess):
    """A robot's equilibrium that follows commands, one state after the other, at the cost of a kept factorisation.

    A state is that of `simulate` at its commands. Where the robot snaps, or remembers (friction with a memory,
    histories of materials), the states are a load path in the order of the calls; along cables whose friction has no
    memory each is the state reached by pulling from rest. Angles are continuous from state to state. Stability is
    judged at every factorisation, and at least once on a way of a twentieth of the robot's size.

    Parameters
    ----------
    twin
        A robot, a project, or a run with its calibrated values.
    controls
        What drives each actuator: "shortening" or "tension", other actuators than cables by their effort; or by
        the names of the driven actuators, one of their controls each, such as "pressure" of a chamber.
    theta
        Values [SI] of robot parameters by dotted name, replacing the robot's own.
    sensitivities
        Of a robot that remembers: the parameters by which derivatives are wanted, carried from state to state; each
        state then costs a factorisation.

    Raises
    ------
    ParameterError
        For a parameter, an actuator or a control that there is not, or a value out of range.
    SimulationError
        Where the robot has no equilibrium under its loads.
    """

    @checked_arguments
    def __init__(
        self,
        twin: Robot | HasRobot,
        controls: Control | Mapping[str, Control] = "shortening",
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
    ) -> None:
        robot = twin if isinstance(twin, Robot) else twin.robot
        known, values = robot_parameters(robot), parameter_values(robot, theta)
        names = tuple(sensitivities)
        faults = statics_faults(robot, values) + [unknown_name(name, known) for name in names if name not in known]
        if faults:
            raise ParameterError(faults)
        self.robot = with_shape(robot, theta or {})
        self._controls: dict[str, Control] = {}
        if isinstance(controls, Mapping):
            self._controls |= controls
        else:
            # A control that is no actuator's own leaves it driven by its effort, as a chamber by its pressure.
            for part in self.robot.commandable:
                self._controls[part.name] = controls if controls in part.controls else part.channels[1].name
        at_rest = Protocol({name: Command(control, np.zeros(1)) for name, control in self._controls.items()})
        if faults := command_faults(self.robot, at_rest):
            raise ParameterError(faults)
        built = twin_of(robot, theta)
        statics = Statics(built.system, values)
        self._names = names if built.system.remembers else ()
        start = loaded(built, statics, self._names)
        coordinate = built.system.commanded(start.state, statics.theta)
        slack = replace(slack_line(built).at(0.0), coordinate=coordinate)
        begin = Reached(start.state, slack, np.zeros((0, 0)), has_snapped=start.snaps)
        self._steps = WarmSteps(statics, begin)
        self._twin, self._slack = built, coordinate
        self._at_rest = instability(UNDER_LOADS) if start.snaps else ""
        self.units = channel_units(built)
        self.reset()

    @property
    def state(self) -> LiveState:
        """The present equilibrium."""
        return self._state

    @_in_turn
    def reset(self) -> LiveState:
        """Return to rest: under the loads, all cables slack, nothing remembered."""
        self._steps.reset()
        n, last = self._steps.statics.n_factorisations, self._steps.last
        place = self._place(last.state, Target(last.controls), last, {})
        status = f"At rest, all cables slack.{self._at_rest}"
        return self._moved_to(place, {}, self._values(place, None), status, n)

    @property
    def controls(self) -> Mapping[str, Control]:
        """Actuator -> the coordinate or effort that commands prescribe."""
        return FixedMapping(self._controls)

    @property
    def remembers(self) -> bool:
        """Whether a state depends on the previous states."""
        return self._twin.system.remembers

    @property
    def extent(self) -> float:
        """The size of the robot [m]."""
        return self._steps.statics.length

    @property
    def stiffness_units(self) -> Mapping[str, str]:
        """Every stiffness of the robot, see `LiveState.stiffnesses`, and its SI unit."""
        return FixedMapping(stiffness_units(self.robot))

    @property
    def actuators(self) -> tuple[ActuatorLimits, ...]:
        """The driven actuators, in the order of the controls."""
        every = {one.name: one for one in self._twin.system.actuators}
        return tuple(every[name] for name in self._controls)

    @_in_turn
    def return_to(self, state: LiveState) -> LiveState:
        """Return to a state of this twin, with what the robot remembered there."""
        self._steps.return_to(state._place.reached)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] (its own)
        self._state = state
        return state

    @_in_turn
    @checked_arguments
    def at(
        self, commands: Mapping[str, float], elapsed: OrInfinite = np.inf, *, released: Collection[str] = ()
    ) -> LiveState:
        """Move to commands.

        Parameters
        ----------
        commands
            Actuator -> its coordinate or effort, such as shortening [m] or tension [N], by the twin's controls. As in a
            `Protocol`, one without a command has no effort; a cable with a pretension is then at zero shortening.
        elapsed
            Time since the last state [s], for materials that relax or flow; infinity: held for long.
        released
            Cables without a command that are slack also where they have a pretension.

        Returns
        -------
        LiveState
            With `succeeded` False and a sentence in `status` where the commands have no equilibrium.

        Raises
        ------
        ParameterError
            For an actuator that is not driven, or a command that it cannot follow.
        """
        what = f"this {self.robot.actuator_word} is not driven"
        faults = [
            unknown(what, name, name, self._controls, got="")
            for name in (*commands, *released)
            if name not in self._controls
        ]
        if not elapsed >= 0.0:
            faults.append(Fault("time does not go back", "elapsed", f"{elapsed:g} s", ">= 0 s"))
        if faults:
            raise ParameterError(faults)
        efforts = {part.name: part.channels[1].name for part in self.robot.actuated}
        free = {name: Command(efforts[name], np.zeros(1)) for name in released}
        driven = {name: Command(self._controls[name], np.array([v])) for name, v in commands.items()}
        protocol = Protocol(free | driven)
        if faults := command_faults(self.robot, protocol):
            raise ParameterError(faults)
        named = dict(protocol.completed(self.robot, 1).commands)
        values = {name: float(command.values[0]) for name, command in named.items()}
        steps, n = self._steps, self._steps.statics.n_factorisations
        before = steps.last.state
        target = replace(controls_at(self._twin.system, named, values, self._slack), elapsed=elapsed)
        try:
            reached = steps.to(Target(target, self._names))
        except SimulationError as error:
            status = f"Not reached{self._told(values)}: {str(error).rstrip('.')}. The twin stays where it was."
            return replace(
                self._state,
                succeeded=False,
                status=status,
                n_iterations=0,
                n_factorisations=steps.statics.n_factorisations - n,
            )
        # Derivatives are at the memory before the step.
        state = replace(reached.state, memory=before.memory) if self._twin.system.remembers else reached.state
        of = kinds()
        coordinates = {name: values[name] for name, one in named.items() if of[one.control].drives == "coordinate"}
        place = self._place(state, Target(target), reached, coordinates)
        status = f"Solved: {steps.n_iterations} iterations." if steps.n_iterations else "Solved along the load path."
        if reached.snaps:
            status += instability(f"before these commands{self._told(values)}")
        return self._moved_to(place, values, self._values(place, self._state), status, n)

    def _place(self, state: State, aim: Target, reached: Reached, coordinates: Mapping[str, float]) -> _Place:
        return _Place(
            twin=self._twin,
            _steps=self._steps,
            state=state,
            aim=aim,
            reached=reached,
            coordinates=coordinates,
            names=self._names,
        )

    def _moved_to(
        self, place: _Place, commands: Mapping[str, float], values: Floats, status: str, n_before: int
    ) -> LiveState:
        self._state = LiveState(
            commands=FixedMapping(commands),
            channels=FixedMapping(zip(self.units, values.tolist(), strict=True)),
            succeeded=True,
            status=status,
            n_iterations=self._steps.n_iterations,
            n_factorisations=self._steps.statics.n_factorisations - n_before,
            snaps=place.reached.snaps,
            _place=place,
        )
        return self._state

    def _values(self, place: _Place, last: LiveState | None) -> Floats:
        """The channels' values (n_channels,), angles continued from the last state."""
        values = sense(self._twin, place.reached.state, self._steps.statics.theta, place.coordinates)
        if last is not None:
            turns = angle_columns(self._twin)
            before = np.array(list(last.channels.values()))[turns]
            values[turns] += 2.0 * np.pi * np.round((before - values[turns]) / (2.0 * np.pi))
        return values

    def _told(self, commands: Mapping[str, float]) -> str:
        """Commands in brackets, after a blank."""
        units = {name: kinds()[control].unit for name, control in self._controls.items()}
        each = ", ".join(f"{name} {format_quantity(value, units.get(name, 'm'))}" for name, value in commands.items())
        return f" ({each})" if each else ""


@dataclass(frozen=True)
class _Place(_InOneProcess):
    """The place of a live twin: the equilibrium with the memory before its step, and the sample that the step reached.

    names: parameters by which the memory has derivatives.
    """

    twin: Twin
    _steps: WarmSteps
    state: State
    aim: Target
    reached: Reached
    coordinates: Mapping[str, float]
    names: tuple[str, ...]

    @_in_turn
    def by_commands(self) -> Jacobian:
        labels, dz = self._ways()
        parts = {part.name: part.channels for part in self.twin.robot.commandable}
        names = {name: str(ChannelName(parts[name][0], name)) for name in self.coordinates}
        own = {name: (np.array(labels) == label).astype(float) for name, label in names.items()}
        return self._jacobian(labels, sense_rates(self.twin, self.state, self._steps.statics.theta, dz, (), own))

    @_in_turn
    def is_stable(self) -> bool:
        statics, now = self._steps.statics, self.reached.controls
        self._steps.factorise(self.state, now)
        if statics.n_unstable() == 0:
            return True
        return is_stable(statics, statics.system.linearise(self.state, now, statics.theta))

    def _ways(self) -> tuple[tuple[str, ...], Floats]:
        """The commands of all actuators, and dz / d command (n_unknowns, k)."""
        now, target = self.reached.controls, self.aim.controls
        parts = {part.name: part.channels for part in self.twin.robot.commandable}
        numbers = np.array([self.twin.system.number(name) for name in parts], dtype=np.int64)
        labels = tuple(
            str(ChannelName(channels[int(is_held)], name))
            for (name, channels), is_held in zip(parts.items(), target.is_held[numbers].tolist(), strict=True)
        )
        return labels, self._steps.by_command(self.state, now, target, numbers)

    @_in_turn
    def stiffnesses(self, names: tuple[str, ...], *, rates: bool = False) -> tuple[Floats, tuple[str, ...], Floats]:
        """Stiffnesses (n,), the commands, and the derivatives (n, k) by these; by none without `rates`."""
        twin, statics, now = self.twin, self._steps.statics, self.reached.controls
        layout, known = twin.system.layout, stiffness_units(twin.robot)
        if others := [name for name in names if name not in known]:
            raise ParameterError([unknown("no such stiffness is computed", "", name, known) for name in others])
        labels, ways = self._ways() if rates else ((), np.zeros((layout.n_unknowns, 0)))
        values, slopes = np.zeros(len(names)), np.zeros((len(names), len(labels)))
        for k, name in enumerate(names):
            channel = channel_name(name.removesuffix(STIFFNESS))
            row, loads = twin.columns[channel], np.zeros((layout.n_unknowns, 6))
            if channel.carrier in twin.frame:
                first = layout.first_frame_unknown + 6 * twin.frame[channel.carrier]
                loads[first + np.arange(6), np.arange(6)] = 1.0

                def load(state: State, own: Floats = loads, row: int = row) -> Floats:
                    """The force or moment on the plate that does work on the channel."""
                    return own @ sense_rates(twin, state, statics.theta, own)[row][:, None]

                (value,), slope = compliances(statics, self.state, now, load, ways)
                values[k], slopes[k] = 1.0 / value, -slope[0] / value**2
                continue
            i = twin.system.number(channel.carrier)
            if now.is_held[i] and not self.aim.controls.is_held[i]:
                continue  # slack
            loads[layout.first_effort_unknown + i, 0] = 1.0
            driven = replace(now, is_held=now.is_held & (np.arange(len(now.is_held)) != i))
            own = loads[:, :1]
            (value,), slope = compliances(statics, self.state, driven, lambda _, own=own: own, ways)
            values[k], slopes[k] = -value, -slope[0]
        return values, labels, slopes

    def clearances(self, obstacles: Mapping[str, Obstacle]) -> Clearances:
        return self.twin.surface.clearances(self.state, obstacles, self._steps.statics.length)

    @_in_turn
    def clearance_rates(self, near: Clearances) -> Jacobian:
        labels, dz = self._ways()
        moves = self.twin.surface.rates(self.state, dz)[near.corners]
        return Jacobian(near.obstacles, labels, np.einsum("ni,nc,ncik->nk", near.normals, near.shares, moves))

    @_in_turn
    def by_parameters(self, names: tuple[str, ...]) -> Jacobian:
        known = robot_parameters(self.twin.robot)
        faults = [unknown_name(name, known) for name in names if name not in known]
        if self.twin.system.remembers:
            faults += [
                Fault(
                    "the memory has no derivative by this parameter",
                    name,
                    allowed=", ".join(self.names) or "none",
                    attempt=f'LiveTwin(..., sensitivities=["{name}"])',
                )
                for name in names
                if name in known and name not in self.names
            ]
        if faults:
            raise ParameterError(faults)
        statics, now = self._steps.statics, self.reached.controls
        self._steps.factorise(self.state, now)
        dz = by_parameters(statics, self.state, now, names)
        own = {name: np.zeros(len(names)) for name in self.coordinates}
        return self._jacobian(names, sense_rates(self.twin, self.state, statics.theta, dz, names, own))

    @_in_turn
    def linearised(
        self, at: LiveState, n_modes: int, settings: TimeSettings, parameters: tuple[str, ...]
    ) -> LinearSystem:
        twin, statics, now, target = self.twin, self._steps.statics, self.reached.controls, self.aim.controls
        system, n, theta = twin.system, twin.system.layout.first_effort_unknown, statics.theta
        known = robot_parameters(twin.robot)
        if faults := [unknown_name(name, known) for name in parameters if name not in known]:
            raise ParameterError(faults)

        def inertia_of(one: Twin, values: Mapping[str, float]) -> Inertia:
            """The inertia of a twin at parameters: its robot has the values of its shape, but not the others."""
            own = {name: values[name] for name, info in robot_parameters(one.robot).items() if not info.shapes}
            return robot_inertia(one, with_parameters(one.robot, own), settings.masses)

        inertia = inertia_of(twin, theta)
        if inertia.is_none:
            raise ParameterError(no_mass(twin.robot))
        driven = [part for part in twin.robot.commandable if target.is_held[system.number(part.name)]]
        inputs = tuple(str(ChannelName(part.channels[1], part.name)) for part in driven)
        numbers = np.array([system.number(part.name) for part in driven], dtype=np.int64)
        motions = small_motions(statics, inertia, settings.rayleigh, self.state, now, numbers, n_modes)
        alone = np.zeros((system.layout.n_unknowns, len(numbers)))
        alone[n + numbers, np.arange(len(numbers))] = 1.0
        outputs, direct = (
            sense_rates(twin, self.state, statics.theta, dz, (), dict.fromkeys(self.coordinates, np.zeros(dz.shape[1])))
            for dz in (motions.basis, alone)
        )
        exact = self.by_commands()
        size = motions.wider.shape[1]
        rates = np.zeros((len(parameters), 3, size, size))
        ways = by_parameters(statics, self.state, now, parameters)  # with the factors of `by_commands`

        def matrices(one: Twin, there: State, values: Mapping[str, float]) -> Floats:
            own = inertia_of(one, values)
            return galerkin(one.system, values, own, settings.rayleigh, there, now, motions.wider)

        def another(name: str, offset: float) -> Twin:
            return build_twin(with_shape(twin.robot, {name: known[name].value + offset}))

        for k, name in enumerate(parameters):
            rates[k] = rates_along(lambda there: matrices(twin, there, theta), statics, self.state, ways[:, k])
            beside = system.neighbours.get(name)
            if beside is None and known[name].shapes:  # such as the place of a via point
                extent = float(np.ptp(system.layout.X, axis=0).max()) if known[name].unit == "m" else 1.0
                beside = Neighbours(partial(another, name), STEP * extent)
            if beside is not None:
                rates[k] += beside.rate(lambda one, there: matrices(one, there, theta), self.state)
                continue
            step = PARAMETER_STEP * (abs(theta[name]) or 1.0)
            before, after = (
                matrices(twin, self.state, {**theta, name: theta[name] + sign * step}) for sign in (-1.0, 1.0)
            )
            rates[k] += (after - before) / (2.0 * step)
        M, C, K = matrices(twin, self.state, theta) if parameters else np.zeros((3, size, size))

        def rates_of(wanted: Any, damping: Floats, of: Floats) -> Any:
            """Derivatives of the poles that are nearest to the wanted ones."""
            if not parameters:
                return np.zeros((len(wanted), 0))
            poles, slopes = pole_rates(np.array([M, damping, K]), of)
            return slopes[np.abs(poles - wanted[:, None]).argmin(axis=1)]

        undamped = rates_of(1j * motions.frequencies, 0.0 * C, rates * np.array([1.0, 0.0, 1.0])[:, None, None])
        reduced = poles_of(np.eye(len(motions.stiffness)), motions.damping, motions.stiffness)[0]
        columns = [exact.names.index(name) for name in inputs]
        gain = outputs @ np.linalg.solve(motions.stiffness, motions.inputs) + direct
        largest = np.abs(exact.values[:, columns]).max(axis=1, initial=0.0)
        off = np.abs(gain - exact.values[:, columns]).max(axis=1, initial=0.0)
        k = np.arange(n_modes)
        return LinearSystem(
            commands=at.commands,
            values=at.channels,
            units=channel_units(twin),
            inputs=inputs,
            channels=exact.channels,
            frequencies=motions.frequencies / (2.0 * np.pi),
            damping_ratios=motions.damping[k, k] / (2.0 * motions.frequencies),
            frequency_errors=motions.errors,
            next_frequency=motions.next_frequency / (2.0 * np.pi),
            mass=np.eye(len(motions.stiffness)),
            damping=motions.damping,
            stiffness=motions.stiffness,
            input_matrix=motions.inputs,
            output_matrix=outputs,
            feedthrough=direct,
            static_error=float(np.max(off / np.where(largest > 0.0, largest, 1.0), initial=0.0)),
            parameters=parameters,
            frequency_rates=np.imag(undamped) / (2.0 * np.pi),
            pole_rates=rates_of(reduced, C, rates),
        )

    def shape(self, commands: Mapping[str, float]) -> Snapshot:
        return snapshot(self.twin, self.state, self._steps.statics.theta, dict(commands), 0.0, "")

    def crossed(self) -> str:
        skins = self.twin.skins
        return "" if skins is None else crossed_at([("these commands", skins.crossings(self.state.x))])

    def warnings(self) -> tuple[str, ...]:
        system, theta = self.twin.system, self._steps.statics.theta
        begin = cables_of(system).lengths(self._steps.begin.state.x)
        crossed = self.crossed()
        out = drawn_out_at([("these commands", drawn_out(system, theta, begin, self.state))])
        return tuple(told.strip() for told in (crossed, out, system.remarks(self.state, theta)) if told)

    def _jacobian(self, names: tuple[str, ...], values: Floats) -> Jacobian:
        return Jacobian(tuple(channel_units(self.twin)), names, values)
