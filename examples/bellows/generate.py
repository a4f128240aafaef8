"""Write the data of this example again, from a finer twin and the truth below; always the same.

python generate.py --out runs/again         ten seconds
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from softcal.geometry.bellows import Bellows
from softcal.project.project import load
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

HERE = Path(__file__).parent
TRUTH = {"bellows.youngs_modulus": 285e3}
MEASURES = {"outer_diameter": 0.030, "root_diameter": 0.020, "pitch": 0.012, "wall": 0.0015, "cap": 0.003}
FINER = {"layers": 16, "sectors": 16}  # of the twin's elements; the project's are the usual ones
LARGEST, NOISE_MM, SAMPLES = 6e3, 0.05, 13  # [Pa], [mm]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "runs" / "again")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    robot, mesh = load(HERE / "project.yaml").robot, Bellows(**MEASURES, **FINER).mesh()
    body = replace(robot.bodies[0], mesh=mesh, fixed=mesh.node_sets["foot"])
    (main,) = robot.actuators
    chamber = replace(main, actuator=main.actuator.on_surfaces({"bellows": mesh.face_sets["cavity"]}))
    robot = with_parameters(replace(robot, bodies=(body,), actuators=(chamber,)), TRUTH)
    pressures = np.linspace(0.0, LARGEST, SAMPLES)
    response = simulate(robot, Protocol({"main": Command("pressure", pressures)}))
    height = 1e3 * response.channels["tip.z"] + NOISE_MM * np.random.default_rng(1).standard_normal(SAMPLES)
    lines = ["pressure [kPa],tip z [mm]", *(f"{1e-3 * p:.3f},{z:.3f}" for p, z in zip(pressures, height, strict=True))]
    (folder / "pressure.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
