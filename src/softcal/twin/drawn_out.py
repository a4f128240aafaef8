"""Cables with friction that other cables draw out while they pull: the friction then acts opposite to the modelled
direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.actuator import NO_EFFORT
from softcal.mechanics.cable import cables_of
from softcal.mechanics.state import State
from softcal.mechanics.system import System
from softcal.units import format_quantity

NOTICED = 1e-3  # of a cable's length


def drawn_out(system: System, theta: Mapping[str, float], begin: Floats, state: State) -> dict[str, float]:
    """Elongation [m] of each taut cable with friction beyond its length under the loads alone.

    Parameters
    ----------
    system
        The discretised robot.
    theta
        Parameter values by dotted name [SI].
    begin
        Lengths under the loads alone (n_cables,) [m].
    state
        The state.
    """
    cables = cables_of(system)
    more = cables.lengths(state.x) - begin
    pulls = state.effort[cables.own]
    taut = pulls > NO_EFFORT * np.abs(pulls).max(initial=0.0)
    lines = cables.lines(theta)
    rough = (lines.mu > 0.0) & ~lines.remembers
    out = np.flatnonzero(taut & rough & (more > NOTICED * cables.rest_length))
    return {cables.names[i]: float(more[i]) for i in out}


def drawn_out_at(found: Sequence[tuple[str, dict[str, float]]]) -> str:
    """The sentences on these cables, with a blank before each, in labelled samples."""
    sentences: list[str] = []
    for cable in dict.fromkeys(name for _, one in found for name in one):
        labels = [label for label, one in found if cable in one]
        later = f" and {len(labels) - 1} more" if len(labels) > 1 else ""
        most = format_quantity(max(one.get(cable, 0.0) for _, one in found), "m", digits=3)
        sentences.append(
            f" The other cables pull {cable} out under tension, by up to {most} (at {labels[0]}{later}). Its friction "
            "then has the opposite sign, but is modelled as that of a cable that is pulled in."
        )
    return "".join(sentences)
