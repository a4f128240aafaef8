"""What the modulus depends on: the fit again with one assumption changed at a time.

`python vary.py [CASE …]` prints a table: E, its change, and the distances of the markers, fitted and predicted.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from derive import arm_mesh

from softcal.calibration.results.result import CalibrationResult
from softcal.project.project import Project, load
from softcal.twin.robot import Robot
from softcal.workflows.calibration import calibrate

HERE = Path(__file__).parent
Change = Callable[[Robot], Robot]


def meshed(columns: int = 2, layers: int = 5, *, element: str = "P2", **measures: float) -> Change:
    """Another mesh or element, or other measures of the section [m]."""

    def change(robot: Robot) -> Robot:
        mesh = arm_mesh(columns, layers, **measures)
        (body,), (plate,), (given,) = robot.bodies, robot.plates, robot.actuators
        sleeve = replace(body.inclusions[0], elements=mesh.element_sets["sleeve"])
        body = replace(body, mesh=mesh, fixed=mesh.node_sets["base"], element=element, inclusions=(sleeve,))
        chamber = replace(given.actuator, walls={body.name: mesh.face_sets["cavity"]})
        plate = replace(plate, nodes={body.name: mesh.node_sets["tip"]})
        return replace(robot, bodies=(body,), plates=(plate,), actuators=(replace(given, actuator=chamber),))

    return change


def of(**constants: float) -> Change:
    """Other constants of the law; Ef: of the outer wall alone."""

    def change(robot: Robot) -> Robot:
        (body,) = robot.bodies
        own = {key: value for key, value in constants.items() if key != "Ef"}
        (sleeve,) = body.inclusions
        sleeve = replace(sleeve, parameters={**sleeve.parameters, **constants})
        body = replace(body, parameters={**body.parameters, **own}, inclusions=(sleeve,))
        return replace(robot, bodies=(body,))

    return change


CASES: Mapping[str, Change] = {
    "as shipped": lambda robot: robot,
    "finer mesh, 3 columns and 8 layers": meshed(3, 8),
    "outer wall 1.73 mm": meshed(wall=1.73e-3),
    "outer wall 2.33 mm": meshed(wall=2.33e-3),
    "webs 3.5 mm": meshed(web=3.5e-3),
    "wall of the hole 1.97 mm": meshed(core=1.97e-3),
    "fibres of 100 MPa": of(Ef=1e8),
    "fibres of 3 MPa": of(Ef=3e6),
    "law that stiffens more, k 0.1": of(k=0.1),
    "Poisson's ratio 0.40": of(nu=0.40),
}


def fitted(project: Project, change: Change) -> CalibrationResult:
    """The fit of the changed robot."""
    return calibrate(replace(project, robot=change(project.robot))).headline


def main() -> None:
    """Print a row for every case, or for those that are named."""
    project = load(HERE / "project.yaml")
    shipped = 0.0
    for name in sys.argv[1:] or CASES:
        result = fitted(project, CASES[name])
        estimate, fit = result.parameters["arm.E"], result.experiments["fit"].distance
        shipped = shipped or estimate.value
        held = result.held_out["predict"].fit.distance if result.held_out else None
        low, high = estimate.interval or (estimate.value, estimate.value)
        sys.stdout.write(
            f"{name:36s} {estimate.value / 1e3:6.1f} ({low / 1e3:.0f} to {high / 1e3:.0f}) kPa "
            f"{100 * (estimate.value / shipped - 1):+6.1f} %   markers {1e3 * fit.rms:.2f} mm RMS, "
            + (f"predicted {1e3 * held.rms:.2f} mm\n" if held else "not predicted\n")
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
