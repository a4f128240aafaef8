"""Elastic constants by Young's modulus E and Poisson's ratio nu, as texts for the laws."""

from __future__ import annotations

# Paper A, Eqs. (2) and (3).
SHEAR_MODULUS = "E/(2*(1 + nu))"
LAME_MODULUS = "E*nu/((1 + nu)*(1 - 2*nu))"
BULK_MODULUS = "E/(3*(1 - 2*nu))"
