"""From tensions of cables to poses of plates, shortenings of cables and their compliance; standard library alone.

In a program:      state = ReducedModel("model.json").state({"front": 3.0})
From the command:  python reduced_model.py front=3.0
"""

from __future__ import annotations

import itertools
import json
import math
import pathlib
import sys
from bisect import bisect_right
from typing import Any


class ReducedModel:
    """Tensor-product cubic Hermite pieces through the twin's values and exact slopes.

    cables: the columns of the compliance; rows: its rows; error: measured against the twin, see README.txt.
    """

    def __init__(self, path: str | pathlib.Path = "model.json") -> None:
        model: dict[str, Any] = json.loads(pathlib.Path(path).read_text(encoding="utf-8"))
        self.cables, self.axes, self.plates = model["cables"], model["axes"], model["plates"]
        self.shortenings, self.rows, self.error = model["shortenings"], model["rows"], model["error"]
        self._nodes = model["nodes"]

    def state(self, tensions: dict[str, float]) -> dict[str, Any]:
        """The robot under tensions [N] by cable; a cable that is not named is slack.

        plates: position [m] and quaternion (x, y, z, w) of the rotation from rest; shortenings [m];
        compliance: d row / d tension; rows .x .y .z in m/N, .rx .ry .rz (about the world's axes) in rad/N.
        """
        values, slopes = self._interpolated([self._inside(name, tensions) for name in self.cables])
        state: dict[str, Any] = {"plates": {}, "shortenings": {}, "compliance": []}
        for k, name in enumerate(self.plates):
            at, (x, y, z, w) = values[7 * k : 7 * k + 3], values[7 * k + 3 : 7 * k + 7]
            n = math.sqrt(x * x + y * y + z * z + w * w)
            state["plates"][name] = {"position": at, "quaternion": [x / n, y / n, z / n, w / n]}
            state["compliance"] += [[slope[7 * k + i] for slope in slopes] for i in range(3)]
            turns = [_turning((x, y, z, w), slope[7 * k + 3 : 7 * k + 7]) for slope in slopes]
            state["compliance"] += [[turn[i] for turn in turns] for i in range(3)]
        for k, name in enumerate(self.shortenings, start=7 * len(self.plates)):
            state["shortenings"][name] = values[k]
            state["compliance"].append([slope[k] for slope in slopes])
        return state

    def _inside(self, name: str, tensions: dict[str, float]) -> float:
        strange = set(tensions) - set(self.cables)
        if strange:
            raise ValueError(f"The model has no cable {min(strange)!r}; it has {', '.join(self.cables)}.")
        tension, most = float(tensions.get(name, 0.0)), self.axes[self.cables.index(name)][-1]
        if not 0.0 <= tension <= most:
            raise ValueError(f"{name}: {tension:g} N is outside the model, which holds from 0 to {most:.6g} N.")
        return tension

    def _interpolated(self, tensions: list[float]) -> tuple[list[float], list[list[float]]]:
        pieces = [_hermite(axis, t) for axis, t in zip(self.axes, tensions)]
        n = len(self._nodes[0][0])
        values, slopes = [0.0] * n, [[0.0] * n for _ in tensions]
        for corner in itertools.product(*pieces):
            node = derivative = 0
            for k, (i, is_slope, _, _) in enumerate(corner):
                node = node * len(self.axes[k]) + i
                derivative += is_slope << k
            row, weights = self._nodes[node][derivative], [piece[2] for piece in corner]
            for sums, changed in [(values, None), *zip(slopes, range(len(corner)))]:
                weight = math.prod(corner[k][3] if k == changed else w for k, w in enumerate(weights))
                for j, value in enumerate(row):
                    sums[j] += weight * value
        return values, slopes


def _hermite(axis: list[float], t: float) -> list[tuple[int, int, float, float]]:
    """Node, whether its slope is meant, weight and the weight's derivative, of the four terms at t."""
    i = min(bisect_right(axis, t), len(axis) - 1) - 1
    h = axis[i + 1] - axis[i]
    s = (t - axis[i]) / h
    return [
        (i, 0, (1 + 2 * s) * (1 - s) ** 2, 6 * s * (s - 1) / h),
        (i, 1, h * s * (1 - s) ** 2, (1 - s) * (1 - 3 * s)),
        (i + 1, 0, s * s * (3 - 2 * s), 6 * s * (1 - s) / h),
        (i + 1, 1, h * s * s * (s - 1), s * (3 * s - 2)),
    ]


def _turning(q: tuple[float, ...], rate: list[float]) -> list[float]:
    """The rotation per newton about the world's axes, of a quaternion and its rate."""
    (x, y, z, w), (dx, dy, dz, dw) = q, rate
    half = (w * dx - dw * x + y * dz - z * dy, w * dy - dw * y + z * dx - x * dz, w * dz - dw * z + x * dy - y * dx)
    return [2 * part / (x * x + y * y + z * z + w * w) for part in half]


if __name__ == "__main__":
    pulls = {name: float(value) for name, _, value in (text.partition("=") for text in sys.argv[1:])}
    beside = pathlib.Path(__file__).with_name("model.json")
    sys.stdout.write(json.dumps(ReducedModel(beside).state(pulls), indent=1) + "\n")
