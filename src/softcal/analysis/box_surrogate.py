"""A surrogate of the twin over the whole search box, from simulated points with their exact derivatives.

Each kind of channel has its own polynomial (`calibration/interval_studies/surrogate.py`), in the coordinates of the
search or in the values themselves, whichever predicts better: a force at a given shortening is proportional to a
modulus that is searched by its logarithm. Every round begins with points that the surrogate has not seen, uniform in
the box: what it misses there is its error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.calibration.interval_studies.likelihood_points import Observer
from softcal.calibration.interval_studies.surrogate import Surrogate, fewest_points, fitted_surrogate
from softcal.calibration.problem.loss import Block, rms, total
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.optimiser import Proposal
from softcal.calibration.statistics.local_model import jacobian_of
from softcal.checks import Floats
from softcal.errors import CalibrationError, SimulationError
from softcal.executors.executor import Executor
from softcal.sensing.channel import channel_name

ERROR = 0.03
"""Largest error of the surrogate over the standard deviation of an output, at points that it has not seen."""
FAILED = 0.1
"""Largest share of points that cannot be simulated."""
LOSS, POSITION, PRIOR = "loss", "position", "prior"
_ROUNDING = 1e-9  # of the measured values
_CHUNK = 2048  # points whose residuals are held at a time
_CHECKS = 20  # points of a round that are checked, at least


@dataclass(frozen=True)
class BoxSurrogate:
    """Residuals and loss over the search box.

    Attributes
    ----------
    problem
        The problem.
    blocks
        Its blocks at one point.
    parts
        Kind of channel -> the polynomial of its residuals, and whether it is one in the values themselves.
    """

    problem: Problem
    blocks: tuple[Block, ...]
    parts: Mapping[str, tuple[Surrogate, bool]]

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of channels, without the priors."""
        return tuple(kind for kind in self.parts if kind != PRIOR)

    def outputs(self, z: Floats) -> dict[str, Floats]:
        """The loss (n, 1) and the residuals (n, m) by kind of channel, at points z (n, size)."""
        held = self._predicted(z)
        return {LOSS: self._loss(held), **{kind: held[kind] for kind in self.kinds}}

    def turned_outputs(self, z: Floats) -> dict[str, Floats]:
        """The outputs, with the residuals projected onto fewer values; the variance by any parameters is unchanged."""
        n = len(z)
        losses = [self._loss(self._predicted(z[i : i + _CHUNK])) for i in range(0, n, _CHUNK)]
        held = self._predicted(z, turned=True)
        return {LOSS: np.concatenate(losses), **{kind: held[kind] for kind in self.kinds}}

    def varies(self, name: str, values: Floats) -> bool:
        """True if values (n, m) of an output differ by more than rounding."""
        return _scatter(values) > self.rounding(name)

    def rounding(self, name: str) -> float:
        """Root mean square of the rounding errors of an output, at most."""
        of = [block for block in self.blocks if name in (LOSS, kind_of(block))]
        if name == LOSS:
            return _ROUNDING * max(total(self.problem.loss, of), _ROUNDING)
        return _ROUNDING * rms(np.concatenate([block.measured for block in of]))

    def _predicted(self, z: Floats, *, turned: bool = False) -> dict[str, Floats]:
        value = _values(self.problem.space, z)[0]
        return {
            kind: (part.turned() if turned else part).predicted(value if by_value else z)
            for kind, (part, by_value) in self.parts.items()
        }

    def _loss(self, held: Mapping[str, Floats]) -> Floats:
        columns: list[Floats] = []
        places = dict.fromkeys(held, 0)
        for block in self.blocks:
            kind = kind_of(block)
            columns.append(held[kind][:, places[kind] : places[kind] + len(block.residual)])
            places[kind] += len(block.residual)
        return np.array(
            [
                [total(self.problem.loss, [replace(b, residual=r) for b, r in zip(self.blocks, row, strict=True)])]
                for row in zip(*columns, strict=True)
            ]
        )


@dataclass
class _BoxPoints:
    """Simulated points of the box, and points that cannot be simulated, with theta and reason."""

    problem: Problem
    evaluator: Evaluator
    progress: Observer | None
    n: int = 0
    n_trajectories: int = 0
    z: list[Floats] = field(default_factory=list[Floats])
    blocks: list[tuple[Block, ...]] = field(default_factory=list[tuple[Block, ...]])
    losses: list[float] = field(default_factory=list[float])
    failures: list[tuple[Floats, str]] = field(default_factory=list[tuple[Floats, str]])

    def add(self, z: Floats) -> int:
        """Simulate points z (n, size); returns the number of successes."""
        before = len(self.z)
        proposals = [Proposal(self.n + i, self.problem.space.to_model(one)) for i, one in enumerate(z)]
        for one, (_, found) in zip(z, self.evaluator.evaluate(proposals), strict=True):
            self.n += 1
            self.n_trajectories += found.n_solves
            if found.loss is None:
                self.failures.append((one, found.failure))
            else:
                self.z.append(one)
                self.blocks.append(found.blocks)
                self.losses.append(found.loss)
            if self.progress is not None:
                self.progress(self.n)
        if len(self.failures) > FAILED * self.n:
            raise SimulationError(
                f"The twin cannot be simulated at {len(self.failures)} of {self.n} points within the bounds, and the "
                f"importance of parameters is that over all of them: {self.failures[0][1]} Try: narrower bounds."
            )
        return len(self.z) - before

    def fitted(self) -> BoxSurrogate:
        """The surrogate through all points."""
        space, z = self.problem.space, np.array(self.z)
        value, slopes = _values(space, z)
        parts: dict[str, tuple[Surrogate, bool]] = {}
        for kind in dict.fromkeys(kind_of(block) for block in self.blocks[0]):
            rows = np.array([residuals(blocks, kind) for blocks in self.blocks])
            jacobians = np.array(
                [
                    np.concatenate([jacobian_of(one) for one in blocks if kind_of(one) == kind]) * space.jacobian(at)
                    for blocks, at in zip(self.blocks, z)
                ]
            )
            by_search, by_value = (
                fitted_surrogate(at, rows, rates, np.eye(space.size))
                for at, rates in ((z, jacobians), (value, jacobians / slopes[:, None, :]))
            )
            parts[kind] = (by_value, True) if by_value.missed < by_search.missed else (by_search, False)
        return BoxSurrogate(self.problem, self.blocks[0], parts)

    def error(self, surrogate: BoxSurrogate, n: int) -> dict[str, float]:
        """Output -> error at the last n points over the standard deviation there."""
        guessed = surrogate.outputs(np.array(self.z[-n:]))
        found: dict[str, float] = {}
        for name, values in guessed.items():
            exact = (
                np.array(self.losses[-n:])[:, None]
                if name == LOSS
                else np.array([residuals(blocks, name) for blocks in self.blocks[-n:]])
            )
            missed = np.sqrt(np.mean((values - exact) ** 2))
            scatter = max(_scatter(exact), surrogate.rounding(name))
            found[name] = float(missed / scatter)
        return found


@dataclass(frozen=True)
class CheckedBox:
    """A surrogate that is accurate at points to which it was not fitted.

    Attributes
    ----------
    surrogate
        The surrogate.
    error
        Output -> its error there over the output's standard deviation.
    failures
        theta [SI by label] of each point that cannot be simulated, with the reason.
    facts
        Counts, by name.
    """

    surrogate: BoxSurrogate
    error: Mapping[str, float]
    failures: tuple[tuple[Mapping[str, float], str], ...]
    facts: Mapping[str, float]


def checked_box(
    problem: Problem, *, simulations: int, seed: int, workers: int | Executor = 1, progress: Observer | None = None
) -> CheckedBox:
    """A surrogate of a problem over its search box.

    Parameters
    ----------
    problem
        The problem.
    simulations
        Evaluations of the twin, at most.
    seed
        Seed of the points.
    workers
        An executor, or a number of processes that simulate.
    progress
        Called after every evaluation with their number.

    Raises
    ------
    SimulationError
        Where the twin cannot be simulated in too large a part of the box.
    CalibrationError
        Where the surrogate does not become accurate.
    """
    size = problem.space.size
    checks = max(_CHECKS, 2 * size)
    chance = np.random.default_rng(seed)
    n, seen = max(fewest_points(size), 2 * size), 0
    error: dict[str, float] = {}
    with Evaluator(problem, workers=workers, jacobian=True) as evaluator:
        points = _BoxPoints(problem, evaluator, progress)
        while seen + n + checks <= simulations:
            places = np.array([chance.permutation(n) for _ in range(size)]).T
            hypercube = (places + chance.random((n, size))) / n
            # Denser at the bounds, where a polynomial is least sure.
            points.add(0.5 - 0.5 * np.cos(np.pi * hypercube))
            surrogate = points.fitted()
            error = points.error(surrogate, points.add(chance.random((checks, size))))
            if max(error.values()) <= ERROR:
                facts = {"evaluations": float(points.n), "trajectories": float(points.n_trajectories)}
                failures = tuple((problem.space.to_model(z), why) for z, why in points.failures)
                return CheckedBox(points.fitted(), error, failures, facts)
            seen += n + checks
            n = seen  # every round doubles the points
    worst = max(error, key=lambda name: error[name], default="")
    state = (
        f"it errs by {error[worst]:.2g} standard deviations in the {worst}, and {ERROR:g} is allowed" if worst else ""
    )
    raise CalibrationError(
        f"No surrogate of the twin became accurate over the bounds within {simulations} evaluations"
        f"{': ' if state else ''}{state}. Try: more simulations, or narrower bounds."
    )


def _scatter(values: Floats) -> float:
    """The standard deviation over points of values (n, m)."""
    return float(np.sqrt(np.mean((values - values.mean(axis=0)) ** 2)))


def kind_of(block: Block) -> str:
    """The kind of a block's channel: coordinates together, priors together."""
    if not block.experiment:
        return PRIOR
    kind = channel_name(block.channel).kind
    return POSITION if kind.is_position else kind.name


def residuals(blocks: tuple[Block, ...], kind: str) -> Floats:
    """The residuals (m,) of the blocks of a kind."""
    return np.concatenate([block.residual for block in blocks if kind_of(block) == kind])


def _values(space: SearchSpace, z: Floats) -> tuple[Floats, Floats]:
    """The parameters' values within their bounds, 0 to 1, at points z (n, size), and their derivatives by z."""
    lower, upper = (np.array([getattr(p, end) for p in space.parameters]) for end in ("lower", "upper"))
    logs = np.array([p.scale == "log" for p in space.parameters])
    ratio = np.log(np.where(logs, upper, np.e) / np.where(logs, lower, 1.0))
    grown = np.where(logs, np.expm1(ratio * z) / np.expm1(ratio), z)
    slopes = np.where(logs, ratio * np.exp(ratio * z) / np.expm1(ratio), 1.0)
    return grown, slopes
