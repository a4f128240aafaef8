"""A project in several engines: which are asked for, and each experiment or pull put through them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence

from softcal.errors import Fault, InputError
from softcal.export.crosscheck import ENGINES, SELF, Crosscheck, crosscheck
from softcal.project.project import Project
from softcal.twin.protocol import Protocol


def crosscheck_project(
    project: Project, protocols: Mapping[str, Protocol], engines: Sequence[str] = ()
) -> dict[str, Crosscheck]:
    """Each protocol's furthest state, by name, in the engines (by default all); see `softcal.export.crosscheck`.

    Raises
    ------
    InputError
        For an engine that does not exist, or none but softcal itself.
    """
    known = [SELF, *ENGINES]
    chosen = list(dict.fromkeys(engines)) or known
    faults = [
        Fault(
            "there is no such engine",
            "--engines",
            f"'{name}'",
            ", ".join(known),
            f"did you mean '{difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]}'?",
        )
        for name in chosen
        if name not in known
    ]
    if not faults and chosen == [SELF]:
        faults.append(Fault("there is nothing to compare softcal with", "--engines", SELF, ", ".join(known)))
    if faults:
        raise InputError(faults)
    return {name: crosscheck(project.robot, protocol, chosen) for name, protocol in protocols.items()}
