"""What is done to the robot: each cable's tension or shortening, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softcal.checks import Floats, frozen_floats
from softcal.errors import Fault, InputError
from softcal.twin.robot import Control


@dataclass(frozen=True)
class Command:
    """One cable's prescribed `tension` [N, >= 0] or `shortening` [m, + = pulled], shape (n_samples,)."""

    control: Control
    values: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen_floats(self.values, name=self.control, shape=(None,)))


@dataclass(frozen=True)
class Protocol:
    """Commands by cable name, all of one length. A cable that is not named is slack (tension zero).

    Samples are quasi-static states; the robot is elastic, so their order and repetition do not matter.
    """

    commands: Mapping[str, Command]

    def __post_init__(self) -> None:
        object.__setattr__(self, "commands", dict(self.commands))
        lengths = {len(command.values) for command in self.commands.values()}
        if len(lengths) > 1:
            raise InputError(Fault("the commands of a protocol have different lengths", got=str(sorted(lengths))))

    @property
    def n_samples(self) -> int:
        return max((len(command.values) for command in self.commands.values()), default=1)
