"""Rendering of scenes by PyVista; where OpenGL is missing, a sentence in the place of pictures."""

from __future__ import annotations

import pickle
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softcal.extras import missing
from softcal.processes import run_module
from softcal.report.scene import Projection, Scene
from softcal.report.style import DPI

_PATIENCE = 120.0  # [s]; a software renderer on a loaded machine needs some ten
_MOST_PIXELS = 1300  # picture height


@dataclass(frozen=True)
class Rendering:
    """RGBA pictures, one per scene, or none if the renderer failed; note: why it did."""

    pictures: tuple[np.ndarray[Any, Any], ...]
    note: str = ""


def render_scenes(scenes: tuple[Scene, ...], cameras: tuple[Projection, ...]) -> Rendering:
    """Render each scene by PyVista in a separate process; on failure the note gives the reason."""
    if (fault := missing("pictures", "pyvista", "vtkmodules")) is not None:
        return Rendering((), f"The pictures are missing: {fault}")
    with tempfile.TemporaryDirectory(prefix="softcal-scene-") as folder:
        request, answer = Path(folder, "request.pickle"), Path(folder, "answer.npz")
        # At display size: more pixels cost time in every later step and are scaled down.
        heights = [min(round(DPI * panel_size(camera)[1]), _MOST_PIXELS) for camera in cameras]
        request.write_bytes(pickle.dumps((scenes, cameras, heights)))
        try:
            done = run_module("softcal.report.scene_worker", str(request), str(answer), timeout=_PATIENCE)
        except subprocess.TimeoutExpired:
            problem = f"it did not finish within {_PATIENCE:g} s"
        else:
            if done.returncode == 0 and answer.exists():
                with np.load(answer) as pictures:
                    return Rendering(tuple(pictures[name] for name in pictures.files))
            lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
            problem = lines[-1].rstrip(".") if lines else f"it ended with code {done.returncode}"
            if done.returncode < 0:
                problem = f"it was ended by signal {-done.returncode}, as happens with VTK if OpenGL is missing"
    note = (
        f"The pictures are missing, since the 3-D renderer (PyVista/VTK) does not work on this machine: {problem}. "
        "On Debian or Ubuntu the packages libegl1 and libgl1 make it work."
    )
    return Rendering((), note)


def panel_size(camera: Projection) -> tuple[float, float]:
    """Display width and height [in] of a projection's picture."""
    left, right, bottom, top = camera.window
    width = min(max(3.4 * (right - left) / (top - bottom), 2.4), 3.6)
    return width, width * (top - bottom) / (right - left)
