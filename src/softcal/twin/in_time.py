"""simulate_in_time(robot, schedule): motion, and settling as in the papers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from softcal.checks import Floats
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, ParameterError, SimulationError, unknown
from softcal.limits import LIMITS
from softcal.mechanics.crossing import Crossings
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.path_watch import path_watch
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import Instant, at_rest
from softcal.sensing.channel import kinds
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.build import Twin, twin_of
from softcal.twin.crossings import crossed_at
from softcal.twin.masses import no_mass, robot_inertia
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Protocol, command_faults, controls_at, let_go_faults
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot
from softcal.twin.schedule import Schedule
from softcal.twin.sensors import channel_units, sense
from softcal.twin.start import UNDER_LOADS, Start, instability, pretensioned, snapshot
from softcal.twin.time_settings import TimeSettings

DEFAULT = TimeSettings()
MOST_SHAPES = replace(LIMITS["shapes of a film"], least=0)
# Called at the beginning and after each step: the time, and the end of the schedule, both [s]; settling follows that.
Observer = Callable[[float, float], None]


@checked_arguments
def simulate_in_time(
    robot: Robot,
    schedule: Schedule,
    settings: TimeSettings = DEFAULT,
    *,
    snapshots: Annotated[int, MOST_SHAPES] = 0,
    progress: Observer | None = None,
) -> Response:
    """The twin's motion under a schedule of commands.

    Parameters
    ----------
    robot, schedule, settings
        The robot, its commands, and the settings of the time integration.
    snapshots
        Number of shapes to draw that are kept, evenly over the run's steps; 0 keeps none.
    progress
        Called at the beginning and after each step with the present time [s] and that at which the schedule is over
        [s]; a motion that is to settle continues after that.

    Returns
    -------
    Response
        Channels at the start and after every step, `time` [s] among them; a sentence in `status`. With `succeeded`
        False where no motion was found, the channels ending before, or where the robot did not settle.

    Raises
    ------
    ParameterError
        For a cable that the robot does not have, a command that it cannot follow, or a robot without mass.
    InputError
        For a settling point that the robot does not have, or too many steps.
    MeshError
        For a robot that cannot be built.
    """
    faults = [*command_faults(robot, protocol := Protocol(schedule.commands)), *let_go_faults(robot, protocol)]
    if settings.scheme == "one-solve":
        for part in robot.actuators:
            if part.actuator.driven:
                what = f"one linear solve for each step is too coarse for a {part.actuator.name}"
                faults.append(Fault(what, part.name, "scheme: one-solve", attempt="scheme: converged"))
        what = "one linear solve for each step is too coarse for friction that depends on the slip"
        for cable in robot.cables:
            keys = ["friction_memory: true"] if cable.line.friction_memory else []
            keys += ["friction_speed"] if cable.line.friction_speed is not None else []
            for key in keys:
                got, attempt = f"scheme: one-solve, {key}", f"scheme: converged, or no {key}"
                faults.append(Fault(what, cable.name, got, "scheme: converged", attempt))
    if faults:
        raise ParameterError(faults)
    after = settings.settle.longest if settings.settle else settings.hold or 0.0
    LIMITS["time steps"].check(1 + (schedule.times[-1] + after) / settings.time_step)
    schedule = schedule.completed(robot)
    schedule = schedule.held(settings.hold) if settings.hold else schedule
    settling = settings.settle
    watched = [part.name for part in (*robot.plates, *robot.markers)]
    if settling is not None and settling.on not in ("", *watched):
        what, none = "there is no such plate or marker", "none: leave it empty"
        raise InputError(unknown(what, "settling", settling.on, watched, none=none))
    twin = twin_of(robot)
    theta = parameter_values(robot)
    inertia = robot_inertia(twin, robot, settings.masses)
    if inertia.is_none:
        raise ParameterError(no_mass(robot))
    dynamics = Dynamics(twin.system, inertia, theta, settings.rayleigh, settings.scheme)
    run = _Motion(twin, theta, schedule, settings, snapshots, progress)
    try:
        run.tell(0.0)
        start = _start(twin, theta, schedule, settings)
        run.instabilities = instability(UNDER_LOADS) if start.snaps else ""
        run.to_the_end(dynamics, at_rest(start.state))
    except SimulationError as error:
        run.fail(str(error))
    except KeyboardInterrupt as stop:
        if not path_watch().keeps:
            raise
        run.stop(stop)
    finally:
        dynamics.release()
    return run.response(dynamics)


def _start(twin: Twin, theta: Mapping[str, float], schedule: Schedule, settings: TimeSettings) -> Start:
    if settings.start == "undeformed":
        return Start(rest_state(twin.system.layout))
    statics = Statics(twin.system, theta, twin.robot.limits)
    try:
        of = kinds()
        slack = [name for name, command in schedule.commands.items() if of[command.control].drives == "effort"]
        return pretensioned(twin, statics, slack)
    finally:
        statics.release()


@dataclass
class _Motion:
    """A run in progress: its response so far."""

    twin: Twin
    theta: Mapping[str, float]
    schedule: Schedule
    settings: TimeSettings
    n_snapshots: int
    progress: Observer | None = None
    times: list[float] = field(default_factory=list[float])
    rows: list[Floats] = field(default_factory=list[Floats])
    shapes: list[Snapshot] = field(default_factory=list[Snapshot])
    status: str = ""
    instabilities: str = ""
    crossed: list[tuple[str, Crossings]] = field(default_factory=list[tuple[str, Crossings]])
    succeeded: bool = True
    stopped_by: KeyboardInterrupt | None = None

    def to_the_end(self, dynamics: Dynamics, now: Instant) -> None:
        """Step until the schedule is over, and then, if requested, until the robot is at rest."""
        h, settling = self.settings.time_step, self.settings.settle
        n_steps = self._n_steps
        longest = n_steps + (0 if settling is None else int(np.ceil(settling.longest / h)))
        self._keep(now, n_steps)
        still_since = np.inf
        for k in range(1, longest + 1):
            now = replace(dynamics.advance(now, h, self._controls), time=k * h)
            self._keep(now, n_steps)
            self.tell(now.time)
            if settling is None or k < n_steps:
                continue
            still_since = min(still_since, now.time) if self._speed(now) <= settling.speed else np.inf
            if now.time - still_since >= settling.hold - 1e-9 * h:
                self.status = (
                    f"Settled after {now.time:.6g} s, {k} steps: {self._watched} slower than "
                    f"{settling.speed:.3g} m/s for {settling.hold:.3g} s."
                )
                break
        else:
            speed = self._speed(now)
            if settling is None:
                self.status = f"Moved for {now.time:.6g} s in {longest} steps; speed at the end {speed:.3g} m/s."
            else:
                self.succeeded = False
                self.status = (
                    f"Not settled after {now.time:.6g} s, {longest} steps: {self._watched} still at {speed:.3g} m/s, "
                    f"tolerance {settling.speed:.3g} m/s. Try more rayleigh_mass, a longer step, or a slower ramp."
                )
        if dynamics.n_halvings:
            self.status += f" {dynamics.n_halvings} step(s) were taken in halves."
        if self.n_snapshots and (not self.shapes or self.shapes[-1].drive != now.time):
            self.shapes.append(self._shape(now))

    def tell(self, time: float) -> None:
        """Report the progress."""
        if self.progress is not None:
            self.progress(time, self._n_steps * self.settings.time_step)

    def fail(self, why: str) -> None:
        """End the run: no motion was found."""
        self.status, self.succeeded = why, False

    def stop(self, by: KeyboardInterrupt) -> None:
        """End the run with the steps that are ready."""
        n = min(len(self.times), len(self.rows))
        self.times, self.rows = self.times[:n], self.rows[:n]
        self.fail(f"Stopped by {str(by) or 'the user'} after {self.times[-1] if n else 0.0:.6g} s.")
        self.stopped_by = by

    def response(self, dynamics: Dynamics) -> Response:
        """The response so far."""
        units = {"time": "s", **channel_units(self.twin)}
        table = np.array(self.rows).reshape(len(self.rows), len(units) - 1)
        crossings = crossed_at(self.crossed)
        columns = [np.array(self.times), *table.T]
        return Response(
            channels=dict(zip(units, columns, strict=True)),
            units=units,
            status=self.status + self.instabilities + crossings,
            succeeded=self.succeeded,
            instabilities=self.instabilities.strip(),
            crossings=crossings.strip(),
            n_factorisations=dynamics.n_factorisations,
            snapshots=tuple(self.shapes),
            tets=self.twin.tets if self.shapes else {},
            walls=self.twin.walls if self.shapes else {},
            stopped_by=self.stopped_by,
        )

    @property
    def _n_steps(self) -> int:
        """Number of steps of the schedule."""
        return max(int(np.ceil(float(self.schedule.times[-1]) / self.settings.time_step - 1e-9)), 0)

    @property
    def _watched(self) -> str:
        settling = self.settings.settle
        return settling.on if settling is not None and settling.on else "every point"

    def _controls(self, time: float) -> Controls:
        none = np.zeros(self.twin.system.layout.n_actuators)
        return controls_at(self.twin.system, self.schedule.commands, self.schedule.at(time), none)

    def _keep(self, now: Instant, n_steps: int) -> None:
        row = sense(self.twin, now.state, self.theta)
        controls = self._controls(now.time)
        robot, slack = self.twin.robot, ~controls.is_held & (now.state.effort == 0.0)
        for i, cable in enumerate(robot.cables):
            if slack[i] and cable.name not in robot.led:  # its shortening is the command
                row[self.twin.column(cable.name, SHORTENING)] = controls.coordinate[i]
        if self.n_snapshots and len(self.rows) % max(n_steps // self.n_snapshots, 1) == 0:
            self.shapes.append(self._shape(now))
        self.times.append(now.time)
        self.rows.append(row)

    def _shape(self, now: Instant) -> Snapshot:
        if self.twin.skins is not None:
            self.crossed.append((f"{now.time:.4g} s", self.twin.skins.crossings(now.state.x)))
        return snapshot(self.twin, now.state, self.theta, self.schedule.at(now.time), now.time, "s")

    def _speed(self, now: Instant) -> float:
        """Speed of the watched points [m/s]."""
        settling, velocities = self.settings.settle, now.velocities
        on = "" if settling is None else settling.on
        if on in self.twin.frame:
            return float(np.linalg.norm(velocities.frames[self.twin.frame[on]]))
        if on in self.twin.markers:
            parts = [w * velocities.points[p] for p, w in self.twin.markers[on].points]
            return float(np.linalg.norm(np.sum(parts, axis=0)))
        return float(np.sqrt(np.square(velocities.points).sum(axis=1).max(initial=0.0)))
