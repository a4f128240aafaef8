"""Name the Debian packages without which the Gmsh and VTK wheels cannot load or draw; nothing where all is there.

Writes one line of package names to standard output. Run with the environment's own Python.
"""

from __future__ import annotations

import ctypes
import importlib.util
import subprocess
import sys
from pathlib import Path

PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libGLU.so.1": "libglu1-mesa",
    "libICE.so.6": "libice6",
    "libOpenGL.so.0": "libopengl0",
    "libSM.so.6": "libsm6",
    "libX11.so.6": "libx11-6",
    "libXcursor.so.1": "libxcursor1",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libXrender.so.1": "libxrender1",
    "libexpat.so.1": "libexpat1",
    "libfontconfig.so.1": "libfontconfig1",
    "libfreetype.so.6": "libfreetype6",
    "libgomp.so.1": "libgomp1",
    "libstdc++.so.6": "libstdc++6",
    "libxcb.so.1": "libxcb1",
    "libz.so.1": "zlib1g",
}
# VTK opens these when it draws, so the dynamic linker does not list them.
OPENED_BY_VTK = ("libEGL.so.1", "libGL.so.1")
# What draws where there is neither a screen nor a graphics card.
SOFTWARE_RENDERER = ("libegl1", "libegl-mesa0", "libgl1-mesa-dri")
# vtkmodules rather than pyvista: importing pyvista costs a second and proves no more.
DRAW_A_CONE = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkFiltersSources import vtkConeSource
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow
from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter
cone, mapper, actor = vtkConeSource(), vtkPolyDataMapper(), vtkActor()
renderer, window, picture = vtkRenderer(), vtkRenderWindow(), vtkWindowToImageFilter()
mapper.SetInputConnection(cone.GetOutputPort())
actor.SetMapper(mapper)
renderer.AddActor(actor)
window.OffScreenRenderingOn()
window.SetSize(32, 32)
window.AddRenderer(renderer)
window.Render()
picture.SetInput(window)
picture.Update()
low, high = picture.GetOutput().GetScalarRange()
raise SystemExit(low == high)
"""


def wheel_libraries() -> list[Path]:
    """Shared libraries of the installed Gmsh and VTK wheels."""
    found = sorted(Path(sys.prefix).glob("lib*/libgmsh.so*"))
    vtk = importlib.util.find_spec("vtkmodules")
    for folder in (vtk.submodule_search_locations or []) if vtk else []:
        found += sorted(Path(folder).glob("vtkRendering*.so"))
        found += sorted(Path(folder).glob("libvtkRendering*.so*"))
    return found


def unresolved(library: Path) -> set[str]:
    """Names of the libraries that the dynamic linker cannot find for `library`."""
    listing = subprocess.run(["ldd", str(library)], capture_output=True, text=True, check=False).stdout
    return {line.split()[0] for line in listing.splitlines() if "not found" in line}


def is_loadable(name: str) -> bool:
    """Whether the dynamic linker finds a library."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def can_draw() -> bool:
    """Whether VTK draws off screen; tried in a process of its own because it may crash instead of failing."""
    command = [sys.executable, "-c", DRAW_A_CONE]
    return subprocess.run(command, capture_output=True, timeout=120, check=False).returncode == 0


def missing_packages() -> list[str]:
    """Debian packages to install, sorted."""
    if sys.platform != "linux":
        return []
    libraries = wheel_libraries()
    names: set[str] = set()
    for library in libraries:
        names |= unresolved(library)
    vtk_is_there = any("vtk" in library.name for library in libraries)
    if vtk_is_there:
        names |= {name for name in OPENED_BY_VTK if not is_loadable(name)}
    unknown = sorted(names - PACKAGES.keys())
    if unknown:
        sys.stderr.write(f"libraries not found, and no package is known for them: {', '.join(unknown)}\n")
    packages = {PACKAGES[name] for name in names & PACKAGES.keys()}
    if vtk_is_there and not packages and not can_draw():
        packages |= set(SOFTWARE_RENDERER)
    return sorted(packages)


if __name__ == "__main__":
    sys.stdout.write(" ".join(missing_packages()))
