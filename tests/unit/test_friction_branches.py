"""Friction has one sign where a cable is pulled and the other where it is let go: corrected by branch, or refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_twin import TRUE, fake_experiment, fake_robot, fake_simulate
from project_case import bar_robot, bench_values, write_project

import softcal
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.observation import observe
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.problem.rig import Pulleys, Rig
from softcal.errors import DatasetError, InputError, ParameterError, ProjectFileError
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.steps.branches import Branch, take_branch
from softcal.experiments.steps.pulleys import correct_pulley_friction, pulley_gain
from softcal.project.project import load
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol, lets_go
from softcal.twin.robot import Cable, Robot, ViaPoint

RIG = ("experiments:\n", "rig:\n  pulleys: {count: 2, wrap: 180 deg, friction_coefficient: 0.1}\nexperiments:\n")
NOISE = "    noise: {tension: 0.05 N, pitch: 0.2 deg}\n"
MU = ("  cables:\n    front:\n", "  cables:\n    front:\n      friction_coefficient: 0.1\n")
LOSS = 0.2 * math.pi  # of paper A's two pulleys
FRICTION = "pulleys.friction_coefficient"


def loop_csv(exponent: float = LOSS) -> str:
    """The bar pulled and let go again, as a machine behind pulleys sees it."""
    _, d, tension, pitch = (np.asarray(column) for column in bench_values())
    up, down = np.arange(len(d)), np.arange(len(d))[::-1]
    rows = np.concatenate([up, down])
    gain = np.concatenate([np.full(len(d), math.exp(exponent)), np.full(len(d), math.exp(-exponent))])
    lines = ["Time [s],Displacement [mm],Force [N],Pitch [deg]"]
    lines += [
        f"{0.1 * i:.3f},{d[r]:.6f},{tension[r] * g:.9f},{pitch[r]:.6f}"
        for i, (r, g) in enumerate(zip(rows, gain, strict=True))
    ]
    return "\n".join(lines) + "\n"


def prepared(*steps: str) -> tuple[str, str]:
    return NOISE, f"    prepare: [{', '.join(steps)}]\n{NOISE}"


def loop() -> Dataset:
    d = np.concatenate([np.linspace(0.0, 0.02, 41), np.linspace(0.02, 0.0, 41)])
    sign = np.repeat([1.0, -1.0], 41)
    channels = {"shortening": Channel(d, "m"), "tension": Channel(500.0 * d * np.exp(sign * LOSS), "N", 0.1)}
    return Dataset("loop", channels)


@pytest.mark.parametrize("branch", ["loading", "unloading", "mean"])
@pytest.mark.parametrize("turn", [0, 1, 6])
def test_where_friction_turns_round_is_on_no_way_back(branch: Branch, turn: int) -> None:
    """The top sample once, as machines write it, and the friction of the pulleys turning over some samples after it."""
    d = np.concatenate([np.linspace(0.0, 0.02, 41), np.linspace(0.0195, 0.0, 40)])
    back = np.clip((np.arange(81) - 40) / (turn + 1), 0.0, 1.0)
    machine = 500.0 * d * np.exp(LOSS * (1.0 - 2.0 * back))
    record = Dataset("loop", {"shortening": Channel(d, "m"), "tension": Channel(machine, "N", 0.1)})
    taken = take_branch(correct_pulley_friction(record, 2, 0.1, np.pi, branch), branch)
    np.testing.assert_allclose(taken.values("tension"), 500.0 * taken.values("shortening"), rtol=0.08, atol=1e-9)
    if turn == 0:
        np.testing.assert_allclose(taken.values("tension"), 500.0 * taken.values("shortening"), rtol=1e-9, atol=1e-9)
    assert taken.values("shortening").max() > 0.015


@pytest.mark.parametrize("branch", ["loading", "unloading", "mean"])
def test_every_branch_of_the_machine_gives_the_necks_tension(tmp_path: Path, branch: str) -> None:
    project = load(write_project(tmp_path, RIG, prepared(f"take_branch: {branch}"), data=loop_csv()))
    data = project.experiments["pull"].dataset
    _, d, tension, _ = bench_values()
    elastic = np.interp(1e3 * data.values("shortening"), d, tension)
    np.testing.assert_allclose(data.values("tension"), elastic, rtol=2e-3, atol=2e-3 * max(tension))


@pytest.mark.parametrize("branch", ["loading", "unloading", "mean"])
def test_the_correction_comes_before_or_after_the_branch(branch: str) -> None:
    before = take_branch(correct_pulley_friction(loop(), 2, 0.1, np.pi, branch), branch)
    after = correct_pulley_friction(take_branch(loop(), branch), 2, 0.1, np.pi)
    one_by_one = correct_pulley_friction(correct_pulley_friction(take_branch(loop(), branch), 1, 0.1), 1, 0.1)
    for data in (before, after, one_by_one):
        np.testing.assert_allclose(data.values("tension"), 500.0 * data.values("shortening"), atol=1e-9)


def test_a_branch_that_the_correction_was_not_for_is_refused() -> None:
    with pytest.raises(DatasetError, match="correct_pulley_friction for loading, take_branch: mean"):
        take_branch(correct_pulley_friction(loop(), 2, 0.1), "mean")
    with pytest.raises(DatasetError, match="correct_pulley_friction for loading, take_branch: unloading"):
        correct_pulley_friction(take_branch(loop(), "unloading"), 2, 0.1, np.pi, "loading")
    take_branch(correct_pulley_friction(loop(), 2, 0.0), "mean")  # no friction has no sign


def test_tensions_of_both_branches_cannot_be_corrected_at_once(tmp_path: Path) -> None:
    path = write_project(tmp_path, RIG, data=loop_csv())
    with pytest.raises(ProjectFileError, match="opposite signs during loading and unloading"):
        load(path)
    assert load(write_project(tmp_path, data=loop_csv(0.0))).experiments["pull"].dataset.n_samples == 50


@pytest.mark.parametrize("branch", ["loading", "unloading", "mean"])
def test_free_pulley_friction_is_read_by_branch(branch: str) -> None:
    pulled = fake_experiment(rig=Rig(pulleys=Pulleys(wrap=np.pi, friction_coefficient=0.1)))
    taken = replace(pulled.dataset, provenance=(Step("take_branch", {"branch": branch}),))
    experiment = replace(pulled, dataset=taken)
    robot = with_parameters(fake_robot(), TRUE)
    response = fake_simulate(robot, Protocol({"front": Command("shortening", taken.values("shortening"))}))

    def seen(mu: float):
        rig = {**experiment.rig_values(), FRICTION: mu}
        return observe(experiment, rig, response, slice(0, taken.n_samples), (FRICTION,))

    true = response.channels["front.tension"]
    expected = {"loading": np.exp, "unloading": lambda a: np.exp(-a), "mean": np.cosh}[branch]
    ratio = expected(2 * np.pi * 0.17) / expected(2 * np.pi * 0.1)
    np.testing.assert_allclose(seen(0.17).predicted["tension"], ratio * true, rtol=1e-12)
    rate = (seen(0.17 + 1e-6).predicted["tension"] - seen(0.17 - 1e-6).predicted["tension"]) / 2e-6
    np.testing.assert_allclose(seen(0.17).derivatives["tension"][FRICTION], rate, rtol=1e-6, atol=1e-9)
    assert pulley_gain(branch, 0.0)[0] == 1.0


def test_a_test_that_lets_a_rough_cable_go_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError) as caught:
        load(write_project(tmp_path, MU, data=loop_csv(0.0)))
    assert "the friction of front is modelled for a cable that is pulled" in str(caught.value)
    assert "project.yaml:" in str(caught.value)
    assert "experiments.pull" in str(caught.value)
    load(write_project(tmp_path, data=loop_csv(0.0)))
    load(write_project(tmp_path, MU, prepared("take_branch: loading"), data=loop_csv(0.0)))
    load(write_project(tmp_path, MU))


@pytest.mark.parametrize("branch", ["unloading", "mean"])
def test_so_is_a_branch_on_which_it_was_let_go(tmp_path: Path, branch: str) -> None:
    step = prepared(f"take_branch: {branch}")
    with pytest.raises(ProjectFileError, match=f"take_branch: {branch}"):
        load(write_project(tmp_path, MU, step, data=loop_csv(0.0)))
    free = ("  front.slack:", "  front.friction_coefficient: {bounds: [0, 0.3]}\n  front.slack:")
    with pytest.raises(ProjectFileError, match="the friction of front is modelled"):
        load(write_project(tmp_path, free, step, data=loop_csv(0.0)))
    load(write_project(tmp_path, step, data=loop_csv(0.0)))


def test_so_is_a_value_that_is_given_for_it(tmp_path: Path) -> None:
    path = write_project(tmp_path, data=loop_csv(0.0))
    told = r"^front\.friction_coefficient: experiments\.pull: the friction of front is modelled"
    with pytest.raises(ParameterError, match=told):
        load(path, values={"front.friction_coefficient": "0.1"})


def test_a_problem_of_python_refuses_it_too() -> None:
    pulled = fake_experiment()
    data = pulled.dataset
    both = data.take(np.r_[0 : data.n_samples, data.n_samples - 1 : -1 : -1], Step("there and back"))
    rough = with_parameters(fake_robot(), {"front.friction_coefficient": 0.1})
    space = SearchSpace((FreeParameter("neck.youngs_modulus", "Pa", 0.1e6, 10e6),))
    Problem(fake_robot(), (replace(pulled, dataset=both),), space, PapersLoss(), simulate=fake_simulate)
    with pytest.raises(InputError, match="the friction of front is modelled"):
        Problem(rough, (replace(pulled, dataset=both),), space, PapersLoss(), simulate=fake_simulate)


def test_a_pull_that_is_let_go_is_simulated_without_friction_alone() -> None:
    there_and_back = np.concatenate([np.linspace(0.0, 0.02, 5), np.linspace(0.015, 0.0, 4)])
    protocol = Protocol({"front": Command("shortening", there_and_back)})
    response = softcal.simulate(bar_robot(), protocol)
    assert response.succeeded
    np.testing.assert_allclose(response.channels["front.tension"][:5][::-1], response.channels["front.tension"][4:])
    rough = with_parameters(bar_robot(), {"front.friction_coefficient": 0.3})
    with pytest.raises(ParameterError, match="reverses where the cable is released"):
        softcal.simulate(rough, protocol)
    with pytest.raises(ParameterError, match="reverses where the cable is released"):
        softcal.simulate(bar_robot(), protocol, {"front.friction_coefficient": 0.3})
    assert softcal.simulate(rough, Protocol({"front": Command("shortening", there_and_back[:5])})).succeeded


def test_a_machines_jitter_lets_nothing_go() -> None:
    d = np.linspace(0.0, 0.02, 400) + 5e-5 * np.random.default_rng(1).standard_normal(400)
    assert not lets_go(d)
    assert lets_go(np.concatenate([d, d[:-40:-1]]))
    assert not lets_go(np.zeros(3))


def two_cables(mu: float) -> Robot:
    """The bar with a second cable on the other side, each bent once on its way."""

    def side(name: str, x: float) -> Cable:
        on_plate = ViaPoint(np.array([x, 0, 0.1]), "plate")
        return Cable(name, (on_plate, *(ViaPoint(np.array([at, 0, 0.0])) for at in (x, 3 * x))), mu)

    return replace(bar_robot(), cables=(side("front", 0.03), side("back", -0.03)))


@pytest.mark.parametrize(("mu", "told"), [(0.0, False), (0.2, True)])
def test_a_rough_cable_that_the_other_draws_out_is_told_of(mu: float, told: bool) -> None:
    tensions = {"front": [1.0, 8.0], "back": [1.0, 1.0]}
    protocol = Protocol({name: Command("tension", np.array(values)) for name, values in tensions.items()})
    response = softcal.simulate(two_cables(mu), protocol)
    assert response.succeeded, response.status
    assert response.channels["back.shortening"][1] < -1e-3
    assert bool(response.drawn_out) == told
    if told:
        assert response.drawn_out.startswith("The other cables pull back out under tension, by up to ")
        assert "(at sample 2" in response.drawn_out
        assert "front" not in response.drawn_out.split("(at")[0]
        assert response.status.endswith(response.drawn_out)


@pytest.mark.parametrize(("mu", "told"), [(0.0, False), (0.2, True)])
def test_the_report_and_the_command_line_tell_of_it_too(mu: float, told: bool) -> None:
    from softcal.workflows.simulation import twin_view

    protocol = Protocol({"front": Command("tension", np.array([1.0, 8.0])), "back": Command("tension", np.ones(2))})
    response = softcal.simulate(two_cables(mu), protocol, snapshots=True)
    view = twin_view(two_cables(mu), response)
    assert view is not None
    assert view.drawn_out == response.drawn_out
    assert response.warnings == ((response.drawn_out,) if told else ())
    assert response.doubts == ("a cable slides opposite to the modelled direction" if told else "")
