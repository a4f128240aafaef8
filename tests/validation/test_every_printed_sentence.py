"""Every sentence and every cell that `calibrate` prints of the shipped examples, recomputed.

A table of sentences (`SENTENCES`) and one of rows (`ROWS`): each has a function that recomputes numbers and verdict,
by the second implementation of the statistics in `second_statistics.py`. What is printed and matched by no entry, or by
two, fails. An error with the mesh is that without it, and the share that the run says the mesh has; where bounds are
active the mesh moves what they cut off too, so a tenth is allowed (`ABOUT`), as where a process along a record is found
by another search.
"""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from second_statistics import (
    Block,
    Estimator,
    Fit,
    causes,
    effective,
    local_hessian,
    minimum_distance,
    profile_interval,
)

import softcal

ROOT = Path(__file__).parents[2]
V = r"(-?[\d.]+\d|-?\d)(?:e-?\d+)?"  # a number
ABOUT, CLOSE = 0.10, 0.02  # of an error with the mesh, or a process along a record; of any other
P = (
    r"(?:at the (?P<level>5) % level|p (?P<sign>=|<) (?P<p>[\d.]+(?:e-?\d+)?)(?P<more> or more)?)"
    r"(?:, Holm's correction for (?P<holm>\d+) comparisons)?"
)
LABEL = r"(?:E|ν|\w+ \([^)]*\))"  # of a parameter
LIST = rf"(?P<list>{V} \(\w+\)(?:(?:, | and ){V} \(\w+\))*)"  # of values and their tests
ITEM = rf"(?P<channel>\w+) of (?P<of>\w+) by (?P<size>{V}) (?P<unit>\w+) \(RMS\), "
CAUSE = rf"((?:an?|another) [\w ]+?|friction that reverses|contact of surfaces) alone (?:would explain )?{V} %"
UNITS = {
    "MPa": 1e6,
    "kPa": 1e3,
    "mm": 1e-3,
    "mm/N": 1e-3,
    "deg": math.pi / 180,
    "g": 1e-3,
    "N": 1.0,
    "%": 0.01,
    "": 1.0,
}

Told = re.Match[str]
ROWS: list[tuple[str, Callable[[Case, str, Told, str], None]]] = []
SENTENCES: list[tuple[str, Callable[[Case, list[str], Told], None]]] = []


def row(pattern: str) -> Callable[[Any], Any]:
    """Enter a check of the cells of a row: of the case, the column's label, the match of the title, and the text."""
    return lambda check: ROWS.append((pattern, check)) or check


def sentence(pattern: str) -> Callable[[Any], Any]:
    """Enter a check of a sentence: of the case, the labels before the sentence, and the match."""
    return lambda check: SENTENCES.append((pattern, check)) or check


@dataclass
class Case:
    """A run of an example, with what was printed at its end."""

    run: Path
    text: str
    project: softcal.Project
    last: tuple[str, str] = ("", "")  # of the sentence before: its calibration and its parameter

    @cached_property
    def fits(self) -> dict[str, Fit]:
        return {label: Fit(self.run, label, self.project) for label in self.labels}

    @cached_property
    def labels(self) -> list[str]:
        return json.loads((self.run / "run.json").read_text())["calibrations"]

    @property
    def joint(self) -> Fit:
        return self.fits["joint"]

    @property
    def each(self) -> dict[str, Fit]:
        return {label: fit for label, fit in self.fits.items() if label != "joint"}

    @cached_property
    def _estimators(self) -> dict[str, Estimator]:
        return {label: Estimator(fit) for label, fit in self.fits.items()}

    def estimator(self, label: str) -> Estimator:
        return self._estimators[label]

    def mesh(self, label: str, name: str) -> float:
        """The mesh's share of a variance, as the run has it."""
        return self.fits[label].p[name].get("shares", {}).get("mesh", 0.0)

    def within(self, label: str, name: str) -> float:
        """How far the second implementation may be from a standard error."""
        along = any(source.along for source in self.estimator(label).sources)
        return ABOUT if along or self.mesh(label, name) else CLOSE


def like(text: str, value: float, within: float = 0.0, *, tens: bool = False) -> None:
    """A printed number is this value, to its last digit and `within` of it; tens: "900" may be to the ten."""
    number = re.match(V, text)
    assert number is not None
    mantissa, _, exponent = number[0].partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    last *= 10.0 if tens and re.search(r"\d0$", mantissa) and "." not in mantissa else 1.0
    far = abs(float(number[0]) - value)
    assert far <= 0.5001 * last + within * abs(value), f"printed {text}, recomputed {value:.6g}"


def named(fit: Fit, label: str) -> str:
    """The parameter of a label: "E", "mass (discs)", "x (frame, loads)"."""
    of = re.match(r"([\w ]+?)(?: \((\w+)(?:, (\w+))?\))?$", label)
    assert of is not None, label
    kind = {"E": "youngs_modulus", "ν": "poissons_ratio"}.get(of[1], of[1].replace(" ", "_"))
    own, owner = f"[{of[3]}]" if of[3] else "", of[2] or r"\w+"
    (found,) = (n for n in fit.names if re.fullmatch(owner + re.escape(f".{kind}{own}"), n))
    return found


def covers(case: Case, label: str, name: str) -> float:
    """The part of the allowed range that a 95 % interval covers; the mesh's share makes it longer."""
    low, high, _ = case.estimator(label).interval(name)
    return case.fits[label].place(name, high) - case.fits[label].place(name, low)


# Cells of the table.


@row(r"[\w.]+\.\w+(?:\[\w+\])?")
def value_cell(case: Case, label: str, told: Told, text: str) -> None:
    fit, name = case.fits[label], told[0]
    j = fit.names.index(name)
    text, _, doubt = text.removesuffix(")").partition(" (")
    unit = next((u for u in UNITS if u and text.endswith(f" {u}")), "")
    value, _, error = text.removesuffix(unit).strip().partition(" ± ")
    column = next(c for c in fit.best if c.split(" [")[0] == name or c.startswith(f"{name} ["))
    like(value, float(fit.best[column]) / UNITS[unit], tens=True)
    nearest_bound = min(abs(fit.z[j]), abs(fit.z[j] - 1.0))
    covered = covers(case, label, name)
    if abs(covered - 0.9) >= 0.02:
        assert (doubt == "not determined") == (covered >= 0.9)
    assert (doubt == "at a bound") == (nearest_bound < 1e-6 and doubt != "not determined")
    assert bool(doubt) == (not error)
    if error:
        _, _, own = case.estimator(label).interval(name)
        like(error, own / math.sqrt(1 - case.mesh(label, name)) / UNITS[unit], case.within(label, name), tens=True)
    assert minimum_distance(fit, case.estimator(label)) < 0.05


@row(r"95 % interval of (\S+)")
def interval_cell(case: Case, label: str, told: Told, text: str) -> None:
    is_interval(case, label, told[1], text)


def is_interval(case: Case, label: str, name: str, text: str) -> None:
    unit = next((u for u in UNITS if u and text.endswith(f" {u}")), "")
    fit = case.fits[label]
    low, high, _ = case.estimator(label).interval(name)
    mesh = case.mesh(label, name)
    # On the scale of the search; printed to the second digit of the half-width, which is at most 5 % of it.
    half = (fit.place(name, high) - fit.place(name, low)) / 2
    within = 0.05 + case.within(label, name) + 1 / math.sqrt(1 - mesh) - 1
    for printed, own in zip(text.removesuffix(unit).split(" to "), (low, high), strict=True):
        z = fit.place(name, float(printed) * UNITS[unit])
        assert abs(z - fit.place(name, own)) <= within * half, f"printed {text}, recomputed {low:.5g} to {high:.5g}"


@row(r"error of the mesh")
def mesh_cell(case: Case, label: str, told: Told, text: str) -> None:
    has_it = any(case.mesh(label, name) for name in case.fits[label].names)
    assert text == ("included" if has_it else "not included")


@row(r"RMSE of (\w+), (\w+)")
def rmse_cell(case: Case, label: str, told: Told, text: str) -> None:
    data = case.fits[label].data[told[2]]
    off = data[f"simulated.{told[1]}"] - data[f"measured.{told[1]}"]
    like(text, math.sqrt(np.nanmean(off**2)) / UNITS[text.split()[1]])


def distances(fit: Fit, e: str) -> np.ndarray:
    data, markers = fit.data[e], [c[10:-2] for c in fit.data[e] if c.startswith("simulated.") and c.endswith(".x")]
    off = [[data[f"simulated.{m}.{axis}"] - data[f"measured.{m}.{axis}"] for axis in "xyz"] for m in markers]
    found = np.sqrt(np.sum(np.square(off), axis=1)).ravel()
    return found[np.isfinite(found)]


@row(r"(?:held out: )?distance, mean and largest, (\w+)")
def distance_cell(case: Case, label: str, told: Told, text: str) -> None:
    length = case.project.experiments[told[1]].rig.length
    far = distances(case.fits[label], told[1])
    printed = re.fullmatch(rf"{V} and {V} mm \({V} and {V} %\)", text)
    assert printed is not None
    for one, value, unit in zip(
        printed.groups(), (far.mean(), far.max()) * 2, (1e-3, 1e-3, *[length / 100] * 2), strict=True
    ):
        like(one, value / unit)


@row(r"trials")
def trials_cell(case: Case, label: str, told: Told, text: str) -> None:
    like(text, len(case.fits[label].trials))


@row(r"loss")
def loss_cell(case: Case, label: str, told: Told, text: str) -> None:
    fit = case.fits[label]
    if fit.loss == "likelihood":
        value = sum(float(np.sum(b.w * b.r**2)) for b in fit.blocks)
    elif fit.loss == "papers":
        weights = {"tension": 0.3, "pitch": 1.0}
        value = sum(weights[b.channel] * math.sqrt(np.mean(b.r**2)) for b in fit.blocks) / len(fit.experiments)
    else:
        far = np.concatenate([distances(fit, e) for e in fit.experiments])
        value = 100 * math.sqrt(np.mean(far**2)) / case.project.experiments[fit.experiments[0]].rig.length
    like(text, value, 1e-6)


# Sentences.

OF_ITS_OWN = ("noise", "drift", "prior", "bounds")  # what an experiment errs in by itself


def values_of(text: str) -> dict[str, str]:
    """Test -> its printed value."""
    return {label: value for value, label in re.findall(r"(-?[\d.]+) \((\w+)\)", text)}


@sentence(
    r"(?P<what>\S+) differs between the separate fits by (?P<size>[\d.]+) %, from (?P<low>[\d.]+) "
    r"(?P<unit>\w+) \((?P<least>\w+)\) to (?P<high>[\d.]+) (?P<unit_too>\w+) \((?P<most>\w+)\): "
    r"(?P<verdict>more|no more) than their noise explains \(Cochran's Q = (?P<q>[\d.]+) without the errors "
    rf"that all fits share, (?P<dof>\d+) degrees? of freedom, {P}\)(?P<conflict>\. One value does not describe "
    r"all tests)?"
)
def spread_of_fits(case: Case, _: list[str], told: Told) -> None:
    name = named(case.joint, told["what"])
    values = {label: fit.p[name]["value"] for label, fit in case.each.items()}
    low, high = (pick(values, key=values.__getitem__) for pick in (min, max))
    assert (low, high) == (told["least"], told["most"])
    for printed, unit, label in ((told["low"], told["unit"], low), (told["high"], told["unit_too"], high)):
        like(printed, values[label] / UNITS[unit], tens=True)
    like(told["size"], 100 * (values[high] - values[low]) / ((values[low] + values[high]) / 2), tens=True)
    y, s = [], []
    for label, value in values.items():
        if case.fits[label].p[name]["standard_error"] is None:
            continue  # excluded
        estimator, j = case.estimator(label), case.fits[label].names.index(name)
        shares = {kind: share[j] for kind, share in estimator.shares.items()}
        own = sum(v for kind, v in shares.items() if kind in OF_ITS_OWN or kind.endswith("of each experiment"))
        y.append(math.log(value))
        s.append(estimator.interval(name)[2] * math.sqrt(own) / value)
    w = 1 / np.square(s)
    q = float(w @ (np.array(y) - w @ y / w.sum()) ** 2)
    like(told["q"], q, 2 * CLOSE)
    assert int(told["dof"]) == len(y) - 1
    p = float(stats.chi2.sf(float(told["q"]), len(y) - 1))
    chance(told, len(y), p, p)
    assert (told["verdict"] == "more") == (p < 0.05) == bool(told["conflict"])


@sentence(
    rf"With (?P<other>\S+) = (?P<at>{V}) in all, (?P<what>E|)(?:it)? ?is {LIST} (?P<unit>\w+), "
    "estimated from the derivatives at the joint fit"
)
def at_one_value(case: Case, _: list[str], told: Told) -> None:
    """One step from the joint fit; each test, fitted again by itself with the other parameter fixed there, is near."""
    name, fixed = named(case.joint, told["what"] or "E"), named(case.joint, told["other"])
    fit, j = case.joint, case.joint.names.index(name)
    like(told["at"], fit.p[fixed]["value"])
    project = softcal.load(case.project.path, values={fixed: case.joint.p[fixed]["value"]})
    found = softcal.calibrate(project, fit="each", mesh_error=False)
    for label, printed in values_of(told["list"]).items():
        like(printed, fit.value(name, fit.z[j] + case.estimator("joint").between[j].steps[label]) / UNITS[told["unit"]])
        like(printed, found.results[label].parameters[name].value / UNITS[told["unit"]], 0.04)


@sentence(r"No separate fit determines (\S+?)(?=\.)")
def none_determines(case: Case, _: list[str], told: Told) -> None:
    assert all(covers(case, label, named(fit, told[1])) >= 0.9 for label, fit in case.each.items())


def chance(told: Told, n: int, least: float, most: float) -> None:
    """A comparison of five tests or more has a p-value, which is that of the second implementation."""
    assert bool(told["level"]) == (n < 5)
    if told["level"]:
        return
    if told["sign"] == "<":
        assert most < float(told["p"]) == 1e-10
    else:
        assert 0.95 * least <= float(told["p"]) <= 1.05 * most


def corrected(told: Told, estimator: Estimator) -> None:
    """The number of comparisons that a p-value is corrected for."""
    n = len(estimator.between)
    assert told["holm"] is None if n == 1 else int(told["holm"]) == n


@sentence(
    rf"(?P<what>{LABEL}) differs between the tests by more than their noise explains \({P}\): {LIST} "
    r"(?P<unit>\w+), estimated from the derivatives at the joint fit"
    r"(?P<fixed>, with the other shared parameters at their joint values)?"
)
def differing_tests(case: Case, labels: list[str], told: Told) -> None:
    (label,) = labels
    fit, estimator = case.fits[label], case.estimator(label)
    name = named(fit, told["what"])
    one = estimator.between[fit.names.index(name)]
    corrected(told, estimator)
    assert one.differs
    assert one.p_most < 0.05
    chance(told, len(one.steps), one.p_least, one.p_most)
    printed = values_of(told["list"])
    assert list(printed) == list(one.steps)
    for test, text in printed.items():
        like(text, fit.value(name, fit.z[fit.names.index(name)] + one.steps[test]) / UNITS[told["unit"]])
    assert bool(told["fixed"]) == (len(estimator.between) > 1)
    case.last = label, name


@sentence(r"(-?[\d.]+) (\w+) minimises the joint loss, but the mean of the tests is (-?[\d.]+) (\w+)")
def mean_of_tests(case: Case, labels: list[str], told: Told) -> None:
    label, name = case.last
    fit, one = case.fits[label], case.estimator(label).between[case.fits[label].names.index(name)]
    like(told[1], fit.p[name]["value"] / UNITS[told[2]])
    z, own = fit.z[fit.names.index(name)], {}
    for test, step in one.steps.items():
        own[test] = fit.value(name, z + step)
    mean = sum(one.weights[test] * value for test, value in own.items())
    like(told[3], mean / UNITS[told[4]], 0.002)
    half = np.ptp(fit.p[name]["interval"]) / 2
    assert abs(mean - fit.p[name]["value"]) > 0.25 * half


@sentence(
    r"The 95 % interval is for the mean of many such tests(?P<same>, and also holds for|; that of) a single further "
    r"test(?: is (-?[\d.]+) to (-?[\d.]+) (\w+))?"
)
def further_test(case: Case, labels: list[str], told: Told) -> None:
    """The interval of one more test: the mean's, and the differences between tests once more."""
    label, name = case.last
    fit, estimator = case.fits[label], case.estimator(label)
    j, p = fit.names.index(name), fit.p[name]
    one = estimator.between[j]
    covariance = estimator.covariance.copy()
    covariance[j, j] += one.spread**2
    # Its degrees of freedom (Satterthwaite): what is between the tests has one less than there are tests.
    shared = sum(float(part[j]) for part in estimator.variances.values()) / (1 - case.mesh(label, name))
    between, further = float(estimator.variances["experiments"][j]), one.spread**2
    scatter = ((between + further) ** 2 - between**2) / (len(one.steps) - 1) + shared**2 / (p.get("dof") or math.inf)
    t = float(stats.t.ppf(0.975, (shared + further) ** 2 / scatter))
    low, high = np.clip(profile_interval(estimator.minimum, covariance, j, t), 0.0, 1.0)
    within = 0.05 + ABOUT + 1 / math.sqrt(1 - case.mesh(label, name)) - 1
    ends = p["interval"] if told["same"].startswith(", and") else [float(told[i]) * UNITS[told[4]] for i in (2, 3)]
    for printed, own in zip(ends, (low, high), strict=True):
        place = fit.place(name, printed)
        assert abs(place - own) <= within * (high - low) / 2, (
            f"printed {printed:.4g}, recomputed {fit.value(name, own):.4g}"
        )


@sentence(
    rf"(?P<what>{LABEL}(?:(?:, | and ){LABEL})*) do(?:es)? not differ between the tests by more than "
    rf"their noise explains \({P}\)"
)
def agreeing_tests(case: Case, labels: list[str], told: Told) -> None:
    (label,) = labels
    fit, estimator = case.fits[label], case.estimator(label)
    corrected(told, estimator)
    names = [named(fit, one) for one in re.findall(LABEL, told["what"])]
    alike = {j: one for j, one in estimator.between.items() if not one.differs}
    assert {fit.names.index(name) for name in names} <= set(alike)
    assert len(names) == len(alike)
    least, most = (min(getattr(one, end) for one in alike.values()) for end in ("p_least", "p_most"))
    assert most >= 0.05
    chance(told, min(len(one.steps) for one in alike.values()), least, most)
    assert told["level"] or bool(told["more"]) == (len({f"{one.p_most:.2g}" for one in alike.values()}) > 1)


@sentence(
    rf"Here each test has its own (?P<own>{LABEL}) too; with (?P<at>{LABEL}) at its joint value, in the joint fit, "
    rf"the tests differ \({P}\)"
)
def differ_at_the_joint_value(case: Case, labels: list[str], told: Told) -> None:
    assert told["own"] == told["at"]
    assert all(named(case.fits[label], told["own"]) in case.fits[label].names for label in case.fits)
    (one,) = (one for one in case.estimator("joint").between.values() if one.differs)
    chance(told, len(one.steps), one.p_least, one.p_most)


def residual_size(case: Case, labels: list[str], told: Told) -> tuple[Fit, Block]:
    fit = case.fits[labels[0]]
    (block,) = (b for b in fit.blocks if (b.channel, b.experiment) == (told["channel"], told["of"]))
    like(told["size"], math.sqrt(np.mean(block.r**2)) / UNITS[told["unit"]])
    return fit, block


def named_causes(fit: Fit, block: Block, text: str, least: float) -> tuple[list[float], list[float]]:
    """The clearest two causes of those that explain more than `least`, with the part of the channel's own squares that
    each explains: how clear each named one is, and its share, in their order. A share of 0 % is not shown.
    """
    _, worth, _, _ = causes(fit, block.experiment)[block.channel]
    clearest = sorted((pair for pair in worth.values() if pair[1] > least), reverse=True)[:2]
    clearest = [clear for clear, share in clearest if share > 0.005]
    named = re.findall(CAUSE, text)
    assert len({cause for cause, *_ in named}) == len(named) == len(clearest)
    for cause, share, *_ in named:
        assert worth[cause][0] >= 0.98 * clearest[-1], f"not one of the two clearest causes: {cause}"
        like(share, 100 * max(worth[cause][1], 0.0), CLOSE)
    return [worth[cause][0] for cause, *_ in named], [float(share) for _, share, *_ in named]


@sentence(rf"{ITEM}most (?P<where>at the start|at the end|\d+ % along the record)(?: \((?P<causes>[^)]*)\))?")
def is_curve(case: Case, labels: list[str], told: Told) -> None:
    fit, b = residual_size(case, labels, told)
    assert effective(b.r) < min(len(b.r) / 5, 10)
    part = max(len(b.r) // 20, 1)
    smooth = np.abs(np.convolve(b.r, np.ones(part) / part, "valid"))
    at = (int(smooth.argmax()) + (part - 1) / 2) / (len(b.r) - 1)
    expected = "at the start" if at < 0.1 else "at the end" if at > 0.9 else f"{100 * at:.0f} % along the record"
    assert told["where"] == expected
    _, shares = named_causes(fit, b, told["causes"] or "", 0.2)
    assert shares == sorted(shares, reverse=True)


@sentence(
    rf"in (?P<channel>\w+) of (?P<of>\w+) \((?P<size>{V}) (?P<unit>\w+) RMS\) the shape of a usual cause is "
    rf"(?P<sure>{V}) standard errors from zero"
)
def is_more_than_noise(case: Case, labels: list[str], told: Told) -> None:
    fit, b = residual_size(case, labels, told)
    assert effective(b.r) >= min(len(b.r) / 5, 10)
    _, _, _, significance = causes(fit, b.experiment)[b.channel]
    assert significance > 5
    like(told["sure"], significance, CLOSE)
    case.last = (labels[0], f"{told['channel']} of {told['of']}")


@sentence(rf"of the squares relative to the noise (?P<causes>{CAUSE}(?:, {CAUSE})?)")
def is_named_by_causes(case: Case, labels: list[str], told: Told) -> None:
    channel, of = case.last[1].split(" of ")
    fit = case.fits[case.last[0]]
    (block,) = (b for b in fit.blocks if (b.channel, b.experiment) == (channel, of))
    (clear, *others), _ = named_causes(fit, block, told["causes"], -1.0)
    assert clear >= 0.98 * max(others, default=0.0)


@sentence(
    rf"(?P<name>\S+) is at its (?P<side>upper|lower) bound of (?P<bound>{V}): (?:the value is "
    r"determined by the bound, not by the data|the best fit is beyond it, by about (?P<far>\d+) "
    r"standard errors)"
)
def at_bound(case: Case, labels: list[str], told: Told) -> None:
    for label in labels:
        fit, name = case.fits[label], told["name"]
        p, j = fit.p[name], fit.names.index(name)
        bound = p["upper" if told["side"] == "upper" else "lower"]
        assert abs(float(told["bound"]) - bound) < 1e-9
        assert abs(float(fit.best[f"{name} [{p['unit']}]"]) - bound) < 1e-6 * (p["upper"] - p["lower"])
        beyond = case.estimator(label).beyond[j]
        if told["far"]:  # the distance in the metric of the own covariance, with the others within their bounds
            assert beyond > 2
            assert abs(float(told["far"]) - beyond) <= 0.5 + CLOSE * beyond
        else:
            assert beyond <= 2 * (1 + CLOSE)


@sentence(r"model and bounds contradict the data: the errors of this fit are multiplied by the largest such number")
def widened(case: Case, labels: list[str], told: Told) -> None:
    """The intervals with that factor are those of the table (`interval_cell`); it is the largest, and above one."""
    assert all(case.estimator(label).factor == case.estimator(label).beyond.max() > 1 for label in labels)


@sentence(r"All (\d+) searches converged, each in (\d+ to \d+|\d+) trials")
def searches(case: Case, _: list[str], told: Told) -> None:
    n = [len(fit.trials) for fit in case.fits.values()]
    assert int(told[1]) == len(n)
    assert told[2] == (f"{min(n)} to {max(n)}" if min(n) < max(n) else str(n[0]))
    assert all(minimum_distance(fit, case.estimator(label)) < 0.05 for label, fit in case.fits.items())


@sentence(r"Converged in (\d+) trials, (?:less than )?([\d.]+) standard errors away from the minimum")
def converged(case: Case, labels: list[str], told: Told) -> None:
    fit = case.fits[labels[0]]
    assert int(told[1]) <= len(fit.trials)
    assert minimum_distance(fit, case.estimator(labels[0])) <= float(told[2]) * 2 + 0.005


@sentence(
    r"(\d+) trials in all(?:, including those of an additional first start with (\S+) in the middle of "
    r"the range, where elements do not lock)?"
)
def first_start(case: Case, labels: list[str], told: Told) -> None:
    """All trials are counted, and one of them is in the middle of the range where that is said."""
    fit = case.fits[labels[0]]
    assert int(told[1]) == len(fit.trials)
    if not told[2]:
        return
    p = fit.p[told[2]]
    values = [float(trial[f"{told[2]} [{p['unit']}]"]) for trial in fit.trials]
    assert any(abs(value - (p["lower"] + p["upper"]) / 2) < 0.05 * (p["upper"] - p["lower"]) for value in values)


@sentence(
    r"(?P<one>\S+) and (?P<other>\S+) move together: if (?P=other) were known, the error of (?P=one) "
    rf"would be (?P<share>{V}) % of what it is"
)
def together(case: Case, labels: list[str], told: Told) -> None:
    """The interval with the other parameter known, over the one without, both within the bounds."""
    fit, estimator = case.fits[labels[0]], case.estimator(labels[0])
    one, other = told["one"], told["other"]
    i, k = fit.names.index(one), fit.names.index(other)
    C, m = estimator.covariance, estimator.minimum
    left = [j for j in range(len(m)) if j != k]
    known = (C - np.outer(C[:, k], C[k]) / C[k, k])[np.ix_(left, left)]
    moved = (m + C[:, k] / C[k, k] * (fit.z[k] - m[k]))[left]
    before, after = (np.ptp(profile_interval(*of, 2.0)) for of in ((m, C, i), (moved, known, left.index(i))))
    like(told["share"], 100 * float(after / before), ABOUT)
    assert after / before < 0.5


@sentence(
    rf"The residuals of (?P<group>\w+) show a noise of (?P<seen>{V}) (?P<unit>\w+), far below the stated (?P<said>{V}) "
    r"(?P<of>\w+)(?: on average)?: independent noise of that size would leave such residuals with a probability below "
    r"0\.001\. The intervals use the stated noise"
)
def noise_stated_too_large(case: Case, labels: list[str], told: Told) -> None:
    for label in labels:
        fit = case.fits[label]
        own = [b for b in fit.blocks if b.experiment and b.group == told["group"]]
        over, stated = np.concatenate([b.r / b.unit for b in own]), np.concatenate([b.unit for b in own])
        dof, rms = len(over) - len(fit.names), math.sqrt(np.mean(stated**2))
        like(told["said"], rms / UNITS[told["of"]], CLOSE)
        like(told["seen"], rms * math.sqrt(over @ over / dof) / UNITS[told["unit"]], CLOSE)
        assert stats.chi2.cdf(over @ over, dof) < 0.001


@sentence(r"The intervals include the noise and its correlation along the records(.*?)(?=\. Not included)")
def included(case: Case, labels: list[str], told: Told) -> None:
    for label in labels:
        estimator = case.estimator(label)
        kinds = {source.kind for source in estimator.sources}
        kinds |= {"mesh"} if any(case.mesh(label, name) > 0 for name in case.fits[label].names) else set()
        listed = set(re.findall(r"the uncertainty of (\S+(?: of each experiment)?)", told[1].replace(",", "")))
        assert listed == {u[0] for u in case.fits[label].uncertain} <= kinds
        assert ("drifts too small to be seen in the noise" in told[1]) == ("drift" in kinds)
        assert ("what the model misses in the residuals, or may miss" in told[1]) == ("misfit" in kinds)
        assert ("the error of the mesh" in told[1]) == ("mesh" in kinds)


@sentence(
    r"Not included: errors (of the mesh, )?of the material law and of the (rest of the )?model of the rig that are the "
    r"same in all tests and leave no residual"
)
def not_included(case: Case, labels: list[str], told: Told) -> None:
    for label in labels:
        mesh = any(case.mesh(label, name) > 0 for name in case.fits[label].names)
        assert mesh != bool(told[1])
        assert bool(told[2]) == bool(case.fits[label].uncertain)


@sentence(r"Those of ([\w, ]+) do not include the error of the mesh")
def without_mesh(case: Case, _: list[str], told: Told) -> None:
    for label in told[1].split(", "):
        fit = case.fits[label]
        assert not any(case.mesh(label, name) for name in fit.names)


@sentence(r"(\w+) \((\d+) states\): not measured, and so not compared: ([^.]*)")
def not_measured(case: Case, _: list[str], told: Told) -> None:
    data, dataset = case.joint.data[told[1]], case.project.experiments[told[1]].dataset
    states = dataset.labels or [str(i + 1) for i in range(dataset.n_samples)]
    assert int(told[2]) == len(states)
    expected = {}
    for column in data:
        if marker := re.fullmatch(r"simulated\.(\w+)\.x", column):
            gone = [s for s, x in zip(states, data[f"measured.{marker[1]}.x"], strict=True) if not math.isfinite(x)]
            if gone:
                expected[marker[1]] = gone
    found = {}
    for text in told[3].split("; "):
        marker, count, names = re.fullmatch(r"(\w+) in (?:state|(\d+) states) \(?([\w, ]+)\)?", text).groups()
        found[marker] = names.split(", ")
        assert count is None or int(count) == len(found[marker])
    assert found == expected


@sentence(r"No single (\S+) fits the tests \(([\d.]+) to ([\d.]+) (\w+)\)")
def contradict(case: Case, _: list[str], told: Told) -> None:
    fit, estimator = case.joint, case.estimator("joint")
    name = named(fit, told[1])
    j = fit.names.index(name)
    one = estimator.between[j]
    ends = [fit.value(name, fit.z[j] + pick(one.steps.values())) for pick in (min, max)]
    for printed, end in zip(told.groups()[1:3], ends, strict=True):
        like(printed, end / UNITS[told[4]])
    assert one.differs
    assert np.ptp(ends) > np.ptp(fit.p[name]["interval"]) / 2


@sentence(r"First find why the tests differ")
def first(case: Case, labels: list[str], told: Told) -> None:
    """It follows where no single value fits the tests, which is printed and checked."""
    (found,) = re.finditer(r"No single (\S+) fits the tests \(([\d.]+) to ([\d.]+) (\w+)\)", case.text)
    contradict(case, labels, found)


@sentence(rf"(?P<what>E) = (?P<value>{V}) (?P<unit>\w+) \(95 %: (?P<ends>[\d.]+ to [\d.]+) (?P=unit)\)")
def estimate(case: Case, _: list[str], told: Told) -> None:
    name = named(case.joint, told["what"])
    like(told["value"], case.joint.p[name]["value"] / UNITS[told["unit"]], tens=True)
    is_interval(case, "joint", name, f"{told['ends']} {told['unit']}")
    assert covers(case, "joint", name) < 0.9


@sentence(r"and (ν) anywhere in (?P<ends>[\d.]+ to [\d.]+)")
def anywhere(case: Case, _: list[str], told: Told) -> None:
    name = named(case.joint, told[1])
    is_interval(case, "joint", name, told["ends"])
    assert covers(case, "joint", name) * (1 + ABOUT) >= 0.9


@sentence(
    r"from (?P<n>\d+) tests(?: whose (?P<all>\d+) measured values are correlated and worth "
    r"(?P<worth>\d+) independent values)?"
)
def basis(case: Case, _: list[str], told: Told) -> None:
    assert int(told["n"]) == len(case.joint.experiments)
    records = [b.r for b in case.joint.blocks if b.experiment and len(b.r) > 1]
    worth = [float(np.clip(effective(r), 1.0, len(r))) for r in records]
    alike = any(len(r) >= 8 and w < len(r) / 3 for r, w in zip(records, worth, strict=True))
    assert alike == bool(told["all"])
    if told["all"]:
        assert int(told["all"]) == sum(len(r) for r in records)
        like(told["worth"], sum(worth), 0.01)


@sentence(r"The data do not determine (ν): its interval covers nearly the whole allowed range")
def not_determined(case: Case, _: list[str], told: Told) -> None:
    assert covers(case, "joint", named(case.joint, told[1])) * (1 + ABOUT) >= 0.9


SOURCES = {
    "the noise of the measurements": "noise",
    "the mesh": "mesh",
    "differences between the tests": "experiments",
    "what the model misses in the residuals, or may miss": "misfit",
    "ν, which the data leave open within the bounds": "bounds",
}


@sentence(
    r"(?P<share>\d+) % of the variance of (?P<what>\S+) comes from (?P<source>[^:]+): "
    r"(?P<remedy>[^.]+)"
)
def largest_source(case: Case, _: list[str], told: Told) -> None:
    name = named(case.joint, told["what"])
    j, mesh = case.joint.names.index(name), case.mesh("joint", name)
    shares = {kind: float(share[j]) * (1 - mesh) for kind, share in case.estimator("joint").shares.items()}
    if mesh:  # by the run; and by how much shorter the own standard error is without it
        shares["mesh"] = 1 - (case.estimator("joint").interval(name)[2] / case.joint.p[name]["standard_error"]) ** 2
    of = re.fullmatch(r"the uncertainty of the ([\w ]+) \((\w+)\)", told["source"])
    kind = f"{of[2]}.{of[1].replace(' ', '_')}" if of else SOURCES[told["source"]]
    like(told["share"], 100 * shares[kind], ABOUT)
    assert abs(sum(case.joint.p[name]["shares"].values()) - 1) < 1e-9
    assert shares[kind] >= (1 - ABOUT) * max(shares.values())
    assert told["remedy"] == REMEDIES.get(kind, "measuring it more precisely will reduce it")


REMEDIES = {
    "noise": "more independent measurements, or better ones, will reduce it; softcal next-test ranks further tests",
    "mesh": "softcal mesh-study shows whether a finer mesh reduces it",
    "bounds": "a measurement of ν, or narrower bounds, will reduce it",
    "misfit": "a model with its cause, where the notes name one, will reduce it",
}


@sentence(
    r"Not included: (?P<what>\S+) shifts by half the length of its interval where "
    r"(?P<errors>\S+ is off by [\d.]+ \S+?(?: or \S+ is off by [\d.]+ \S+?)*)(?=\.(?: |$))"
)
def shifts(case: Case, _: list[str], told: Told) -> None:
    """An error c of the readings moves the minimum by -H^-1 J^T W c, parameters at their bounds staying there: by
    half the length of the interval.
    """
    fit, name = case.joint, named(case.joint, told["what"])
    j, (low, high) = fit.names.index(name), (fit.place(name, end) for end in fit.p[name]["interval"])
    free = np.minimum(fit.z, 1.0 - fit.z) > 1e-6
    inverse = np.linalg.inv(local_hessian(fit)[np.ix_(free, free)])
    for error, size, unit in re.findall(rf"(\S+) is off by {V} (\S+?)(?= or |$)", told["errors"]):
        assert error not in {u[1] for u in fit.uncertain}
        pull = np.zeros(len(fit.names))
        cable, _, kind = error.partition(".")
        if kind == "compliance":  # pulled by that times the tension less, as by such a slack
            for b in (b for b in fit.blocks if b.experiment):
                seen = fit.project.experiments[b.experiment].seen(b.channel)
                yields = fit.arrays["derivative", b.experiment, b.channel, f"{cable}.slack"]
                shape = (yields * fit.data[b.experiment]["simulated.tension"])[seen]
                pull += b.bent(shape[:, None])[:, 0] @ b.pull
            channel, form = "", ""
        else:
            channel, form = kind.split("_")
        for b in fit.blocks:
            if b.experiment and b.channel == channel:
                shape = {"offset": b.r * 0 + 1, "gain": b.r + b.measured, "drift": b.time}[form]
                pull += b.bent(shape[:, None])[:, 0] @ b.pull
        moved = abs(float((inverse @ pull[free])[np.flatnonzero(free).tolist().index(j)])) * float(size) * UNITS[unit]
        like(size, float(size) * (high - low) / 2 / moved, CLOSE)


@sentence(r"The twin reproduces the .*\)(?=\.$)")
def reproduces(case: Case, _: list[str], told: Told) -> None:
    rows: dict[str, dict[str, tuple[float, float]]] = {}
    for b in case.joint.blocks:
        if b.experiment and "." not in b.channel:
            rms = math.sqrt(np.mean(b.r**2))
            rows.setdefault(b.channel, {})[b.experiment] = rms, rms / float(np.ptp(b.measured))
    for word, size, unit, where in re.findall(
        rf"the (force|pitch) with an RMS error of {V} (%|deg)[^(]* at most \((\w+)\)", told[0]
    ):
        by = {
            e: (one[1] if word == "force" else one[0])
            for e, one in rows["tension" if word == "force" else word].items()
        }
        assert where == max(by, key=by.__getitem__)
        like(size, by[where] / UNITS[unit])
    if marker := re.search(rf"the markers to {V} mm RMS \({V} % of the length\)", told[0]):
        far = np.concatenate([distances(case.joint, e) for e in case.joint.experiments])
        rms = math.sqrt(np.mean(far**2))
        like(marker[1], rms / 1e-3)
        like(marker[2], 100 * rms / case.project.experiments[case.joint.experiments[0]].rig.length)


@sentence(r"Run: .*")
@sentence(r"The residuals are more than noise:")
@sentence(r"The residuals are a curve that the model misses, not noise:")
def heading(case: Case, labels: list[str], told: Told) -> None:
    """What it says is checked of each of the items that follow it."""


@dataclass(frozen=True)
class Check:
    """A sentence or a cell that was printed, and why it is not what was recomputed; "" where it is."""

    text: str
    fault: str


def checked(case: Case) -> Iterator[Check]:
    """Every cell and every sentence, each by the only entry that matches it."""
    lines = case.text.splitlines()
    last = max(i for i, line in enumerate(lines) if line.startswith("└"))
    heads, before = [], ""
    for line in lines[: last + 1]:
        if line.startswith("┃"):
            heads = [cell.strip() for cell in line.strip("┃").split("┃")][1:]
        if not line.startswith("│"):
            continue
        row, *cells = (cell.strip() for cell in line.strip("│").split("│"))
        title = f"{row} of {before}" if row == "95 % interval" else row
        before = before if row == "95 % interval" else row
        entries = [(told, check) for pattern, check in ROWS if (told := re.fullmatch(pattern, title))]
        if len(entries) != 1:
            yield Check(title, f"{len(entries)} entries match this row")
        for label, cell in zip(heads, cells, strict=True):
            if cell and len(entries) == 1:
                told, check = entries[0]
                yield Check(f"{title}, {label}: {cell}", fault_of(check, case, label, told, cell))
    label = f"(?:{'|'.join(map(re.escape, case.labels))})"
    lead = re.compile(rf"(?:Warning: )?(?:Note \(({label}(?:, {label})*)\): |({label}(?:, {label})*): )?")
    for line in lines[last + 1 :]:
        start = lead.match(line)
        of = (start[1] or start[2] or "joint").split(", ")
        rest = line[start.end() :]
        while rest:
            entries = [(told, check) for pattern, check in SENTENCES if (told := re.match(pattern, rest))]
            if len(entries) != 1:
                yield Check(rest, f"{len(entries)} entries match the beginning of this")
                break
            told, check = entries[0]
            yield Check(told[0], fault_of(check, case, of, told))
            rest = rest[told.end() :].lstrip(" .,;:")


def fault_of(check: Callable[..., None], *of: Any) -> str:
    try:
        check(*of)
    except (AssertionError, KeyError, ValueError) as error:
        return f"{type(error).__name__}: {error}".splitlines()[0]
    return ""


@dataclass(frozen=True)
class Printed:
    """What a calibration of an example prints, and every check of it."""

    example: str
    text: str
    checks: list[Check]


@pytest.fixture(
    scope="module",
    params=[
        "neck",
        "beam",
        *(pytest.param(one, marks=pytest.mark.long) for one in ("manipulator", "neck-bench", "finger")),
    ],
)
def printed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Printed:
    project, run = ROOT / "examples" / request.param / "project.yaml", tmp_path_factory.mktemp("run") / "run"
    words = [sys.executable, "-m", "softcal", "calibrate", str(project), "--verbose", "--no-report", "--out", str(run)]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True, env=WIDE)
    return Printed(request.param, done.stdout, list(checked(Case(run, done.stdout, softcal.load(project)))))


WIDE = {**os.environ, "COLUMNS": "400"}


@pytest.mark.slow  # minutes each
def test_every_cell_and_every_sentence_is_what_is_recomputed(printed: Printed) -> None:
    faults = [f"{one.text}\n    {one.fault}" for one in printed.checks if one.fault]
    assert not faults, "\n".join(faults)
    assert len(printed.checks) > 30


# What the READMEs say of the examples.


TRUE = {"neck": (), "neck-bench": (2.07, 2.135), "beam": (263.8, 283.0), "manipulator": (780.0, 860.0)}


@pytest.mark.slow  # with the printed sentences above
@pytest.mark.parametrize(
    "printed",
    [pytest.param(name, marks=pytest.mark.long if name in ("neck-bench", "manipulator") else ()) for name in TRUE],
    indirect=True,
)
def test_the_readme_of_an_example_quotes_it(printed: Printed):
    text = (ROOT / "examples" / printed.example / "README.md").read_text(encoding="utf-8")
    # The one quotation that begins with E or a doubt of it.
    (quotation,) = re.findall(r"^> (?:No single E fits .*\n|E = .*\n)(?:> .*\n)*", text, re.MULTILINE)
    statement = " ".join(quotation.replace("\n> ", " ").removeprefix("> ").split())
    assert statement in " ".join(printed.text.split())
    told = re.search(r"E = \S+ \w+ \(95 %: (\S+) to (\S+)", statement)
    assert told is not None
    assert all(float(told[1]) < value < float(told[2]) for value in TRUE[printed.example])


@pytest.mark.slow  # a minute each
@pytest.mark.parametrize(
    "options",
    [
        pytest.param(("--set", "neck.poissons_ratio=0.45"), marks=pytest.mark.long, id="ratio fixed"),
        pytest.param((), id="ratio free"),
    ],
)
def test_the_answer_stands_at_the_end_of_at_most_forty_lines_and_in_the_readme(
    options: tuple[str, ...], tmp_path: Path
):
    project = ROOT / "examples" / "neck" / "project.yaml"
    words = ["calibrate", str(project), "--no-report", "--out", str(tmp_path / "run"), *options]
    done = subprocess.run([sys.executable, "-m", "softcal", *words], capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines() + done.stderr.splitlines()) <= 40
    said = " ".join(" ".join(done.stdout.splitlines()[-6:]).split())
    told = re.search(r"E = (\S+) MPa \(95 %: (\S+ to \S+) MPa\)", said)
    assert told is not None
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert re.search(rf"{re.escape(told[1])} MPa \((?:95 %: )?{re.escape(told[2])}\)", readme), told[0]
    largest = re.search(r"(\d+) % of the variance of E comes from", said)
    assert largest is not None
    assert re.search(rf"\b{largest[1]}(?: %)?(?: of the variance|,| and)", readme), largest[0]
