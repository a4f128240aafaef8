"""Evenly spaced steps of a pull, for an animation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softcal.errors import Fault, ParameterError
from softcal.limits import LIMITS
from softcal.twin.protocol import Command, Protocol

SAME = 1e-9  # of the furthest command


def films(protocols: Mapping[str, Protocol], n: int) -> dict[str, Protocol]:
    """Each protocol as n even steps from no pull to its furthest sample; one state if nothing is pulled.

    Raises
    ------
    InputError
        For too few steps or too many.
    ParameterError
        If no protocol pulls a cable; for samples whose commands are not proportional to each other.
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
            problem = "the cables' commands are not proportional: the samples are states, not one pull"
            faults.append(Fault(problem, name, attempt="--pull, or without --shapes, which writes every state"))
        else:
            share = np.linspace(0.0, 1.0, n)
            pulls = zip(protocol.commands.items(), end, strict=True)
            steps = {cable: Command(command.control, value * share) for (cable, command), value in pulls}
            found[name] = Protocol(steps)
    if not faults and not any(protocol.commands for protocol in found.values()):
        faults.append(Fault("nothing is pulled", "--shapes", attempt="--pull"))
    if faults:
        raise ParameterError(faults)
    return found
