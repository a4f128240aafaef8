"""For CalculiX; see `softcal.plugins.calculix.deck`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from softcal.workflows.export import ExportRequest, each_in_its_folder, register_export


@register_export("robot.inp", "README.txt", hint="run it there with: ccx -i robot")
def calculix(request: ExportRequest, folder: Path) -> list[Path]:
    """For CalculiX: a deck of the robot at the end of each experiment or pull, with the cables as springs.

    That state is solved with CalculiX's material law and elements, so that it is in equilibrium there.
    """
    from softcal.export.engine import not_exported
    from softcal.plugins.calculix.deck import PLACE, in_its_law, write_calculix
    from softcal.twin.crossings import REMEDY

    for sentence in not_exported(request.project.robot, PLACE):
        request.warn(sentence)
    cases = request.cases()
    own = {name: replace(case, robot=in_its_law(case.robot)) for name, case in cases.items()}
    asked = replace(request, warn=lambda sentence: request.warn(sentence.replace(REMEDY, "")))  # contact is left out
    ends = {name: response.snapshots[-1] for name, response in asked.solved(own).items()}
    return each_in_its_folder(
        list(cases),
        folder,
        lambda name, inside: write_calculix(own[name].robot, ends[name], inside, given=cases[name].robot),
    )
