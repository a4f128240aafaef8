"""Energy, stress and tangent of a law at points, whatever its energy is written in.

S is the second Piola-Kirchhoff stress and D = dS/dE, in the components of `components.PAIRS`, the shears of E
doubled. psi_d is that of `CompiledLaw`; the volumetric part is added with p g(J), p being an unknown or kappa g.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials import stress_kernels
from softcal.materials.components import NO_DIRECTIONS
from softcal.materials.law import STRETCHES, CompiledLaw, stacked

NO_TANGENT: Floats = np.zeros((0, 6, 6))


class Points(NamedTuple):
    """Deformation at points.

    Attributes
    ----------
    F
        Deformation gradients (n, 3, 3) [-].
    I1, I2, J
        Invariants (n,) [-].
    directions
        Unit vectors of a law in I4, then of I6 (n, 1 or 2, 3); (1, …) where they are the same everywhere.
    """

    F: Floats
    I1: Floats
    I2: Floats
    J: Floats
    directions: Floats = NO_DIRECTIONS


class Stress(NamedTuple):
    """Stress at points. S (n, 6) [Pa], D (n, 6, 6) [Pa]; D is empty where no tangent was asked for."""

    S: Floats
    D: Floats


class Volumetric(NamedTuple):
    """First and second derivative of an energy by J alone (n,) [Pa]."""

    by_J: Floats
    by_JJ: Floats


def points(F: Floats, directions: Floats = NO_DIRECTIONS) -> Points:
    """The points with deformation gradients F (n, 3, 3)."""
    C = np.einsum("nki,nkj->nij", F, F)
    I1 = np.trace(C, axis1=1, axis2=2)
    I2 = 0.5 * (I1**2 - np.einsum("nij,nji->n", C, C))
    return Points(np.ascontiguousarray(F), I1, I2, np.linalg.det(F), directions)


class Deformation:
    """The variables of a law at points, computed once for its energy, its stress and their derivatives."""

    def __init__(self, law: CompiledLaw, at: Points) -> None:
        self.law, self.at = law, at
        n = len(at.J)
        self.axes: Floats = np.zeros((0, 3, 3))
        if law.variables == STRETCHES:
            self._squares, self.axes = np.empty((3, n)), np.empty((n, 3, 3))
            stress_kernels.principal(at.F, self._squares, self.axes)
            self.variables: tuple[Floats, ...] = tuple(0.5 * np.log(self._squares))
        else:
            ways = np.swapaxes(at.directions, 0, 1)[: len(law.variables) - 3, ..., None]
            self.variables = (at.I1, at.I2, at.J, *(np.square(at.F @ way).sum(axis=(1, 2)) for way in ways))

    def energy(self, values: tuple[float, ...]) -> Floats:
        """psi_d (n,) [J/m^3] at the constants' values."""
        return np.broadcast_to(self.law.energy(*self.variables, *values), self.at.J.shape).astype(np.float64)

    def energy_by_parameters(self, values: tuple[float, ...]) -> Floats:
        """d psi_d / d constant (n_constants, n), of each constant."""
        return stacked(self.law.energy_by_parameter(*self.variables, *values), len(self.at.J))

    def rows(self, values: tuple[float, ...]) -> Floats:
        """The derivatives of psi_d by the law's variables, as `CompiledLaw.rows`."""
        return stacked(self.law.rows(*self.variables, *values), len(self.at.J))

    def stress(self, values: tuple[float, ...], volume: Volumetric | None = None, *, tangent: bool = True) -> Stress:
        """The stress of psi_d, and of a volumetric part.

        Parameters
        ----------
        values
            Values of the law's constants, in their order [SI].
        volume
            Derivatives of the volumetric part by J; None: there is none.
        tangent
            Whether the tangent is wanted.
        """
        rows = self.rows(values)
        # The derivatives of the volumetric part by the law's variables: logarithms of stretches, or invariants.
        if volume is not None and len(self.axes):
            J = self.at.J
            rows[:3] += J * volume.by_J
            rows[3:] += J * volume.by_J + J**2 * volume.by_JJ
        elif volume is not None:
            rows[2] += volume.by_J
            rows[3 * len(self.variables) - 1] += volume.by_JJ
        return self._stress(rows, tangent)

    def stress_by_parameters(self, values: tuple[float, ...]) -> list[Floats]:
        """dS/d constant (n, 6) of psi_d, of each constant."""
        first = self.law.first_by_parameter(*self.variables, *values)
        return [self._stress(stacked(rows, len(self.at.J)), tangent=False).S for rows in first]

    def _stress(self, rows: Floats, tangent: bool) -> Stress:
        at, n = self.at, len(self.at.J)
        S, D = np.empty((n, 6)), np.empty((n if tangent else 0, 6, 6))
        if len(self.axes):
            stress_kernels.from_stretches(self._squares, self.axes, rows, tangent, S, D)
        else:
            stress_kernels.from_invariants(at.F, at.I1, at.J, rows, at.directions, tangent, S, D)
        return Stress(S, D)


def add_volumetric(stress: Stress, at: Points, volume: Volumetric) -> None:
    """Add the part of an energy by J alone to a stress.

    Parameters
    ----------
    stress
        The stress, changed.
    at
        Deformation at the points (n,).
    volume
        Derivatives of that part by J.
    """
    stress_kernels.add_volumetric(at.F, at.J, *volume, len(stress.D) > 0, stress.S, stress.D)


def volumetric(law: CompiledLaw, J: Floats, modulus: float) -> Volumetric:
    """The derivatives of modulus/2 g(J)^2 by J.

    Parameters
    ----------
    law
        The law.
    J
        Volume ratios (n,) [-].
    modulus
        The modulus [Pa].
    """
    g, dg, ddg = law.strain(J)
    return Volumetric(modulus * g * dg, modulus * (dg**2 + g * ddg))


def whole_stress(law: CompiledLaw, at: Points, values: tuple[float, ...], *, tangent: bool = True) -> Stress:
    """The stress of psi_d + kappa/2 g(J)^2.

    Parameters
    ----------
    law
        The law.
    at
        Deformation at the points (n,).
    values
        Values of its constants, in their order [SI].
    tangent
        Whether the tangent is wanted.
    """
    return Deformation(law, at).stress(values, volumetric(law, at.J, float(law.bulk(*values))), tangent=tangent)


def whole_energy(law: CompiledLaw, at: Points, values: tuple[float, ...]) -> Floats:
    """psi_d + kappa/2 g(J)^2 (n,) [J/m^3].

    Parameters
    ----------
    law
        The law.
    at
        Deformation at the points (n,).
    values
        Values of its constants, in their order [SI].
    """
    g = stacked(law.strain(at.J), len(at.J))[0]
    return Deformation(law, at).energy(values) + 0.5 * float(law.bulk(*values)) * g**2
