"""Fitted materials as `softcal coupon` stores them, and read again to predict further tests without a fit."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from softcal.errors import Fault, InputError, ParameterError, StorageError, unknown
from softcal.materials.catalogue import LAWS
from softcal.plugins.coupons.fitted_material import FittedMaterial, PredictedCoupon
from softcal.plugins.coupons.free_constants import free_constants
from softcal.quantities import QUANTITIES

RECORD = "coupon.json"
FORMAT = 2
NU = QUANTITIES["Poisson's ratio"]
ROUNDING = 1e-9  # of the largest variance
_WRITES = "a folder that softcal coupon --out wrote"


def material_json(material: FittedMaterial) -> dict[str, Any]:
    """The data for predictions, all in SI."""
    covariance = material.covariance
    return {
        "history": list(material.constants.parts),
        "names": list(material.constants.names),
        "values": material.values.tolist(),
        "covariance": None if covariance is None else covariance.tolist(),
        "spread": material.spread.tolist(),
        "dof": material.dof if math.isfinite(material.dof) else None,
        "noise": dict(material.noise),
    }


def prediction_json(one: PredictedCoupon) -> dict[str, Any]:
    """A predicted test, without its rows."""
    found: dict[str, Any] = {"specimen": one.coupon.name, "test": one.coupon.test, "rows": len(one.coupon.strain)}
    if one.is_measured:
        numbers = {"error": one.error, "nmad": one.nmad, "factor": one.factor, "nmad_by_factor": one.nmad_by_factor}
        numbers["inside_band"] = one.inside
        found |= {name: number if math.isfinite(number) else None for name, number in numbers.items()}
    return found


def read_material(folder: Path, law: str | None = None) -> FittedMaterial:
    """The material of a folder of results; law: which of its laws, the recommended or the only one without.

    Raises
    ------
    StorageError
        Where the folder has no record, or it cannot be read.
    InputError
        Where the record is not one, or of another format.
    ParameterError
        Where the record has no such law, or several and none recommended.
    """
    path = folder / RECORD
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise StorageError(Fault("the record of a fit cannot be read", str(path), reason, _WRITES)) from error
    except (ValueError, RecursionError) as error:
        raise InputError(Fault("this is no record of softcal coupon", str(path), "no JSON", _WRITES)) from error
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        got = f"format {record.get('format')!r}"[:60] if isinstance(record, dict) else "no mapping"
        raise InputError(Fault("this is no record of softcal coupon that can predict", str(path), got, f"{FORMAT}"))
    try:
        laws, recommended = dict(record["laws"]), record["recommended"]
        name = law or recommended or (next(iter(laws)) if len(laws) == 1 else None)
        if name is None or name not in laws:
            what = "the record has no such law" if law else "the record recommends no law"
            raise ParameterError(unknown(what, "--law", law or "", laws, got=law or ""))
        if name not in LAWS:
            raise ParameterError(LAWS.unknown(name, f"{path}: laws"))
        stored = laws[name]["material"]
        poissons_ratio = float(record["poissons_ratio"])
        constants = free_constants(LAWS[name], poissons_ratio, [str(part) for part in stored["history"]])
        given = dict(zip(stored["names"], stored["values"], strict=True))
        n = len(constants.names)
        values = np.array([float(given[name]) for name in constants.names])
        covariance = None if stored["covariance"] is None else np.array(stored["covariance"], dtype=float).reshape(n, n)
        spread = np.array(stored["spread"], dtype=float).reshape(n)
        for one, value in zip(constants.fitted, values.tolist(), strict=True):
            if not one.quantity.allows(value):
                raise ValueError(f"{one.name} {value:.4g} (allowed {one.quantity.allowed})")
        if not NU.allows(poissons_ratio):
            raise ValueError(f"poissons_ratio {poissons_ratio:.4g} (allowed {NU.allowed})")
        dof = math.inf if stored["dof"] is None else float(stored["dof"])
        noise = {str(test): float(size) for test, size in stored["noise"].items()}
        variances = np.zeros(1) if covariance is None else np.linalg.eigvalsh(0.5 * (covariance + covariance.T))
        sizes = np.array([*spread, *noise.values(), *variances, dof])
        if np.isnan(sizes).any() or not (sizes[:-1] < np.inf).all() or not (spread >= 0.0).all() or not dof > 0.0:
            raise ValueError("a variance, noise or number of degrees of freedom that is none")
        if variances[0] < -ROUNDING * variances[-1] or min(noise.values(), default=0.0) < 0.0:
            raise ValueError("a variance or noise below zero")
        return FittedMaterial(constants, values, covariance, spread, dof, noise)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(Fault("this record of softcal coupon is damaged", str(path), str(error)[:100])) from error
