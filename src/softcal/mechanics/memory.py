"""Memory: what terms carry from one converged sample to the next, with its derivatives by the parameters.

A slip, an internal strain, the largest energy so far: numbers m, of which each term that remembers owns a part. Sample
n is solved with the memory that the one before it left, and leaves its own,

    r(z; m_n, theta) = 0,    m_(n+1) = a(z, m_n, theta)

and so are the derivatives, which are exact through the whole history:

    K dz/dtheta = -(dr/dtheta + dr/dm dm_n/dtheta)
    dm_(n+1)/dtheta = da/dz dz/dtheta + da/dm dm_n/dtheta + da/dtheta

All that is solved on the way to one sample (steps, corrections, snap-throughs) begins from m_n and leaves nothing
behind. So a response depends on the protocol's samples and on theta, never on the solver's steps, and stability is
that of the potential at m_n. The samples are the way: more of them follow a turning one more closely. In time, each
time step is a sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softcal.checks import Floats


@dataclass(frozen=True)
class Memory:
    """The memory of all terms of a system, in their order.

    Attributes
    ----------
    values
        The memory m (n,), in the terms' own units.
    by_parameter
        Parameter -> dm/dtheta (n,); zero for a parameter that is not in it.
    """

    values: Floats
    by_parameter: Mapping[str, Floats]
