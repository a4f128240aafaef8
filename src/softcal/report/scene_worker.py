"""Renders scenes by VTK in a separate process, since VTK aborts the process if OpenGL is missing.

Run as `python -m softcal.report.scene_worker REQUEST ANSWER`: REQUEST is a pickle of (scenes, cameras, heights
in pixels) that the parent wrote, ANSWER the .npz of one RGBA picture per scene.
"""

from __future__ import annotations

import importlib
import pickle
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.report.scene import Projection, Scene, Surface, polylines

if TYPE_CHECKING:
    from pyvista import PolyData

# Ambient, diffuse and specular light. What is small is drawn brighter, or its colour could not be told.
_BULKY, _SMALL = (0.25, 0.75, 0.1), (0.35, 1.0, 0.0)
_EDGES = "#4b5563"
_FINER = 2  # pixels rendered for each one of the picture, across and up
_PEELS = 4  # layers of what is seen through


def render(scene: Scene, camera: Projection, height: int) -> np.ndarray[Any, Any]:
    """One scene as RGBA, shape (height, width, 4), the background transparent.

    By VTK's classes, since PyVista's plotter imports pyplot, which takes longer than the picture.

    Parameters
    ----------
    scene
        What is drawn.
    camera
        Its projection.
    height
        Height of the picture [pixels].
    """
    importlib.import_module("vtkmodules.vtkRenderingOpenGL2")  # makes VTK's classes below those of OpenGL
    from PIL import Image
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkRenderingCore import vtkLightKit, vtkRenderer, vtkRenderWindow, vtkWindowToImageFilter

    left, right, bottom, top = camera.window
    width = round(height * (right - left) / (top - bottom))
    window, renderer = vtkRenderWindow(), vtkRenderer()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)  # with which nothing can be seen through
    window.SetAlphaBitPlanes(True)
    window.SetSize(_FINER * width, _FINER * height)
    window.AddRenderer(renderer)
    renderer.SetBackgroundAlpha(0.0)
    renderer.SetUseDepthPeeling(True)
    renderer.SetMaximumNumberOfPeels(_PEELS)
    vtkLightKit().AddLightsToRenderer(renderer)
    for part in scene.parts:
        mesh = part.mesh()
        if part.opacity < 1.0:
            mesh = from_behind(mesh.triangulate(), camera)
        actor = _actor(mesh, part.colour if isinstance(part.colour, str) else "white", part.opacity)
        renderer.AddActor(actor)
        look = actor.GetProperty()
        ambient, diffuse, specular = _BULKY if part.bulky else _SMALL
        look.SetAmbient(ambient)
        look.SetDiffuse(diffuse)
        look.SetSpecular(specular)
        if not part.smooth:
            look.SetInterpolationToFlat()
        if isinstance(part, Surface) and part.edges is not None:
            edges = _actor(polylines(tuple(part.points[part.edges])), _EDGES, part.opacity)
            edges.GetProperty().SetLighting(False)
            edges.GetProperty().SetLineWidth(_FINER)
            renderer.AddActor(edges)
    middle = 0.5 * ((left + right) * camera.right + (bottom + top) * camera.up)
    view = renderer.GetActiveCamera()
    view.SetPosition(*middle + 10.0 * (right - left + top - bottom) * camera.back)
    view.SetFocalPoint(*middle)
    view.SetViewUp(*camera.up)
    view.SetParallelProjection(True)
    view.SetParallelScale(0.5 * (top - bottom))
    renderer.ResetCameraClippingRange()
    seen = vtkWindowToImageFilter()
    seen.SetInput(window)
    seen.SetInputBufferTypeToRGBA()
    seen.ReadFrontBufferOff()
    seen.Update()
    scalars = seen.GetOutput().GetPointData().GetScalars()
    pixels = vtk_to_numpy(scalars).reshape(_FINER * height, _FINER * width, 4)[::-1]
    # Means of opaque colours: what is clear has none.
    return np.asarray(Image.fromarray(pixels).convert("RGBa").reduce(_FINER).convert("RGBA"))


def _actor(mesh: PolyData, colour: str, opacity: float) -> Any:
    """A mesh in its own colours where it has any, else in one."""
    from matplotlib.colors import to_rgb
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    mapper, actor = vtkPolyDataMapper(), vtkActor()
    # Edges lie on their surface, which is therefore moved back a little.
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetInputData(mesh)
    mapper.ScalarVisibilityOff()  # other data of a mesh, such as a tube's radius, are no colours
    for data, use in (
        (mesh.cell_data, mapper.SetScalarModeToUseCellFieldData),
        (mesh.point_data, mapper.SetScalarModeToUsePointFieldData),
    ):
        if "colour" in data:
            use()
            mapper.ScalarVisibilityOn()
            mapper.SelectColorArray("colour")
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*to_rgb(colour))
    actor.GetProperty().SetOpacity(opacity)
    return actor


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
