"""Round numbers: where a value may be anywhere in an interval, others come to the same one, and what is solved there
serves them.
"""

from __future__ import annotations

import numpy as np


def roundest(low: float, high: float) -> float:
    """The number from `low` to `high` with the fewest binary digits."""
    if not low < high:
        return low
    digit = 2.0 ** (np.floor(np.log2(high - low)) + 1.0)
    while (number := np.ceil(low / digit) * digit) > high:
        digit *= 0.5
    return float(number)
