"""Display of softcal's objects: a short text, and a small table and pictures in a notebook.

`displayed` gives a class both, by its fields; a class that says more of itself defines `_repr_html_` or `__repr__`.
Pictures and plots are asked for here, and the layers above draw them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import MISSING, fields, is_dataclass
from functools import singledispatch
from importlib import import_module
from pathlib import PurePath
from typing import Any, TypeVar

from softcal.html_text import heading, html_table

_HOME = "softcal.report.plots"  # imported when it is needed: it is in a layer above those that ask for pictures

T = TypeVar("T")

LONGEST = 160  # characters of the text of an object
MOST = 4  # names or numbers that are listed
LONG_TEXT = 60


def displayed(cls: type[T]) -> type[T]:
    """Decorator of a class whose objects users see: their text is short, and a notebook shows a table of their fields.

    The text that a dataclass makes, of all that it holds, does not stay; one that is written does, with `repr=False`.
    """
    made = vars(cls).get("__dataclass_params__")
    if cls.__repr__ is object.__repr__ or (made is not None and made.repr):
        setattr(cls, "__repr__", short_text)  # noqa: B010 (of a class in general pyright allows no assignment)
    if not hasattr(cls, "_repr_html_"):
        setattr(cls, "_repr_html_", field_table)  # noqa: B010
    return cls


def short_text(thing: object) -> str:
    """Class(field=value, …) of the fields that are neither empty nor as by default, cut after 160 characters."""
    text = f"{type(thing).__name__}("
    for k, (name, value) in enumerate(_told(thing)):
        more = f"{', ' if k else ''}{name}={brief(value)}"
        if len(text) + len(more) > LONGEST:
            return f"{text}{', ' if k else ''}…)"
        text += more
    return f"{text})"


def field_table(thing: object) -> str:
    """The table of an object's fields, as short_text has them."""
    rows = [[name, brief(value)] for name, value in _told(thing)]
    return heading(title(thing)) + html_table(["field", "value"], rows)


def title(thing: object) -> str:
    """The class and the name of an object that has one."""
    name = getattr(thing, "name", "")
    return f"{type(thing).__name__} {name}" if isinstance(name, str) and name else type(thing).__name__


def brief(value: Any) -> str:
    """A value in a few characters: numbers and names where there are few, else how many of what there are."""
    match value:
        case str():
            return repr(value if len(value) <= LONG_TEXT else value[:LONG_TEXT] + "…")
        case bool() | None | PurePath():
            return str(value)
        case float():
            return f"{value:.6g}"
        case Mapping():
            some = list(value.items())[: MOST + 1]
            shown = (f"{key}: {brief(one)}" if isinstance(one, int | float) else str(key) for key, one in some)
            return _listed(list(shown), len(value))
        case Sequence() | Set():
            return _listed([_item(one) for one in list(value)[: MOST + 1]], len(value))
        case type():
            return value.__name__
        case _ if hasattr(value, "shape") and hasattr(value, "tolist"):
            if value.ndim == 0:
                return brief(value.tolist())
            few = value.size <= MOST and value.dtype.kind in "fiub"
            return f"[{', '.join(map(brief, value.ravel().tolist()))}]" if few else f"array {value.shape}"
        case _ if is_dataclass(value):
            return title(value)
        case _ if callable(value):
            return getattr(value, "__name__", type(value).__name__)
        case _:
            text = str(value)
            return text if len(text) <= LONG_TEXT and "0x" not in text else type(value).__name__


def _item(one: object) -> str:
    name = getattr(one, "name", None)
    return name if isinstance(name, str) else brief(one)


def _listed(items: Sequence[str], n: int) -> str:
    return f"[{', '.join(items)}]" if n <= MOST and sum(map(len, items)) <= LONG_TEXT else f"{n} entries"


def _told(thing: object) -> list[tuple[str, object]]:
    """The fields of an object that say something: neither empty nor as by default."""
    if not is_dataclass(thing):
        return [(name, value) for name, value in vars(thing).items() if not name.startswith("_")]
    told: list[tuple[str, object]] = []
    for one in fields(thing):
        value = getattr(thing, one.name)
        standard = one.default if one.default_factory is MISSING else one.default_factory()
        is_empty = value is None or (isinstance(value, str | Mapping | Sequence | Set) and not value)
        if not (one.name.startswith("_") or is_empty or _is_same(value, standard)):
            told.append((one.name, value))
    return told


def _is_same(value: Any, other: Any) -> bool:
    """Whether two values are one; arrays by their numbers."""
    if type(value) is not type(other) or is_dataclass(value):
        return value is other
    return bool(value.tolist() == other.tolist() if hasattr(value, "tolist") else value == other)


def plotted(plot: str, thing: object, *args: Any) -> Any:
    """What the function of that name of the report's plots draws of an object."""
    return getattr(import_module(_HOME), plot)(thing, *args)


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
