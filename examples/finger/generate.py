"""Write the data of this example again, from a finer twin and the truth below; always the same.

python generate.py --out runs/again         a minute; needs Gmsh
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from softcal.geometry.generate import mesh_file
from softcal.geometry.regions import Plane, select_nodes
from softcal.project.project import load
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

HERE = Path(__file__).parent
TRUTH = {"finger.youngs_modulus": 9.2e6, "finger.poissons_ratio": 0.44}
SIZE = 3e-3  # [m], of the finer twin's elements; the project's are 4 mm
TESTS = {"pull-7mm": (7.0, 0.6, 1), "pull-10mm": (10.0, 0.9, 2)}  # target and slack [mm], seed
NOISE_N, NOISE_DEG, SAMPLES = 0.05, 0.3, 41


def finer_robot() -> Robot:
    """The project's robot on a finer mesh, at the truth."""
    robot = load(HERE / "project.yaml").robot
    mesh = mesh_file(HERE / "finger.stl", size=SIZE)
    foot = select_nodes(mesh, Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    cap = select_nodes(mesh, Plane((0.0, 0.0, 0.084), (0.0, 0.0, 1.0)))
    body = replace(robot.bodies[0], mesh=mesh, fixed=foot)
    plate = replace(robot.plates[0], nodes={"finger": cap})
    return with_parameters(replace(robot, bodies=(body,), plates=(plate,)), TRUTH)


def main() -> None:
    """Write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "runs" / "again")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    robot = finer_robot()
    for name, (target, slack, seed) in TESTS.items():
        measured = np.linspace(0.0, target, SAMPLES)
        taut = np.maximum(measured - slack, 0.0)
        response = simulate(robot, Protocol({"tendon": Command("shortening", 1e-3 * taut)}))
        chance = np.random.default_rng(seed)
        force = response.channels["tendon.tension"] + NOISE_N * chance.standard_normal(SAMPLES)
        pitch = np.degrees(response.channels["tip.pitch"]) + NOISE_DEG * chance.standard_normal(SAMPLES)
        rows = zip(measured, force, pitch, strict=True)
        lines = ["displacement [mm],force [N],pitch [deg]", *(f"{d:.3f},{f:.3f},{p:.2f}" for d, f, p in rows)]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
