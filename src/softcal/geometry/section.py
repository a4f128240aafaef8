"""Cross-sections of rods: area, second moments, torsion constant, and shear coefficients as functions of nu.

Axes 1 and 2 are the section's principal ones, through its centroid; axis 3 is the rod's tangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from softcal.errors import Fault, MeshError


@dataclass(frozen=True)
class CrossSection:
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

    def __post_init__(self) -> None:
        given = {"area": self.area, "I1": self.I1, "I2": self.I2, "J": self.J}
        given |= {"shear1": sum(self.shear1), "shear2": sum(self.shear2)}
        faults = [_not_positive(name, value) for name, value in given.items() if not 0.0 < value < math.inf]
        if faults:
            raise MeshError(faults)

    @property
    def outer_diameter(self) -> float:
        """Outer diameter of the round bar or tube with this area and mean second moment [m]."""
        return math.sqrt(4.0 * (self.I1 + self.I2) / self.area + 2.0 * self.area / math.pi)


def circular(diameter: float, *, inner_diameter: float = 0.0) -> CrossSection:
    """A round bar or, with an inner diameter [m], a tube.

    References
    ----------
    Cowper (1966), The shear coefficient in Timoshenko's beam theory: k = 6 (1 + nu) / (7 + 6 nu) for a full circle;
    with m the ratio of the diameters, k = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2) for a
    tube.

    Raises
    ------
    MeshError
        Where the diameter is not positive, or the inner one not smaller.
    """
    if not 0.0 < diameter < math.inf:
        raise MeshError(_not_positive("diameter", diameter))
    if not 0.0 <= inner_diameter < diameter:
        raise MeshError(
            Fault(
                "a tube's inner diameter does not fit into it",
                got=f"{inner_diameter:.6g} m",
                allowed=f">= 0 and below {diameter:.6g} m",
            )
        )
    area = math.pi * (diameter**2 - inner_diameter**2) / 4.0
    second = math.pi * (diameter**4 - inner_diameter**4) / 64.0
    m2 = (inner_diameter / diameter) ** 2
    hollow = m2 / (1.0 + m2) ** 2
    # 2 (1 + nu) / k with 7 + 6 nu = 1 + 6 (1 + nu) and 20 + 12 nu = 8 + 12 (1 + nu)
    shear = ((1.0 + 8.0 * hollow) / 3.0, (6.0 + 12.0 * hollow) / 3.0)
    return CrossSection(area, second, second, 2.0 * second, shear, shear)


def rectangular(width: float, height: float) -> CrossSection:
    """A bar of `width` along axis 1 and `height` along axis 2 [m].

    References
    ----------
    Cowper (1966): k = 10 (1 + nu) / (12 + 11 nu). Torsion: Saint-Venant's series (Timoshenko and Goodier, 1951).

    Raises
    ------
    MeshError
        Where a side is not positive.
    """
    sides = {"width": width, "height": height}
    faults = [_not_positive(name, value) for name, value in sides.items() if not 0.0 < value < math.inf]
    if faults:
        raise MeshError(faults)
    area = width * height
    shear = (0.2, 2.2)
    return CrossSection(area, width * height**3 / 12.0, height * width**3 / 12.0, _torsion(width, height), shear, shear)


def given(
    area: float, I1: float, I2: float, J: float, *, shear_coefficients: tuple[float, float] = (5 / 6, 5 / 6)
) -> CrossSection:
    """A section with given constants; shear coefficients k along axes 1 and 2, independent of Poisson's ratio.

    Raises
    ------
    MeshError
        Where a value is not positive.
    """
    faults = [
        _not_positive(f"shear coefficient {i + 1}", k) for i, k in enumerate(shear_coefficients) if not 0.0 < k < 1e6
    ]
    if faults:
        raise MeshError(faults)
    k1, k2 = shear_coefficients
    return CrossSection(area, I1, I2, J, (0.0, 2.0 / k1), (0.0, 2.0 / k2))


def _torsion(width: float, height: float) -> float:
    long, short = max(width, height), min(width, height)
    odd = range(1, 40, 2)
    series = sum(math.tanh(n * math.pi * long / (2.0 * short)) / n**5 for n in odd)
    return long * short**3 * (1.0 / 3.0 - 64.0 / math.pi**5 * short / long * series)


def _not_positive(name: str, value: float) -> Fault:
    return Fault(f"a section's {name} must be positive", got=f"{value:.6g}", allowed="> 0")
