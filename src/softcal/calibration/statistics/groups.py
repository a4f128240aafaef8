"""Groups of measurements that may share an error: what a jackknife leaves out, and a bootstrap draws, as one.

| kind        | a group is                                                                   |
|-------------|------------------------------------------------------------------------------|
| experiments | all of an experiment                                                         |
| actuators   | all experiments that drive the same actuators                                |
| weights     | all states under the same prescribed tensions, of whatever cable             |
| markers     | all positions of a marker or plate                                           |
| cycles      | one cycle of a record that holds several                                     |
| records     | a piece of a record, long enough that its neighbours err independently of it |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.problem import Problem
from softcal.calibration.statistics.residuals import FEWEST as SHORT
from softcal.calibration.statistics.residuals import residual_record
from softcal.calibration.statistics.reweighted import FEWEST, NONE
from softcal.errors import Fault, InputError, unknown
from softcal.sensing.sensors.actuators import TENSION
from softcal.units import format_quantity

_WORTH = 2.0  # independent samples in a piece of a record
_PIECES = 20  # of a record, at most

Labels = Sequence[str]


def groups_of(problem: Problem, blocks: Sequence[Block], kind: str) -> list[np.ndarray]:
    """The group of each sample (n,) of each block, `NONE` for a sample that is in none, as those of the priors.

    Parameters
    ----------
    problem, blocks
        The problem, and the blocks of its residuals.
    kind
        A key of `KINDS`.

    Raises
    ------
    InputError
        Where there is no such kind of group, or fewer than three groups.
    """
    if kind not in KINDS:
        raise InputError(unknown("this is no kind of group", "--over", kind, KINDS))
    experiments = {one.name: one for one in problem.experiments}
    found: list[np.ndarray] = []
    for block in blocks:
        if not block.experiment:
            found.append(np.full(len(block.residual), NONE, dtype=object))
            continue
        own = [other for other in blocks if other.experiment == block.experiment]
        experiment = experiments[block.experiment]
        labels = np.array(KINDS[kind](experiment, block, own), dtype=object)
        found.append(labels[experiment.seen(block.channel)])
    n = len({name for held in found for name in held} - {NONE})
    if n < FEWEST:
        raise InputError(
            Fault(
                f"there are too few {kind} to estimate their scatter",
                "--over",
                str(n),
                f"{FEWEST} or more",
                f"another of {', '.join(other for other in KINDS if other != kind)}",
            )
        )
    return found


def _weights(experiment: Experiment, block: Block, own: Sequence[Block]) -> Labels:
    drives = experiment.drives
    n = experiment.dataset.n_samples
    if not drives or any(experiment.twin_channel(channel).kind != TENSION for channel in drives):
        return [NONE] * n
    pulled = [experiment.dataset.values(channel) for channel in drives]
    return [" and ".join(format_quantity(float(one[i]), "N", digits=3) for one in pulled) for i in range(n)]


def _cycles(experiment: Experiment, block: Block, own: Sequence[Block]) -> Labels:
    cycle = experiment.dataset.cycle
    n = experiment.dataset.n_samples
    if cycle is None:
        return [NONE] * n
    # Where a step has averaged the cycles, the numbers that are left alternate from sample to sample.
    if int(np.sum(np.diff(cycle) != 0)) > 2 * len(np.unique(cycle)):
        return [NONE] * n
    return [f"{experiment.name}, cycle {int(number) + 1}" if number >= 0 else NONE for number in cycle]


def _records(experiment: Experiment, block: Block, own: Sequence[Block]) -> Labels:
    n = experiment.dataset.n_samples
    seen = [residual_record(one.residual) for one in own if len(one.residual) >= SHORT]
    effective = min((one.effective for one in seen if one is not None), default=1.0)
    pieces = int(np.clip(effective / _WORTH, 1, _PIECES))
    return [f"{experiment.name}, piece {i * pieces // n + 1}" for i in range(n)]


KINDS: Mapping[str, Callable[[Experiment, Block, Sequence[Block]], Labels]] = {
    "experiments": lambda experiment, block, own: [experiment.name] * experiment.dataset.n_samples,
    "actuators": lambda experiment, block, own: (
        [" and ".join(experiment.twin_channel(channel).carrier for channel in experiment.drives) or NONE]
        * experiment.dataset.n_samples
    ),
    "weights": _weights,
    "markers": lambda experiment, block, own: [block.point or NONE] * experiment.dataset.n_samples,
    "cycles": _cycles,
    "records": _records,
}
"""Kind of group -> the group of every sample of an experiment."""
