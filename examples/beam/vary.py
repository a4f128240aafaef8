"""What the modulus hangs on: the joint fit again with one assumption changed at a time.

`python vary.py` prints a table: E, its change, and the distance of the markers. It takes about a minute.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.results.result import CalibrationResult
from softcal.geometry.primitives import box_mesh
from softcal.project.project import Project, load
from softcal.twin.robot import Marker, PointLoad, Robot
from softcal.workflows.calibration import calibrate

HERE = Path(__file__).parent
LENGTH, WIDTH = 0.1, 0.03  # [m]


def of_robot(change: Callable[[Robot], Robot]) -> Callable[[Project], Project]:
    """A change of the robot as one of the project."""
    return lambda project: replace(project, robot=change(project.robot))


def meshed(*divisions: int, element: str = "P2P1", held: float = 0.0) -> Callable[[Robot], Robot]:
    """Another mesh or element; held: length [m] of the beam that the clamp holds, which is left out."""

    def change(robot: Robot) -> Robot:
        mesh = box_mesh((LENGTH - held, WIDTH, WIDTH), divisions, origin=(held, 0.0, 0.0))
        body = replace(robot.bodies[0], mesh=mesh, fixed=mesh.node_sets["x0"], element=element)
        return replace(robot, bodies=(body,))

    return change


def with_material(**values: float) -> Callable[[Robot], Robot]:
    """Another Poisson's ratio or density [kg/m^3]."""

    def change(robot: Robot) -> Robot:
        body = robot.bodies[0]
        density = values.get("density", body.density)
        parameters = {key: values.get(key, value) for key, value in body.parameters.items()}
        return replace(robot, bodies=(replace(body, parameters=parameters, density=density),))

    return change


def loaded(move: Callable[[PointLoad], tuple[float, float, float]]) -> Callable[[Robot], Robot]:
    """The weight elsewhere."""

    def change(robot: Robot) -> Robot:
        loads = [replace(load, at=np.array(move(load))) for load in robot.loads if isinstance(load, PointLoad)]
        return replace(robot, loads=tuple(loads))

    return change


def moved(names: str, by: tuple[float, float, float]) -> Callable[[Robot], Robot]:
    """Markers whose names begin so, moved [m]."""

    def place(marker: Marker) -> Marker:
        return replace(marker, at=marker.at + np.array(by)) if marker.name.startswith(names) else marker

    return lambda robot: replace(robot, markers=tuple(map(place, robot.markers)))


def tilted(angle: float) -> Callable[[Robot], Robot]:
    """Gravity and weight turned about y [deg]: the beam slopes down towards its tip."""
    turn = np.deg2rad(angle)
    down = np.array([np.sin(turn), 0.0, -np.cos(turn)])

    def change(robot: Robot) -> Robot:
        g = float(np.linalg.norm(robot.gravity))
        loads = [replace(load, direction=down) for load in robot.loads if isinstance(load, PointLoad)]
        return replace(robot, gravity=g * down, loads=tuple(loads))

    return change


def without(marker: str) -> Callable[[Project], Project]:
    """A marker left out of the comparison."""

    def change(project: Project) -> Project:
        experiments = {
            name: replace(one, compared=tuple(c for c in one.compared if one.point_of(c) != marker))
            for name, one in project.experiments.items()
        }
        return replace(project, experiments=experiments)

    return change


def without_priors(project: Project) -> Project:
    """Nothing known of the frames."""
    parameters = () if project.space is None else project.space.parameters
    free = tuple(replace(p, prior_mean=None, prior_sd=None) for p in parameters)
    return replace(project, space=SearchSpace(free))


HELD_FRAME: Mapping[str, float] = dict.fromkeys((f"frame.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")), 0.0)
CASES: Mapping[str, Callable[[Project], Project]] = {
    "as shipped": lambda project: project,
    "frames as laid on the beam held straight": lambda project: load(project.path, values=HELD_FRAME),
    "frames of which nothing is known": without_priors,
    "weight on the middle of the edge alone": of_robot(loaded(lambda load: (LENGTH, WIDTH / 2, WIDTH))),
    "weight 3 mm behind the edge": of_robot(loaded(lambda load: (LENGTH - 0.003, load.at[1], WIDTH))),
    "tip markers 1 mm further out": of_robot(moved("tip", (0.001, 0.0, 0.0))),
    "base markers 1 mm further out": of_robot(moved("base", (0.001, 0.0, 0.0))),
    "without the marker base2": without("base2"),
    "without the marker tip1": without("tip1"),
    "clamp holds 2 mm of the beam": of_robot(meshed(10, 3, 3, held=0.002)),
    "beam slopes down by 5 deg": of_robot(tilted(5.0)),
    "Poisson's ratio 0.49": of_robot(with_material(poissons_ratio=0.49)),
    "Poisson's ratio 0.45": of_robot(with_material(poissons_ratio=0.45)),
    "density 3 % lower": of_robot(with_material(density=0.97 * 1070.0)),
    "finer mesh, 20 x 5 x 5 bricks": of_robot(meshed(20, 5, 5)),
    "linear tets, 10 x 3 x 3 bricks": of_robot(meshed(10, 3, 3, element="P1")),
    "linear tets, 20 x 6 x 6 bricks": of_robot(meshed(20, 6, 6, element="P1")),
}


def fitted(project: Project) -> CalibrationResult:
    """The joint fit."""
    return calibrate(project, fit="joint").headline


def main() -> None:
    """Print a row for every case."""
    project = load(HERE / "project.yaml")
    shipped = 0.0
    for name, change in CASES.items():
        result = fitted(change(project))
        estimate = result.parameters["beam.youngs_modulus"]
        shipped = shipped or estimate.value
        squares = [d.rms**2 for fit in result.experiments.values() for d in fit.distances.values()]
        bound = " at its bound" if estimate.at_bound else ""
        error = f"± {(estimate.standard_error or 0.0) / 1e3:3.0f}"
        sys.stdout.write(
            f"{name:42s} {estimate.value / 1e3:6.1f} {error} kPa {100 * (estimate.value / shipped - 1):+6.1f} %"
            f"   markers {1e3 * np.sqrt(np.mean(squares)):.2f} mm RMS{bound}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
