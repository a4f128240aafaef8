"""The twin's own noise-free data gives its parameters back, from any corner of paper A's bounds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.run import calibrate
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.geometry.quadratic import to_linear
from softcal.geometry.read import read_mesh
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate

E, NU = "neck.youngs_modulus", "neck.poissons_ratio"
TRUE = {E: 2.3e6, NU: 0.43}
E_BOUNDS, NU_BOUNDS = (0.1e6, 40e6), (0.4, 0.4999)  # paper A, section II.D
CORNERS = [(e, nu) for e in E_BOUNDS for nu in NU_BOUNDS]
D = np.linspace(0.0, 0.03, 31)


def shipped_mesh(element: str) -> TetMesh:
    mesh = read_mesh(Path(__file__).parents[2] / "examples" / "neck-bench" / "neck.msh", unit="mm")
    return to_linear(mesh) if element == "P1" else mesh


def neck(element: str, mesh: TetMesh) -> Robot:
    top = (0.0, 0.0, 0.106704)
    return Robot(
        bodies=(
            Body(
                "neck",
                mesh,
                mesh.node_sets["socket"],
                {"youngs_modulus": TRUE[E], "poissons_ratio": TRUE[NU]},
                element=element,
            ),
        ),
        plates=(Plate("plate", {"neck": mesh.node_sets["collar"]}, top),),
        cables=(Cable("front", (ViaPoint((0.05, 0.0, 0.106704), "plate"), ViaPoint((0.05, 0.0, 0.01406)))),),
    )


def problem(element: str, start: tuple[float, float]) -> Problem:
    return problem_of(neck(element, shipped_mesh(element)), D, start)


def problem_of(robot: Robot, d: np.ndarray, start: tuple[float, float] | None = None) -> Problem:
    """E and nu of a robot from its own tension and pitch at shortenings d [m]."""
    # By the load path of a search, so that what is interpolated is the same to rounding.
    seen = simulate(robot, Protocol({"front": Command("shortening", d)}), shared=True)
    channels = {
        "shortening": Channel(d, "m"),
        "tension": Channel(seen.channels["front.tension"], "N"),
        "pitch": Channel(seen.channels["plate.pitch"], "rad"),
    }
    test = Experiment("bench", Dataset("bench", channels), "front", "plate", "shortening")
    begin = (None, None) if start is None else start
    free = (
        FreeParameter(E, "Pa", *E_BOUNDS, scale="log", start=begin[0]),
        FreeParameter(NU, "1", *NU_BOUNDS, start=begin[1]),
    )
    # The search must not begin at the truth.
    return make_problem(with_parameters(robot, {E: 1.0e6, NU: 0.45}), (test,), free)


def with_noise(problem: Problem, **sigmas: float) -> Problem:
    chance = np.random.default_rng(0)
    (test,) = problem.experiments
    channels = dict(test.dataset.channels)
    for name, sigma in sigmas.items():
        clean = channels[name]
        channels[name] = replace(clean, values=clean.values + sigma * chance.standard_normal(len(clean.values)))
    return replace(problem, experiments=(replace(test, dataset=replace(test.dataset, channels=channels)),))


def begun_at(problem: Problem, start: dict[str, float]) -> Problem:
    free = tuple(replace(parameter, start=start[parameter.name]) for parameter in problem.space.parameters)
    return replace(problem, space=SearchSpace(free))


@pytest.mark.parametrize("start", CORNERS)
def test_least_squares_recovers_from_every_corner_with_linear_tets(start: tuple[float, float]) -> None:
    # With the default starts: where the first meets the measurements exactly, the others cost nothing.
    result = calibrate(problem("P1", start), method="least-squares")
    for name, true in TRUE.items():
        assert result.parameters[name].value == pytest.approx(true, rel=1e-5), name
    assert result.n_solves <= 9
    assert not any(estimate.at_bound for estimate in result.parameters.values())


@pytest.mark.slow
@pytest.mark.parametrize("start", [CORNERS[0], *(pytest.param(one, marks=pytest.mark.long) for one in CORNERS[1:])])
def test_least_squares_recovers_with_locking_free_tets(start: tuple[float, float]) -> None:
    result = calibrate(problem("P2P1", start), method="least-squares")
    for name, true in TRUE.items():
        assert result.parameters[name].value == pytest.approx(true, rel=1e-5), name
    assert result.n_solves <= 7


@pytest.mark.parametrize("start", CORNERS)
def test_with_noise_the_default_starts_end_alike_from_every_corner(start: tuple[float, float]) -> None:
    noisy = with_noise(problem("P1", start), tension=0.05, pitch=3e-3)
    result = calibrate(noisy, method="least-squares")
    from_the_truth = calibrate(begun_at(noisy, TRUE), method="least-squares", starts=1)
    assert result.loss <= from_the_truth.loss * (1 + 1e-4)
    assert result.n_solves <= 12


@pytest.mark.long
def test_a_thousand_trials_of_tpe_find_the_valley_of_the_neck() -> None:
    """Paper A's pipeline on a coarser mesh. Along the valley E makes up for what nu does, and TPE ends anywhere in it:
    on a mesh like the paper's, of 3,700 tets, seeds 1 to 6 end at losses from 0.0008 to 0.0024, where E is from 14 %
    low to 4 % high. What is held to account is the loss, and that E is the best one for its nu.
    """
    pytest.importorskip("gmsh")
    robot = neck("P1", Neck(tets=900, order=1).mesh())
    problem = problem_of(robot, np.linspace(0.0, 0.04, 41))
    result = calibrate(problem, method="tpe", trials=1000, seed=1, workers=2)
    assert len(result.trials) == 1000
    by_chance = np.median([trial.loss for trial in result.trials[:10] if trial.loss is not None])
    assert result.loss < 0.003 < 0.01 * by_chance
    found = {name: estimate.value for name, estimate in result.parameters.items()}
    moduli = found[E] * np.linspace(0.98, 1.02, 41)
    losses = [problem.evaluate({**found, E: float(modulus)}).loss or np.inf for modulus in moduli]
    assert moduli[np.argmin(losses)] == pytest.approx(found[E], rel=0.005)
