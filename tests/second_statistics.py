"""The statistics of a calibration a second time, from the files of its run: none of softcal's own is imported.

As in docs/uncertainty.md: the minimum of the loss as a linear estimator (a sandwich covariance), white noise or a
process along each record by restricted maximum likelihood, tests as random effects, intervals within the bounds.
Derivatives are those of the best trial, which the run keeps; the twin's own tests compare them with differences.

What is not found again, and why:

- The degrees of freedom of an interval are the run's; they come from the curvature of a likelihood. A p-value is
  bounded: from below by known variances, from above by three degrees of freedom, the fewest that a process has.
- The change of the predictions on a finer mesh: it takes minutes. `Estimator` is without it.
"""

from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize, stats

import softcal

# --- The run and its linear model -------------------------------------------------------------------------------------


def columns(path: Path) -> dict[str, np.ndarray]:
    with path.open() as file:
        head, *rows = csv.reader(file)
    values = [np.array([float(x) if x else np.nan for x in column]) for column in zip(*rows, strict=True)]
    return {name.split(" [")[0]: column for name, column in zip(head, values, strict=True)}


@dataclass(frozen=True)
class Block:
    """A channel of an experiment, or a prior: residuals r (n,), derivatives J (n, k) in the unit box of the search and
    S by one standard deviation of each uncertain parameter, weights w, and the direction in which a root is straight.
    """

    experiment: str
    channel: str
    group: str
    measured: np.ndarray
    r: np.ndarray
    J: np.ndarray
    S: np.ndarray
    w: np.ndarray
    unit: np.ndarray
    time: np.ndarray
    drifts: bool = False
    straight: np.ndarray | None = None
    command: np.ndarray | None = None

    @property
    def pull(self) -> np.ndarray:
        return self.w[:, None] * self.J

    def bent(self, change: np.ndarray) -> np.ndarray:
        if self.straight is None:
            return change
        root = np.sqrt(self.w)
        return change - np.outer(self.straight / root, self.straight @ (root[:, None] * change))


class Fit:
    """One calibration of a run."""

    def __init__(self, run: Path, label: str, project: softcal.Project) -> None:
        self.folder, self.label, self.project = run / "calibrations" / label, label, project
        self.result = json.loads((self.folder / "result.json").read_text())
        self.p: dict[str, Any] = self.result["parameters"]
        self.names, self.loss = list(self.p), self.result["loss_name"]
        self.experiments, self.held_out = list(self.result["experiments"]), list(self.result.get("held_out", {}))
        self.trials = list(csv.DictReader((self.folder / "trials.csv").read_text().splitlines()))
        self.best = min((t for t in self.trials if t["loss"]), key=lambda t: float(t["loss"]))
        with np.load(self.folder / "arrays" / f"{self.best['number']}.npz") as raw:
            self.arrays = {tuple(key.split("\x1f")): raw[str(i)] for i, key in enumerate(raw["keys"])}
        self.data = {e: columns(self.folder / f"response-{e}.csv") for e in (*self.experiments, *self.held_out)}

    def serves(self, name: str, experiment: str) -> bool:
        own = re.search(r"\[(.*)\]", name)
        return own is None or own[1] in (experiment, self.project.experiments[experiment].set_up)

    def place(self, name: str, value: float) -> float:
        """Of a value in the unit box."""
        p = self.p[name]
        if p["scale"] == "log":
            return math.log(value / p["lower"]) / math.log(p["upper"] / p["lower"])
        return (value - p["lower"]) / (p["upper"] - p["lower"])

    def value(self, name: str, z: float) -> float:
        p = self.p[name]
        if p["scale"] == "log":
            return p["lower"] * (p["upper"] / p["lower"]) ** z
        return p["lower"] + z * (p["upper"] - p["lower"])

    @cached_property
    def z(self) -> np.ndarray:
        return np.array([self.place(name, self.p[name]["value"]) for name in self.names])

    @cached_property
    def slopes(self) -> np.ndarray:
        """d value / dz, by differences."""
        step = 1e-6
        pairs = zip(self.names, self.z, strict=True)
        return np.array([(self.value(n, z + step) - self.value(n, z - step)) / (2 * step) for n, z in pairs])

    @cached_property
    def uncertain(self) -> list[tuple[str, str, float, str]]:
        """(source, parameter, standard deviation, the one experiment that it errs in, or "")."""
        found = [(u.source, u.targets[0], u.sd, u.experiment) for u in self.project.uncertain]
        return [one for one in found if one[3] in ("", *self.experiments)]

    @cached_property
    def blocks(self) -> list[Block]:
        found = [self._block(e, c) for e in self.experiments for c in self.project.experiments[e].compared]
        if self.loss == "likelihood" and self.project.space is not None:
            for prior in self.project.space.parameters:
                if prior.label in self.names and prior.prior_sd is not None:
                    J = np.where(np.array(self.names) == prior.label, self.slopes, 0.0)[None, :]
                    r, sd = np.array([self.p[prior.label]["value"] - prior.prior_mean]), np.array([prior.prior_sd])
                    S = np.zeros((1, len(self.uncertain)))
                    found.append(Block("", prior.label, "prior", r * 0, r, J, S, sd**-2.0, sd, r * 0))
        return found

    def _block(self, e: str, c: str) -> Block:
        experiment, data = self.project.experiments[e], self.data[e]
        measured, predicted = data[f"measured.{c}"], data[f"simulated.{c}"]
        seen = experiment.seen(c) & np.isfinite(predicted)
        measured, r = measured[seen], (predicted - measured)[seen]
        J = np.zeros((len(seen), len(self.names)))
        for k, name in enumerate(self.names):
            if self.serves(name, e):
                targets = self.p[name].get("of") or [name.split("[")[0]]
                J[:, k] = self.slopes[k] * np.sum([self.arrays["derivative", e, c, t] for t in targets], axis=0)
        S = np.zeros((len(seen), len(self.uncertain)))
        for k, (_, target, sd, own) in enumerate(self.uncertain):
            if own in ("", e):
                S[:, k] = sd * self.arrays["derivative", e, c, target]
        kind, reading, size = c.rpartition(".")[2], experiment.twin_channel(c), math.sqrt(np.mean(r**2))
        time = data.get("measured.time", np.arange(len(seen), dtype=float))[seen]
        time = (time - time.min()) / max(np.ptp(time), 1e-300)
        stated = {*experiment.settings, *(n.split("[")[0] for n in self.names), *(u[1] for u in self.uncertain)}
        drifts = kind in ("tension", "pitch") and f"{reading.carrier}.{kind}_drift" not in stated
        unit, straight, group, w = np.ones(len(r)), None, kind, np.ones(len(r))
        if self.loss == "papers":
            w = w * {"tension": 0.3, "pitch": 1.0}[kind] / (2 * len(r) * size)
            straight, group = r / np.linalg.norm(r), f"{c} in {e}"
        elif self.loss == "likelihood":
            unit = experiment.sigma(c)[seen]
            w = unit**-2.0
        driven = experiment.drives
        command = data[f"measured.{driven[0]}"][seen] if len(driven) == 1 else None
        return Block(e, c, group, measured, r, J[seen], S[seen], w, unit, time, drifts, straight, command)


def inverse_hessian(blocks: list[Block]) -> np.ndarray:
    """Of half the loss. A root mean square is a cone: straight along the residual that no step removes."""
    rows = [np.sqrt(b.w)[:, None] * b.J for b in blocks]
    hessian = np.sum([row.T @ row for row in rows], axis=0)
    step = np.linalg.pinv(hessian) @ np.sum([b.pull.T @ b.r for b in blocks], axis=0)
    for b, row in zip(blocks, rows, strict=True):
        if b.straight is not None:
            left = b.r - b.J @ step
            along = row.T @ (left / np.linalg.norm(left))
            hessian = hessian - np.outer(along, along)
    return np.linalg.inv(hessian)


def least_squares(blocks: list[Block], over: np.ndarray) -> np.ndarray:
    """The inverse of the normal equations in some parameters, zero in the others."""
    out = np.zeros((blocks[0].J.shape[1],) * 2)
    normal = np.sum([b.J[:, over].T @ b.pull[:, over] for b in blocks], axis=0)
    out[np.ix_(over, over)] = np.linalg.pinv(normal, rcond=1e-12)
    return out


def refitted(blocks: list[Block], inverse: np.ndarray) -> list[Block]:
    step = -inverse @ np.sum([b.pull.T @ b.r for b in blocks], axis=0)
    return [replace(b, r=b.r + b.J @ step) for b in blocks]


# --- Noise, and processes along a record ------------------------------------------------------------------------------


def white_noise(blocks: list[Block], inverse: np.ndarray) -> dict[str, tuple[float, float]]:
    """Group -> variance over the stated one, and its degrees of freedom: E |r_g|^2 = sum_h s_h^2 |M_gh|^2."""
    groups = [g for g in dict.fromkeys(b.group for b in blocks) if g != "prior"]
    J = {
        g: np.concatenate([b.J / b.unit[:, None] for b in blocks if b.group == g])
        for g in (*groups, "prior")
        if g in {b.group for b in blocks}
    }
    P = {g: np.concatenate([b.unit[:, None] * b.pull for b in blocks if b.group == g]) for g in J}
    squares = np.array([sum(np.sum((b.r / b.unit) ** 2) for b in blocks if b.group == g) for g in groups])
    used = np.array([np.trace(inverse @ P[g].T @ J[g]) for g in groups])
    count = np.array([len(J[g]) for g in groups])
    moved = np.array([[np.sum((J[g] @ inverse @ P[h].T) ** 2) for h in groups] for g in groups])
    moved += np.diag(count - 2 * used)
    if "prior" in J:
        squares = squares - np.array([np.sum((J[g] @ inverse @ P["prior"].T) ** 2) for g in groups])
    found = np.maximum(squares, 1e-300)
    for _ in range(1000):
        found = found * np.maximum(squares, 1e-300) / (moved @ found)
    stated = any(np.any(b.unit != 1.0) for b in blocks)
    at_statement = [stated and v <= 1.0 for v in found]
    pairs = zip(groups, found, count - used, at_statement, strict=True)
    return {g: (1.0, np.inf) if known else (float(v), float(n)) for g, v, n, known in pairs} | {"prior": (1.0, np.inf)}


def correlation(n: int, share: float, length: float) -> np.ndarray:
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return share * np.exp(-apart / length) + (1 - share) * np.eye(n)


def span(X: np.ndarray) -> np.ndarray:
    left, sizes, _ = np.linalg.svd(X, full_matrices=False)
    return left[:, sizes > 1e-9 * max(sizes.max(initial=0.0), 1e-300)]


def averaged(values: np.ndarray, *, summed: bool = False) -> np.ndarray:
    """A record of more than 100 samples as 100 values."""
    if len(values) <= 100:
        return values
    parts = np.split(values, np.linspace(0, len(values), 101).astype(int)[1:-1])
    return np.array([np.sum(part, axis=0) if summed else np.mean(part, axis=0) for part in parts])


@dataclass(frozen=True)
class Process:
    variance: float
    share: float
    length: float

    def covariance(self, n: int) -> np.ndarray:
        return self.variance * correlation(n, self.share, self.length)


def process(records: list[tuple[np.ndarray, np.ndarray]]) -> Process | None:
    """By restricted maximum likelihood; None unless twice its logarithm gains more than 8 over white noise."""
    records = [(r, span(X)) for r, X in records if len(r) >= 8]
    free = sum(len(r) - X.shape[1] for r, X in records)
    if free < 8:
        return None
    longest = max(len(r) for r, _ in records) / 2

    def parts(share: float, length: float) -> tuple[float, float]:
        square = determinant = 0.0
        for r, X in records:
            lower = np.linalg.cholesky(correlation(len(r), share, length))
            Q, R = np.linalg.qr(np.linalg.solve(lower, X))
            y = np.linalg.solve(lower, r)
            square += float(y @ y - np.sum((Q.T @ y) ** 2))
            determinant += 2 * float(np.log(np.diag(lower)).sum() + np.log(np.abs(np.diag(R))).sum())
        return square, determinant

    def read(x: np.ndarray) -> tuple[float, float]:
        return float(np.clip(1 / (1 + np.exp(-x[0])), 0.001, 0.999)), float(np.clip(np.exp(x[1]), 0.5, longest))

    def minus(share: float, length: float) -> float:
        square, determinant = parts(share, length)
        return free * math.log(square / free) + determinant

    options = {"xatol": 1e-2, "fatol": 1e-3, "maxiter": 200}
    starts = [(0.0, 0.5), (2.0, 2.0), (5.0, 3.0)]
    found = [optimize.minimize(lambda x: minus(*read(x)), s, method="Nelder-Mead", options=options) for s in starts]
    best = min(found, key=lambda one: one.fun)
    if minus(0.0, 1.0) - best.fun <= 8:
        return None
    return Process(parts(*read(best.x))[0] / free, *read(best.x))


@dataclass(frozen=True)
class Source:
    """A source of error: rows by which it pulls on the minimum, of the experiments that are named beside them."""

    kind: str
    rows: list[np.ndarray]
    experiments: list[str]
    alone: list[np.ndarray]
    common: bool = False
    group: str = ""
    dof: float = math.inf
    along: Process | None = None
    variance: float = 1.0


def noise_sources(blocks: list[Block], noise: dict[str, tuple[float, float]]) -> list[Source]:
    found: list[Source] = []
    for group, (variance, dof) in noise.items():
        own = [b for b in blocks if b.group == group]
        pulls = [b.unit[:, None] * b.pull for b in own]
        records = [(averaged(b.r / b.unit), averaged(b.J / b.unit[:, None])) for b in own]
        along = None if group == "prior" else process(records)
        rows = [math.sqrt(variance) * pull for pull in pulls]
        if along is not None:
            pulls = [averaged(pull, summed=True) for pull in pulls]
            rows, dof = [np.linalg.cholesky(along.covariance(len(pull))).T @ pull for pull in pulls], 3.0
        kind = "prior" if group == "prior" else "noise"
        names = [b.experiment for b in own]
        found += [Source(kind, rows, names, rows, group=group, dof=dof, along=along, variance=variance)] if own else []
    return found


# --- The minimum as an estimator --------------------------------------------------------------------------------------


@dataclass
class Between:
    """How tests differ in one parameter: steps from the joint value and their variances; p between two bounds."""

    steps: dict[str, float]
    responses: dict[str, np.ndarray]
    q: float
    p_least: float
    p_most: float
    spread: float
    mean: float
    weights: dict[str, float]

    @property
    def differs(self) -> bool:
        return self.p_most < 0.05


class Estimator:
    def __init__(self, fit: Fit) -> None:
        self.fit, blocks = fit, fit.blocks
        self.inverse = inverse_hessian(blocks)
        self.between = self._between() if len(fit.experiments) > 1 else {}
        differing = {j: one for j, one in self.between.items() if one.differs}
        self.means = {j: one for j, one in differing.items() if len(one.steps) > 2}
        self.sources = noise_sources(blocks, self._noise(differing))
        for k, (source, *_) in enumerate(fit.uncertain):
            changes = [[b for b in blocks if b.experiment == e] for e in fit.experiments]
            rows = [np.sum([b.bent(b.S[:, [k]]).T @ b.pull for b in own], axis=0) for own in changes]
            alone = [np.sum([b.S[:, [k]].T @ b.pull for b in own], axis=0) for own in changes]
            self.sources.append(Source(source, rows, fit.experiments, alone, common=True))
        for j, one in differing.items():
            pulls = {
                e: np.sum([b.J[:, [j]].T @ b.pull for b in blocks if b.experiment == e], axis=0) for e in one.steps
            }
            rows = [one.spread * pull for pull in pulls.values()]
            self.sources.append(Source("experiments", rows, list(pulls), rows))
        joint = -self.inverse @ np.sum([b.pull.T @ b.r for b in blocks], axis=0)
        self.minimum = fit.z + joint
        for j, one in self.means.items():
            self.minimum[j] = fit.z[j] + one.mean + self._by_others(one) @ joint
        self.answers = [self._answer(source) for source in self.sources]
        self._add_drifts()
        covariance = np.sum([row.T @ row for answer in self.answers for row in answer], axis=0)
        self.beyond = beyond_bounds(self.minimum, covariance)
        self.factor = max(1.0, float(self.beyond.max()))
        self.answers = [[self.factor * row for row in answer] for answer in self.answers]
        self._add_misfits()
        self.covariance = np.sum([row.T @ row for answer in self.answers for row in answer], axis=0)

    def _noise(self, differing: dict[int, Between]) -> dict[str, tuple[float, float]]:
        """White noise, every test with its own value of what they differ in."""
        blocks, own = self.fit.blocks, [(e, j) for j, one in differing.items() for e in one.steps]
        if not own:
            return white_noise(blocks, self.inverse)
        wide = [
            replace(b, J=np.column_stack([b.J, *(b.J[:, j] * (e == b.experiment) for e, j in own)])) for b in blocks
        ]
        inverse = least_squares(wide, np.arange(wide[0].J.shape[1]))
        return white_noise(refitted(wide, inverse), inverse)

    def _by_others(self, one: Between) -> np.ndarray:
        out = np.zeros(len(self.fit.names))
        for e, own in one.responses.items():
            moved = np.sum([(own @ b.pull.T) @ b.J for b in self.fit.blocks if b.experiment == e], axis=0)
            out -= one.weights[e] * np.where(own == 0.0, moved, 0.0)
        return out

    def _answer(self, source: Source) -> list[np.ndarray]:
        found = [row @ self.inverse for row in source.rows]
        for j, one in self.means.items():
            others = self._by_others(one)
            for answer, alone, e in zip(found, source.alone, source.experiments, strict=True):
                direct = one.weights[e] * (alone @ one.responses[e]) if e in one.weights else 0.0
                answer[:, j] = direct + answer @ others
        return [np.sum(found, axis=0)] if source.common else found

    def _add_drifts(self) -> None:
        """Drifts that the noise of a record conceals, none of which makes an error longer than by half."""
        found: list[tuple[Source, list[np.ndarray]]] = []
        for b in self.fit.blocks:
            if not b.drifts or len(b.time) < 8:
                continue
            of = next(s for s in self.sources if s.group == b.group)
            time = b.time if of.along is None else averaged(b.time)
            a = time - time.mean()
            V = of.variance * np.eye(len(a)) if of.along is None else of.along.covariance(len(a))
            row = 2 / math.sqrt(3) * math.sqrt(a @ V @ a) / (a @ a) * (b.time @ b.pull)[None, :]
            one = Source("drift", [row], [b.experiment], [row])
            found.append((one, self._answer(one)))
        if found:
            before, added = (
                np.sum([np.sum(row**2, axis=0) for answer in answers for row in answer], axis=0)
                for answers in (self.answers, [answer for _, answer in found])
            )
            limit = 1 / math.sqrt(max(float((added / before).max()) / (1.5**2 - 1), 1.0))
            self.sources += [one for one, _ in found]
            self.answers += [[limit * row for row in answer] for _, answer in found]

    def _add_misfits(self) -> None:
        """The causes in a channel that may have more than noise, by their probabilities, up to twice as large."""
        for e in self.fit.experiments:
            worths = causes(self.fit, e)
            for b in (b for b in self.fit.blocks if b.experiment == e):
                clear, _, changes, _ = worths[b.channel]
                beyond_chance = clear**2 - 2 * math.log(max(len(worths), 2) / 2)
                if beyond_chance > 3.5**2 and changes:
                    most = max(t for t, _ in changes.values())
                    odds = [math.exp((t**2 - most**2) / 2 / max(1, 0.02 * most**2)) for t, _ in changes.values()]
                    parts = zip(odds, changes.values(), strict=True)
                    likely = [math.sqrt(p / sum(odds)) * change for p, (_, change) in parts]
                    missing = np.stack(likely, axis=1) * math.sqrt(min(math.sqrt(beyond_chance) - 3.5, 1) * 4 / 3)
                    one = Source("misfit", [b.bent(missing).T @ b.pull], [e], [missing.T @ b.pull])
                    self.sources.append(one)
                    self.answers.append(self._answer(one))

    @cached_property
    def variances(self) -> dict[str, np.ndarray]:
        """Source -> its part of every variance, the other parameters within their bounds as by a uniform prior."""
        k, parts = len(self.fit.names), {}
        weights = 12.0 * (1.0 - np.eye(k))
        M = np.column_stack(
            [np.linalg.solve(np.eye(k) + weights[j][:, None] * self.covariance, np.eye(k)[j]) for j in range(k)]
        )
        for source, answer in zip(self.sources, self.answers, strict=True):
            part = np.sum([np.sum((row @ M) ** 2, axis=0) for row in answer], axis=0)
            parts[source.kind] = parts.get(source.kind, 0.0) + part
        left = np.where(np.eye(k) == 1, 0.0, np.eye(k) - M)
        parts["bounds"] = np.sum(left**2, axis=0) / 12.0
        return parts

    @property
    def shares(self) -> dict[str, np.ndarray]:
        total = np.sum(list(self.variances.values()), axis=0)
        return {kind: part / total for kind, part in self.variances.items()}

    def interval(self, name: str) -> tuple[float, float, float]:
        """Ends [SI] within the bounds, and the standard error [SI], without the mesh."""
        j, p = self.fit.names.index(name), self.fit.p[name]
        t = float(stats.t.ppf(0.975, p["dof"])) if p.get("dof") else float(stats.norm.ppf(0.975))
        low, high = profile_interval(self.minimum, self.covariance, j, t)
        ends = [self.fit.value(name, float(np.clip(end, 0.0, 1.0))) for end in (low, high)]
        return ends[0], ends[1], (high - low) / (2 * t) * float(self.fit.slopes[j])

    def _between(self) -> dict[int, Between]:
        fit, k = self.fit, len(self.fit.names)
        serves = {e: np.array([fit.serves(name, e) for name in fit.names]) for e in fit.experiments}
        count = np.sum(list(serves.values()), axis=0)
        own, left, found, alone = count == 1, list(np.flatnonzero(count > 1)), {}, {}
        for e, on in serves.items():
            blocks = [b for b in fit.blocks if b.experiment == e]
            blocks += [b for b in fit.blocks if b.group == "prior" and (own & on)[np.any(b.J != 0, axis=0)].all()]
            inverse = least_squares(blocks, np.flatnonzero(on))
            moved = refitted(blocks, inverse)
            sources = noise_sources(moved, white_noise(moved, inverse))
            for q, (source, _, _, whose) in enumerate(fit.uncertain):
                if whose == e:
                    row = np.sum([b.S[:, [q]].T @ b.pull for b in blocks if b.experiment == e], axis=0)
                    sources.append(Source(source, [row], [e], [row]))
            alone[e] = blocks, sources
        while True:
            compared = {j: one for j in left if (one := self._compared(j, alone, serves, own, k, found)) is not None}
            for one in compared.values():
                one.p_least, one.p_most = (min(1.0, len(compared) * p) for p in (one.p_least, one.p_most))
            first = min(compared, key=lambda j: compared[j].p_most, default=None)
            if first is None or not compared[first].differs:
                return {**found, **compared}
            found[first] = compared[first]
            left.remove(first)
            own = own.copy()
            own[first] = True

    def _compared(self, j: int, alone: Any, serves: Any, own: np.ndarray, k: int, found: Any) -> Between | None:
        inside: dict[str, bool] = {}
        steps, variances, dof, responses = {}, {}, {}, {}
        for e, (blocks, sources) in alone.items():
            over = [j, *(int(c) for c in np.flatnonzero(serves[e] & own) if c != j)]
            normal = np.sum([b.J[:, over].T @ b.pull[:, over] for b in blocks], axis=0)
            scale = np.sqrt(np.diag(normal))
            if not serves[e][j] or np.any(scale == 0):
                continue
            normal = normal / np.outer(scale, scale)
            if np.linalg.eigvalsh(normal)[0] < 1e-9:
                continue
            response = np.zeros(k)
            response[over] = np.linalg.inv(normal)[0] / scale[0] / scale
            parts = [sum(float(np.sum((row @ response) ** 2)) for row in s.rows) for s in sources]
            scatter = sum(2 * part**2 / s.dof for part, s in zip(parts, sources, strict=True))
            pulled = np.sum([b.pull.T @ b.r for b in blocks], axis=0)[over]
            moved = dict(zip(over, -np.linalg.solve(normal, pulled / scale) / scale, strict=True))
            steps[e] = float(moved[j])
            inside[e] = all(0.0 <= self.fit.z[c] + moved.get(c, 0.0) <= 1.0 for c in (j, *found))
            variances[e], responses[e] = sum(parts), response
            dof[e] = 2 * sum(parts) ** 2 / scatter if scatter > 0 else math.inf
        clear = [e for e in steps if variances[e] < 1e6 * min(variances.values())]
        if len(clear) < 2 or not all(inside[e] for e in clear):
            return None
        y, v, n = (np.array([of[e] for e in clear]) for of in (steps, variances, dof))
        tau2 = between_variance(y, v)
        weights = 1 / (v + tau2) / np.sum(1 / (v + tau2))
        responses, steps = ({e: of[e] for e in clear} for of in (responses, steps))
        q, known, estimated = welch(y, v, n)
        if not any(source.along for e in clear for source in alone[e][1]):
            known = estimated  # white noise, whose degrees of freedom are exact
        named = dict(zip(clear, weights, strict=True))
        return Between(steps, responses, q, known, estimated, math.sqrt(tau2), float(weights @ y), named)


def welch(y: np.ndarray, v: np.ndarray, dof: np.ndarray) -> tuple[float, float, float]:
    """Cochran's Q, its p where the variances are known, and where they are estimated with `dof`."""
    w, k = 1 / v, len(y)
    q = float(w @ (y - w @ y / w.sum()) ** 2)
    lack = float(np.sum((1 - w / w.sum()) ** 2 / dof)) / (k**2 - 1)
    known = float(stats.chi2.sf(q, k - 1))
    if lack == 0.0:
        return q, known, known
    return q, known, float(stats.f.sf(q / (k - 1) / (1 + 2 * (k - 2) * lack), k - 1, 1 / (3 * lack)))


def between_variance(y: np.ndarray, v: np.ndarray) -> float:
    """tau^2 of random effects by restricted maximum likelihood."""

    def minus(tau2: float) -> float:
        w = 1 / (v + tau2)
        return float(w @ (y - w @ y / w.sum()) ** 2 - np.log(w).sum() + np.log(w.sum()))

    grid = [0.0, *np.geomspace(1e-6 * v.min(), 100 * (np.var(y) + v.max()), 4000)]
    return min(grid, key=minus)


def nearest(covariance: np.ndarray, minimum: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[float, np.ndarray]:
    """The least squared distance from the minimum in a box, in the metric of the covariance, and where it is."""
    s = np.sqrt(np.diag(covariance))
    metric = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(s, s)))
    low, high, fixed = (low - minimum) / s, (high - minimum) / s, low == high
    x = np.where(fixed, low, 0.0)
    if not fixed.all():
        free = ~fixed
        x[free] = optimize.lsq_linear(metric[:, free], -metric @ x, (low[free], high[free]), method="bvls").x
    return float(np.sum((metric @ x) ** 2)), minimum + x * s


def without_bounds(j: int, k: int, value: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.zeros(k), np.ones(k)
    low[j], high[j] = (-np.inf, np.inf) if value is None else (value, value)
    return low, high


def beyond_bounds(minimum: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    k = len(minimum)
    least = nearest(covariance, minimum, np.zeros(k), np.ones(k))[0]
    removed = [nearest(covariance, minimum, *without_bounds(j, k))[0] for j in range(k)]
    return np.sqrt(np.maximum(least - np.array(removed), 0.0))


def profile_interval(minimum: np.ndarray, covariance: np.ndarray, j: int, t: float) -> tuple[float, float]:
    k = len(minimum)
    least, best = nearest(covariance, minimum, np.zeros(k), np.ones(k))

    def excess(value: float) -> float:
        return nearest(covariance, minimum, *without_bounds(j, k, value))[0] - least - t**2

    ends: list[float] = []
    for side in (-1.0, 1.0):
        step = t * math.sqrt(covariance[j, j])
        while excess(best[j] + side * step) < 0:
            step *= 2
        ends.append(float(optimize.brentq(excess, best[j], best[j] + side * step)))
    return ends[0], ends[1]


Worth = dict[str, tuple[float, float]]


def causes(fit: Fit, experiment: str) -> dict[str, tuple[float, Worth, dict[str, tuple[float, np.ndarray]], float]]:
    """Channel -> standard errors of the clearest shape; cause no larger than the record -> (those of it, the part of
    the channel's own squares by which they fall where it is fitted beside the parameters); for each shape the standard
    errors of it, and what it changes of the residuals; and how many of the clearest are in the channel's own ones.

    Whitened by the noise beside all shapes (generalised least squares), both channels of the experiment together.
    """
    rows, found = [], {}
    for b in (b for b in fit.blocks if b.experiment == experiment):
        y = b.r + b.measured
        if len(y) < 20:  # too few to tell a cause from noise
            size = max(math.sqrt(np.mean(b.r**2)), 1e-300)
            rows.append((b.channel, b.r / size, b.J / size, {}))
            continue
        time = b.time if b.drifts else np.linspace(0.0, 1.0, len(y))
        change, onwards = np.gradient(y), np.sign(np.gradient(y if b.command is None else b.command))
        drift, law = "a drift or relaxation", "another material law or friction in bends"
        shapes = {"an offset": y * 0 + 1, drift: time, "a gain": y}
        shapes["a slack"] = change if b.command is None else onwards * change
        shapes |= {law: y**3, f"{law} #2": y * abs(y)}
        if 0.1 < np.mean(onwards > 0) < 0.9:
            shapes |= {"friction that reverses": onwards * y, "a delay": change}
        if b.channel == "tension":
            shapes |= {f"{drift} #{k}": y * (1 - np.exp(-k * (time - time[0]))) for k in (1, 3)}
        if b.channel == "tension":  # contact from a place on, by which the force is larger than without
            for share in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8):
                hinge = y - ((1 - share) * y.min() + share * y.max())
                shapes[f"contact of surfaces{share}"] = np.where(hinge > 0, hinge, 0)
        shapes = {cause: shape / np.linalg.norm(shape) for cause, shape in shapes.items() if np.any(shape != 0)}
        beside = [not cause.startswith("contact of surfaces") and "#" not in cause for cause in shapes]
        C = averaged(np.column_stack(list(shapes.values())))
        J, r = averaged(b.J), averaged(b.r)
        X = span(np.column_stack([J / np.maximum(np.linalg.norm(J, axis=0), 1e-300), C[:, beside]]))
        along = process([(r, X)])
        left = r - X @ (X.T @ r)
        V = left @ left / (len(r) - X.shape[1]) * np.eye(len(r)) if along is None else along.covariance(len(r))
        r, J, C = (np.linalg.solve(np.linalg.cholesky(V), one) for one in (r, J, C))
        largest = max(np.ptp(b.measured), np.ptp(y))
        whitened = {cause: (c, shape, largest) for (cause, shape), c in zip(shapes.items(), C.T, strict=True)}
        rows.append((b.channel, r, J, whitened))
    J = np.concatenate([J for _, _, J, _ in rows])
    basis = span(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))
    whole_r = np.concatenate([r for _, r, _, _ in rows])
    r = whole_r - basis @ (basis.T @ whole_r)
    start = 0
    for channel, own, J, shapes in rows:
        at = slice(start, start + len(own))
        start, clearest, in_residuals, worth, changes = at.stop, 0.0, 0.0, {}, {}
        scaled = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        for cause, (shape, along, largest) in shapes.items():
            whole = np.zeros(len(r))
            whole[at] = shape
            whole = whole - basis @ (basis.T @ whole)
            if np.linalg.norm(whole) > 1e-3 * np.linalg.norm(shape):
                after = r - whole * (whole @ r) / (whole @ whole)
                t = abs(float(whole @ r)) / float(np.linalg.norm(whole))
                one = t, 1.0 - float(np.sum(after[at] ** 2) / np.sum(r[at] ** 2))
                contact, change = cause.startswith("contact of surfaces"), along * (whole @ r) / (whole @ whole)
                clearest = max(clearest, 0.0 if contact else t)
                taken = 0.0 if contact else float(np.linalg.norm(span(np.column_stack([scaled, shape])).T @ own))
                in_residuals = max(in_residuals, min(t, taken))
                if np.max(np.abs(change)) > largest:  # no cause is larger than the record
                    continue
                if contact:
                    if whole @ r < 0 and one > worth.get("contact of surfaces", (0.0, 0.0)):
                        worth["contact of surfaces"] = one
                else:
                    named = cause.partition(" #")[0]
                    worth[named], changes[cause] = max(one, worth.get(named, one)), (t, change)
        most = max((t for t, _ in changes.values()), default=0.0)
        worth = {cause: (min(t, most), share) for cause, (t, share) in worth.items()}
        found[channel] = clearest, worth, changes, in_residuals
    return found


def local_hessian(fit: Fit) -> np.ndarray:
    """Half the loss's Hessian where the search ended, of which only parameters within their bounds count."""
    H = np.zeros((len(fit.names),) * 2)
    for b in fit.blocks:
        row = np.sqrt(b.w)[:, None] * b.J
        H += row.T @ row
        if b.straight is not None:
            H -= np.outer(row.T @ b.straight, b.straight @ row)
    return H


def effective(r: np.ndarray) -> float:
    """How many independent values a record of residuals is worth, by its lag-1 correlation."""
    rho = float(np.clip(r[1:] @ r[:-1] / (r @ r), 0.0, 1.0 - 1.0 / len(r)))
    return len(r) * (1 - rho) / (1 + rho)


def minimum_distance(fit: Fit, estimator: Estimator) -> float:
    """From the best trial to the minimum within the bounds, by the local derivatives, in standard errors."""
    free = np.minimum(fit.z, 1.0 - fit.z) > 1e-6
    pull = np.sum([b.pull.T @ b.r for b in fit.blocks], axis=0)
    step = np.linalg.solve(local_hessian(fit)[np.ix_(free, free)], -pull[free])
    return float(np.max(np.abs(step) / np.sqrt(np.diag(estimator.covariance))[free]))
