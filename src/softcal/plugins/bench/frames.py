"""Whether predicted positions are in another unit or frame than the measured ones.

A similarity (Umeyama, 1991) is fitted between the two. It is a fault only where it is unmistakable: the positions agree
far better after a rotation by a large angle, or a change of scale by a power of ten.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault
from softcal.units import format_quantity

LARGE_TURN = np.deg2rad(25.0)
BETTER = 3.0  # times smaller must the residual be in the other frame
FAR = 0.2  # of the positions' extent: errors smaller than this are errors of a prediction
SCALES = {1e3: "mm written as m", 1e-3: "m written as mm", 1e2: "cm written as m", 1e-2: "m written as cm"}


def frame_faults(measured: Floats, predicted: Floats, where: str, *, aligned: bool = False) -> list[Fault]:
    """Faults of predicted positions (n, 3) [m] that are in another unit or frame than the measured ones (n, 3).

    aligned: whether the score takes the mean error off, so that any origin will do.
    """
    extent = float(np.linalg.norm(np.ptp(measured, axis=0)))
    near = predicted - (predicted - measured).mean(axis=0) if aligned else predicted
    off = float(np.sqrt(np.mean(np.sum((near - measured) ** 2, axis=1))))
    if len(measured) < 3 or extent == 0.0 or off < FAR * extent:
        return []
    got = f"positions that are {format_quantity(off, 'm', digits=3)} off, over an extent of "
    got += format_quantity(extent, "m", digits=3)
    size = float(np.sqrt(np.mean(np.sum(predicted**2, axis=1)) / np.mean(np.sum(measured**2, axis=1))))
    if size == 0.0:
        return [Fault("the predicted positions are all at the origin", where, got, "a prediction of each sample")]
    for scale, mistake in SCALES.items():
        if abs(np.log10(size / scale)) < 0.25:
            return [Fault("the positions are in another unit", where, got, "the unit of the header", mistake)]
    was, now = measured - measured.mean(axis=0), predicted - predicted.mean(axis=0)
    U, _, Vt = np.linalg.svd(was.T @ now)
    rotation = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    angle = float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    shifted = float(np.sqrt(np.mean(np.sum((now - was) ** 2, axis=1))))
    turned = float(np.sqrt(np.mean(np.sum((now @ rotation.T - was) ** 2, axis=1))))
    if angle > LARGE_TURN and BETTER * turned < shifted:
        got += f"; turned by {np.rad2deg(angle):.0f} deg they agree to {format_quantity(turned, 'm', digits=3)}"
        return [Fault("the positions are in another frame", where, got, "the frame of the case; see its README")]
    if BETTER * shifted < off:
        got += f"; moved they agree to {format_quantity(shifted, 'm', digits=3)}"
        return [Fault("the positions are from another origin", where, got, "the frame of the case; see its README")]
    return []
