"""Cross-sections that vary along a rod, such as a tentacle's."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, fields

from softcal.display import displayed
from softcal.errors import Fault, MeshError
from softcal.geometry.section import CrossSection, SectionConstants
from softcal.quantities import Share


@displayed
@dataclass(frozen=True)
class VariedSection(CrossSection):
    """Sections of one kind at stations of a rod; between them every dimension varies linearly.

    Attributes
    ----------
    stations : Shares (n,) of the arc length, ascending from 0 to 1; two equal ones make a step
    sections : The section at each station (n,)
    """

    stations: tuple[Share, ...]
    sections: tuple[CrossSection, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        at = list(self.stations)
        faults: list[Fault] = []
        if len(at) < 2 or len(at) != len(self.sections):
            got = f"{len(self.sections)} sections at {len(at)} stations"
            faults.append(Fault("a varied section needs two stations or more, with a section each", got=got))
        elif at[0] != 0.0 or at[-1] != 1.0 or sorted(at) != at:
            got = ", ".join(f"{100 * share:g} %" for share in at)
            faults.append(Fault("the stations do not ascend from one end of the rod to the other", "stations", got))
        if len({type(section) for section in self.sections}) > 1 or not all(one.is_uniform for one in self.sections):
            kinds = ", ".join(dict.fromkeys(type(section).__name__ for section in self.sections))
            faults.append(Fault("sections of several kinds cannot vary into each other", "sections", kinds, "one kind"))
        elif len({tuple(key for key in _dimensions(one)) for one in self.sections}) > 1:
            what = "a tube cannot vary into a full bar"
            faults.append(Fault(what, "sections", attempt="a small inner diameter"))
        if faults:
            raise MeshError(faults)

    @property
    def is_uniform(self) -> bool:
        return False

    @property
    def constants(self) -> SectionConstants:
        return max((section.constants for section in self.sections), key=lambda one: one.outer_diameter)

    def at(self, share: float) -> SectionConstants:
        place = min(max(bisect_right(self.stations, share), 1), len(self.stations) - 1)
        before, after = self.stations[place - 1 : place + 1]
        t = 0.0 if after == before else (min(max(share, before), after) - before) / (after - before)
        first, last = self.sections[place - 1 : place + 1]
        start, end = _dimensions(first), _dimensions(last)
        between = {key: _between(start[key], end[key], t) for key in start}
        return type(first)(**between).constants


def _dimensions(section: CrossSection) -> dict[str, float | tuple[float, ...]]:
    """Stated dimensions of a section."""
    given = {one.name: getattr(section, one.name) for one in fields(section)}  # pyright: ignore[reportArgumentType]
    return {name: value for name, value in given.items() if value is not None}


def _between(a: float | tuple[float, ...], b: float | tuple[float, ...], t: float) -> float | tuple[float, ...]:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return tuple((1.0 - t) * x + t * y for x, y in zip(a, b, strict=True))
    assert isinstance(a, float | int)  # noqa: S101
    assert isinstance(b, float | int)  # noqa: S101
    return (1.0 - t) * a + t * b
