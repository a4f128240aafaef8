"""Images of flat panels (markers, boards) as a real camera would take them, with known poses.

For planning a bench (is this camera near enough?) and for tests: perspective, lens distortion, uneven light, blur
and noise are those of the optics given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats
from softcal.experiments.camera import Camera
from softcal.experiments.pose import Pose

Image = NDArray[np.uint8]

_BAND = 64  # rows painted at a time, to bound the memory


@dataclass(frozen=True)
class Panel:
    """A flat rectangle with a texture.

    texture: share of light sent back, 0 black to 1 white, rows from the top; NaN is transparent. width, height [m].
    pose: of the panel's frame (origin in its middle, x right, y up, z towards who looks at it) in the world.
    """

    texture: Floats
    width: float
    height: float
    pose: Pose


@dataclass(frozen=True)
class Optics:
    """What stands between the scene and the image.

    rays: per pixel. blur: Gaussian's standard deviation [px]. noise: standard deviation
    [grey levels]. black, white: grey levels of a black and a white panel in full light. background: its share of
    light. light: how much brighter the image is at its right and bottom edge than in its middle, as a share.
    vignetting: share of light lost in the corners.
    """

    rays: int = 55
    blur: float = 0.7
    noise: float = 1.5
    black: float = 25.0
    white: float = 215.0
    background: float = 0.45
    light: tuple[float, float] = (0.0, 0.0)
    vignetting: float = 0.0


def render(
    camera: Camera, viewpoint: Pose, panels: Sequence[Panel], optics: Optics | None = None, seed: int = 0
) -> Image:
    """The grey image, shape (height, width), of panels seen from a viewpoint.

    Parameters
    ----------
    camera
        Resolution, focal lengths and distortion.
    viewpoint
        Turns world coordinates into the camera's.
    panels
        May hide each other; the back of a panel is not seen.
    optics
        Light, blur and noise.
    seed
        Of the noise.
    """
    optics = optics or Optics()
    seen = [one for panel in panels if (one := _seen(camera, viewpoint, panel)) is not None]
    bands = [
        _band(camera, seen, top, min(top + _BAND, camera.height), optics) for top in range(0, camera.height, _BAND)
    ]
    grey = optics.black + (optics.white - optics.black) * np.concatenate(bands) * _light(camera, optics)
    return _exposed(grey, optics, seed)


@dataclass(frozen=True)
class _Seen:
    """A panel that shows its face: its pose in the camera's frame, and the window of pixels it may cover."""

    panel: Panel
    pose: Pose
    left: int
    right: int
    top: int
    bottom: int


def _seen(camera: Camera, viewpoint: Pose, panel: Panel) -> _Seen | None:
    pose = viewpoint.after(panel.pose)
    edge = np.linspace(-1.0, 1.0, 33)
    rim = np.concatenate([[(t, s), (s, t)] for s in (-1.0, 1.0) for t in edge]) * (panel.width / 2, panel.height / 2)
    outline = pose.apply(np.column_stack([rim, np.zeros(len(rim))]))
    if outline[:, 2].min() <= 0 or pose.rotation[:, 2] @ pose.position >= 0:
        return None
    pixels = camera.project(outline)
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 1, 0)
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 2, (camera.width, camera.height))
    return None if left >= right or top >= bottom else _Seen(panel, pose, left, right, top, bottom)


def _band(camera: Camera, seen: Sequence[_Seen], top: int, bottom: int, optics: Optics) -> Floats:
    """Share of light (bottom - top, width) that reaches some rows of the image."""
    found: Floats = np.full((bottom - top, camera.width), optics.background)
    here = [one for one in seen if max(top, one.top) < min(bottom, one.bottom)]
    if not here:
        return found
    left, right = min(one.left for one in here), max(one.right for one in here)
    depth: Floats = np.full((bottom - top, right - left, optics.rays), np.inf)
    share: Floats = np.full((bottom - top, right - left, optics.rays), optics.background)
    for one in here:
        rows = (max(top, one.top), min(bottom, one.bottom))
        window = np.s_[rows[0] - top : rows[1] - top, one.left - left : one.right - left]
        _paint(one, _rays(camera, (one.left, one.right), rows, optics.rays), depth[window], share[window])
    found[:, left:right] = share.mean(axis=2)
    return found


def _paint(one: _Seen, rays: Floats, depth: Floats, share: Floats) -> None:
    """Paint what can be seen of a panel over what is behind it."""
    panel, normal = one.panel, one.pose.rotation[:, 2]
    along = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    z = (normal @ one.pose.position) / (along @ normal)
    local = (along * z[..., None] - one.pose.position) @ one.pose.rotation[:, :2]
    n_rows, n_columns = panel.texture.shape
    column = np.floor((local[..., 0] / panel.width + 0.5) * n_columns).astype(int)
    row = np.floor((0.5 - local[..., 1] / panel.height) * n_rows).astype(int)
    inside = (column >= 0) & (column < n_columns) & (row >= 0) & (row < n_rows)
    texel = panel.texture[row.clip(0, n_rows - 1), column.clip(0, n_columns - 1)]
    front = inside & (z > 0) & (z < depth) & ~np.isnan(texel)
    depth[front] = z[front]
    share[front] = texel[front]


def _rays(camera: Camera, columns: tuple[int, int], rows: tuple[int, int], n: int) -> Floats:
    """Directions (height, width, n, 2) of the rays through a window of pixels.

    Between the corners of a pixel they are interpolated: distortion bends by far less than can be seen over one.
    """
    x = np.arange(columns[0], columns[1] + 1) - 0.5
    y = np.arange(rows[0], rows[1] + 1) - 0.5
    grid = np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)
    corners = camera.directions(grid.reshape(-1, 2)).reshape(grid.shape)
    offsets = _spread(n)
    x, y = offsets[:, :1], offsets[:, 1:]
    top = corners[:-1, :-1, None] * (1 - x) + corners[:-1, 1:, None] * x
    bottom = corners[1:, :-1, None] * (1 - x) + corners[1:, 1:, None] * x
    return top * (1 - y) + bottom * y


def _spread(n: int) -> Floats:
    """Places (n, 2) in the unit square that leave no direction of an edge in steps (a golden-section lattice)."""
    i = np.arange(n) + 0.5
    return np.column_stack([i / n, (i * (np.sqrt(5.0) - 1) / 2) % 1.0])


def _light(camera: Camera, optics: Optics) -> Floats:
    x = np.linspace(-1.0, 1.0, camera.width)[None, :]
    y = np.linspace(-1.0, 1.0, camera.height)[:, None]
    return (1 + optics.light[0] * x + optics.light[1] * y) * (1 - optics.vignetting * (x * x + y * y) / 2)


def _exposed(grey: Floats, optics: Optics, seed: int) -> Image:
    from scipy.ndimage import gaussian_filter

    blurred = gaussian_filter(grey, optics.blur) if optics.blur > 0 else grey
    noise = np.random.default_rng(seed).normal(0.0, optics.noise, grey.shape) if optics.noise > 0 else 0.0
    return np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)
