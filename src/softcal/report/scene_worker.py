"""Renders scenes by PyVista in a separate process, since VTK aborts the process if OpenGL is missing.

Run as `python -m softcal.report.scene_worker REQUEST ANSWER`: REQUEST is a pickle of (scenes, cameras, heights
in pixels) that the parent wrote, ANSWER the .npz of one RGBA picture per scene.
"""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from softcal.report.scene import Arrow, Ball, Part, Projection, Scene, Surface, Tube


def render(scene: Scene, camera: Projection, height: int) -> np.ndarray[Any, Any]:
    """One scene as RGBA, shape (height, width, 4), the background transparent."""
    import pyvista as pv

    left, right, bottom, top = camera.window
    width = round(height * (right - left) / (top - bottom))
    plotter = pv.Plotter(off_screen=True, window_size=[width, height], lighting="light kit")
    try:
        for part in scene.parts:
            _add(plotter, part, camera)
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


def _add(plotter: Any, part: Part, camera: Projection) -> None:
    import pyvista as pv

    if isinstance(part, Surface):
        if part.opacity < 1:
            part = from_behind(part, camera)
        mesh = pv.PolyData(np.array(part.points), _cells(part.triangles))
        data = mesh.point_data if part.per_point else mesh.cell_data
        data["colour"] = np.round(255 * part.colours).astype(np.uint8)
        plotter.add_mesh(
            mesh, scalars="colour", rgb=True, opacity=part.opacity, show_edges=part.edges, edge_color="#4b5563",
            line_width=1, ambient=0.25, diffuse=0.75, specular=0.1,
        )  # fmt: skip
    elif isinstance(part, Tube):
        tube = pv.lines_from_points(np.array(part.path)).tube(radius=part.radius, n_sides=16)
        plotter.add_mesh(tube, color=part.colour, ambient=0.35)
    elif isinstance(part, Ball):
        plotter.add_mesh(pv.Sphere(radius=part.radius, center=tuple(part.at)), color=part.colour, ambient=0.35)
    else:
        plotter.add_mesh(_arrow(part), color=part.colour, ambient=0.35)


def from_behind(part: Surface, camera: Projection) -> Surface:
    """Triangles sorted back to front: depth peeling does not sort them with every OpenGL."""
    depth = camera.project(part.points)[part.triangles][..., 2].mean(axis=1)
    order = np.argsort(depth)
    colours = part.colours if part.per_point else part.colours[order]
    return replace(part, triangles=part.triangles[order], colours=colours)


def _arrow(part: Arrow) -> Any:
    import pyvista as pv

    length = float(np.linalg.norm(part.tip - part.tail))
    return pv.Arrow(
        start=tuple(part.tail),
        direction=tuple(part.tip - part.tail),
        scale=length,
        tip_length=min(0.4, 5 * part.radius / length),
        tip_radius=2.4 * part.radius / length,
        shaft_radius=part.radius / length,
    )


def _cells(triangles: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.column_stack([np.full(len(triangles), 3), triangles]).ravel()


def main(request: str, answer: str) -> None:
    """Render every scene of the request."""
    scenes, cameras, heights = pickle.loads(Path(request).read_bytes())
    np.savez(answer, *[render(*one) for one in zip(scenes, cameras, heights, strict=True)])


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
