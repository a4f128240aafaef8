"""Set-ups in the place of experiments, where it is the set-ups that differ.

Experiments of one set-up, such as the weights that one printed specimen carries, share the errors of that specimen.
Where the set-ups differ, ten experiments on one specimen are one sample of the specimens, not ten. The set-ups are then
compared, and the mean is that over set-ups; the parts of the residuals have the set-up's name instead of the
experiment's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.calibration.loss import Block
from softcal.calibration.noise import ScaledBlock


def set_ups_of(blocks: Iterable[Block]) -> dict[str, str]:
    """Experiment -> its set-up, one without being a set-up by itself; empty unless there are two set-ups or more, and
    one of them has several experiments.
    """
    found = {block.experiment: block.set_up or block.experiment for block in blocks if block.experiment}
    return found if 1 < len(set(found.values())) < len(found) else {}


def members(set_ups: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Set-up -> its experiments."""
    return {own: tuple(e for e, s in set_ups.items() if s == own) for own in dict.fromkeys(set_ups.values())}


def parts_by_set_up(parts: Iterable[ScaledBlock], set_ups: Mapping[str, str]) -> list[ScaledBlock]:
    """The parts with the name of the set-up in the place of the experiment's."""
    return [replace(part, experiment=set_ups.get(part.experiment, part.experiment)) for part in parts]


def serves_by_set_up(serves: Mapping[str, np.ndarray], set_ups: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Set-up -> whether each parameter (size,) has an effect on one of its experiments."""
    held: dict[str, list[np.ndarray]] = {}
    for experiment, on in serves.items():
        held.setdefault(set_ups.get(experiment, experiment), []).append(on)
    return {name: np.any(every, axis=0) for name, every in held.items()}


def others(experiment: str, names: Iterable[str], set_ups: Mapping[str, str]) -> Sequence[str]:
    """The experiments that are not of an experiment's set-up."""
    own = set_ups.get(experiment, experiment)
    return [name for name in names if set_ups.get(name, name) != own]
