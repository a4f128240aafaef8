"""Rendering of scenes: by PyVista if OpenGL works, else by matplotlib with a note."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.processes import run
from softcal.report.scene import Arrow, Ball, Part, Projection, Scene, Surface, Tube, refined
from softcal.report.style import DPI

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Timeout of one rendering attempt [s]; a software renderer on a loaded machine needs some ten.
_PATIENCE = 120.0
_MOST_PIXELS = 1300  # picture height


@dataclass(frozen=True)
class Rendering:
    """RGBA pictures, one per scene, or none if the renderer failed; note: the fallback and its reason."""

    pictures: tuple[np.ndarray[Any, Any], ...]
    note: str = ""


def render_scenes(scenes: tuple[Scene, ...], cameras: tuple[Projection, ...]) -> Rendering:
    """Render each scene by PyVista in a separate process; on failure the note gives the reason."""
    problem = ""
    with tempfile.TemporaryDirectory(prefix="softcal-scene-") as folder:
        request, answer = Path(folder, "request.pickle"), Path(folder, "answer.npz")
        # At display size: more pixels cost time in every later step and are scaled down.
        heights = [min(round(DPI * panel_size(camera)[1]), _MOST_PIXELS) for camera in cameras]
        request.write_bytes(pickle.dumps((scenes, cameras, heights)))
        for window in _windows():
            environment = {**os.environ, **({"VTK_DEFAULT_OPENGL_WINDOW": window} if window else {})}
            command = [sys.executable, "-m", "softcal.report.scene_worker", str(request), str(answer)]
            try:
                done = run(command, timeout=_PATIENCE, environment=environment)
            except subprocess.TimeoutExpired:
                problem = f"the renderer did not finish within {_PATIENCE:g} s"
                continue
            if done.returncode == 0 and answer.exists():
                with np.load(answer) as pictures:
                    return Rendering(tuple(pictures[name] for name in pictures.files))
            problem = _reason(done.returncode, done.stderr)
    note = (
        f"Drawn flat by matplotlib, since the 3-D renderer (PyVista/VTK) does not work on this machine: {problem}. "
        "On Debian or Ubuntu the packages libegl1 and libgl1 make it work."
    )
    return Rendering((), note)


def panel_size(camera: Projection) -> tuple[float, float]:
    """Display width and height [in] of a projection's picture."""
    left, right, bottom, top = camera.window
    width = min(max(3.4 * (right - left) / (top - bottom), 2.4), 3.6)
    return width, width * (top - bottom) / (right - left)


def _windows() -> tuple[str, ...]:
    """The VTK render windows to try, without a display first; "" leaves the choice to VTK."""
    if not sys.platform.startswith("linux"):
        return ("",)
    offscreen = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
    return (*offscreen, "") if os.environ.get("DISPLAY") else offscreen


def _reason(code: int, errors: str) -> str:
    if code < 0:
        return f"it was ended by signal {-code}, as VTK is where OpenGL is missing"
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    return lines[-1].rstrip(".") if lines else f"it ended with code {code}"


def draw_flat(axes: Axes, scene: Scene, camera: Projection) -> None:
    """Draw a scene on axes in picture coordinates [mm], far parts first; shading by the angle to the viewer."""
    from matplotlib.collections import PolyCollection

    pieces = [_flat(part, camera) for part in scene.parts]
    corners = np.concatenate([corners for corners, _ in pieces])
    colours = np.concatenate([colours for _, colours in pieces])
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    colours = colours[order]
    edges = np.where(colours[:, 3:] < 1.0, 0.0, colours)  # edges of translucent faces would show as lines
    axes.add_collection(
        PolyCollection(
            list(1e3 * corners[order, :, :2]), facecolors=colours, edgecolors=edges, linewidths=0.15, rasterized=True
        )
    )


def _flat(part: Part, camera: Projection) -> tuple[Floats, Floats]:
    """Quadrilaterals in picture coordinates and depth (n, 4, 3) [m], and their RGBA (n, 4)."""
    if isinstance(part, Surface):
        corners = camera.project(part.points)[part.triangles]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(normal, axis=1)
        light = np.abs(normal @ np.array([-0.35, 0.45, 0.82])) / np.where(size > 0, size, 1.0)
        colours = part.colours[part.triangles].mean(axis=1) if part.per_point else part.colours
        rgba = np.column_stack([colours * (0.45 + 0.55 * light)[:, None], np.full(len(corners), part.opacity)])
        return corners[:, [0, 1, 2, 2]], np.clip(rgba, 0, 1)
    if isinstance(part, Tube):
        return _ribbon(camera.project(refined(part.path)), part.radius, part.colour)
    if isinstance(part, Ball):
        return _round(camera.project(part.at[None])[0], part.radius, part.colour)
    return _flat_arrow(part, camera)


def _ribbon(path: Floats, radius: float, colour: str) -> tuple[Floats, Floats]:
    from matplotlib.colors import to_rgba

    along = np.diff(path[:, :2], axis=0)
    size = np.linalg.norm(along, axis=1, keepdims=True)
    side = radius * np.column_stack([-along[:, 1], along[:, 0]]) / np.where(size > 0, size, 1.0)
    side = np.column_stack([side, np.zeros(len(side))])
    corners = np.stack([path[:-1] + side, path[1:] + side, path[1:] - side, path[:-1] - side], axis=1)
    return corners, np.tile(to_rgba(colour), (len(corners), 1))


def _round(at: Floats, radius: float, colour: str) -> tuple[Floats, Floats]:
    from matplotlib.colors import to_rgba

    angle = np.linspace(0, 2 * np.pi, 17)
    ring = at + radius * np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(angle))])
    centre = np.tile(at + np.array([0.0, 0.0, radius]), (16, 1))
    corners = np.stack([centre, ring[:-1], ring[1:], ring[1:]], axis=1)
    return corners, np.tile(to_rgba(colour), (16, 1))


def _flat_arrow(part: Arrow, camera: Projection) -> tuple[Floats, Floats]:
    tail, tip = camera.project(np.stack([part.tail, part.tip]))
    neck = tip - (tip - tail) * min(0.4, 5 * part.radius / max(float(np.linalg.norm(tip - tail)), 1e-12))
    shaft, colours = _ribbon(refined(np.stack([tail, neck])), part.radius, part.colour)
    wide, _ = _ribbon(np.stack([neck, tip]), 2.4 * part.radius, part.colour)
    head = np.stack([wide[:, 0], tip[None], tip[None], wide[:, 3]], axis=1)
    return np.concatenate([shaft, head]), np.concatenate([colours, colours[:1]])
