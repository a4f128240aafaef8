"""Functions that Numba compiles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of a function that Numba compiles, with options of `numba.njit`.

    What is compiled is kept on disk, unless neither this package's folder nor one of the user's can be written, as in
    some containers: then every process compiles it again.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, **options)(function)
        except RuntimeError:
            return numba.njit(**options)(function)

    return compiled
