"""Renders scenes by PyVista in a separate process, since VTK aborts the process if OpenGL is missing.

Run as `python -m softcal.report.scene_worker REQUEST ANSWER`: REQUEST is a pickle of (scenes, cameras, heights
in pixels) that the parent wrote, ANSWER the .npz of one RGBA picture per scene.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.report.scene import Projection, Scene

if TYPE_CHECKING:
    from pyvista import PolyData

# What is small is drawn brighter, or its colour could not be told.
_BULKY: dict[str, Any] = {"ambient": 0.25, "diffuse": 0.75, "specular": 0.1}
_SMALL: dict[str, Any] = {"ambient": 0.35}


def render(scene: Scene, camera: Projection, height: int) -> np.ndarray[Any, Any]:
    """One scene as RGBA, shape (height, width, 4), the background transparent."""
    import pyvista as pv

    left, right, bottom, top = camera.window
    width = round(height * (right - left) / (top - bottom))
    plotter = pv.Plotter(off_screen=True, window_size=[width, height], lighting="light kit")
    try:
        for part in scene.parts:
            mesh = part.mesh() if part.opacity == 1.0 else from_behind(part.mesh().triangulate(), camera)
            own: dict[str, Any] = {"scalars": "colour", "rgb": True} if part.rgb else {"color": part.colour}
            plotter.add_mesh(
                mesh, **own, **(_BULKY if part.bulky else _SMALL), opacity=part.opacity, show_edges=part.edges,
                edge_color="#4b5563", line_width=1, smooth_shading=part.smooth,
            )  # fmt: skip
        middle = 0.5 * ((left + right) * camera.right + (bottom + top) * camera.up)
        depth = 10.0 * (right - left + top - bottom)
        plotter.camera_position = [tuple(middle + depth * camera.back), tuple(middle), tuple(camera.up)]
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = 0.5 * (top - bottom)
        plotter.reset_camera_clipping_range()
        plotter.enable_anti_aliasing("ssaa")
        plotter.renderer.enable_depth_peeling()
        return np.asarray(plotter.screenshot(None, transparent_background=True, return_img=True))
    finally:
        plotter.close()


def from_behind(mesh: PolyData, camera: Projection) -> PolyData:
    """Triangles sorted back to front: depth peeling does not sort them with every OpenGL."""
    import pyvista as pv

    order = np.argsort(mesh.points[mesh.regular_faces].mean(axis=1) @ camera.back)
    found = pv.PolyData.from_regular_faces(mesh.points, mesh.regular_faces[order])
    for name, values in mesh.cell_data.items():
        found.cell_data[name] = values[order]
    for name, values in mesh.point_data.items():
        found.point_data[name] = values
    return found


def main(request: str, answer: str) -> None:
    """Render every scene of the request."""
    scenes, cameras, heights = pickle.loads(Path(request).read_bytes())
    np.savez(answer, *[render(*one) for one in zip(scenes, cameras, heights, strict=True)])


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
