"""Even steps of a pull, for shapes that play as a film."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softcal.errors import Fault, ParameterError
from softcal.limits import LIMITS
from softcal.twin.protocol import Command, Protocol

SAME = 1e-9  # of the furthest command


def films(protocols: Mapping[str, Protocol], n: int) -> dict[str, Protocol]:
    """Each protocol, by name, as n even steps from no pull to its furthest sample; one state where nothing is pulled.

    Raises
    ------
    InputError
        For too few steps or too many.
    ParameterError
        Where nothing at all is pulled; for samples that pull the cables by different shares.
    """
    LIMITS["shapes of a film"].check(n, where="--shapes")
    found: dict[str, Protocol] = {}
    faults: list[Fault] = []
    for name, protocol in protocols.items():
        commands = np.array([command.values for command in protocol.commands.values()])
        end = commands[:, int((commands**2).sum(axis=0).argmax())] if len(commands) else commands
        if not end.any():
            found[name] = Protocol({})
        elif np.abs(commands - np.outer(end, end @ commands / (end @ end))).max() > SAME * np.abs(end).max():
            problem = "the samples pull the cables by different shares: they are states, not one pull"
            faults.append(Fault(problem, name, attempt="--pull, or without --shapes, which writes every state"))
        else:
            share = np.linspace(0.0, 1.0, n)
            pulls = zip(protocol.commands.items(), end, strict=True)
            found[name] = Protocol({cable: Command(told.control, value * share) for (cable, told), value in pulls})
    if not faults and not any(protocol.commands for protocol in found.values()):
        faults.append(Fault("nothing is pulled", "--shapes", attempt="--pull"))
    if faults:
        raise ParameterError(faults)
    return found
