"""What is said of a fleet is true as often as it says: synthetic estimates, many replications."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fleet_case import estimates

from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.mixed_effects import mixed_effects
from softcal.plugins.fleet.specimen import Specimen, own_error
from softcal.plugins.fleet.statement import FleetStatement, fleet_statement
from softcal.plugins.fleet.verdict import fleet_sentences, spread_text

MEAN, DOF = 3.0, 28


def drawn(chance: np.random.Generator, k: int, tau: float, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of k specimens, and their errors as estimated with some degrees of freedom."""
    sizes = noise * np.exp(0.3 * chance.standard_normal(k))
    values = MEAN + tau * chance.standard_normal(k) + sizes * chance.standard_normal(k)
    return values, sizes * np.sqrt(chance.chisquare(DOF, k) / DOF)


def stated(specimens: Sequence[Specimen], factors: Sequence[str] = ()) -> FleetStatement:
    return fleet_statement(specimens, factors)


def text(specimens: Sequence[Specimen], factors: Sequence[str] = ()) -> str:
    return " ".join(one.text for one in fleet_sentences(specimens, stated(specimens, factors)))


@pytest.mark.parametrize("tau", [0.0, 0.1, 0.4])
@pytest.mark.parametrize(("k", "n"), [(5, 300), (20, 300), pytest.param(100, 1000, marks=pytest.mark.slow)])
def test_the_intervals_of_mean_and_spread_hold_them(k: int, n: int, tau: float) -> None:
    chance = np.random.default_rng([k, int(10 * tau)])
    means = spreads = 0
    for _ in range(n):
        values, errors = drawn(chance, k, tau)
        found = mixed_effects(values, errors**2 * DOF / (DOF - 2))
        means += found.intervals[0, 0] <= MEAN <= found.intervals[0, 1]
        spreads += found.spread_interval[0] <= tau <= found.spread_interval[1]
    assert means / n >= 0.92
    assert 0.92 <= spreads / n
    if tau > 0.2:  # without a spread the interval is that of the errors alone, and holds more
        assert means / n <= 0.985


def test_alike_specimens_are_called_different_one_time_in_twenty() -> None:
    chance = np.random.default_rng(11)
    n, alarms = 200, 0
    for _ in range(n):
        (found,) = stated(estimates(*drawn(chance, 30, 0.0), dof=DOF)).populations
        alarms += found.differs
    assert 0.01 <= alarms / n <= 0.09


def test_a_further_specimen_lies_where_it_is_expected() -> None:
    chance = np.random.default_rng(12)
    given = inside = 0
    for _ in range(200):
        (found,) = stated(estimates(*drawn(chance, 12, 0.2), dof=DOF)).populations
        if found.further is not None:
            given += 1
            inside += found.further[0] <= MEAN + 0.2 * chance.standard_normal() <= found.further[1]
    assert given > 150
    assert 0.92 <= inside / given <= 0.985


def test_specimens_that_do_not_differ_have_no_interval_of_a_further_one() -> None:
    (found,) = stated(estimates([3.0, 3.01, 2.99, 3.0, 3.01, 2.99], [0.1] * 6)).populations
    assert not found.differs
    assert found.further is None
    said = text(estimates([3.0, 3.01, 2.99, 3.0, 3.01, 2.99], [0.1] * 6))
    assert "No difference between them is seen" in said
    assert "further specimen" not in said


def test_on_the_log_scale_mean_and_spread_are_those_of_the_logarithm() -> None:
    values = np.exp([0.0, 0.1, -0.1, 0.2, -0.2])
    (found,) = stated(estimates(values.tolist(), [1e-3] * 5, scale="log")).populations
    assert found.mean == pytest.approx(1.0)
    assert found.spread == pytest.approx(np.std([0.0, 0.1, -0.1, 0.2, -0.2], ddof=1), rel=1e-3)
    assert spread_text(found.spread, "log", "1", 1.0) == "16 %"
    assert spread_text(math.log(2.0), "log", "1", 1.0) == "a factor of 2.00"


def test_what_all_specimens_share_is_no_error_of_one() -> None:
    shares = {"noise": 0.5, "mesh": 0.25, "gain": 0.15, "angle (each)": 0.1}
    from softcal.calibration.problem.uncertain import EACH

    shares = {name.replace(" (each)", EACH): part for name, part in shares.items()}
    one = Estimate(1.0, "1", False, 0.0, 2.0, 0.2, (0.6, 1.4), shares=shares)
    assert own_error(one) == pytest.approx(0.2 * math.sqrt(0.6))


def test_errors_that_depend_on_the_value_do_not_weigh() -> None:
    """Weights by such errors would move the mean to where they are small."""
    chance = np.random.default_rng(13)
    held = 0
    for _ in range(200):
        true = MEAN + 0.1 * chance.standard_normal(40)
        values = true + 0.3 * np.exp(MEAN - true) * chance.standard_normal(40)
        (found,) = stated(estimates(values.tolist(), (0.3 * np.exp(MEAN - values)).tolist())).populations
        assert found.is_pooled
        held += found.interval[0] <= MEAN <= found.interval[1]
    assert held / 200 >= 0.9
    sizes = np.linspace(0.1, 0.3, 12)
    assert "so that all specimens count alike" in text(estimates((MEAN + sizes).tolist(), sizes.tolist()))
    assert "count alike" not in text(estimates((MEAN + sizes).tolist(), [0.1] * 12))


def test_a_parameter_that_few_determine_gets_no_statement() -> None:
    specimens = estimates([0.45] * 10, [0.01] * 10)
    free = Estimate(0.49, "1", False, 0.3, 0.4999, 0.02, (0.45, 0.4999))
    assert stated([*specimens[:9], Specimen("far", "DONE", {}, {"x": free}, 1.0)]).populations[0].left_out == {
        "far": "its interval reaches a bound"
    }
    two = [Specimen(f"far{k}", "DONE", {}, {"x": free}, 1.0) for k in range(2)]
    found = stated([*specimens[:8], *two])
    assert not found.populations
    assert "no statement on the population of the specimens: 2 of 10 specimens do not determine it" in text(
        [*specimens[:8], *two]
    )


def test_one_specimen_that_is_ten_times_stiffer_is_named() -> None:
    chance = np.random.default_rng(14)
    values = 2e6 * np.exp(0.05 * chance.standard_normal(30))
    values[17] *= 10
    specimens = estimates(values.tolist(), [0.01] * 30, scale="log", unit="Pa")
    (found,) = stated(specimens).populations
    assert [one.name for one in found.outliers] == ["s17"]
    assert found.without is not None
    assert found.without.spread_interval[0] <= 0.05 <= found.without.spread_interval[1]
    assert found.spread > 5 * found.without.spread
    assert "s17" in text(specimens)
    assert "is not like the other specimens" in text(specimens)


def test_like_specimens_are_rarely_called_outliers() -> None:
    chance = np.random.default_rng(15)
    n, alarms = 300, 0
    for k in [6, 12, 30] * (n // 3):
        alarms += bool(stated(estimates(*drawn(chance, k, 0.3), dof=DOF)).populations[0].outliers)
    assert alarms / n <= 0.03


@pytest.mark.parametrize("tau", [0.0, 0.3])
def test_groups_that_do_not_differ_are_rarely_told_apart(tau: float) -> None:
    chance = np.random.default_rng(16)
    groups = [{"filament": "ABC"[k % 3]} for k in range(18)]
    n, alarms = 150, 0
    for _ in range(n):
        (effect,) = stated(estimates(*drawn(chance, 18, tau), factors=groups, dof=DOF), ["filament"]).effects
        alarms += effect.differs
    assert alarms / n <= 0.09


def test_the_means_of_groups_lie_in_their_intervals_and_the_share_is_that_of_the_variance() -> None:
    chance = np.random.default_rng(17)
    groups = [{"filament": "AB"[k % 2]} for k in range(40)]
    n, held, shares = 150, 0, []
    for _ in range(n):
        values, errors = drawn(chance, 40, 0.2)
        values += [0.25 * (-1) ** k for k in range(40)]
        (effect,) = stated(estimates(values.tolist(), errors.tolist(), factors=groups, dof=DOF), ["filament"]).effects
        assert effect.differs
        held += sum(
            abs(g.mean - MEAN) > 0 and g.interval[0] <= MEAN + s <= g.interval[1]
            for g, s in zip(effect.groups, (0.25, -0.25), strict=True)
        )
        shares.append(effect.explained)
    assert 0.92 <= held / (2 * n) <= 0.985
    assert np.mean(shares) == pytest.approx(0.25**2 / (0.25**2 + 0.2**2), abs=0.03)


def infilled(chance: np.random.Generator, k: int, phi: Sequence[float], tau: float = 0.05) -> list[Specimen]:
    own = [phi[i % len(phi)] for i in range(k)]
    logs = math.log(10e6) + 1.4 * np.log(own) + tau * chance.standard_normal(k) + 0.02 * chance.standard_normal(k)
    factors = [{"infill": one, "filament": "AB"[(i // len(phi)) % 2]} for i, one in enumerate(own)]
    return estimates(np.exp(logs).tolist(), [0.02] * k, scale="log", unit="Pa", factors=factors)


@pytest.mark.parametrize("k", [6, 24])
def test_exponent_and_bulk_modulus_lie_in_their_intervals(k: int) -> None:
    chance = np.random.default_rng(18)
    n, exponents, bulks, misfits = 120, 0, 0, 0
    for _ in range(n):
        (law,) = stated(infilled(chance, k, (0.2, 0.4, 0.8)), ["infill"]).laws
        exponents += law.exponent_interval[0] <= 1.4 <= law.exponent_interval[1]
        bulks += law.bulk_interval[0] <= 10e6 <= law.bulk_interval[1]
        misfits += law.departs
    assert 0.92 <= exponents / n <= 0.99
    assert 0.92 <= bulks / n <= 0.99
    assert misfits / n <= 0.09


def test_moduli_that_do_not_follow_the_law_are_said_to_depart_from_it() -> None:
    chance = np.random.default_rng(19)
    specimens = infilled(chance, 24, (0.2, 0.4, 0.8))
    stiff = [
        Specimen(
            s.name,
            s.state,
            s.factors,
            {"x": Estimate(**{**s.parameters["x"].__dict__, "value": 2 * s.parameters["x"].value, "interval": None})},
        )
        if s.factors["infill"] == 0.4
        else s
        for s in specimens
    ]
    assert stated(stiff, ["infill"]).laws[0].departs
    assert "depart from this law" in text(stiff, ["infill"])
    assert "depart from this law" not in text(specimens, ["infill"])


def test_two_infills_do_not_tell_an_exponent() -> None:
    specimens = infilled(np.random.default_rng(20), 12, (0.2, 0.8))
    assert not stated(specimens, ["infill"]).laws
    assert "the specimens have 2 different infills, and it takes three" in text(specimens, ["infill"])


def test_a_modulus_without_a_law_does_not_hide_that_of_another() -> None:
    """Of the second one there are too few specimens, or too few infills."""
    specimens = infilled(np.random.default_rng(20), 12, (0.2, 0.4, 0.8))
    for order in (("a", "b"), ("b", "a")):
        for kept, why in (
            (("s0", "s1", "s2", "s3"), "there are 4 specimens, and it takes five"),
            (("s0", "s1", "s3", "s4", "s6", "s7"), "the specimens have 2 different infills, and it takes three"),
        ):
            two = [
                replace(s, parameters={k: s.parameters["x"] for k in order if k == "a" or s.name in kept})
                for s in specimens
            ]
            assert [law.label for law in stated(two, ["infill"]).laws] == ["a"]
            said = text(two, ["infill"])
            assert f"The law of b against the infill cannot be fitted: {why}." in said
            assert "The law of a against the infill cannot be fitted" not in said


def test_of_a_modulus_that_specimens_do_not_determine_it_is_not_said_that_there_is_none() -> None:
    specimens = infilled(np.random.default_rng(20), 12, (0.2, 0.4, 0.8))
    at_bound = [
        replace(s, parameters={"x": replace(s.parameters["x"], at_bound=True)}) if k < 3 else s
        for k, s in enumerate(specimens)
    ]
    said = text(at_bound, ["infill"])
    assert (
        "x: no statement on the population of the specimens: 3 of 12 specimens do not determine it (at a bound)."
        in said
    )
    assert "against the infill cannot be fitted" not in said
    linear = [replace(s, parameters={"x": replace(s.parameters["x"], scale="linear")}) for s in specimens]
    none = "The law of E against the infill cannot be fitted: no modulus is searched by its logarithm."
    assert none in text(linear, ["infill"])
    assert none in text([replace(s, parameters={"x": replace(s.parameters["x"], unit="1")}) for s in specimens])
    assert "cannot be fitted" not in text(specimens, ["infill"])


RESIDUALS = "The residuals of {} are {} times the noise of the records: the model is incomplete. Errors are increased."


def test_the_most_frequent_warning_is_told_once() -> None:
    chance = np.random.default_rng(22)
    specimens = estimates(*drawn(chance, 6, 0.1))
    assert "have warnings" not in text(specimens)
    bound = "front.slack is at its upper bound of 12 mm: the value is determined by the bound, not by the data."
    of = {
        "s1": (bound,),
        "s2": (RESIDUALS.format("tension", 8.4),),
        "s3": (bound, RESIDUALS.format("tension", "160")),
        "s5": (RESIDUALS.format("pitch", 3), RESIDUALS.format("tension", 33)),
    }
    warned = [replace(one, warnings=of.get(one.name, ())) for one in specimens]
    failed = Specimen("no", "FAILED", reason="It buckles.", warnings=(bound,))
    (said,) = (one for one in fleet_sentences([*warned, failed], stated([*warned, failed])) if "warnings" in one.text)
    assert said.tone == "warning"
    assert said.text == (
        "4 of 6 calibrated specimens have warnings: The residuals of tension are 8.4 times the noise of the records "
        "(s2), and the like of 2 more. specimens/NAME.json has all."
    )
    one = [replace(s, warnings=of["s1"]) if s.name == "s1" else s for s in specimens]
    said = "1 of 6 calibrated specimens has warnings: front.slack is at its upper bound of 12 mm (s1). specimens/"
    assert said in text(one)
    assert "1 of 1 calibrated specimens has warnings" in text(one[1:2])


def test_specimens_with_the_same_measured_files_are_named() -> None:
    content = ["a", "b", "a", "c", "b", "d"]
    specimens = [
        replace(one, hashes={"bar.msh": "mesh", f"p{k}.csv": content[k], "both.csv": "both"})
        for k, one in enumerate(estimates([1.0] * 6, [0.1] * 6))
    ]
    measured = {f"s{k}": (f"p{k}.csv", "both.csv") for k in range(6)}
    found = fleet_statement(specimens, [], measured)
    assert found.same_data == (("s0", "s2"), ("s1", "s4"))
    said = [one for one in fleet_sentences(specimens, found) if "share data files" in one.text]
    assert [one.tone for one in said] == ["warning"]
    assert said[0].text.endswith("but are counted separately: s0, s2; s1, s4.")
    assert not fleet_statement([specimens[k] for k in (0, 1, 3, 5)], [], measured).same_data
    failed = [replace(one, state="FAILED") if one.name in ("s2", "s4") else one for one in specimens]
    assert not fleet_statement(failed, [], measured).same_data
    assert not fleet_statement([replace(one, hashes={}) for one in specimens], [], measured).same_data  # an older fleet
    assert "share data files" not in text(specimens)


def test_filaments_are_compared_at_equal_infill() -> None:
    """Their difference of 10 % is far below that of the infills."""
    chance = np.random.default_rng(21)
    specimens = infilled(chance, 24, (0.2, 0.4, 0.8), tau=0.02)
    stiffer = [
        Specimen(
            s.name,
            s.state,
            s.factors,
            {"x": Estimate(**{**s.parameters["x"].__dict__, "value": 1.1 * s.parameters["x"].value, "interval": None})},
        )
        if s.factors["filament"] == "B"
        else s
        for s in specimens
    ]
    (effect,) = [one for one in stated(stiffer, ["infill", "filament"]).effects if one.factor == "filament"]
    assert effect.differs
    assert effect.at_infill == pytest.approx(0.4)
    ratio = effect.groups[1].mean / effect.groups[0].mean
    assert ratio == pytest.approx(1.1, abs=0.03)
    assert "at an infill of 40 %" in text(stiffer, ["infill", "filament"])


def test_factors_that_go_together_are_named() -> None:
    factors = [{"filament": "AB"[k % 2], "printer": "XY"[k % 2]} for k in range(8)]
    said = text(estimates([1.0, 2.0] * 4, [0.1] * 8, factors=factors), ["filament", "printer"])
    assert "Printer determines filament in this table" in said
    crossed = [{"filament": "AB"[k % 2], "printer": "XY"[k // 4]} for k in range(8)]
    assert "determines" not in text(estimates([1.0, 2.0] * 4, [0.1] * 8, factors=crossed), ["filament", "printer"])


def test_one_specimen_is_no_population() -> None:
    assert text(estimates([1.0], [0.1])) == "There is one specimen: differences between specimens cannot be estimated."


def test_two_specimens_have_a_mean_and_a_spread() -> None:
    (found,) = stated(estimates([1.0, 2.0], [0.01, 0.01])).populations
    assert found.differs
    assert found.mean == pytest.approx(1.5)
    assert found.interval[0] < 0 < 3 < found.interval[1]  # 12.7 standard errors
    assert found.further is None


def test_specimens_that_are_all_the_same_number() -> None:
    (found,) = stated(estimates([2.0] * 10, [0.1] * 10)).populations
    assert found.mean == pytest.approx(2.0)
    assert found.spread == 0.0
    assert found.spread_interval == (0.0, 0.0)
    assert not found.differs


def test_a_factor_that_all_share_is_named() -> None:
    said = text(estimates([1.0, 2.0, 3.0], [0.1] * 3, factors=[{"operator": "Ann"}] * 3), ["operator"])
    assert "No comparison by operator: all specimens have the same." in said


def test_a_spread_and_its_interval_are_told_in_one_form() -> None:
    values = (2e6 * np.exp([0.0, 0.17])).tolist()
    assert "their spread is a factor of 1.13 (1.0" in text(estimates(values, [0.01] * 2, scale="log", unit="Pa"))
    values = (2e6 * np.exp(0.02 * np.array([-1.5, -0.5, 0.5, 1.5] * 5))).tolist()
    assert "their spread is 2.1 % (1.4 to 3.2 %)" in text(estimates(values, [0.01] * 20, scale="log", unit="Pa"))


def test_a_failed_specimen_is_named_and_does_not_count() -> None:
    specimens = [*estimates([1.0, 1.1, 0.9], [0.1] * 3), Specimen("broken", "FAILED", {}, reason="No equilibrium.")]
    assert stated(specimens).failed == 1
    assert "1 of 4 specimens failed, and do not count: broken: No equilibrium." in text(specimens)
    assert "failed" not in text(specimens[:3])
