"""Evaluator of the model of a page to pull, by the formulas of its script: tensions to poses and compliance."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any


class GridModel:
    """Cubic Hermite interpolation of the twin's values and slopes on a grid of tensions; model: see `tension_grid`."""

    def __init__(self, model: Mapping[str, Any]) -> None:
        self.model = model
        self.cables, self.axes, self.rows, self.error = (model[k] for k in ("cables", "axes", "rows", "error"))

    def state(self, tensions: Mapping[str, float]) -> dict[str, Any]:
        """Position [m] and quaternion of plates, shortenings [m], compliance (`rows` by `cables`). Unnamed is slack."""
        for name in sorted(set(tensions) - set(self.cables)):
            raise ValueError(f"The model has no cable {name!r}; it has {', '.join(self.cables)}.")
        at = [float(tensions.get(name, 0.0)) for name in self.cables]
        for name, t, axis in zip(self.cables, at, self.axes):
            if not 0.0 <= t <= axis[-1]:
                raise ValueError(f"{name}: {t:g} N is outside the model, which holds from 0 to {axis[-1]:.6g} N.")
        plates, shortenings, columns = {}, {}, []
        for k, t in enumerate(at):  # a complex step: what becomes imaginary is the exact derivative by this tension
            rows = self.channels([*at[:k], t + 1e-30j, *at[k + 1 :]], self.model["nodes"])
            for i, name in enumerate(self.model["plates"]):
                *position, x, y, z, w = rows[6 * i : 6 * i + 7]
                size = (x * x + y * y + z * z + w * w) ** 0.5
                a, b, c, d = quaternion = [(part / size).real for part in (x, y, z, w)]
                turn = (d * x - a * w + b * z - c * y, d * y - b * w + c * x - a * z, d * z - c * w + a * y - b * x)
                rows[6 * i + 3 : 6 * i + 7] = [2 * part / size for part in turn]  # the quaternion gives way to it
                plates[name] = {"position": [part.real for part in position], "quaternion": quaternion}
            shortenings = dict(zip(self.model["shortenings"], (part.real for part in rows[6 * len(plates) :])))
            columns.append([part.imag / 1e-30 for part in rows])
        return {"plates": plates, "shortenings": shortenings, "compliance": [list(row) for row in zip(*columns)]}

    def channels(self, at: Sequence[complex], table: Any) -> list[complex]:
        """Values at tensions, complex ones for derivatives; table: at each node, the values and the slopes."""
        axis = self.axes[-len(at)]  # the first that is left; table: at each of its nodes, the values and the slopes
        i = bisect_right(axis, at[0].real, 1, len(axis) - 1)
        h, s = axis[i] - axis[i - 1], (at[0] - axis[i - 1]) / (axis[i] - axis[i - 1])
        a, b, c, d = (1 + 2 * s) * (1 - s) ** 2, h * s * (1 - s) ** 2, s * s * (3 - 2 * s), h * s * s * (s - 1)
        ends = [self.channels(at[1:], end) if len(at) > 1 else end for end in (*table[i - 1], *table[i])]
        return [a * p + b * q + c * r + d * t for p, q, r, t in zip(*ends)]
