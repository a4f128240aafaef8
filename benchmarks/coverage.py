"""Coverage of the stated 95 % intervals: synthetic studies under each loss; writes docs/uncertainty.md.

python -m benchmarks.coverage [--studies 200] [--cases NAME …] [--out FILE]

With `--cases` the rows of the others stay as they are stored (`coverage.json`). Every study draws new independent noise
(and new prior means), and goes through softcal's own `calibrate`. The twins are read off tables of softcal's own
answers (`benchmarks.table_twins`).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import softcal
from benchmarks.neck_case import pull
from benchmarks.section import table
from benchmarks.table_twins import (
    NU,
    ComplianceTable,
    E,
    NeckTable,
    ParameterTable,
    compliance_table,
    neck_table,
    parameter_table,
)
from benchmarks.written_page import written_page
from softcal.calibration.problem.experiment import PULLEY_FRICTION, Experiment
from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.rig import Pulleys, Rig
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.misfit import CONTACT, DRIFT, FRICTION, LAW, OFFSET
from softcal.calibration.statistics.residuals import ResidualRecord
from softcal.executors.each import executor_of, executor_on, results
from softcal.executors.executor import Executor
from softcal.experiments.dataset import Channel, Dataset
from softcal.project.project import Project, load
from softcal.sensing.channel import channel_name
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.units import format_quantity

HERE = Path(__file__).resolve().parent
NECK = HERE.parent / "examples" / "neck-bench" / "project.yaml"
EXAMPLE = HERE.parent / "examples" / "manipulator" / "project.yaml"
PNEUNET = HERE.parent / "examples" / "pneunet" / "project.yaml"
MANIPULATOR = Path(softcal.__file__).parent / "templates" / "manipulator" / "project.yaml"
PAGE = HERE.parent / "docs" / "uncertainty.md"
STORED = HERE / "coverage.json"  # the rows of all cases, so that some can be studied again
STUDIES = 200
SLACK = "front.slack"
TRUE = {E: 2.3e6, NU: 0.43, SLACK: 2e-3, PULLEY_FRICTION: 0.10}
NOISE = {"tension": 0.02, "pitch": np.deg2rad(0.03)}  # [N], [rad]
PRIOR_SD = 0.02  # of the pulleys' friction
REACH = (4e-3, 34e-3)  # [m] of shortening
LENGTH = 0.425  # [m]
CABLES, MARKERS = ("cable1", "cable3", "cable5"), tuple(f"marker{k}" for k in range(1, 5))
SIX, EIGHT = tuple(f"cable{k}" for k in range(1, 7)), (*MARKERS, *(f"side{k}" for k in range(1, 5)))
FORCES = (4.905, 9.81, 14.715)  # [N]
SPRINGS = {f"spring{k + 1}.youngs_modulus": value for k, value in enumerate((0.7e9, 0.85e9, 1.0e9, 0.75e9))}
CAMERA = (0.01, -0.02, 0.40, 0.05, -0.1, 0.2)  # [m], [rad]


@dataclass(frozen=True)
class Case:
    """A kind of study: what it is in words, its loss, and how it is drawn.

    n: samples of each channel of the neck, 0 for the manipulator and the pneunet. true: in the place of `TRUE`;
    that of the pneunet. ratios: bounds of nu. stated: the noise in the data sheet over the true one. depth: noise
    of the camera's axis over that across it.
    correlation: of neighbouring samples' noise. misfit: a smooth error of the force, over its root mean square; a third
    of it in the pitch. reaches: the largest shortening [m] of each pull; spread: standard deviation of ln E among them.
    gain: standard deviation of the load cell's, which is known of it beforehand and drawn anew in every study. known:
    whether the pulleys' friction is known. drift: of load cell and IMU over the record, over the noise, up or down;
    states_drift: whether `uncertain:` states it, or `settings:` that there is none. law: of the true material, in the
    place of the neo-Hookean one that is fitted. loop: friction by which the force is larger while pulling than on the
    way back, both of which are fitted. bends: friction, by which the force is larger the more the neck bends, and which
    is left out of the fit. touches: whether the true neck's grooves close; the fit is without contact. relaxes: share
    of the force that is lost in the course of the pull. turned: zero of the IMU [rad], of which nothing is said.
    outliers: share of samples with 20 times the noise. step: of the load cell's readings [N]. cause: the words of the
    misfit's true cause. six: six cables and eight markers of the manipulator, and 0.2 mm of noise; off: how far each
    marker [m], pulled: by what share each cable's force is off (standard deviations).
    studies: at most, for those that take long.
    """

    name: str
    words: str
    loss: Loss
    n: int = 60
    true: Mapping[str, float] | None = None
    ratios: tuple[float, float] = (0.30, 0.4999)
    stated: float = 1.0
    depth: float = 1.0
    correlation: float = 0.0
    misfit: float = 0.0
    reaches: tuple[float, ...] = (REACH[1],)
    spread: float = 0.0
    gain: float = 0.0
    known: bool = False
    fixed: bool = False
    drift: float = 0.0
    states_drift: bool = False
    cause: str = ""
    law: str = ""
    loop: float = 0.0
    bends: float = 0.0
    touches: bool = False
    relaxes: float = 0.0
    turned: float = 0.0
    outliers: float = 0.0
    step: float = 0.0
    six: bool = False
    off: float = 0.0
    pulled: float = 0.0
    studies: int = STUDIES

    @property
    def truth(self) -> dict[str, float]:
        """What is free and has to be found [SI by label], but for the camera's frame."""
        if not self.n:
            return dict(self.true or SPRINGS)
        has_friction = self.loss.uses_priors and len(self.reaches) == 1 and not self.known
        known = [NU] * self.fixed + [PULLEY_FRICTION] * (not has_friction)
        free = {name: value for name, value in TRUE.items() if name not in known}
        free |= self.true or {}
        if len(self.reaches) > 1:
            free |= {f"{SLACK}[{pull}]": free[SLACK] for pull in self.pulls}
        return free

    @property
    def pulls(self) -> tuple[str, ...]:
        """Names of the neck's experiments."""
        return tuple(f"pull{k + 1}" for k in range(len(self.reaches)))


PNEUNET_TRUE = {"finger.youngs_modulus": 262e3, "main.dead_volume": 7.4e-6}
PNEUNET_RANGES = {"finger.youngs_modulus": (230e3, 300e3), "main.dead_volume": (5e-6, 10e-6)}
LIKELIHOOD, PAPERS, DISTANCE = LikelihoodLoss(), PapersLoss(), DistanceLoss(LENGTH)
NEAR_BOUND, PAPER_RATIOS = {NU: 0.41}, (0.40, 0.4999)
FOUR = (0.020, 0.026, 0.030, 0.034)  # [m]
LOTS = (0.020, 0.023, 0.026, 0.029, 0.032, 0.034)  # [m]
CORRELATED, MISFIT, SPREAD, LOT_SPREAD, GAIN_SD = 0.95, 0.03, 0.03, 0.05, 0.02
WRONG_STUDIES = 100
OUTLIERS, STEPS, DIFFERENCES = "single samples", "steps of the readings", "differences between the tests"
NEAR_WORDS = "ν 0.41 within bounds of 0.40 and 0.4999"
# Models that are a little wrong, and data that are not as stated.
WRONG: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("steady", "neck, 300 samples, noise correlated by 0.8", {"correlation": 0.8}),
    ("drift-1", "the same, drift of load cell and IMU of one σ", {"correlation": 0.8, "drift": 1.0, "cause": DRIFT}),
    ("drift-3", "the same, drift of three σ", {"correlation": 0.8, "drift": 3.0, "cause": DRIFT}),
    ("drift-stated", "the same, stated (`uncertain:`)", {"correlation": 0.8, "drift": 3.0, "states_drift": True}),
    ("stiffer", "neck, 300 samples, a material that stiffens, fitted as neo-Hookean", {"law": "stiffer", "cause": LAW}),
    ("softer", "the same, a material that softens", {"law": "softer", "cause": LAW}),
    (
        "loop",
        "neck, 300 samples, both branches of a loop of ± 3 %, fitted without friction",
        {"loop": 0.03, "cause": FRICTION},
    ),
    (
        "bends",
        "neck, 300 samples, friction of 0.1 where the cable bends with the neck, fitted without",
        {"bends": 0.1, "cause": LAW},
    ),
    ("relaxes", "neck, 300 samples, a force that relaxes by 4 %", {"relaxes": 0.04, "cause": DRIFT}),
    ("turned", "neck, 300 samples, an IMU that is turned by 0.3 deg", {"turned": np.deg2rad(0.3), "cause": OFFSET}),
    ("contact", "neck, 300 samples, grooves that close, fitted without contact", {"touches": True, "cause": CONTACT}),
    ("outliers", "neck, 300 samples, one in a hundred off by 20 σ", {"outliers": 0.01, "cause": OUTLIERS}),
    ("quantised", "neck, 300 samples, a load cell in steps of 0.1 N", {"step": 0.1, "cause": STEPS}),
)
OF_WRONG: dict[str, Any] = {"n": 300, "known": True, "studies": WRONG_STUDIES}
FIXED = ("steady", "stiffer", "softer", "bends", "relaxes", "turned", "contact")  # with nu known, E has less room
# Yeoh's C20 and C30 over C10: force by -2 to +14 % and by -2 to -5 % of neo-Hooke's over the record.
OTHER_LAWS = {"stiffer": (8.0, 0.0), "softer": (-1.0, 1.0)}
CASES = (
    Case("likelihood", "neck, `likelihood`, a prior on the pulleys' friction", LIKELIHOOD),
    Case("likelihood-known", "the same, instruments stated to be without drift", LIKELIHOOD, states_drift=True),
    Case(
        "likelihood-understated", "neck, `likelihood`, stated noise a third of the true noise", LIKELIHOOD, stated=1 / 3
    ),
    Case("likelihood-bound", f"neck, `likelihood`, {NEAR_WORDS}", LIKELIHOOD, true=NEAR_BOUND, ratios=PAPER_RATIOS),
    Case("papers", "neck, `papers`, friction known", PAPERS),
    Case("papers-known", "the same, instruments stated to be without drift", PAPERS, states_drift=True),
    Case("papers-1000", "neck, `papers`, friction known, 1000 samples", PAPERS, n=1000),
    Case("papers-bound", f"neck, `papers`, 60 samples, {NEAR_WORDS}", PAPERS, true=NEAR_BOUND, ratios=PAPER_RATIOS),
    Case(
        "likelihood-correlated",
        "neck, `likelihood`, noise correlated by 0.95, 1000 samples",
        LIKELIHOOD,
        n=1000,
        correlation=CORRELATED,
    ),
    Case("papers-correlated", "the same, `papers`", PAPERS, n=1000, correlation=CORRELATED),
    Case("likelihood-misfit", "neck, `likelihood`, smooth misfit of 3 % of the force", LIKELIHOOD, misfit=MISFIT),
    Case("papers-misfit", "the same, `papers`", PAPERS, misfit=MISFIT),
    Case("likelihood-alike", "four pulls, `likelihood`, one E", LIKELIHOOD, reaches=FOUR),
    Case("papers-alike", "the same, `papers`", PAPERS, reaches=FOUR),
    Case("likelihood-differ", "four pulls, `likelihood`, E differs by 3 %", LIKELIHOOD, reaches=FOUR, spread=SPREAD),
    Case("papers-differ", "the same, `papers`", PAPERS, reaches=FOUR, spread=SPREAD),
    Case(
        "likelihood-lots",
        "six pulls, `likelihood`, E differs by 5 %",
        LIKELIHOOD,
        reaches=LOTS,
        spread=LOT_SPREAD,
        cause=DIFFERENCES,
    ),
    Case("papers-lots", "the same, `papers`", PAPERS, reaches=LOTS, spread=LOT_SPREAD, cause=DIFFERENCES),
    Case("likelihood-gain", "neck, `likelihood`, load cell off by 2 % (`uncertain:`)", LIKELIHOOD, gain=GAIN_SD),
    Case("papers-gain", "the same, `papers`", PAPERS, gain=GAIN_SD),
    *(
        Case(f"{loss.name}-{name}", f"{words}, `{loss.name}`", loss, **OF_WRONG, **how)
        for name, words, how in WRONG
        for loss in (LIKELIHOOD, PAPERS)
    ),
    *(
        Case(f"{loss.name}-fixed-{name}", f"{words}, ν known, `{loss.name}`", loss, fixed=True, **OF_WRONG, **how)
        for name, words, how in WRONG
        if name in FIXED
        for loss in (LIKELIHOOD, PAPERS)
    ),
    Case("distance", "manipulator, `distance`, the camera's frame free", DISTANCE, n=0),
    Case("distance-depth", "the same, three times the noise in depth", DISTANCE, n=0, depth=3.0),
    Case(
        "six",
        "manipulator, six cables, eight markers, `distance`, the camera's frame free",
        DISTANCE,
        n=0,
        six=True,
        studies=100,
    ),
    Case("six-off", "the same, each marker glued on 0.5 mm off", DISTANCE, n=0, six=True, off=5e-4, studies=100),
    Case("six-pulled", "the same, the force of each cable 3 % off", DISTANCE, n=0, six=True, pulled=0.03, studies=100),
    Case("pneunet", "pneunet, pressure and syringe, three markers", LIKELIHOOD, n=0, true=PNEUNET_TRUE),
    Case(
        "pneunet-known",
        "the same, the gauge stated to be without drift",
        LIKELIHOOD,
        n=0,
        true=PNEUNET_TRUE,
        states_drift=True,
    ),
)


@dataclass(frozen=True)
class Coverage:
    """Of one parameter of a case: how many studies gave an interval, how many of those contain the true value.

    ratio: the intervals' mean half-length over 1.96 times the estimates' root-mean-square error. differ: studies that
    call the experiments different in any parameter. misfits: studies that say that residuals are more than noise, or
    that model and bounds contradict the data. named: studies that name the case's cause among the first two of the
    channel of which a cause explains the largest share. times: as many times as long, 90 % of the intervals would
    contain the true value.
    """

    case: Case
    parameter: str
    studies: int
    given: int
    held: int
    ratio: float
    differ: int = 0
    misfits: int | None = None
    named: int | None = None
    times: float | None = None

    @property
    def share(self) -> float:
        return self.held / self.given if self.given else float("nan")


def coverage(case: Case, studies: int = STUDIES, workers: int | Executor = 1) -> list[Coverage]:
    """Run the studies of a case; workers: an executor, or a number of processes."""
    truth = case.truth
    found: dict[str, list[tuple[float, tuple[float, float] | None]]] = {}
    differ = misfits = named = 0
    with executor_of(workers) as executor:
        calls = [(seed,) for seed in range(studies)]
        held_by_seed: list[CalibrationResult] = list(results(executor, calibrated_study, case, calls))
    for result in held_by_seed:
        differs = any(spread.differs for spread in result.spreads.values())
        differ += differs
        records = [one for channels in result.residuals.values() for one in channels.values() if one.is_misfit]
        misfits += bool(records) or any(one.is_contradicted for one in result.parameters.values())
        named += case.cause in [*_causes(records), *[DIFFERENCES] * differs]
        for name, estimate in result.parameters.items():
            if name in truth:
                found.setdefault(name, []).append((estimate.value, estimate.interval))
    rows: list[Coverage] = []
    for name, held in found.items():
        ends = np.array([interval for _, interval in held if interval is not None]).reshape(-1, 2)
        inside = np.sum((ends[:, 0] <= truth[name]) & (truth[name] <= ends[:, 1]))
        far = [_distance(truth[name], value, interval) for value, interval in held if interval is not None]
        times = float(np.quantile(far, 0.9)) if np.isfinite(far).all() and far else None
        error = float(np.sqrt(np.mean([(value - truth[name]) ** 2 for value, _ in held])))
        ratio = float(np.mean(ends[:, 1] - ends[:, 0])) / 2 / (1.96 * error) if len(ends) else float("nan")
        rows.append(Coverage(case, name, len(held), len(ends), int(inside), ratio, differ, misfits, named, times))
    return rows


def _distance(true: float, value: float, interval: tuple[float, float]) -> float:
    """How far the true value is from the estimate, over the length of the interval on that side."""
    side = abs((interval[0] if true < value else interval[1]) - value)
    return abs(true - value) / side if side else float("inf") * (true != value)


def _causes(records: Sequence[ResidualRecord]) -> list[str]:
    """What is said of the records: the first two causes of the channel of which a cause explains the largest share,
    outliers, steps.
    """
    clearest = max(records, key=lambda one: max(one.explained.values(), default=0.0), default=None)
    words = [] if clearest is None else list(clearest.explained)[:2]
    outliers, steps = any(one.outliers for one in records), any(one.step for one in records)
    return [*words, *[OUTLIERS] * outliers, *[STEPS] * steps]


def calibrated_study(case: Case, seed: int) -> CalibrationResult:
    """One study, calibrated."""
    return calibrate(study(case, seed), starts=1)


def study(case: Case, seed: int) -> Problem:
    """One study: the twin's own answers at the truth, with noise."""
    chance = np.random.default_rng([seed, 2026])
    if case.true == PNEUNET_TRUE:  # not `is`: a worker has a copy
        return _pneunet_study(case, chance)
    return _neck_study(case, chance) if case.n else _manipulator_study(case, chance)


def _neck_study(case: Case, chance: np.random.Generator) -> Problem:
    robot, twin = neck()
    true = TRUE | case.truth
    robot = with_parameters(robot, {NU: true[NU]})
    experiments: list[Experiment] = []
    gains = {"tension": 1.0 + case.gain * chance.standard_normal() if case.gain else 1.0, "pitch": 1.0}
    for name, reach in zip(case.pulls, case.reaches, strict=True):
        shortening = np.linspace(REACH[0], reach, case.n)
        if case.loop:
            shortening = np.concatenate([shortening[::2], shortening[::-2]])
        of_robot = {
            E: true[E] * np.exp(case.spread * chance.standard_normal()) if case.spread else true[E],
            NU: true[NU],
        }
        pulled = Protocol({"front": Command("shortening", shortening - true[SLACK])})
        made = other_neck(case.law, case.touches) if case.law or case.touches else twin
        seen = made(with_parameters(robot, of_robot), pulled)
        channels = {"shortening": Channel(shortening, "m")}
        for kind, unit, channel, share in (
            ("tension", "N", "front.tension", 1.0),
            ("pitch", "rad", "plate.pitch", 1 / 3),
        ):
            values = gains[kind] * seen.channels[channel] + NOISE[kind] * _noise(case, chance)
            if case.bends and kind == "tension":
                values = values + seen.channels[channel] * np.expm1(case.bends * np.abs(seen.channels["plate.pitch"]))
            if case.loop and kind == "tension":
                values = values + case.loop * seen.channels[channel] * np.repeat([1.0, -1.0], case.n // 2)
            if case.relaxes and kind == "tension":
                values = values + case.relaxes * seen.channels[channel] * np.expm1(-np.linspace(0.0, 3.0, case.n))
            if case.turned and kind == "pitch":
                values = values + case.turned
            if case.outliers:
                far = chance.random(case.n) < case.outliers
                values = values + 20.0 * NOISE[kind] * chance.choice([-1.0, 1.0], case.n) * far
            if case.step and kind == "tension":
                values = case.step * np.round(values / case.step)
            if case.drift:
                values = values + case.drift * NOISE[kind] * chance.choice([-1.0, 1.0]) * np.linspace(0.0, 1.0, case.n)
            if case.misfit:
                size = share * case.misfit * float(np.sqrt(np.mean(seen.channels[channel] ** 2)))
                values = values + size * _smooth(case.n, chance)
            channels[kind] = Channel(values, unit, case.stated * NOISE[kind])
        pulleys = Pulleys(count=2, wrap=np.pi, friction_coefficient=TRUE[PULLEY_FRICTION])
        rig = Rig(pulleys=None if case.loop else pulleys)
        experiments.append(Experiment(name, Dataset(name, channels), cable="front", plate="plate", rig=rig))
    free = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=true[E]),
        FreeParameter(NU, "1", *case.ratios, start=true[NU]),
        FreeParameter(SLACK, "m", 0.0, 6e-3, start=true[SLACK], per_experiment=len(experiments) > 1),
    ]
    free = [parameter for parameter in free if parameter.name in {*case.truth, SLACK}]
    if PULLEY_FRICTION in case.truth:
        mean = TRUE[PULLEY_FRICTION] + PRIOR_SD * chance.standard_normal()
        friction = FreeParameter(PULLEY_FRICTION, "1", 0.0, 0.3, start=TRUE[PULLEY_FRICTION])
        free.append(replace(friction, prior_mean=mean, prior_sd=PRIOR_SD))
    uncertain = [UncertainParameter("front.tension_gain", "1", case.gain)] if case.gain else []
    if case.states_drift:
        drifts = (("front.tension_drift", "N", "tension"), ("plate.pitch_drift", "rad", "pitch"))
        if case.drift:
            uncertain += [UncertainParameter(name, unit, case.drift * NOISE[kind]) for name, unit, kind in drifts]
        else:
            steady = {name: 0.0 for name, *_ in drifts}
            experiments = [replace(one, settings=steady) for one in experiments]
    return make_problem(robot, experiments, free, case.loss, twin, uncertain)


def _noise(case: Case, chance: np.random.Generator) -> np.ndarray:
    """Noise of unit variance along a record, with the case's correlation of neighbours."""
    from scipy.signal import lfilter

    values = chance.standard_normal(case.n)
    if not case.correlation:
        return values
    values[1:] *= np.sqrt(1 - case.correlation**2)
    return lfilter([1.0], [1.0, -case.correlation], values)


def _smooth(n: int, chance: np.random.Generator) -> np.ndarray:
    """One wave along the record, of random phase and size (root mean square one in the mean)."""
    turn = 2 * np.pi * np.linspace(0, 1, n)
    return np.cos(turn) * chance.standard_normal() + np.sin(turn) * chance.standard_normal()


def _manipulator_study(case: Case, chance: np.random.Generator) -> Problem:
    from softcal.calibration.problem.frame import rotation

    robot, twin = manipulator(case.six)
    noise = (2e-4 if case.six else 5e-4) * np.array([1.0, 1.0, case.depth])
    experiments: list[Experiment] = []
    cables, markers = (SIX, EIGHT) if case.six else (CABLES, MARKERS)
    off = {marker: case.off * chance.standard_normal(3) for marker in markers} if case.off else {}
    for cable in cables:
        pulled = 1.0 + case.pulled * chance.standard_normal() if case.pulled else 1.0
        channels = {f"{cable}.tension": Channel(np.array(FORCES), "N")}
        for marker in markers:
            places = np.column_stack([_at(twin, cable, f"{marker}.{axis}", pulled) for axis in "xyz"])
            places = places + off.get(marker, 0.0)
            places = places @ rotation(np.array(CAMERA[3:])).T + CAMERA[:3]
            places = places + noise * chance.standard_normal(places.shape)
            channels |= {f"{marker}.{axis}": Channel(places[:, k], "m", noise[k]) for k, axis in enumerate("xyz")}
        data = Dataset(cable, channels)
        experiments.append(Experiment(cable, data, drive=(f"{cable}.tension",), rig=Rig(length=LENGTH)))
    free = [FreeParameter(name, "Pa", 0.1e9, 10e9, "log", start=value) for name, value in SPRINGS.items()]
    free += [
        FreeParameter(name, "m" if k < 3 else "rad", true - 0.5, true + 0.5, start=true)
        for k, (name, true) in enumerate(zip(FRAME, CAMERA, strict=True))
    ]
    return make_problem(robot, experiments, free, case.loss, twin)


def _pneunet_study(case: Case, chance: np.random.Generator) -> Problem:
    project, twin = pneunet()
    robot = with_parameters(project.robot, case.truth)
    experiments: list[Experiment] = []
    for name, experiment in project.experiments.items():
        seen, channels = twin(robot, _as_commanded(experiment)), dict(experiment.dataset.channels)
        for channel in experiment.compared:
            values = seen.channels[channel] + experiment.sigma(channel) * chance.standard_normal(
                len(seen.channels[channel])
            )
            channels[channel] = replace(channels[channel], values=values)
        steady = {"main.pressure_drift": 0.0} if case.states_drift else {}
        experiments.append(replace(experiment, dataset=Dataset(name, channels), settings=steady))
    free = [
        FreeParameter(name, unit, *ends, start=case.truth[name])
        for (name, ends), unit in zip(PNEUNET_RANGES.items(), ("Pa", "m^3"), strict=True)
    ]
    return make_problem(project.robot, experiments, free, case.loss, twin)


def _at(twin: ComplianceTable, cable: str, channel: str, factor: float) -> np.ndarray:
    """A coordinate (n,) [m] under the forces times a factor near one, by the parabola through those of the table."""
    values = twin.places[cable][channel]
    return values if factor == 1.0 else np.polyval(np.polyfit(FORCES, values, 2), factor * np.array(FORCES))


@cache
def neck(reach: float = REACH[1] + 5e-4) -> tuple[Robot, NeckTable]:
    """The neck of examples/neck-bench (2k P2P1 tets), and its table up to a shortening [m]. There is no contact: its
    curve has kinks that polynomials do not follow.
    """
    robot = replace(load(NECK).robot, contact=None)
    return robot, neck_table(robot, reach)


@cache
def other_neck(law: str, touches: bool) -> Callable[[Robot, Protocol], Response]:
    """The twin of the neck with another law of the same moduli at small strain, or with contact."""
    robot = load(NECK).robot
    robot = with_parameters(robot if touches else replace(robot, contact=None), {name: TRUE[name] for name in (E, NU)})
    if law:
        C10 = TRUE[E] / (4.0 * (1.0 + TRUE[NU]))
        C20, C30 = (over * C10 for over in OTHER_LAWS[law])
        parameters = {"C10": C10, "C20": C20, "C30": C30, "bulk_modulus": TRUE[E] / (3.0 * (1.0 - 2.0 * TRUE[NU]))}
        robot = replace(robot, bodies=(replace(robot.bodies[0], law="yeoh", parameters=parameters), *robot.bodies[1:]))

    @cache
    def pulled(*shortening: float) -> Response:
        return simulate(robot, pull(np.array(shortening)), crossings=False)

    return lambda _, protocol: pulled(*protocol.commands["front"].values.tolist())


@cache
def manipulator(six: bool = False) -> tuple[Robot, ComplianceTable]:
    """The manipulator of `softcal init manipulator` and its table; six: that of examples/manipulator."""
    robot = load(EXAMPLE if six else MANIPULATOR).robot
    return robot, compliance_table(robot, SPRINGS, *((SIX, EIGHT) if six else (CABLES, MARKERS)), FORCES)


def _as_commanded(experiment: Experiment) -> Protocol:
    """The protocol of an experiment that drives one actuator."""
    (drive,) = experiment.drives
    name = channel_name(drive)
    return Protocol({name.carrier: Command(name.kind.name, experiment.dataset.values(drive))})


@cache
def pneunet() -> tuple[Project, ParameterTable]:
    """examples/pneunet, and its responses to both tests over modulus and dead volume."""
    project = load(PNEUNET)
    protocols = [_as_commanded(experiment) for experiment in project.experiments.values()]
    return project, parameter_table(project.robot, protocols, PNEUNET_RANGES, (6, 4))


def page(found: Sequence[Coverage]) -> str:
    """docs/uncertainty.md with the table of what was found."""
    head = ["Study", "Parameter", "True value", "Intervals given", "Coverage", "Length", "Misfit said", "Cause named"]
    rows = [
        [
            one.case.words,
            one.parameter,
            format_quantity(one.case.truth[one.parameter], _unit(one.parameter)),
            f"{one.given} of {one.studies}",
            f"{100 * one.share:.1f} %",
            f"{one.ratio:.2f}",
            "–" if one.misfits is None else f"{100 * one.misfits / one.studies:.0f} %",
            "–" if one.named is None or not one.case.cause else f"{100 * one.named / one.studies:.0f} %",
        ]
        for one in found
    ]
    studies = max(one.studies for one in found)
    told = {"table": "\n".join(table(head, rows)), "studies": str(studies)}
    told["sampling"] = f"{100 * np.sqrt(0.95 * 0.05 / studies):.1f}"
    compared = [case.name for case in CASES if case.reaches == FOUR]
    differ = {one.case.name: f"{one.differ} of {one.studies}" for one in found}
    told |= {f"differ {name}": differ.get(name, "(not run)") for name in compared}
    slack = {one.case.name: one for one in found if one.parameter == SLACK}
    for loss in (LIKELIHOOD.name, PAPERS.name):
        drifting, steady = (slack.get(f"{loss}-{name}") for name in ("drift-3", "steady"))
        known = drifting and steady and drifting.times
        told[f"times {loss}"] = f"{drifting.times:.2f}" if known else "(not run)"
        told[f"long {loss}"] = f"{drifting.times * steady.ratio:.2f}" if known else "(not run)"
    return written_page(PAGE, told)


def _unit(parameter: str) -> str:
    kind = parameter.rpartition(".")[2]
    return {"youngs_modulus": "Pa", "slack": "m", "dead_volume": "m^3"}.get(kind, "1")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES, help=f"of each case; {STUDIES} by default")
    names = [case.name for case in CASES]
    parser.add_argument("--cases", nargs="+", metavar="NAME", choices=names, default=names, help=", ".join(names))
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/uncertainty.md by default")
    parser.add_argument("--workers", type=int, help="number of processes, 1 by default")
    parser.add_argument("--on", default="local", help="local, dask:ADDRESS or slurm, as of softcal's commands")
    arguments = parser.parse_args()
    known = json.loads(STORED.read_text(encoding="utf-8"))
    with executor_on(arguments.on, arguments.workers) as executor:
        for case in CASES:
            if case.name not in arguments.cases:
                continue
            began = time.perf_counter()
            rows = coverage(case, min(arguments.studies, case.studies), executor)
            print(f"{case.name}: {time.perf_counter() - began:.0f} s")
            for one in rows:
                share = f"{one.held} of {one.given} contain the true value ({one.studies} studies)"
                print(f"  {one.parameter}: {share}, length {one.ratio:.2f}")
            known[case.name] = [
                {field.name: getattr(one, field.name) for field in fields(one) if field.name != "case"} for one in rows
            ]
            if arguments.out == PAGE:
                STORED.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    found = [Coverage(case, **row) for case in CASES for row in known.get(case.name, [])]
    arguments.out.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
