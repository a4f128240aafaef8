"""Quaternions (x, y, z, w) of the twin's angles, and their rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats


def quaternions(pitch: Floats, roll: Floats, yaw: Floats) -> Floats:
    """Quaternions and their rates (n, 1 + k, 4) of Ry(pitch) Rx(roll) Rz(yaw).

    Parameters
    ----------
    pitch, roll, yaw
        Angles, then k rates of each (n, 1 + k) [rad].
    """

    def about(axis: int, angle: Floats) -> tuple[Floats, Floats]:
        half = 0.5 * angle[:, 0]
        q, dq = np.zeros((len(half), 4)), np.zeros((len(half), 4))
        q[:, axis], q[:, 3] = np.sin(half), np.cos(half)
        dq[:, axis], dq[:, 3] = 0.5 * np.cos(half), -0.5 * np.sin(half)
        return q, dq

    (a, da), (b, db), (c, dc) = about(1, pitch), about(0, roll), about(2, yaw)
    parts = (product(product(da, b), c), product(product(a, db), c), product(product(a, b), dc))
    rates = sum(
        (part[:, None] * angle[:, 1:, None] for part, angle in zip(parts, (pitch, roll, yaw), strict=True)),
        np.zeros((len(a), pitch.shape[1] - 1, 4)),
    )
    return np.concatenate([product(product(a, b), c)[:, None], rates], axis=1)


def product(p: Floats, q: Floats) -> Floats:
    """The product of quaternions (…, 4)."""
    v, w = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + np.cross(p[..., :3], q[..., :3]), p[..., 3] * q[..., 3]
    return np.concatenate([v, (w - np.sum(p[..., :3] * q[..., :3], axis=-1))[..., None]], axis=-1)


def rotation_rates(q: Floats, rates: Floats) -> Floats:
    """Small rotations about the world's axes (…, 3) [rad] of rates (…, 4) of unit quaternions."""
    return 2.0 * product(rates, q * [-1.0, -1.0, -1.0, 1.0])[..., :3]


def angle_between(p: Floats, q: Floats) -> Floats:
    """The angle [rad] between unit quaternions (…, 4)."""
    between = product(p, q * [-1.0, -1.0, -1.0, 1.0])
    return 2.0 * np.arctan2(np.linalg.norm(between[..., :3], axis=-1), np.abs(between[..., 3]))


def align(table: Floats, near: Sequence[int], places: Sequence[slice]) -> None:
    """Choose the sign of each quaternion nearest to that of a neighbour before it: q and -q are one rotation.

    Parameters
    ----------
    table
        Values, and below them their rates (n, 1 + k, m), changed.
    near
        The neighbour of each row (n,).
    places
        Columns of the quaternions.
    """
    for row, neighbour in enumerate(near):
        for own in places:
            if table[row, 0, own] @ table[neighbour, 0, own] < 0.0:
                table[row, :, own] *= -1.0
