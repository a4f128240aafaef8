"""One configuration of the robot, and its update by a step of the unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import Layout
from softcal.mechanics.memory import Memory
from softcal.mechanics.rotation_kernels import rotation_vector


@dataclass(frozen=True)
class State:
    """One configuration of the robot.

    Attributes
    ----------
    x
        Positions of all points (n_points, 3) [m].
    position
        Positions of the frames (n_frames, 3) [m].
    rotation
        Rotations of the frames (n_frames, 3, 3) [-].
    pressure
        Nodal pressures (n_pressures,) [Pa].
    effort
        Efforts of the actuators (n_actuators,), each in its own unit, such as a cable's tension [N].
    memory
        What the last converged sample left to the terms; None before the first one, and where no term remembers.
    """

    x: Floats
    position: Floats
    rotation: Floats
    pressure: Floats
    effort: Floats
    memory: Memory | None = None


def rest_state(layout: Layout) -> State:
    """The undeformed, unloaded robot."""
    return State(
        x=layout.X.copy(),
        position=layout.references.copy(),
        rotation=np.broadcast_to(np.eye(3), (layout.n_frames, 3, 3)).copy(),
        pressure=np.zeros(layout.n_pressures),
        effort=np.zeros(layout.n_actuators),
    )


def moved(layout: Layout, state: State, dz: Floats) -> State:
    """The state after a step dz of the unknowns; rotations are updated as R <- exp(omega) R.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    state
        The state before the step.
    dz
        The step (n_unknowns,).
    """
    x = state.x.copy()
    _move_points(x, layout.free_points, np.ascontiguousarray(dz))
    position, rotation = state.position.copy(), state.rotation.copy()
    _move_frames(position, rotation, dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6))
    layout.links.place(x, position, rotation)
    return State(
        x=x,
        position=position,
        rotation=rotation,
        pressure=state.pressure + dz[layout.first_pressure_unknown : layout.first_effort_unknown],
        effort=state.effort + dz[layout.first_effort_unknown :],
        memory=state.memory,
    )


def difference(layout: Layout, after: State, before: State) -> Floats:
    """The dz (n_unknowns,) with moved(layout, before, dz) = after.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    after, before
        The states.
    """
    free = layout.free_points
    n = layout.n_moving_frames
    omega = logarithm(after.rotation[:n] @ np.swapaxes(before.rotation[:n], 1, 2))
    frames = np.concatenate([after.position[:n] - before.position[:n], omega], axis=1)
    return np.concatenate(
        [
            (after.x[free] - before.x[free]).ravel(),
            frames.ravel(),
            after.pressure - before.pressure,
            after.effort - before.effort,
        ]
    )


def distance(layout: Layout, one: State, other: State) -> float:
    """Distance of two states: the norm of the dz of points and frames, with metres and radians weighted alike.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    one, other
        The states.
    """
    return float(np.linalg.norm(difference(layout, one, other)[: layout.first_pressure_unknown]))


def exponential(omega: Floats) -> Floats:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3) [rad] (Rodrigues)."""
    rotation = np.broadcast_to(np.eye(3), (len(omega), 3, 3)).copy()
    _move_frames(np.zeros((len(omega), 3)), rotation, np.concatenate([np.zeros_like(omega), omega], axis=1))
    return rotation


@kernel(error_model="numpy")
def _move_points(x: Floats, free: Ints, step: Floats) -> None:
    for k in range(len(free)):
        for i in range(3):
            x[free[k], i] += step[3 * k + i]


@kernel(error_model="numpy")
def _move_frames(position: Floats, rotation: Floats, step: Floats) -> None:
    """c <- c + dc, R <- exp(omega) R (Rodrigues) for the moving frames."""
    for k in range(len(step)):
        for i in range(3):
            position[k, i] += step[k, i]
        w0, w1, w2 = step[k, 3], step[k, 4], step[k, 5]
        square = w0 * w0 + w1 * w1 + w2 * w2
        if square == 0.0:
            continue
        angle = np.sqrt(square)
        half = np.sin(0.5 * angle) / angle
        a, b = np.sin(angle) / angle, 2.0 * half * half
        for j in range(3):
            r0, r1, r2 = rotation[k, 0, j], rotation[k, 1, j], rotation[k, 2, j]
            c0, c1, c2 = w1 * r2 - w2 * r1, w2 * r0 - w0 * r2, w0 * r1 - w1 * r0
            rotation[k, 0, j] = r0 + a * c0 + b * (w1 * c2 - w2 * c1)
            rotation[k, 1, j] = r1 + a * c1 + b * (w2 * c0 - w0 * c2)
            rotation[k, 2, j] = r2 + a * c2 + b * (w0 * c1 - w1 * c0)


def logarithm(rotation: Floats) -> Floats:
    """Rotation vectors (n, 3) [rad] of rotation matrices (n, 3, 3)."""
    vectors = np.empty((len(rotation), 3))
    _take_logarithms(np.ascontiguousarray(rotation), vectors)
    return vectors


@kernel(error_model="numpy")
def _take_logarithms(rotation: Floats, out: Floats) -> None:
    for k in range(len(out)):
        rotation_vector(rotation[k], out[k])
