"""For ParaView; see `softcal.export.vtk`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from softcal.workflows.export import ExportOption, ExportRequest, each_in_its_folder, register_export


@register_export(
    "shape-*.vtu",
    "shapes.pvd",
    shapes=ExportOption(
        int, "For an animation: N shapes in even steps of the pull; by default the solved load steps.", "N"
    ),
    in_time=ExportOption(bool, "Shapes of the motion, as by simulate --in-time."),
)
def vtk(request: ExportRequest, folder: Path, shapes: int | None = None, in_time: bool = False) -> list[Path]:
    """For ParaView: shapes over a pull as .vtu files, with displacement, stress, strain and the parameters.

    Parameters
    ----------
    request
        The project, its cases, and observers.
    folder
        Folder of the files.
    shapes
        Shapes of an animation; in motion those over the schedule, 40 by default, then at the same rate.
    in_time
        Shapes of the motion.

    Raises
    ------
    InputError
        Where PyVista is not installed.
    ParameterError
        For a number of shapes of a case that is no pull; see `softcal.workflows.cases.films`.
    """
    from softcal.export.vtk import write_vtk
    from softcal.extras import require_extra
    from softcal.limits import LIMITS
    from softcal.workflows.cases import films, protocols_of
    from softcal.workflows.motion import SNAPSHOTS, simulate_each_in_time

    require_extra("pictures", "pyvista", where="export for ParaView")
    cases = request.cases()
    if in_time:
        n = SNAPSHOTS if shapes is None else shapes
        LIMITS["shapes of a film"].check(n, where="--shapes")
        responses = request.told(simulate_each_in_time(request.project, cases, n, progress=request.motion))
    elif shapes is None:
        responses = request.solved(cases)
    else:
        animations = films(protocols_of(cases), shapes)
        filmed = {name: replace(case, protocol=animations[name]) for name, case in cases.items()}
        responses = request.solved(filmed, "samples")
    return each_in_its_folder(
        list(cases), folder, lambda name, inside: write_vtk(cases[name].robot, responses[name], inside)
    )
