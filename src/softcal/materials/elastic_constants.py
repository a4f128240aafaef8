"""Elastic constants by Young's modulus E and Poisson's ratio nu, as texts for the laws."""

from __future__ import annotations

# Paper A, Eq. (2); its Eq. (3), Lamé's lambda, is kappa - 2 mu / 3.
SHEAR_MODULUS = "E/(2*(1 + nu))"
BULK_MODULUS = "E/(3*(1 - 2*nu))"
