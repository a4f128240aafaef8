"""Cross-sections of rods: area, second moments, torsion constant, and shear coefficients as functions of nu.

Axes 1 and 2 are the section's principal ones, through its centroid; axis 3 is the rod's tangent.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from softcal.declare import Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError, MeshError
from softcal.quantities import QUANTITIES, Area, PositiveRatio, SecondMoment, Size


@dataclass(frozen=True)
class SectionConstants:
    """area A [m^2]; I1, I2: second moments about axes 1 and 2 [m^4]; J: torsion constant [m^4]; shear: (s0, s1), with
    the shear coefficient k of k G A by E A / (k G A) = s0 + s1 (1 + nu), the same along axes 1 and 2 or one pair each.

    Cowper's coefficients are of this form, and a constant k is (0, 2 / k).
    """

    area: float
    I1: float
    I2: float
    J: float
    shear1: tuple[float, float]
    shear2: tuple[float, float]

    @property
    def outer_diameter(self) -> float:
        """Outer diameter of the round bar or tube with this area and mean second moment [m]."""
        return math.sqrt(4.0 * (self.I1 + self.I2) / self.area + 2.0 * self.area / math.pi)


class CrossSection(Declared, ABC):
    """The cross-section of a rod."""

    @property
    @abstractmethod
    def constants(self) -> SectionConstants:
        """Areas and moments of area for the mechanics; of the widest place, if the section varies along the rod."""

    @property
    def is_uniform(self) -> bool:
        """True if the section is the same all along a rod."""
        return True

    def at(self, share: float) -> SectionConstants:
        """Areas and moments of area at a share of the rod's arc length, from 0 to 1."""
        return self.constants


@displayed
@dataclass(frozen=True)
class RoundBar(CrossSection):
    """A round bar or, with an inner diameter, a tube.

    Attributes
    ----------
    diameter, inner_diameter : [m]; None: it is not hollow

    References
    ----------
    Cowper (1966), The shear coefficient in Timoshenko's beam theory: k = 6 (1 + nu) / (7 + 6 nu) for a full circle;
    with m the ratio of the diameters, k = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2) for a
    tube.
    """

    diameter: Size
    inner_diameter: Size | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.inner_diameter or 0.0) >= self.diameter:
            raise MeshError(
                Fault(
                    "a tube's inner diameter does not fit into it",
                    got=f"{self.inner_diameter:.6g} m",
                    allowed=f"below {self.diameter:.6g} m",
                )
            )

    @property
    def constants(self) -> SectionConstants:
        outer, inner = self.diameter, self.inner_diameter or 0.0
        second = math.pi * (outer**4 - inner**4) / 64.0
        m2 = (inner / outer) ** 2
        hollow = m2 / (1.0 + m2) ** 2
        # 2 (1 + nu) / k with 7 + 6 nu = 1 + 6 (1 + nu) and 20 + 12 nu = 8 + 12 (1 + nu)
        shear = ((1.0 + 8.0 * hollow) / 3.0, (6.0 + 12.0 * hollow) / 3.0)
        return SectionConstants(math.pi * (outer**2 - inner**2) / 4.0, second, second, 2.0 * second, shear, shear)


@displayed
@dataclass(frozen=True)
class RectangularBar(CrossSection):
    """A rectangular bar.

    Attributes
    ----------
    width, height : Along axes 1 and 2 [m]

    References
    ----------
    Cowper (1966): k = 10 (1 + nu) / (12 + 11 nu). Torsion: Saint-Venant's series (Timoshenko and Goodier, 1951).
    """

    width: Size
    height: Size

    @property
    def constants(self) -> SectionConstants:
        b, h = self.width, self.height
        long, short = max(b, h), min(b, h)
        odd = range(1, 40, 2)
        series = sum(math.tanh(n * math.pi * long / (2.0 * short)) / n**5 for n in odd)
        torsion = long * short**3 * (1.0 / 3.0 - 64.0 / math.pi**5 * short / long * series)
        shear = (0.2, 2.2)
        return SectionConstants(b * h, b * h**3 / 12.0, h * b**3 / 12.0, torsion, shear, shear)


@displayed
@dataclass(frozen=True)
class GivenSection(CrossSection):
    """A section with given constants.

    Attributes
    ----------
    area : [m^2]
    I1, I2, J : Second moments about axes 1 and 2, and torsion constant [m^4]
    shear_coefficients : k along axes 1 and 2 [-], independent of Poisson's ratio
    """

    area: Area
    I1: SecondMoment
    I2: SecondMoment
    J: SecondMoment
    shear_coefficients: tuple[PositiveRatio, PositiveRatio] = (5 / 6, 5 / 6)

    def __post_init__(self) -> None:
        super().__post_init__()
        kind = QUANTITIES["positive ratio"]
        if faults := [fault for k in self.shear_coefficients if (fault := kind.fault(k, "shear_coefficients"))]:
            raise InputError(faults)

    @property
    def constants(self) -> SectionConstants:
        k1, k2 = self.shear_coefficients
        return SectionConstants(self.area, self.I1, self.I2, self.J, (0.0, 2.0 / k1), (0.0, 2.0 / k2))
