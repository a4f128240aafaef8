"""The published neck through its cycles: what was measured, and the twin's predictions with exact derivatives."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.neck_case import neck_robot
from softcal import Command, Protocol, Robot, load
from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.geometry.neck import Neck
from softcal.twin.barrier import Contact
from softcal.twin.parameters import with_parameters
from softcal.twin.simulate import simulate

SHAPE = Neck(tets=1000, waist_refinement=10.0, sectors=6)
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
TENSION = "front.tension"
SLACK = "slack"
FLOOR = 1.3  # [N], what the machine reads while the cable is slack
POISSONS_RATIO = 0.43  # as the neck's authors found it; nothing here tells it from E
N_CYCLES = 2  # at each target: the first has the peak, the last the curve and the loop; the ten of the test are near it


@dataclass(frozen=True)
class Target:
    """One amplitude of the test: pull [m], rows on each way, the window of the mean curve [m] without the remains of
    the reversals, the loops' energy over the work of loading by `SPEEDS`, and the first cycle's peak [N].
    """

    pull: float
    rows: int
    window: tuple[float, float]
    loops: tuple[float, ...]
    peak: float


# As the neck's authors published them, see examples/neck/data and its source.
SPEEDS = (2.5e-3, 5e-3, 10e-3, 15e-3)  # [m/s]
CURVES_AT = 15e-3  # the mean curves and first peaks are of this speed
TARGETS = (
    Target(0.02, 8, (5e-3, 18.2e-3), (0.063, 0.0574, 0.0483, 0.0437), 8.9),
    Target(0.04, 10, (8.3e-3, 38.2e-3), (0.0837, 0.0828, 0.0762, 0.0661), 15.6),
    Target(0.06, 12, (10.8e-3, 58.2e-3), (0.0901, 0.0867, 0.0819, 0.0816), 22.3),
)


@dataclass(frozen=True)
class Compared:
    """One kind of measured values at a target: measured (n,), the twin's (n,), its derivatives (n, k).

    what: "curve", "loop" or "peak". at: the travels [m] or the speed [m/s] of the values.
    """

    what: str
    target: Target
    at: Floats
    measured: Floats
    predicted: Floats
    by: Floats

    @property
    def weight(self) -> Floats:
        """One over what a value may be off (n,): a curve 2 % of its mean, as eight values; a peak 4 %; a loop 15 %."""
        if self.what == "curve":
            return np.full(len(self.at), np.sqrt(8 / len(self.at)) / (0.02 * self.measured.mean()))
        return 1.0 / ((0.15 if self.what == "loop" else 0.04) * self.measured)

    @property
    def off(self) -> float:
        """Mean error over the measured values [-]."""
        return float(np.mean(np.abs(self.predicted / self.measured - 1.0)))


@cache
def robot(contact: Contact | None = Contact()) -> Robot:  # noqa: B008 (frozen)
    """The neck of some 1000 quadratic tets with the material of examples/neck-bench/cycles.yaml; its grooves close, and
    its cable has no friction.
    """
    own = load(EXAMPLES / "neck-bench" / "cycles.yaml").robot
    mesh = SHAPE.mesh()
    body = replace(own.bodies[0], mesh=mesh, element="P2P1", fixed=mesh.node_sets["socket"])
    drawn = neck_robot(mesh, "P2P1", shape=SHAPE)
    return with_parameters(replace(drawn, bodies=(body,), contact=contact), {"neck.poissons_ratio": POISSONS_RATIO})


def curve(target: Target) -> tuple[Floats, Floats]:
    """The published mean of loading and unloading within the window: travel [m], force [N]."""
    with (EXAMPLES / "neck" / "data" / "utm-equilibrium-15mms.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    of = [row for row in rows if round(float(row["target_mm"])) == round(1e3 * target.pull)]
    d, force = np.array([(1e-3 * float(row["displacement_mm"]), float(row["force_N"])) for row in of]).T
    inside = (d >= target.window[0]) & (d <= target.window[1])
    return d[inside], force[inside]


def way(n_cycles: int = N_CYCLES, finer: int = 1) -> tuple[Floats, dict[Target, list[tuple[slice, slice]]]]:
    """The travel [m] of the whole test, 20, 40, then 60 mm, and the rows of loading and unloading of its cycles,
    `finer` times as many as those of the targets.
    """
    parts, rows, last = [np.zeros(1)], dict[Target, list[tuple[slice, slice]]](), 0
    for target in TARGETS:
        n = finer * target.rows
        up = np.linspace(0.0, target.pull, n + 1)
        for _ in range(n_cycles):
            parts += [up[1:], up[-2::-1]]
            rows.setdefault(target, []).append((slice(last, last + n + 1), slice(last + n, last + 2 * n + 1)))
            last += 2 * n
    return np.concatenate(parts), rows


def predict(
    values: Mapping[str, float], names: tuple[str, ...], n_cycles: int = N_CYCLES, finer: int = 1
) -> tuple[list[Compared], dict[float, Floats]]:
    """All compared values at constants of the material [SI by name] and the slack [m], with derivatives by `names`;
    and the twin's force [N] along the way by speed. n_cycles, finer: see `way`.

    Raises
    ------
    SimulationError
        Where the twin does not reach the end of the test.
    """
    constants = {f"neck.{name}": value for name, value in values.items() if name != SLACK}
    by = [name if name == SLACK else f"neck.{name}" for name in names]
    d, cycles = way(n_cycles, finer)
    found, forces = list[Compared](), dict[float, Floats]()
    for speed in SPEEDS:
        time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(d))) / speed])
        pull = Command("shortening", d - values[SLACK], {SLACK: -np.ones(len(d))})
        response = simulate(robot(), Protocol({"front": pull}, time), constants, sensitivities=by, crossings=False)
        if not response.succeeded:
            raise SimulationError(response.status)
        force = forces[speed] = response.channels[TENSION] + FLOOR
        rates = response.sensitivities.get(TENSION, {})
        slopes = np.column_stack([rates[name] for name in by]) if by else np.zeros((len(d), 0))
        for target, held in cycles.items():
            found.append(_loop(target, speed, *held[-1], d, force, slopes))
            if speed == CURVES_AT:
                found += [_curve(target, *held[-1], d, force, slopes), _peak(target, held[0][0], force, slopes)]
    return found, forces


def part_of_contact(values: Mapping[str, float]) -> tuple[float, float]:
    """Where the grooves close on the way to 60 mm at 15 mm/s, the first travel [m] at which contact changes the tension
    by a thousandth of its largest; and the share [-] of the tension at 58 mm that is due to contact.
    """
    d = np.linspace(0.0, TARGETS[-1].pull, 61)
    pull = Protocol({"front": Command("shortening", d - values[SLACK])}, d / CURVES_AT)
    constants = {f"neck.{name}": value for name, value in values.items() if name != SLACK}
    touching, free = (
        simulate(robot(contact), pull, constants, crossings=False).channels[TENSION] for contact in (Contact(), None)
    )
    by_contact = touching - free
    closed = d[np.abs(by_contact) > 1e-3 * touching.max()]
    return float(closed[0]), float(np.interp(0.058, d, by_contact) / np.interp(0.058, d, touching))


def _loop(target: Target, speed: float, up: slice, down: slice, d: Floats, force: Floats, slopes: Floats) -> Compared:
    both = np.column_stack([force, slopes])
    work = np.trapezoid(both[up], d[up], axis=0)
    lost = work + np.trapezoid(both[down], d[down], axis=0)
    share = lost[0] / work[0]
    by = (lost[1:] - share * work[1:]) / work[0]
    measured = np.array([target.loops[SPEEDS.index(speed)]])
    return Compared("loop", target, np.array([speed]), measured, np.array([share]), by[None])


def _curve(target: Target, up: slice, down: slice, d: Floats, force: Floats, slopes: Floats) -> Compared:
    at, measured = curve(target)
    both = np.column_stack([force, slopes])
    mean = [0.5 * (np.interp(at, d[up], one[up]) + np.interp(at, d[down][::-1], one[down][::-1])) for one in both.T]
    return Compared("curve", target, at, measured, mean[0], np.array(mean[1:]).reshape(-1, len(at)).T)


def _peak(target: Target, up: slice, force: Floats, slopes: Floats) -> Compared:
    top = up.stop - 1
    at, measured = np.array([CURVES_AT]), np.array([target.peak])
    return Compared("peak", target, at, measured, force[[top]], slopes[[top]])
