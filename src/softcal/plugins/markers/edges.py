"""Refinement of a marker's corners by its four edges, more accurate than corner detection.

Blur rounds off a black corner, so that a corner detector is biased inwards by some tenths of a pixel, which at half a
metre is millimetres of depth. Edges have no such bias. A blurred step is fitted to a strip of the image across each
edge, I(s, t) = B(t) + (W(t) - B(t)) Phi((s - d(t)) / w), where s runs across the edge and t along it, B and W are the
grey levels inside and outside (linear along the edge, for uneven light), d is the position of the edge and w its blur.
After correction of the lens distortion an edge is a straight line, and neighbouring lines intersect in the corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.plugins.markers.camera import Camera, Image

_ROUNDS = 2
_WIDEST, _NARROWEST = 4.0, 1.2  # half the width of the strip across an edge [px]
_STRIP = 0.6  # the same as a share of a module, so that the strip stays clear of the pattern inside
_ACROSS, _ALONG = 0.5, 1.0  # between samples [px]
_BLURRED = 3.0  # extent of an edge's blur [px]
_FEWEST = 5  # sections along an edge
_SMALLEST_RISE = 15.0  # contrast from black to white [grey levels]
_WIDEST_BLUR = 4.0  # [px]
_OUTLYING = 12.0  # residual from which a sample is down-weighted [grey levels]
_STRAY, _MOST_STRAY = 0.25, 0.08  # residual over the contrast, and largest share of samples above it
_FARTHEST = 2.5  # largest displacement of a corner [px]


@dataclass(frozen=True)
class _Strip:
    """Samples of the image across an edge. s [px], t in -1 to 1; grey (len(t), len(s))."""

    s: Floats
    t: Floats
    grey: Floats


def refine_corners(image: Image, corners: Floats, modules: int, camera: Camera) -> Floats | None:
    """Refined corners (4, 2) [px] of a black square near `corners`; None if its edges are not clear.

    Parameters
    ----------
    image
        Grey image.
    corners
        Corners in order around the square, to about a pixel [px].
    modules
        Width of the square in modules; the outermost of them is black all around, and one outside is white.
    camera
        The camera, for its distortion.
    """
    from scipy.ndimage import spline_filter

    margin = 16
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - margin, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + margin + 1, (image.shape[1], image.shape[0]))
    if np.any(high - low < margin):
        return None
    spline = spline_filter(image[low[1] : high[1], low[0] : high[0]].astype(np.float64), order=3, mode="mirror")
    found = corners.astype(np.float64)
    for _ in range(_ROUNDS):
        lines: list[Floats] = []
        for side in range(4):
            line = _line(spline, low, np.roll(found, -side, axis=0), modules, camera)
            if line is None:
                return None
            lines.append(line)
        # Corner i is between side i - 1 and side i.
        meeting = np.array([np.cross(lines[i - 1], lines[i]) for i in range(4)])
        found = camera.pixels(meeting[:, :2] / meeting[:, 2:])
        if not np.abs(found - corners).max() < _FARTHEST:
            return None
    return found


def _line(spline: Floats, low: Floats, square: Floats, modules: int, camera: Camera) -> Floats | None:
    """(a, b, c), with a x + b y + c = 0 for directions on the edge between the square's first two corners."""
    from scipy.ndimage import map_coordinates

    a, b, c, d = square
    length = float(np.linalg.norm(b - a))
    tangent = (b - a) / max(length, 1e-9)
    outward = np.array([tangent[1], -tangent[0]])
    depth = float(outward @ ((a + b) - (c + d)) / 2)
    if depth < 0:
        outward, depth = -outward, -depth
    half = min(_WIDEST, _STRIP * depth / modules)
    before, after = _clearance(a - d, tangent, half), _clearance(c - b, tangent, half)
    n = int((length - before - after) / _ALONG)
    if half < _NARROWEST or n < _FEWEST:
        return None
    share = np.linspace(before / length, 1 - after / length, n)[:, None]
    ends = camera.directions(np.array([a, b]))
    on_edge = camera.pixels(ends[0] * (1 - share) + ends[1] * share)
    s = np.arange(-half, half + _ACROSS / 2, _ACROSS)
    places = on_edge[:, None] + s[:, None] * outward - low
    if places.min() < 0 or np.any(places.max(axis=(0, 1)) > np.array(spline.shape)[::-1] - 1):
        return None
    grey = map_coordinates(spline, (places[..., 1], places[..., 0]), order=3, prefilter=False, mode="mirror")
    offset = _offset(_Strip(s, np.linspace(-1.0, 1.0, n), grey))
    if offset is None:
        return None
    first, last = camera.directions(on_edge[[0, -1]] + offset[:, None] * outward)
    return np.cross([*first, 1.0], [*last, 1.0])


def _clearance(neighbour: Floats, tangent: Floats, half: float) -> float:
    """Distance from a corner [px] beyond which the strip is clear of the neighbouring edge and its blur."""
    along = float(abs(neighbour @ tangent)) / max(float(np.linalg.norm(neighbour)), 1e-9)
    return (half * along + _BLURRED) / max(np.sqrt(max(1 - along**2, 0.0)), 0.05)


def _offset(strip: _Strip) -> Floats | None:
    """Position of the edge across the strip at its two ends [px]; None if there is no clear edge."""
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    s, t, grey = strip.s, strip.t[:, None], strip.grey
    n_end = max(2, len(s) // 5)
    black, white = float(np.median(grey[:, :n_end])), float(np.median(grey[:, -n_end:]))
    if white - black < _SMALLEST_RISE:
        return None

    def residuals(p: Floats) -> Floats:
        step = ndtr((s - p[0] - p[1] * t) / p[2])
        return (p[3] + p[4] * t + (p[5] + p[6] * t) * step - grey).ravel()

    def slopes(p: Floats) -> Floats:
        x = (s - p[0] - p[1] * t) / p[2]
        step = ndtr(x)
        by_offset = -(p[5] + p[6] * t) * np.exp(-0.5 * x * x) / (np.sqrt(2 * np.pi) * p[2])
        one = np.ones_like(step)
        columns = (by_offset, by_offset * t, by_offset * x, one, one * t, step, step * t)
        return np.stack(columns, axis=-1).reshape(-1, 7)

    middle = float(np.clip(s[-1] - np.trapezoid(grey.mean(axis=0) - black, s) / (white - black), s[1], s[-2]))
    start = np.array([middle, 0.0, 1.0, black, 0.0, white - black, 0.0])
    reach = float(s[-1])
    lower = np.array([-reach, -reach, 0.2, -100.0, -np.inf, 0.0, -np.inf])
    upper = np.array([reach, reach, _WIDEST_BLUR, 300.0, np.inf, 600.0, np.inf])
    found = least_squares(
        residuals,
        start,
        slopes,  # pyright: ignore[reportArgumentType] (SciPy takes a function where its annotation has text)
        bounds=(lower, upper),
        x_scale=(0.1, 0.1, 0.3, 5.0, 5.0, 5.0, 5.0),
        loss="soft_l1",
        f_scale=_OUTLYING,
        xtol=1e-6,
        ftol=1e-9,
    )
    d0, d1, blur, rise = found.x[0], found.x[1], found.x[2], found.x[5]
    if not found.success or rise < _SMALLEST_RISE or max(abs(d0 - d1), abs(d0 + d1)) > reach - 0.5 * blur:
        return None
    if np.mean(np.abs(residuals(found.x)) > max(_STRAY * rise, 2 * _OUTLYING)) > _MOST_STRAY:
        return None
    return np.array([d0 - d1, d0 + d1])
