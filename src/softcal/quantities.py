"""Kinds of quantity: the unit and the admissible range of every number that a user gives.

The project file, `--set`, the bounds of free parameters and the options of commands all use these, so that no number is
valid in one of them and invalid in another. The ranges are wide: they end beyond any robot that is pulled by cables, so
that a number outside is a slip of unit or sign.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Literal

from softcal.declare import Check, Reading, checked_arguments, shown
from softcal.display import displayed
from softcal.errors import Fault, ParameterError, unknown
from softcal.units import parse_quantity

if TYPE_CHECKING:
    from pydantic_core import CoreSchema


@displayed
@dataclass(frozen=True)
class Quantity:
    """A kind of quantity: its unit, and the range [unit] in which it must lie.

    It annotates the fields that a project file can give: `Annotated[float, QUANTITIES["speed"]]`, or `Speed` below.

    Attributes
    ----------
    name, unit
        Name of the kind, and its unit.
    lower, upper
        Ends of the range [unit].
    ends
        Which ends belong to the range, in the notation of intervals.
    least
        Smallest magnitude [unit], for a factor that must not be zero.
    attempt, attempt_below
        Suggestion for a value above, or below, the range or at that end of it.
    """

    name: str
    unit: str
    lower: float
    upper: float
    ends: Literal["[]", "(]", "[)", "()"] = "[]"
    least: float = 0.0
    attempt: str = ""
    attempt_below: str = ""

    def allows(self, value: float) -> bool:
        """Whether a number [unit] lies in the range; NaN does not."""
        above = self.lower < value if self.ends[0] == "(" else self.lower <= value
        below = value < self.upper if self.ends[1] == ")" else value <= self.upper
        return above and below and abs(value) >= self.least

    @property
    def allowed(self) -> str:
        """The range in words, such as "above 0, to 100 m"."""
        words = {"[]": "{} to {}", "(]": "above {}, to {}", "[)": "{} to below {}", "()": "between {} and {}"}
        text = words[self.ends].format(f"{self.lower:g}", f"{self.upper:g}")
        text += "" if self.unit == "1" else f" {self.unit}"
        return f"{text}, and not 0" if self.least else text

    def fault(self, value: float, where: str = "") -> Fault | None:
        """The fault of a number [unit], or None; of what is no number too."""
        if isinstance(value, bool) or not isinstance(value, Real):
            return Fault("this is not a number", where, shown(value), f"one number in SI ({self.unit})")
        if self.allows(value):
            return None
        return Fault(
            f"{'' if self.name[0].isupper() else 'the '}{self.name} is out of range",
            where=where,
            got=f"{value:.6g}" if self.unit == "1" else f"{value:.6g} {self.unit}",
            allowed=self.allowed,
            attempt=self.attempt if value >= self.upper else self.attempt_below if value <= self.lower else "",
        )

    def checked(self, value: float, *, where: str = "") -> float:
        """The number [unit], where it lies in the range.

        Raises
        ------
        ParameterError
            Where it does not.
        """
        if fault := self.fault(value, where):
            raise ParameterError(fault)
        return value

    def read(self, value: object, *, where: str = "") -> float:
        """The number [unit] in a text with a unit.

        Raises
        ------
        UnitError
            Where the unit is missing, unknown or of another dimension.
        ParameterError
            Where the number lies outside the range.
        """
        number = parse_quantity(value, self.unit, where=where)
        if fault := self.fault(number, where):
            raise ParameterError(replace(fault, got=value.strip() if isinstance(value, str) else shown(value)))
        return number

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        return Reading(self.read, "instead").__get_pydantic_core_schema__(source, handler)


def noise_in(unit: str) -> Quantity:
    """The standard deviations that a channel of a unit may have."""
    return replace(QUANTITIES["noise"], unit=unit)


GRAVITY = ("gravity.gx", "gravity.gy", "gravity.gz")
"""The parameters that are the acceleration of weights, along the axes of space."""
_EARTHS = "9.81 m/s^2, or 9810 mm/s^2"

QUANTITIES: Mapping[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity("length", "m", -100.0, 100.0),
        Quantity("size", "m", 0.0, 100.0, "(]"),
        Quantity("extent of a mesh", "m", 1e-6, 100.0, attempt="another unit", attempt_below="another unit"),
        Quantity("clearance", "m", 0.0, 100.0),
        Quantity("slack", "m", -10.0, 10.0),
        Quantity("shortening", "m", -10.0, 10.0),
        Quantity("area", "m^2", 0.0, 1e4, "(]"),
        Quantity("second moment", "m^4", 0.0, 1e8, "(]"),
        Quantity("force", "N", -1e8, 1e8),
        Quantity("moment", "N*m", -1e8, 1e8),
        Quantity("tension", "N", 0.0, 1e8),
        # The softest elastic cords have some 1 N.
        Quantity(
            "stiffness of a cable", "N", 1e-3, 1e10, attempt="another unit", attempt_below="another unit, or none"
        ),
        Quantity("spring rate", "N/m", 1e-3, 1e12, attempt="another unit", attempt_below="another unit, or none"),
        Quantity("compliance", "m/N", 0.0, 1e3, attempt="another unit, such as mm/N"),
        Quantity("presliding displacement", "m", 1e-8, 1.0, attempt="10 um", attempt_below="10 um"),
        Quantity("tension offset", "N", -1e6, 1e6),
        Quantity("pressure", "Pa", -1e13, 1e13),
        Quantity("gauge pressure", "Pa", -101325.0, 1e9, "(]", attempt_below="above a vacuum, -101.325 kPa"),
        Quantity("pressure offset", "Pa", -1e8, 1e8),
        Quantity("pumped volume", "m^3", -10.0, 10.0, attempt="another unit, such as ml"),
        Quantity("dead volume", "m^3", 0.0, 10.0, attempt="another unit, such as ml"),
        Quantity("compliance of a hose", "m^3/Pa", 0.0, 1.0, attempt="another unit, such as ml/kPa"),
        Quantity("polytropic exponent", "1", 1.0, 2.0),
        # The softest gels have some 1 Pa; far below, the solver fails only after minutes.
        Quantity("modulus", "Pa", 1e-3, 1e13, attempt="another unit", attempt_below="another unit, such as MPa"),
        Quantity("fibre modulus", "Pa", 0.0, 1e13, attempt="another unit"),
        Quantity("coefficient", "Pa", -1e13, 1e13),
        Quantity("Poisson's ratio", "1", -1.0, 0.5, "()", attempt="0.4999 instead of 0.5, with element P2P1"),
        Quantity("mass", "kg", 0.0, 1e6),
        Quantity("density", "kg/m^3", 0.0, 1e5),
        Quantity("moment of inertia", "kg*m^2", -1e9, 1e9),
        Quantity("rotor inertia", "kg*m^2", 0.0, 1e9, attempt="another unit, such as g*cm^2"),
        Quantity("acceleration", "m/s^2", -1e3, 1e3, attempt=_EARTHS, attempt_below=_EARTHS),
        Quantity("friction coefficient", "1", 0.0, 2.0, attempt="0.05 for 5 %"),
        # Number, coefficient and wrap multiplied: at its end the cable's tension is lost but for a twenty-thousandth.
        Quantity("friction over all pulleys", "1", 0.0, 10.0, attempt="the wrap of one pulley, and 0.05 for 5 %"),
        Quantity("wrap angle", "rad", 0.0, 100.0),
        Quantity("angle", "rad", -1000.0, 1000.0),
        Quantity("backlash", "rad", 0.0, 6.3, attempt="another unit, such as deg"),
        Quantity("twist", "rad/m", -1e5, 1e5),
        Quantity("time", "s", 0.0, 1e7),
        Quantity("duration", "s", 0.0, 1e7, "(]"),
        Quantity("speed", "m/s", 0.0, 1e5, "(]"),
        Quantity("rate", "1/s", 0.0, 1e9),
        Quantity("ratio", "1", -1e9, 1e9),
        Quantity("positive ratio", "1", 0.0, 1e9, "(]"),
        Quantity("relaxing share", "1", 0.0, 1.0, "[)", attempt="a share of the stress at once, such as 0.3"),
        Quantity("relaxation time", "s", 1e-6, 1e9),
        Quantity("softening amount", "1", 1.0, 1e6),
        Quantity("softening range", "1", 0.0, 1e6),
        Quantity("threshold", "Pa", 0.0, 1e13),
        Quantity("locking stretch", "1", 1.0, 1e3),
        Quantity("exponent of stretches", "1", -50.0, 50.0, least=1e-3),
        Quantity("build ratio", "1", 1.0 / 3.0, 1e3, "(]"),
        Quantity("share", "1", 0.0, 1.0),
        Quantity("infill", "1", 0.0, 1.0, "(]"),
        Quantity("exponent", "1", 0.0, 10.0),
        Quantity("number of turns", "1", 0.0, 1000.0, "(]"),
        Quantity("refinement", "1", 1.0, 1000.0),
        Quantity("scale factor", "1", -1e9, 1e9, least=1e-9),
        Quantity("noise", "1", 1e-12, 1e6),
        Quantity("pixel", "px", -1e6, 1e6),
        Quantity("focal length", "px", 0.0, 1e6, "(]"),
        Quantity("width in pixels", "px", 1.0, 65535.0),
        Quantity("reprojection error", "px", 0.0, 1e3),
        Quantity("distortion coefficient", "1", -1e4, 1e4),
    )
}


@checked_arguments
def quantity(kind: str) -> Quantity:
    """A kind of quantity by its name, such as "modulus", "length" or "positive ratio": its unit and range.

    Raises
    ------
    ParameterError
        For an unknown kind.
    """
    if kind not in QUANTITIES:
        raise ParameterError(unknown("there is no such kind of quantity", "", kind, sorted(QUANTITIES)))
    return QUANTITIES[kind]


# Types of fields that a project file can give; in Python they are floats in SI.
Length = Annotated[float, QUANTITIES["length"]]
Size = Annotated[float, QUANTITIES["size"]]
Clearance = Annotated[float, QUANTITIES["clearance"]]
Slack = Annotated[float, QUANTITIES["slack"]]
Area = Annotated[float, QUANTITIES["area"]]
SecondMoment = Annotated[float, QUANTITIES["second moment"]]
Angle = Annotated[float, QUANTITIES["angle"]]
Twist = Annotated[float, QUANTITIES["twist"]]
Force = Annotated[float, QUANTITIES["force"]]
Tension = Annotated[float, QUANTITIES["tension"]]
CableStiffness = Annotated[float, QUANTITIES["stiffness of a cable"]]
SpringRate = Annotated[float, QUANTITIES["spring rate"]]
Compliance = Annotated[float, QUANTITIES["compliance"]]
Presliding = Annotated[float, QUANTITIES["presliding displacement"]]
Moment = Annotated[float, QUANTITIES["moment"]]
TensionOffset = Annotated[float, QUANTITIES["tension offset"]]
Pressure = Annotated[float, QUANTITIES["pressure"]]
Modulus = Annotated[float, QUANTITIES["modulus"]]
PoissonsRatio = Annotated[float, QUANTITIES["Poisson's ratio"]]
Wrap = Annotated[float, QUANTITIES["wrap angle"]]
Friction = Annotated[float, QUANTITIES["friction coefficient"]]
Mass = Annotated[float, QUANTITIES["mass"]]
Density = Annotated[float, QUANTITIES["density"]]
MomentOfInertia = Annotated[float, QUANTITIES["moment of inertia"]]
Acceleration = Annotated[float, QUANTITIES["acceleration"]]
Time = Annotated[float, QUANTITIES["time"]]
Duration = Annotated[float, QUANTITIES["duration"]]
Speed = Annotated[float, QUANTITIES["speed"]]
Rate = Annotated[float, QUANTITIES["rate"]]
Ratio = Annotated[float, QUANTITIES["ratio"]]
PositiveRatio = Annotated[float, QUANTITIES["positive ratio"]]
Share = Annotated[float, QUANTITIES["share"]]
Infill = Annotated[float, QUANTITIES["infill"]]
Exponent = Annotated[float, QUANTITIES["exponent"]]
Turns = Annotated[float, QUANTITIES["number of turns"]]
Refinement = Annotated[float, QUANTITIES["refinement"]]
Factor = Annotated[float, QUANTITIES["scale factor"]]
Point = tuple[Length, Length, Length]


def _pointing(value: tuple[float, float, float], where: str) -> tuple[float, float, float]:
    if not sum(x * x for x in value):  # as of [0, 0, 1e-200]
        got = f"[{', '.join(f'{x:g}' for x in value)}]"
        raise ParameterError(Fault("the direction has no length", where, got, "such as [0, 0, 1]"))
    return value


Direction = Annotated[tuple[Ratio, Ratio, Ratio], Check(_pointing)]
