"""The prediction of a coupon test by a material with a history, row after row, with derivatives by its constants.

The pressure that keeps the free side without stress is not remembered: it is found at each row from the stress there,
as in an elastic coupon.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import doubled
from softcal.materials.inelastic import PointRates, Stressed
from softcal.materials.law import compile_law
from softcal.materials.stress_at import NO_TANGENT, Deformation
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import FreeConstants
from softcal.plugins.coupons.kind import LawResponse


class CouponResponse(Protocol):
    """A material in a test."""

    def stress(self, values: Floats) -> Floats:
        """Nominal stresses (n, k) [Pa] at the fitted constants; not finite where there is none."""
        ...

    def by_constants(self, values: Floats) -> Floats:
        """Their derivatives (n, k, size)."""
        ...


def response_of(constants: FreeConstants, coupon: Coupon) -> CouponResponse:
    """The response of a law in a coupon's test, with the history of its constants, if any."""
    return HistoryResponse(constants, coupon) if constants.parts else ElasticResponse(constants, coupon)


class ElasticResponse:
    """A law alone in a test."""

    def __init__(self, constants: FreeConstants, coupon: Coupon) -> None:
        self._constants, self._law = constants, LawResponse(constants.law, coupon.states)

    def stress(self, values: Floats) -> Floats:
        """See `CouponResponse`."""
        return self._law.stress(self._constants.ordered(values))

    def by_constants(self, values: Floats) -> Floats:
        """See `CouponResponse`."""
        return self._law.by_constants(self._constants.ordered(values))[..., self._constants.columns]


class HistoryResponse:
    """A law with a history in a test, which begins at rest."""

    def __init__(self, constants: FreeConstants, coupon: Coupon) -> None:
        self._constants, self._coupon, self._history = constants, coupon, constants.history
        n = len(coupon.strain)
        self._elapsed = [np.inf] * n if coupon.time is None else np.diff(coupon.time, prepend=0.0).tolist()
        F = coupon.states.points.F
        self._strain = doubled(0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(3)))

    @cached_property
    def _deformation(self) -> Deformation:
        return Deformation(compile_law(self._constants.law), self._coupon.states.points)

    def stress(self, values: Floats) -> Floats:
        """See `CouponResponse`."""
        with np.errstate(all="ignore"):
            return self._measured(self._passed(values, None))

    def by_constants(self, values: Floats) -> Floats:
        """See `CouponResponse`."""
        with np.errstate(all="ignore"):
            slopes: Floats = np.empty((len(values), *self._strain.shape))
            self._passed(values, slopes)
            return np.stack([self._measured(slopes[k]) for k in range(len(values))], axis=-1)

    def _measured(self, S: Floats) -> Floats:
        return np.einsum("knc,nc->nk", self._coupon.states.by_stress, S)

    def _passed(self, values: Floats, slopes: Floats | None) -> Floats:
        """S (n, 6) along the way; slopes (size, n, 6): where its derivatives go."""
        own = self._constants.of_history(values)
        if any(part.faults(own) for part in self._history.parts):
            return np.full_like(self._strain, np.nan)
        ordered, columns, size = self._constants.ordered(values), self._constants.columns, len(values)
        W, S = self._deformation.energy(ordered), self._deformation.stress(ordered, tangent=False).S
        by_W, by_S = np.zeros((size, len(W))), np.zeros((size, *S.shape))
        if slopes is not None:
            by_W[: len(columns)] = self._deformation.energy_by_parameters(ordered)[columns]
            by_S[: len(columns)] = np.array(self._deformation.stress_by_parameters(ordered))[columns]
        changes = {name: np.eye(size)[k] for k, name in enumerate(self._constants.names) if name in own}
        memory, moved = np.zeros((1, self._history.size)), np.zeros((size, self._history.size))
        still, out = np.zeros((size, 6)), np.empty_like(S)
        for i, elapsed in enumerate(self._elapsed):
            at = Stressed(self._strain[i : i + 1], W[i : i + 1], S[i : i + 1], NO_TANGENT)
            if slopes is not None:
                E, W_i, S_i = (np.repeat(one, size, axis=0) for one in at[:3])
                each = Stressed(E, W_i, S_i, NO_TANGENT)
                before = np.repeat(memory, size, axis=0), moved
                rates, moved = self._history.rates(
                    each, PointRates(still, by_W[:, i], by_S[:, i]), before, elapsed, (own, changes)
                )
                slopes[:, i] = rates.S
            found, memory = self._history.respond(at, memory, elapsed, own)
            out[i] = found.S[0]
        return out
