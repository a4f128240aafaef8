"""Rods on frames, solved by a dense Newton iteration, and the rod's differential equations, solved by shooting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from softcal.geometry.centreline import Centreline
from softcal.geometry.section import CrossSection
from softcal.mechanics.rod import RodTerm, build_rod


def modulus(E: float, nu: float) -> dict[str, float]:
    return {"youngs_modulus": E, "poissons_ratio": nu}


@dataclass
class Pose:
    """Of all frames: c (n, 3) and R (n, 3, 3); residuals of the iterations that led there, one list per load step."""

    c: np.ndarray
    R: np.ndarray
    residuals: list[list[float]] = field(default_factory=list)

    def moved(self, dz: np.ndarray) -> Pose:
        dz = dz.reshape(-1, 6)
        return Pose(self.c + dz[:, :3], Rotation.from_rotvec(dz[:, 3:]).as_matrix() @ self.R, self.residuals)


def on_own_frames(section: CrossSection, centreline: Centreline) -> tuple[RodTerm, Pose]:
    """A rod each of whose nodes is a frame, and its rest pose."""
    nodes = np.array(centreline.nodes)
    return build_rod("rod", section, centreline, np.arange(len(nodes)), nodes), at_rest(nodes)


def at_rest(references: np.ndarray) -> Pose:
    return Pose(references.copy(), np.tile(np.eye(3), (len(references), 1, 1)))


def unknowns(rod: RodTerm) -> np.ndarray:
    """Places (n, 12) of each element's unknowns."""
    return (6 * rod.frames[:, :, None] + np.arange(6)).reshape(-1, 12)


def assembled(
    rod: RodTerm, pose: Pose, theta: dict[str, float], carried: np.ndarray | None = None
) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy, gradient and tangent of all frames; carried: section forces for the tangent's geometric part."""
    forces = rod.assemble(pose.c, pose.R, theta)
    tangent = forces.tangent
    if carried is not None:
        _, tangent = rod._derivatives(pose.c, pose.R, carried, rod._law(rod.xi_rest, theta).S)
    g, K = np.zeros(6 * len(pose.c)), np.zeros((6 * len(pose.c),) * 2)
    at = unknowns(rod)
    np.add.at(g, at, forces.gradient)
    np.add.at(K, (at[:, :, None], at[:, None, :]), tangent)
    return forces.energy, g, K


def predicted(rod: RodTerm, pose: Pose, theta: dict[str, float], dz: np.ndarray) -> np.ndarray:
    """Section forces (n, 6) of each element, linear in the frames' increments dz from a pose.

    With those of the last step the tangent survives load steps many times larger (Magisano, Leonetti and Garcea, 2017:
    mixed integration points): a step that turns a rod also stretches it, to second order.
    """
    here, *ends = (rod._coordinates(p.c, p.R)[0] for p in (pose, pose.moved(1e-6 * dz), pose.moved(-1e-6 * dz)))
    strain = here - rod.xi_rest + (ends[0] - ends[1]) / 2e-6
    return np.einsum("nij,nj->ni", rod._law(rod.xi_rest, theta).S, strain)


def solved(
    rod: RodTerm,
    pose: Pose,
    theta: dict[str, float],
    load: np.ndarray,
    *,
    fixed: Sequence[int] = (0, 1, 2, 3, 4, 5),
    steps: int = 1,
    carry: bool = True,
    tolerance: float = 1e-9,
    iterations: int = 30,
) -> Pose:
    """Equilibrium under dead forces and, in a plane, moments, load (n_frames, 6). With `carry`, the section forces are
    carried from step to step; without, the tangent is the energy's second derivative.
    """
    free = np.setdiff1d(np.arange(6 * len(pose.c)), fixed)
    scale = np.abs(load).max()
    carried = None
    for step in range(1, steps + 1):
        pose.residuals.append([])
        for _ in range(iterations):
            _, g, K = assembled(rod, pose, theta, carried)
            r = (g - step / steps * load.ravel())[free]
            pose.residuals[-1].append(float(np.abs(r).max() / scale))
            if pose.residuals[-1][-1] < tolerance:
                break
            dz = np.zeros(6 * len(pose.c))
            dz[free] = np.linalg.solve(K[np.ix_(free, free)], -r)
            if carry:
                carried = predicted(rod, pose, theta, dz)
            pose = pose.moved(dz)
        else:
            raise AssertionError(f"no equilibrium in step {step}: residuals {pose.residuals[-1]}")
    return pose


def loaded(pose: Pose, at: int, *, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0)) -> np.ndarray:
    load = np.zeros((len(pose.c), 6))
    load[at] = [*force, *moment]
    return load


def compliances(section: CrossSection, E: float, nu: float) -> np.ndarray:
    """1 / (k1 G A, k2 G A, E A, E I1, E I2, G J)."""
    of = section.constants
    shear = [(s0 + s1 * (1.0 + nu)) / (E * of.area) for s0, s1 in (of.shear1, of.shear2)]
    bending = [1.0 / (E * of.I1), 1.0 / (E * of.I2), 2.0 * (1.0 + nu) / (E * of.J)]
    return np.array([*shear, 1.0 / (E * of.area), *bending])


def tip_by_shooting(
    section: CrossSection,
    theta: dict[str, float],
    triad: np.ndarray,
    curvature: np.ndarray,
    length: float,
    force: np.ndarray,
    start: np.ndarray,
) -> np.ndarray:
    """Tip of a clamped rod of constant rest curvature (section's axes) under a dead tip force, from the equations

        x' = R (e3 + Cn R^T n),   R' = R [curvature + Cm R^T m],   n' = 0,   m' = -x' x n,   m(length) = 0,

    by shooting for the moment at the clamp, m(0), from `start`.
    """
    C = compliances(section, theta["youngs_modulus"], theta["poissons_ratio"])

    def slope(_, y):
        q, m = y[3:7], y[7:]
        R = Rotation.from_quat(q).as_matrix()
        dx = R @ ([0.0, 0.0, 1.0] + C[:3] * (R.T @ force))
        k = curvature + C[3:] * (R.T @ m)
        dq = 0.5 * np.concatenate([q[3] * k + np.cross(q[:3], k), [-(q[:3] @ k)]])
        return np.concatenate([dx, dq, -np.cross(dx, force)])

    def end(m):
        y = np.concatenate([np.zeros(3), Rotation.from_matrix(triad).as_quat(), m])
        return solve_ivp(slope, (0.0, length), y, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]

    found = root(lambda m: end(m)[7:], start, tol=1e-11)
    assert np.abs(found.fun).max() < 1e-6 * np.abs(start).max()
    return end(found.x)[:3]
