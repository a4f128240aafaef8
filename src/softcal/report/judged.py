"""The results that a report or the command line judges: the one that is shown first, or all separate fits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from softcal.calibration.results.result import SearchResult

R = TypeVar("R", bound=SearchResult)
JOINT = "joint"


def first_label(results: Mapping[str, SearchResult]) -> str:
    """Label of the result that is shown first: the joint one, else the first."""
    return JOINT if JOINT in results else next(iter(results))


def judged(results: Mapping[str, R], first: str) -> dict[str, R]:
    """The result shown first if it is of several experiments; else all results of one."""
    if len(results[first].experiments) > 1:
        return {first: results[first]}
    return {label: one for label, one in results.items() if len(one.experiments) == 1}
