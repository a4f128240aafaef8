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
    from softcal.export.left_out_contact import not_exported
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
    """
    from softcal.plugins.sofa.settings import SofaSettings
    from softcal.plugins.sofa.writing import furthest, write_sofa
    from softcal.workflows.cases import protocols_of

    stated = project.engines.get("sofa")
    settings = stated if isinstance(stated, SofaSettings) else SofaSettings()
    chosen = furthest(protocols_of(cases))
    return write_sofa(
        cases[chosen].robot,
        cases[chosen].protocol,
        folder,
        project.name,
        experiment=chosen if len(cases) > 1 else "",
        slack=_slack(project, cases[chosen]),
        motion=project.dynamics,
        settings=settings,
    )


def _slack(project: Project, case: Case) -> dict[str, float]:
    """Cable -> slack [m]: travel on the bench minus the case's shortening; empty for a pull given by the user."""
    if not case.experiment:
        return {}
    from softcal.sensing.sensors.cable import SHORTENING

    experiment = project.experiments[case.experiment]
    rig = experiment.rig_values()
    driven = [experiment.twin_channel(channel) for channel in experiment.drives]
    return {name.carrier: rig[name.offset] for name in driven if name.kind == SHORTENING}
