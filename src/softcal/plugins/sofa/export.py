"""For SOFA; see `softcal.plugins.sofa.writing`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.workflows.export import ExportRequest, register_export

if TYPE_CHECKING:
    from softcal.project.project import Project
    from softcal.workflows.cases import Case


@register_export("scene.py", "run.py", "README.md", "*/*", hint="run it with: runSofa -l SofaPython3 {out}/scene.py")
def sofa(request: ExportRequest, folder: Path) -> list[Path]:
    """For SOFA: a scene for SofaPython3 and SoftRobots, with meshes, parameters as JSON, keys and a schedule."""
    from softcal.export.engine import not_exported
    from softcal.plugins.sofa.writing import PLACE
    from softcal.twin.protocol import Protocol
    from softcal.workflows.cases import Case

    project = request.project
    for sentence in not_exported(project.robot, PLACE):
        request.warn(sentence)
    moves = bool(request.pulls or project.experiments)
    return write_scene(project, request.cases() if moves else {"": Case(project.robot, Protocol({}))}, folder)


def write_scene(project: Project, cases: Mapping[str, Case], folder: Path) -> list[Path]:
    """The scene, whose schedule is the protocol of the case with the largest pull.

    It uses the project's `dynamics`, and `run.py` its `engines`.

    Parameters
    ----------
    project
        The project, whose `dynamics` the scene uses, and whose `engines` `run.py` does.
    cases
        Robots with their protocols.
    folder
        Existing one to write into.
    """
    from softcal.plugins.sofa.settings import SofaSettings
    from softcal.plugins.sofa.writing import furthest, write_sofa
    from softcal.sensing.sensors.actuators import SHORTENING
    from softcal.workflows.cases import protocols_of

    stated = project.engines.get("sofa")
    settings = stated if isinstance(stated, SofaSettings) else SofaSettings()
    chosen = furthest(protocols_of(cases))
    slack: dict[str, float] = {}  # travel on the bench minus the case's shortening; none for a pull given by the user
    if cases[chosen].experiment:
        experiment = project.experiments[cases[chosen].experiment]
        rig = experiment.rig_values()
        driven = [experiment.twin_channel(channel) for channel in experiment.drives]
        slack = {name.carrier: rig[name.offset] for name in driven if name.kind == SHORTENING}
    return write_sofa(
        cases[chosen].robot,
        cases[chosen].protocol,
        folder,
        project.name,
        experiment=chosen if len(cases) > 1 else "",
        slack=slack,
        motion=project.dynamics,
        settings=settings,
    )
