"""Images of flat panels (markers, boards) as a real camera would take them, with known poses.

For planning a bench (is this camera near enough?) and for tests: perspective, lens distortion, uneven light, blur
and noise are those of the optics given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.geometry.pose import Pose
from softcal.plugins.markers.camera import Camera, Image

_CHUNK = 20_000  # pixels at edges seen to at a time, to bound the memory


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
    share: Floats = np.full((camera.height, camera.width), optics.background)
    scene = [part for panel in panels if (part := _part(camera, panel, viewpoint.after(panel.pose))) is not None]
    if scene:
        left, top = np.min([part.window[:2] for part in scene], axis=0)
        right, bottom = np.max([part.window[2:] for part in scene], axis=0)
        share[top:bottom, left:right] = _window_share(camera, scene, (left, top, right, bottom), optics)
    grey = optics.black + (optics.white - optics.black) * share * _light(camera, optics)
    return _exposed(grey, optics, seed)


_Window = tuple[int, int, int, int]  # left, top, right and bottom [px]


@dataclass(frozen=True)
class _Part:
    """A panel, its pose in the camera's frame, and the pixels that it may cover."""

    panel: Panel
    pose: Pose
    window: _Window


def _part(camera: Camera, panel: Panel, pose: Pose) -> _Part | None:
    """A panel with its window; None where its face is not seen."""
    half = (panel.width / 2, panel.height / 2)
    edge = np.linspace(-1.0, 1.0, 33)
    rim = np.concatenate([[(t, s), (s, t)] for s in (-1.0, 1.0) for t in edge]) * half
    outline = pose.apply(np.column_stack([rim, np.zeros(len(rim))]))
    if outline[:, 2].min() <= 0 or pose.rotation[:, 2] @ pose.position >= 0:
        return None
    pixels = camera.project(outline)
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, (camera.width, camera.height))
    if left >= right or top >= bottom:
        return None
    return _Part(panel, pose, (int(left), int(top), int(right), int(bottom)))


def _window_share(camera: Camera, scene: Sequence[_Part], window: _Window, optics: Optics) -> Floats:
    """Share of light in each pixel of a window: by one ray where all around is alike, by many at edges."""
    from scipy.ndimage import maximum_filter, minimum_filter

    left, top, right, bottom = window
    x, y = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
    pixels = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    found = np.empty(len(pixels))
    for first in range(0, len(pixels), _CHUNK):
        chunk = pixels[first : first + _CHUNK]
        found[first : first + _CHUNK] = _seen(scene, chunk, camera.directions(chunk)[:, None], optics.background)
    coarse = found.reshape(x.shape)
    at_edge = np.flatnonzero(maximum_filter(coarse, 3) != minimum_filter(coarse, 3))
    offsets = _spread(optics.rays)
    for first in range(0, len(at_edge), _CHUNK):
        chunk = at_edge[first : first + _CHUNK]
        found[chunk] = _seen(scene, pixels[chunk], _rays(camera, pixels[chunk], offsets), optics.background)
    return coarse


def _seen(scene: Sequence[_Part], pixels: Floats, rays: Floats, background: float) -> Floats:
    """Share of light (n,) that pixels (n, 2) get back from what their rays (n, k, 2) meet first, the mean over k."""
    depth = np.full(rays.shape[:2], np.inf)
    share = np.full(rays.shape[:2], background)
    lowest, highest = pixels.min(axis=0), pixels.max(axis=0)
    for part in scene:
        start, end = np.array(part.window[:2]), np.array(part.window[2:])
        if np.any(highest < start) or np.any(lowest >= end):
            continue
        inside = np.flatnonzero(np.all((pixels >= start) & (pixels < end), axis=1))
        z, texel = (met.reshape(-1, rays.shape[1]) for met in _met(part, rays[inside].reshape(-1, 2)))
        nearer = z < depth[inside]
        depth[inside] = np.where(nearer, z, depth[inside])
        share[inside] = np.where(nearer, texel, share[inside])
    return share.mean(axis=1)


def _met(part: _Part, rays: Floats) -> tuple[Floats, Floats]:
    """Depth (n,) [m] at which rays (n, 2) meet a panel, infinite where they pass it, and its share of light there."""
    panel, normal = part.panel, part.pose.rotation[:, 2]
    along = np.column_stack([rays, np.ones(len(rays))])
    facing = along @ normal
    z = (normal @ part.pose.position) / np.where(facing < 0, facing, -np.inf)
    local = (along * z[:, None] - part.pose.position) @ part.pose.rotation[:, :2]
    n_rows, n_columns = panel.texture.shape
    across, down = local[:, 0] / panel.width + 0.5, 0.5 - local[:, 1] / panel.height
    hit = (across >= 0) & (across < 1) & (down >= 0) & (down < 1) & (z > 0)
    rows = np.clip((down * n_rows).astype(int), 0, n_rows - 1)
    columns = np.clip((across * n_columns).astype(int), 0, n_columns - 1)
    texel = panel.texture[rows, columns]
    return np.where(hit & ~np.isnan(texel), z, np.inf), texel


def _rays(camera: Camera, pixels: Floats, offsets: Floats) -> Floats:
    """Directions (n, k, 2) of rays through pixels (n, 2) at offsets (k, 2) from their upper left corners.

    Between the corners of a pixel they are interpolated: distortion bends by far less than can be seen over one.
    """
    corners = [
        camera.directions(pixels + shift)[:, None] for shift in ((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5))
    ]
    x, y = offsets[:, :1], offsets[:, 1:]
    upper = corners[0] * (1 - x) + corners[1] * x
    lower = corners[2] * (1 - x) + corners[3] * x
    return upper * (1 - y) + lower * y


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
