"""Write the data of this example again, from the twin and the truth below; always the same.

python generate.py --out runs/again         half a minute
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np

from softcal.geometry.neck import Neck
from softcal.geometry.write import write_mesh
from softcal.project.project import load
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

HERE = Path(__file__).parent
BULK, EXPONENT = 9e6, 1.4  # [Pa], [-]: E = BULK * infill ** EXPONENT, times the filament's factor
FILAMENTS = {"82A": 1.0, "90A": 1.25}
INFILLS, PRINTERS = (0.2, 0.4, 0.6), ("XL", "Mini")
SPREAD = 0.04  # of ln E between prints of one filament and infill
NOISE_N, NOISE_DEG, SEED = 0.03, 0.1, 4
SHORTENING = np.linspace(0.0, 30.0, 31)  # [mm]


def main() -> None:
    """Write mesh, bench data, table and truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "runs" / "again")
    folder = parser.parse_args().out
    (folder / "data").mkdir(parents=True, exist_ok=True)
    write_mesh(Neck(tets=1000, order=1, sectors=6, waist_refinement=4).mesh(), folder / "neck.vtu")
    robot, chance = load(HERE / "project.yaml").robot, np.random.default_rng(SEED)
    rows, truth = ["specimen,file,filament,printer,infill [%]"], ["specimen,youngs_modulus [MPa],slack [mm]"]
    for k, (infill, filament, printer) in enumerate(itertools.product(INFILLS, FILAMENTS, PRINTERS), 1):
        modulus = BULK * infill**EXPONENT * FILAMENTS[filament] * np.exp(SPREAD * chance.standard_normal())
        slack = chance.uniform(1.0, 3.0)
        taut = np.maximum(SHORTENING - slack, 0.0)
        pull = Protocol({"front": Command("shortening", 1e-3 * taut)})
        response = simulate(robot, pull, {"neck.youngs_modulus": modulus})
        force = response.channels["front.tension"] + NOISE_N * chance.standard_normal(len(taut))
        pitch = np.degrees(response.channels["plate.pitch"]) + NOISE_DEG * chance.standard_normal(len(taut))
        lines = [f"{d:.2f},{f:.3f},{p:.2f}" for d, f, p in zip(SHORTENING, force, pitch, strict=True)]
        text = "\n".join(["displacement [mm],force [N],pitch [deg]", *lines]) + "\n"
        (folder / "data" / f"p{k:02}.csv").write_text(text, encoding="utf-8")
        rows.append(f"p{k:02},data/p{k:02}.csv,{filament},{printer},{100 * infill:.0f}")
        truth.append(f"p{k:02},{modulus / 1e6:.4f},{slack:.4f}")
    (folder / "fleet.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (folder / "truth.csv").write_text("\n".join(truth) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
