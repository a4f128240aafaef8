"""Memory: what terms carry from one converged sample to the next, with its derivatives by the parameters.

A slip, an internal strain, the largest energy so far: numbers m, of which each term with memory owns a part. Sample n
is solved with the memory after the sample before it,

    r(z; m_n, theta) = 0,    m_(n+1) = a(z, m_n, theta)

and its derivatives likewise, so that they are exact through the whole history:

    K dz/dtheta = -(dr/dtheta + dr/dm dm_n/dtheta)
    dm_(n+1)/dtheta = da/dz dz/dtheta + da/dm dm_n/dtheta + da/dtheta

The solver's steps between two samples, and a snap-through, all start from m_n and change no memory. So a response
depends on the protocol's samples and on theta, never on the solver's steps, and stability is that of the potential at
m_n. A load path that reverses between two samples needs more samples. In time, each step is a sample.
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
