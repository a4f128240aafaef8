"""Evaluator of a reduced model, with NumPy alone: inputs to poses and derivatives, and poses to commands.

`python reduced_model.py front=3.0` prints a state.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


class ReducedModel:
    """Chebyshev polynomials in directions of the inputs; `error`: see README.txt.

    `inputs`: names, of actuators' efforts and of parameters; `channels`: names of what `inverse` brings to a value;
    `rows`: of the Jacobian.
    """

    def __init__(self, path: "str | Path" = "model.json") -> None:
        self.model: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
        entries = self.model["inputs"]
        self.inputs: list[str] = [entry["name"] for entry in entries]
        self.units: list[str] = [entry["unit"] for entry in entries]
        self.least, self.most, self.default = (
            np.array([entry[key] for entry in entries]) for key in ("least", "most", "default")
        )
        self.is_command = np.array([bool(entry["control"]) for entry in entries])
        self.plates, self.markers, self.coordinates = (self.model[key] for key in ("plates", "markers", "coordinates"))
        self.rows, self.error = self.model["rows"], self.model["error"]
        angles = [f"{name}.{key}" for name in self.plates for key in ("x", "y", "z", "pitch", "roll", "yaw")]
        points = [f"{name}.{axis}" for name in self.markers for axis in "xyz"]
        self.channels: list[str] = angles + self.coordinates + points
        number = np.arange(len(self.channels))
        self._turns = (number < len(angles)) & (number % 6 >= 3)
        self._half = 0.5 * (self.most - self.least)
        self._means = _Polynomials(self.model, self.model)
        self._squares = None if self.model["bands"] is None else _Polynomials(self.model, self.model["bands"])

    def state(self, commands: "dict[str, float]") -> "dict[str, Any]":
        """Poses of plates (position [m], quaternion x, y, z, w), places of markers [m], coordinates of actuators, and
        the Jacobian (`rows` by `inputs`); of a calibrated run, `bands`: channel -> half the width of its 95 % band. An
        input that is not named has its default, an actuator no effort.
        """
        n, at = len(self.plates), self._at(commands)
        values, rates = self._outputs(at, None, n)
        points = values[7 * n + len(self.coordinates) :].reshape(-1, 3)
        poses = values[: 7 * n].reshape(n, 7)
        state = {
            "plates": {
                name: {"position": pose[:3].tolist(), "quaternion": pose[3:].tolist()}
                for name, pose in zip(self.plates, poses)
            },
            "markers": dict(zip(self.markers, points.tolist())),
            "coordinates": dict(zip(self.coordinates, values[7 * n : 7 * n + len(self.coordinates)].tolist())),
            "jacobian": rates.T.tolist(),
        }
        if self._squares is not None:
            state["bands"] = dict(zip(self.channels, np.sqrt(np.maximum(self._squares(at)[0], 0.0)).tolist()))
        return state

    def read(self, commands: "dict[str, float]", channels: "list[str]") -> "tuple[np.ndarray, np.ndarray]":
        """Values [SI] of channels (n,), and their derivatives by the inputs (n, n_inputs); angles as in softcal."""
        read = self._read([self.number(name, self.channels, "channel") for name in channels])
        values, rates = self._differences(self._at(commands), read, np.zeros(len(channels)), np.ones(len(channels)))
        return values, rates.T

    def inverse(
        self,
        targets: "dict[str, float]",
        start: "dict[str, float] | None" = None,
        weights: "dict[str, float] | None" = None,
        inputs: "dict[str, float] | None" = None,
    ) -> "dict[str, Any]":
        """The commands within the model's ranges that bring channels nearest to values: least squares.

        Parameters
        ----------
        targets
            Channel -> wanted value [SI].
        start
            Commands to start from: of several solutions, one near them results; by default no effort.
        weights
            Channel -> weight of its difference; by default 1, for angles 0.1 m/rad.
        inputs
            Values of inputs other than commands, where they differ from the robot's.

        Returns
        -------
        dict
            `commands`; `misses`, channel less target; and `limits`, the commands at an end of their range.
        """
        if not targets:
            raise ValueError("There is no target.")
        wanted = _finite(targets)
        read = self._read([self.number(name, self.channels, "channel") for name in targets])
        weight = np.where(read[-1], 0.1, 1.0)
        for name, value in (weights or {}).items():
            weight[self.number(name, list(targets), "target")] = value
        if not np.all((weight > 0.0) & np.isfinite(weight)):
            raise ValueError("A weight is a positive number.")
        at, free = self._at({**(inputs or {}), **(start or {})}), np.flatnonzero(self.is_command)
        scale, least, most = self._half[free], self.least[free], self.most[free]
        r, by = self._differences(at, read, wanted, weight)
        damping, growth = 0.0, 10.0
        for _ in range(200):  # as a rule five; some hundred along a curved valley
            A = by[free].T * scale
            step = _step(A, r, (least - at[free]) / scale, (most - at[free]) / scale, damping)
            ahead = at.copy()
            ahead[free] = np.minimum(np.maximum(at[free] + scale * step, least), most)
            r_ahead, by_ahead = self._differences(ahead, read, wanted, weight)
            is_end = np.abs(step).max(initial=0.0) <= 1e-6  # the error after it is of the order of its square
            before, after = float(r @ r), float(r_ahead @ r_ahead)
            predicted, gain = before - float(np.sum((r + A @ step) ** 2)), before - after
            if gain >= 0.0:
                at, r, by, growth = ahead, r_ahead, by_ahead, 2.0
                share = 2.0 * min(gain / predicted, 1.0) - 1.0 if predicted > 0.0 else 1.0
                damping = damping * max(0.1, 1.0 - share**3) if damping > 1e-9 else 0.0  # of Nielsen
            elif damping < 1e6:
                damping, growth = max(growth * damping, 1e-6), 2.0 * growth
            if is_end:
                break
        ends = (at <= self.least) | (at >= self.most)
        return {
            "commands": {self.inputs[k]: float(at[k]) for k in free},
            "misses": dict(zip(targets, (r / weight).tolist())),
            "limits": [self.inputs[k] for k in free if ends[k]],
        }

    def _at(self, commands: "dict[str, float]") -> np.ndarray:
        at = self.default.copy()
        for name, value in commands.items():
            k = self.number(name, self.inputs, "input")
            if not self.least[k] <= value <= self.most[k]:
                raise ValueError(
                    f"{name}: {value:g} {self.units[k]} is outside the model, which holds from "
                    f"{self.least[k]:.6g} to {self.most[k]:.6g} {self.units[k]}."
                )
            at[k] = value
        return at

    def number(self, name: str, names: "list[str]", what: str) -> int:
        """The number of a name.

        Parameters
        ----------
        name
            The name.
        names
            Those of inputs or channels.
        what
            What they are, for the message.

        Raises
        ------
        ValueError
            Where it is none of them.
        """
        if name not in names:
            raise ValueError(f"The model has no {what} {name!r}; it has {', '.join(names)}.")
        return names.index(name)

    def _outputs(self, at: np.ndarray, columns: "list[int] | None", n: int) -> "tuple[np.ndarray, np.ndarray]":
        """Outputs (n_outputs,), by default all, the first n of them poses with unit quaternions, and their rates
        (n_inputs, n_rows), of quaternions as small rotations about the world's axes.
        """
        found = self._means(at, columns)
        values, rates = found[0], found[1:]
        pose, by = values[: 7 * n].reshape(n, 7), rates[:, : 7 * n].reshape(len(at), n, 7)
        size = np.sqrt((pose[:, 3:] ** 2).sum(axis=1, keepdims=True))
        pose[:, 3:] /= size
        a, b, c, d = pose[:, 3:].T
        x, y, z, w = np.moveaxis(by[..., 3:], -1, 0)
        turns = (d * x - a * w + b * z - c * y, d * y - b * w + c * x - a * z, d * z - c * w + a * y - b * x)
        moved = np.concatenate([by[..., :3], 2.0 / size * np.stack(turns, axis=-1)], axis=-1)
        return values, np.concatenate([moved.reshape(len(rates), 6 * n), rates[:, 7 * n :]], axis=1)

    def _read(self, numbers: "list[int]") -> "tuple[list[int], int, list[int], np.ndarray]":
        """The outputs that channels need, of plates and others, the number of these plates, the columns of the channels
        among those of these outputs, and whether they are angles.
        """
        n = 6 * len(self.plates)
        plates = sorted({k // 6 for k in numbers if k < n})
        outputs = [7 * k + i for k in plates for i in range(7)] + [k + len(self.plates) for k in numbers if k >= n]
        others = iter(range(6 * len(plates), 6 * len(plates) + len(numbers)))
        columns = [6 * plates.index(k // 6) + k % 6 if k < n else next(others) for k in numbers]
        return outputs, len(plates), columns, self._turns[numbers]

    def _differences(
        self, at: np.ndarray, read: "tuple[Any, ...]", wanted: np.ndarray, weight: np.ndarray
    ) -> "tuple[np.ndarray, np.ndarray]":
        """Weighted differences (n,) of channels from wanted values, and their rates (n_inputs, n)."""
        outputs, n, columns, turns = read
        values, rates = self._outputs(at, outputs, n)
        poses = values[: 7 * n].reshape(n, 7)
        channels = np.empty(6 * n + len(values) - 7 * n)
        channels[6 * n :] = values[7 * n :]
        by = rates[:, : 6 * n].reshape(len(at), n, 6)
        for k, (px, py, pz, x, y, z, w) in enumerate(poses.tolist()):
            # R = Ry(pitch) Rx(roll) Rz(yaw), by its quaternion.
            R02, R22, R12 = 2 * (x * z + w * y), 1 - 2 * (x * x + y * y), 2 * (y * z - w * x)
            R10, R11 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z)
            across = max(R02 * R02 + R22 * R22, 1e-12)
            channels[6 * k : 6 * k + 6] = (
                px, py, pz, np.arctan2(R02, R22), np.arcsin(max(-1.0, min(1.0, -R12))), np.arctan2(R10, R11)
            )  # fmt: skip
            wx, wy, wz = by[:, k, 3:].T.copy()
            cosine, sine = R22 / across**0.5, R02 / across**0.5  # of the pitch
            yaw = (wx * sine + wz * cosine) / across**0.5
            by[:, k, 3], by[:, k, 4], by[:, k, 5] = wy - yaw * R12, wx * cosine - wz * sine, yaw
        r = channels[columns] - wanted
        r[turns] = (r[turns] + np.pi) % (2 * np.pi) - np.pi
        return weight * r, weight * rates[:, columns]


class _Polynomials:
    """Chebyshev polynomials in the directions of a model's inputs."""

    def __init__(self, model: "dict[str, Any]", own: "dict[str, Any]") -> None:
        least, most = (np.array([entry[key] for entry in model["inputs"]]) for key in ("least", "most"))
        self._half, self._middle = 0.5 * (most - least), 0.5 * (most + least)
        powers = np.array(own["powers"], dtype=np.int64).T
        self._degree, self._places = max(int(powers.max()), 1), (powers, np.arange(len(powers))[:, None])
        self._directions, self._coefficients = np.array(model["directions"]), np.array(own["coefficients"])

    def __call__(self, at: np.ndarray, columns: "list[int] | None" = None) -> np.ndarray:
        """Values at inputs (n_inputs,), and below them their derivatives by each: (1 + n_inputs, n)."""
        s = self._directions @ ((at - self._middle) / self._half)
        T, U = np.empty((2, 1 + self._degree, len(s)))  # T_k and U_(k-1), since T_k' = k U_(k-1)
        T[0], T[1], U[0], U[1] = 1.0, s, 0.0, 1.0
        for k in range(2, self._degree + 1):
            T[k], U[k] = 2.0 * s * T[k - 1] - T[k - 2], 2.0 * s * U[k - 1] - U[k - 2]
        factors, slopes = T[self._places], (U * np.arange(1.0 + self._degree)[:, None])[self._places]
        basis = np.empty((1 + len(s), factors.shape[1]))
        basis[0] = before = np.ones(factors.shape[1])
        for k in range(len(s)):
            basis[1 + k] = before * slopes[k]
            before = before * factors[k]
        basis[0], after = before, np.ones(factors.shape[1])
        for k in range(len(s) - 1, -1, -1):
            basis[1 + k] *= after
            after = after * factors[k]
        found = basis @ (self._coefficients if columns is None else self._coefficients[:, columns])
        found[1:] = self._directions.T @ found[1:] / self._half[:, None]
        return found


class KalmanFilter:
    """Values of the model's parameters from measured channels, one measurement after the other: an iterated extended
    Kalman filter. `mean` and `covariance`, of parameters in the order of `names`.

    values, deviations: before the first measurement, by name of the parameter; drifts: standard deviations by which
    they may change from one measurement to the next, by default 0.
    """

    def __init__(
        self,
        model: ReducedModel,
        values: "dict[str, float]",
        deviations: "dict[str, float]",
        drifts: "dict[str, float] | None" = None,
    ) -> None:
        self.model, self.names = model, list(values)
        self._columns = [model.number(name, model.inputs, "input") for name in self.names]
        self.mean = np.array([values[name] for name in self.names], dtype=float)
        if missing := [name for name in self.names if name not in deviations]:
            raise ValueError(f"The deviation of {', '.join(missing)} is missing.")
        self.covariance = np.diag([float(deviations[name]) ** 2 for name in self.names])
        self._drift = np.diag([float((drifts or {}).get(name, 0.0)) ** 2 for name in self.names])

    def update(
        self, commands: "dict[str, float]", measured: "dict[str, float]", noise: "dict[str, float]"
    ) -> "tuple[float, int]":
        """Take a measurement; a value beyond the model's range is put at its end.

        Parameters
        ----------
        commands
            Those at which it was measured.
        measured
            Channel -> value [SI].
        noise
            Channel -> standard deviation of its noise [SI].

        Returns
        -------
        tuple
            The squared innovation over its covariance, of a consistent filter chi squared, and its degrees of freedom.
        """
        least, most = self.model.least[self._columns], self.model.most[self._columns]
        if twice := [name for name in self.names if name in commands]:
            raise ValueError(f"{', '.join(twice)}: this is estimated, and is no command.")
        if missing := [name for name in measured if name not in noise]:
            raise ValueError(f"The noise of {', '.join(missing)} is missing.")
        R = np.diag([float(noise[name]) ** 2 for name in measured])
        P, y = self.covariance + self._drift, _finite(measured)
        before = now = np.minimum(np.maximum(self.mean, least), most)
        squares: list[float] = []
        while True:  # linearised anew at the estimate: the first one may be far off
            values, rates = self.model.read({**commands, **dict(zip(self.names, now.tolist()))}, list(measured))
            H = rates[:, self._columns]
            r = y - values
            S = H @ P @ H.T + R
            squares.append(float(r @ np.linalg.solve(S, r)))
            gain = np.linalg.solve(S, H @ P).T
            ahead = np.minimum(np.maximum(before + gain @ (r - H @ (before - now)), least), most)
            is_end = np.all(np.abs(ahead - now) <= 1e-3 * np.sqrt(np.diag(P)))
            now = ahead
            if is_end or len(squares) == 10:
                break
        kept = np.eye(len(P)) - gain @ H
        self.mean, self.covariance = now, kept @ P @ kept.T + gain @ R @ gain.T
        return squares[0], len(y)


def _finite(values: "dict[str, float]") -> np.ndarray:
    """The values; a ValueError where one is no finite number."""
    for name, value in values.items():
        if not np.isfinite(value):
            raise ValueError(f"{name}: {value} is no finite number.")
    return np.array(list(values.values()), dtype=float)


def _step(A: np.ndarray, r: np.ndarray, least: np.ndarray, most: np.ndarray, damping: float) -> np.ndarray:
    """The shortest step d within a box that makes A d + r small, by an active set: components that leave the box stay
    at its side, the others are solved again; a component leaves its side where that lowers the sum of squares.
    """
    d, slope = np.zeros(A.shape[1]), A.T @ r
    moves = ~((least >= 0.0) & (slope > 0.0) | (most <= 0.0) & (slope < 0.0))
    while moves.any():
        U, s, V = np.linalg.svd(A[:, moves], full_matrices=False)
        kept = s / (s * s + (damping + 1e-18) * s[0] * s[0]) * (s > 1e-9 * s[0])
        d[moves] = -V.T @ (kept * (U.T @ (r + A[:, ~moves] @ d[~moves])))
        out = moves & ((d < least) | (d > most))
        if not out.any():
            break
        d[out] = np.minimum(np.maximum(d[out], least[out]), most[out])
        moves &= ~out
    return d


if __name__ == "__main__":
    pulls = {name: float(value) for name, _, value in (text.partition("=") for text in sys.argv[1:])}
    sys.stdout.write(json.dumps(ReducedModel(Path(__file__).with_name("model.json")).state(pulls), indent=1) + "\n")
