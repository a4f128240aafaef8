"""One forward solve, and the experiments whose samples are states of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import Samples, control_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response

Member = tuple[Experiment, dict[str, Command]]
# Samples: a longer trajectory of several actuators, whose states are no points of one curve, ends with its experiment.
# The others begin a new one, which another process can solve meanwhile.
_LONG = 100


@dataclass(frozen=True)
class Trajectory:
    """One forward solve that serves several experiments: the robot's values [SI] in it, by dotted name, and these.

    remembers: whether the robot does, so that a state depends on the samples before it. held: what may be
    driven beside the commands: what has a pretension, and stays at zero where it has no command, and the cables of
    drives. needs_time: whether the time between samples counts.
    """

    theta: Mapping[str, float]
    members: tuple[Member, ...]
    remembers: bool = False
    held: tuple[str, ...] = ()
    needs_time: bool = False

    def protocol(self) -> Protocol:
        _, first = self.members[0]
        by = {name: dict.fromkeys(p for _, told in self.members for p in told[name].by) for name in first}
        return Protocol(
            {
                name: Command(
                    command.control,
                    np.concatenate([told[name].values for _, told in self.members]),
                    # A parameter may have no effect on some of them, as the backlash of another test.
                    {
                        p: np.concatenate(
                            [told[name].by.get(p, np.zeros_like(told[name].values)) for _, told in self.members]
                        )
                        for p in by[name]
                    },
                )
                for name, command in first.items()
            },
            self.members[0][0].times if self.needs_time else None,
        )

    def controls(self, free: set[str]) -> list[str]:
        """Further names by which the response has derivatives: the commands of several actuators, where free rig values
        change them; in a robot with a memory, these values.
        """
        _, told = self.members[0]
        if self.remembers:
            return [name for name in self.protocol().parameters if name in free]
        changed = any(free & control_parameters(experiment) for experiment, _ in self.members)
        if len({*told, *self.held}) < 2 or not changed:
            return []
        return list(Protocol(told).drives)

    def samples(self) -> list[tuple[Experiment, Samples]]:
        if not self.members[0][1]:
            # Nothing is driven: every row of every table is the one equilibrium under the dead loads.
            return [(experiment, np.zeros(experiment.dataset.n_samples, dtype=int)) for experiment, _ in self.members]
        ends = np.cumsum([0, *(experiment.dataset.n_samples for experiment, _ in self.members)])
        return [(member[0], slice(int(a), int(b))) for member, a, b in zip(self.members, ends, ends[1:], strict=False)]

    def failure(self, response: Response) -> str:
        """Why the response lacks states of some experiments, a sentence beginning with their names; "" where it lacks
        none.
        """
        whole = response.over(self.protocol().n_samples)
        lacking: dict[str, str] = {}
        for experiment, samples in self.samples():
            for channel in (str(experiment.twin_channel(c)) for c in experiment.compared):
                values = whole.channels.get(channel)
                if values is not None and not np.all(np.isfinite(values[samples])):
                    lacking.setdefault(experiment.name, channel)
        if response.succeeded and lacking:
            name, channel = next(iter(lacking.items()))
            return f"{name}: the twin's {channel} is not finite. {response.status}"
        if response.succeeded:
            return ""
        names = list(lacking) or [experiment.name for experiment, _ in self.members]
        return f"{', '.join(names)}: {response.status}"


def shared_out(members: Sequence[Member]) -> list[list[Member]]:
    """Experiments that can share a trajectory, in several where they drive many actuators and one is long."""
    if len(members[0][1]) < 2:
        return [list(members)]
    out: list[list[Member]] = [[]]
    for member in members:
        if sum(experiment.dataset.n_samples for experiment, _ in out[-1]) >= _LONG:
            out.append([])
        out[-1].append(member)
    return out
