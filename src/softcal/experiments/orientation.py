"""Conversion of an IMU's quaternions to the plate's pitch, roll and yaw, as defined in the twin.

With R the rotation of the plate from its rest pose, in the robot's frame (z along the neck):
R = Ry(pitch) Rx(roll) Rz(yaw), so that
pitch = atan2(R[0, 2], R[2, 2]), roll = atan2(-R[1, 2], hypot(R[0, 2], R[2, 2])), yaw = atan2(R[1, 0], R[1, 1]).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault

QUATERNION = ("qw", "qx", "qy", "qz")


def plate_angles(
    quaternions: Floats, *, axes: Sequence[str] = ("x", "y", "z"), rest_samples: int = 10
) -> tuple[Floats, Floats, Floats]:
    """Pitch, roll and yaw [rad] relative to the mean pose of the first samples.

    Parameters
    ----------
    quaternions
        (n, 4), scalar first, rotating sensor coordinates into the instrument's earth frame of any heading.
        For the opposite convention give qx, qy and qz the scale -1.
    axes
        The robot's x, y and z at rest in sensor axes, such as ("-y", "x", "z").
    rest_samples
        Number of samples whose mean pose is the rest pose.

    Raises
    ------
    DatasetError
        If the axes are not a right-handed triad or a quaternion is far from unit length.
    """
    from scipy.spatial.transform import Rotation

    lengths = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > 0.05)
    if wrong.size:
        raise DatasetError(
            Fault(
                f"{wrong.size} quaternion(s) are not of unit length",
                where=f"sample {wrong[0]}",
                got=f"length {lengths[wrong[0]]:.4g}",
                allowed="0.95 to 1.05",
                attempt="check that qw, qx, qy and qz name the right columns",
            )
        )
    # Matrix whose rows are the robot's axes in sensor coordinates: it turns sensor vectors into robot vectors.
    units = {"x": 0, "y": 1, "z": 2}
    matrix = np.zeros((3, 3))
    if len(axes) == 3 and all(axis.lstrip("+-") in units for axis in axes):
        for row, axis in enumerate(axes):
            matrix[row, units[axis.lstrip("+-")]] = -1.0 if axis.startswith("-") else 1.0
    if not np.isclose(np.linalg.det(matrix), 1.0):
        raise DatasetError(
            Fault(
                "the IMU axes are not a right-handed triad",
                where="axes",
                got=", ".join(axes),
                allowed="three of x, y, z, -x, -y, -z at right angles, such as -y, x, z",
            )
        )
    to_robot = Rotation.from_matrix(matrix)
    pose = Rotation.from_quat(quaternions, scalar_first=True)
    turned = to_robot * pose[:rest_samples].mean().inv() * pose * to_robot.inv()
    pitch, roll, yaw = turned.as_euler("YXZ").T
    return np.unwrap(pitch), roll, np.unwrap(yaw)
