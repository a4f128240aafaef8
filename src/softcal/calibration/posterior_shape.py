"""What sets a posterior apart from the quick intervals, as far as draws show it: bounds that cut it, and skewness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats

_NEAR = 0.1  # standard deviations from a bound
_CUT = 0.05  # of the peak of a normal density: with more at a bound, the 95 % interval ends elsewhere
_CORRELATED = 0.5
_SKEWED = 0.3  # moves a 2.5 % percentile by 0.14 standard deviations


def reasons(labels: Sequence[str], z: Floats) -> dict[str, str]:
    """Why the interval of each parameter may differ from the quick one; "" where the draws z (n, size) show nothing."""
    away = (z - z.mean(axis=0)) / np.maximum(z.std(axis=0), 1e-300)
    correlations = away.T @ away / len(z)
    is_cut = _cut(z)
    found: dict[str, str] = {}
    for j, label in enumerate(labels):
        seen: list[str] = []
        if is_cut[j]:
            seen.append("a bound cuts the posterior")
        for k, other in enumerate(labels):
            if k != j and is_cut[k] and abs(correlations[j, k]) > _CORRELATED:
                r = correlations[j, k]
                seen.append(f"a bound cuts the posterior of {other}, with which it is correlated ({r:+.2f})")
        skewness = float(np.mean(away[:, j] ** 3))
        if abs(skewness) > _SKEWED:
            seen.append(f"the posterior is skewed towards {'high' if skewness > 0 else 'low'} values ({skewness:+.1f})")
        found[label] = ", and ".join(seen)
    return found


def _cut(z: Floats) -> list[bool]:
    """Whether a bound of the unit box cuts the density of each parameter: it is not negligible there."""
    near = _NEAR * z.std(axis=0)
    share = np.maximum(np.mean(z < near, axis=0), np.mean(z > 1 - near, axis=0))
    return [bool(one) for one in share > _CUT * _NEAR / np.sqrt(2 * np.pi)]
