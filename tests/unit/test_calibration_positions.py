"""Positions, several cables or none, settings, missing values, ties and distances: paper B's and the beam's bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manipulator_case import (
    CABLES,
    FORCES,
    FREE,
    LENGTH,
    MARKERS,
    MODULI,
    TIED,
    experiment,
    manipulator,
    true_places,
)

from softcal.calibration.problem.experiment import Experiment, rig_parameters
from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.loss import Block, gradient, total
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter, search_space, split
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.rig import Rig
from softcal.calibration.results.fit import experiment_fit, missing_rows
from softcal.errors import DatasetError, InputError, ParameterError
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import PointLoad
from softcal.twin.simulate import simulate

AT = dict.fromkeys(MODULI, 0.9e9)
FRAMES = tuple(FreeParameter(n, "m" if len(n) == 7 else "rad", -0.5, 0.5) for n in FRAME)


def loaded() -> Experiment:
    """Places under a weight at the tip, no cable driven: two takes of one state, the second without marker 2."""
    places = np.tile(np.arange(12.0).reshape(4, 3) * 0.01, (2, 1, 1))
    places[1, 1, 2] = np.nan
    channels = {f"{m}.{axis}": Channel(places[:, i, k], "m", 1e-3) for i, m in enumerate(MARKERS)
                for k, axis in enumerate("xyz")}  # fmt: skip
    return Experiment("tip load", Dataset("tip load", channels), settings={"weight.force": 2.0}, rig=Rig(length=LENGTH))


def with_weight():
    weight = PointLoad("weight", "S4", np.array([0.0, 0.0, -LENGTH]), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    return replace(manipulator(), loads=(weight,))


def problem(*names: str, parameters=FREE, loss=None, **options) -> Problem:
    tests = [experiment(name, **options) for name in names or ("cable1", "cable5")]
    return make_problem(manipulator(), tests, parameters, loss or DistanceLoss(LENGTH))


def test_a_dotted_channel_drives_and_everything_else_that_the_twin_answers_is_compared() -> None:
    test = experiment("cable5")
    assert test.drives == ("cable5.tension",)
    assert test.compared == tuple(f"{m}.{axis}" for m in MARKERS for axis in "xyz")
    assert test.points == MARKERS
    assert set(FRAME) <= set(rig_parameters([test]))


def test_the_loss_is_the_root_mean_square_of_equation_1() -> None:
    seen = problem("cable1", "cable5").evaluate(AT)
    away = []
    for cable in ("cable1", "cable5"):
        response = simulate(manipulator(), Protocol({cable: Command("tension", np.array(FORCES))}), AT)
        for marker, places in true_places(cable).items():
            moved = np.column_stack([response.channels[f"{marker}.{axis}"] for axis in "xyz"]) - places
            away += (100 * np.linalg.norm(moved, axis=1) / LENGTH).tolist()
    assert len(away) == 2 * 4 * 3
    assert seen.loss == pytest.approx(np.sqrt(np.mean(np.square(away))), rel=1e-12)
    fits = [experiment_fit(e, seen.observations[e.name]) for e in problem("cable1", "cable5").experiments]
    means = [100 * d.mean / LENGTH for fit in fits for d in fit.distances.values()]
    assert np.mean(means) == pytest.approx(np.mean(away))
    assert max(d.max for fit in fits for d in fit.distances.values()) == pytest.approx(max(away) * LENGTH / 100)


@pytest.mark.parametrize("loss", [DistanceLoss(LENGTH), LikelihoodLoss()])
def test_losses_of_positions_have_exact_gradients(loss: DistanceLoss | LikelihoodLoss) -> None:
    random = np.random.default_rng(2)
    jacobians = [random.standard_normal((n, 3)) for n in (6, 4)]
    residuals = [random.standard_normal(n) for n in (6, 4)]
    sigmas = [random.uniform(0.5, 2.0, n) for n in (6, 4)]

    def blocks(theta: np.ndarray) -> list[Block]:
        return [
            Block("a", f"m{i}.x", np.ones(len(r)), r + j @ theta, s, j, f"m{i}")
            for i, (r, j, s) in enumerate(zip(residuals, jacobians, sigmas, strict=True))
        ]

    theta, h = np.array([0.3, -0.2, 0.1]), 1e-6
    slopes = [(total(loss, blocks(theta + h * e)) - total(loss, blocks(theta - h * e))) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(gradient(loss, blocks(theta)), slopes, rtol=1e-7)


def test_each_sample_counts_by_its_own_noise() -> None:
    test = experiment("cable1", noise=1e-3)
    own = {f"{c}_sd": Channel(np.array([1e-3, 2e-3, 4e-3]), "m") for c in test.compared}
    noisy = replace(test, dataset=replace(test.dataset, channels={**test.dataset.channels, **own}))
    seen = make_problem(manipulator(), [noisy], FREE, LikelihoodLoss()).evaluate(AT)
    away = np.array([seen.observations["cable1"].predicted[c] - test.dataset.values(c) for c in test.compared])
    assert seen.loss == pytest.approx(np.sum((away / [1e-3, 2e-3, 4e-3]) ** 2), rel=1e-12)


def test_a_frame_turns_and_moves_what_is_predicted_and_nothing_else() -> None:
    frame = (0.01, -0.02, 0.03, 0.3, -0.2, 0.1)
    plain = problem("cable1", frame=frame, parameters=(*FREE, *FRAMES))
    theta = {**MODULI, **dict(zip(FRAME, frame, strict=True))}
    assert plain.evaluate(theta).loss == pytest.approx(0.0, abs=2e-3)
    assert plain.evaluate({**theta, "frame.rz": 0.2}).loss > 1.0
    with_pitch = Experiment(
        "pitch", Dataset("pitch", {"cable1.tension": Channel([5.0], "N"), "S4.pitch": Channel([0.1], "rad")}),
        drive=("cable1.tension",),
    )  # fmt: skip
    assert not set(FRAME) & set(rig_parameters([with_pitch]))
    with pytest.raises(ParameterError, match=r"frame\.x"):
        make_problem(manipulator(), [with_pitch], FRAMES[:1], LikelihoodLoss({"S4.pitch": 0.1}))


def test_a_nominal_frame_is_where_a_nuisance_starts_in_each_experiment() -> None:
    tests = [experiment("cable1", nominal={"x": 0.1}), experiment("cable2", nominal={"x": -0.2})]
    own = replace(FRAMES[0], per_experiment=True)
    space = make_problem(manipulator(), tests, (own,), DistanceLoss(LENGTH)).space
    assert {p.label: p.start for p in space.parameters} == {"frame.x[cable1]": 0.1, "frame.x[cable2]": -0.2}


def test_what_was_not_seen_is_left_out_counted_and_named() -> None:
    test = loaded()
    assert test.drives == ()
    assert missing_rows(test) == {"m2": [1]}
    made = make_problem(with_weight(), [test], FREE, DistanceLoss(LENGTH))
    seen = made.evaluate(AT, jacobian=True)
    sizes = {block.channel: len(block.residual) for block in seen.blocks}
    assert sizes["m1.x"] == 2
    assert {sizes[f"m2.{axis}"] for axis in "xyz"} == {1}
    fit = experiment_fit(test, seen.observations["tip load"])
    assert dict(fit.missing) == {"m2": 1}
    assert fit.distances["m2"].n == 1
    assert seen.loss is not None
    assert np.isfinite(seen.loss)


def test_settings_hold_in_their_experiment_alone() -> None:
    test = loaded()
    light = replace(test, name="light", settings={"weight.force": 0.5})
    made = make_problem(with_weight(), [test, light], FREE, DistanceLoss(LENGTH))
    seen = made.evaluate(AT)
    assert seen.n_solves == 2
    for one, force in ((test, 2.0), (light, 0.5)):
        alone = simulate(with_weight(), Protocol({}), {**AT, "weight.force": force})
        np.testing.assert_array_equal(seen.observations[one.name].predicted["m4.x"], alone.channels["m4.x"][[0, 0]])


def test_tests_of_one_pair_of_cables_share_a_trajectory_and_give_what_they_would_alone() -> None:
    def pulled(name: str, first: tuple[float, ...], second: tuple[float, ...]) -> Experiment:
        channels = {"cable1.tension": Channel(first, "N"), "cable5.tension": Channel(second, "N"),
                    "m4.x": Channel(np.zeros(len(first)), "m")}  # fmt: skip
        return Experiment(name, Dataset(name, channels), drive=("cable1.tension", "cable5.tension"))

    one, two = pulled("one", (4.0, 2.0), (3.0, 6.0)), pulled("two", (1.0,), (5.0,))
    made = make_problem(manipulator(), [one, two], FREE, LikelihoodLoss({"m4.x": 1.0}))
    seen = made.evaluate(AT)
    assert seen.n_solves == 1
    alone = made.alone("two").evaluate(AT).observations["two"].predicted["m4.x"]
    np.testing.assert_allclose(seen.observations["two"].predicted["m4.x"], alone, rtol=1e-8)


def test_a_tied_parameter_feels_what_its_parts_feel_together() -> None:
    parts, tied = problem("cable5"), problem("cable5", parameters=(TIED,))
    assert tied.space.parameters[0].of == tuple(MODULI)
    each = parts.evaluate(AT, jacobian=True)
    together = tied.evaluate({TIED.label: 0.9e9}, jacobian=True)
    assert together.loss == pytest.approx(each.loss)
    for a, b in zip(together.blocks, each.blocks, strict=True):
        np.testing.assert_allclose(a.jacobian[:, 0], b.jacobian.sum(axis=1), rtol=1e-9, atol=1e-20)


def test_a_tied_parameter_splits_into_its_parts() -> None:
    space = search_space([TIED], (), robot_parameters(manipulator()))
    parts = split(space, TIED.label, robot_parameters(manipulator()))
    assert parts.labels == tuple(MODULI)
    with pytest.raises(ParameterError, match="spring1"):
        split(parts, "spring1.youngs_modulus", robot_parameters(manipulator()))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ((TIED, FREE[0]), "spring1.youngs_modulus: the parameter is free twice"),
        ((replace(TIED, of=("sprig*.youngs_modulus",)),), r"sprig.*Try: '"),
        ((replace(TIED, of=("spring1.youngs_modulus", "spring1.density")),), r"the parameter has another unit"),
        ((replace(TIED, name="spring1.poissons_ratio"),), "the name is that of another parameter"),
    ],
)
def test_ties_that_make_no_sense_are_told(parameters: tuple[FreeParameter, ...], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        search_space(parameters, (), robot_parameters(manipulator()))


def test_shared_and_own_values_of_one_parameter_exclude_each_other() -> None:
    own = replace(FRAMES[0], per_experiment=True)
    with pytest.raises(ParameterError, match="free twice"):
        problem("cable1", parameters=(FRAMES[0], own))


def test_faults_of_experiments_with_positions_are_told() -> None:
    test = experiment("cable1")
    channels = dict(test.dataset.channels)
    strange = Dataset("cable1", {**channels, "m9.x": Channel(np.zeros(3), "m")})
    with pytest.raises(InputError, match=r"no such marker or plate; got m9.*Try: '"):
        make_problem(manipulator(), [Experiment("a", strange, drive=test.drive)], FREE, LikelihoodLoss())
    with pytest.raises(InputError, match=r"settings of a, weight\.force"):
        make_problem(manipulator(), [replace(test, name="a", settings={"weight.force": 1.0})], FREE, DistanceLoss(1.0))
    with pytest.raises(InputError, match="set and free at once"):
        make_problem(manipulator(), [replace(test, settings={"spring1.youngs_modulus": 1e9})], FREE, DistanceLoss(1.0))
    hole = Dataset("cable1", {**channels, "cable1.tension": Channel([1.0, np.nan, 2.0], "N")})
    with pytest.raises(DatasetError, match=r"drives the twin has no value; got cable1\.tension, row 2"):
        Experiment("a", hole, drive=("cable1.tension",))
    with pytest.raises(DatasetError, match="cannot drive the twin"):
        Experiment("a", test.dataset, drive=("m1.x",))
    with pytest.raises(DatasetError, match="driven twice"):
        Experiment("a", test.dataset, drive=("cable1.tension", "cable1.tension"))


def test_losses_say_which_channels_they_cannot_judge() -> None:
    test = experiment("cable1")
    with pytest.raises(DatasetError, match=r"the loss 'papers' has no weight for 'm1\.x'"):
        make_problem(manipulator(), [test], FREE, PapersLoss())
    with pytest.raises(DatasetError, match=r"all three parts; got m1\.x"):
        make_problem(manipulator(), [replace(test, compared=("m1.x",))], FREE, DistanceLoss(LENGTH))
    pitched = Dataset("a", {**test.dataset.channels, "S4.pitch": Channel(np.zeros(3), "rad")})
    with pytest.raises(DatasetError, match=r"positions only; got .*S4\.pitch"):
        make_problem(manipulator(), [replace(test, dataset=pitched, compared=())], FREE, DistanceLoss(LENGTH))
    with pytest.raises(DatasetError, match=r"noise of 'm1\.x'"):
        make_problem(manipulator(), [test], FREE, LikelihoodLoss())


def test_six_cables_make_six_experiments_or_one() -> None:
    assert len({experiment(cable).drives for cable in CABLES}) == 6
