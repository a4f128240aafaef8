"""One configuration of the robot, and how a step of the unknowns changes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.layout import Layout


@dataclass(frozen=True)
class State:
    """x: positions of all points (n_points, 3) [m]; position (n_plates, 3) [m] and rotation (n_plates, 3, 3) of the
    plates; pressure (n_pressures,) [Pa]; tension (n_cables,) [N].
    """

    x: Floats
    position: Floats
    rotation: Floats
    pressure: Floats
    tension: Floats


def rest_state(layout: Layout) -> State:
    """The undeformed, unloaded robot."""
    return State(
        x=layout.X.copy(),
        position=layout.references.copy(),
        rotation=np.broadcast_to(np.eye(3), (layout.n_plates, 3, 3)).copy(),
        pressure=np.zeros(layout.n_pressures),
        tension=np.zeros(layout.n_cables),
    )


def moved(layout: Layout, state: State, dz: Floats) -> State:
    """The state after a step dz of the unknowns; rotations are updated as R <- exp(omega) R."""
    x = state.x.copy()
    free = layout.free_points
    x[free] += dz[: 3 * len(free)].reshape(-1, 3)
    plates = dz[layout.first_plate_unknown : layout.first_pressure_unknown].reshape(-1, 6)
    position = state.position + plates[:, :3]
    rotation = exponential(plates[:, 3:]) @ state.rotation
    rigid = layout.rigid_points
    k = layout.rider[rigid]
    x[rigid] = position[k] + np.einsum("nij,nj->ni", rotation[k], layout.X[rigid] - layout.references[k])
    return State(
        x=x,
        position=position,
        rotation=rotation,
        pressure=state.pressure + dz[layout.first_pressure_unknown : layout.first_tension_unknown],
        tension=state.tension + dz[layout.first_tension_unknown :],
    )


def difference(layout: Layout, after: State, before: State) -> Floats:
    """The dz with moved(layout, before, dz) = after."""
    free = layout.free_points
    omega = logarithm(after.rotation @ np.swapaxes(before.rotation, 1, 2))
    plates = np.concatenate([after.position - before.position, omega], axis=1)
    return np.concatenate(
        [
            (after.x[free] - before.x[free]).ravel(),
            plates.ravel(),
            after.pressure - before.pressure,
            after.tension - before.tension,
        ]
    )


def exponential(omega: Floats) -> Floats:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3) [rad] (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    if len(omega) == 0:
        return np.zeros((0, 3, 3))
    return Rotation.from_rotvec(omega).as_matrix()


def logarithm(rotation: Floats) -> Floats:
    """Rotation vectors (n, 3) [rad] of rotation matrices (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    if len(rotation) == 0:
        return np.zeros((0, 3))
    return Rotation.from_matrix(rotation).as_rotvec()
