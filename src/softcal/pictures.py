"""Pictures of objects for notebooks: what is shown asks for them here, the layers above that draw register them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch
from importlib import import_module

_HOME = "softcal.report.notebook"  # imported when it is needed: it is in a layer above those that ask for pictures


@singledispatch
def drawn(thing: object) -> Iterable[bytes]:
    """Pictures of an object as PNG; none of a kind for which nothing is registered."""
    return ()


def pictures_of(thing: object) -> tuple[bytes, ...]:
    """The pictures of an object; none where they cannot be drawn, since what is said in words is shown anyway."""
    try:
        import_module(_HOME)
        return tuple(drawn(thing))
    except Exception:  # noqa: BLE001 - whatever a library raises: a notebook shows the tables
        return ()
