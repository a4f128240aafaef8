"""Write what this example ships: positions.csv from the motion capture files, and beam.msh.

    python derive.py DIR               DIR holds beam_gravity_V2_a.c3d … beam_load101_V2_b.c3d
    python derive.py --mesh            beam.msh alone; nothing else is needed

The files are in srl-ethz/diffPD_sim2real, python/realbeam_experiments/Measurement_data. Of each take, the last half
second is averaged: by then the beam, which was held straight by hand at first, has come to rest.

The motion capture's own frame lies anywhere. Positions are therefore told in a frame that is laid on the three base
markers of each set-up: turned and moved so that their mean places are nearest to where they were meant to sit. This is
as good as those three are known, a few millimetres and degrees; the calibration finds out the rest.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from softcal.checks import Floats
from softcal.experiments.averaging import average
from softcal.experiments.motion_capture import read_c3d
from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh

HERE = Path(__file__).parent
REST = 0.5  # [s] at the end of a take
LENGTH, WIDTH = 0.1, 0.03  # [m]
LABELS = {f"{part.lower()}{n}": f"{part} - {n}" for part in ("Tip", "Base") for n in (1, 2, 3)}
# Where the authors say that the base markers sit [m]; they count x from the tip, we from the clamp.
BASE = {"base1": (0.006, -0.010, -0.001), "base2": (0.006, 0.040, 0.0275), "base3": (0.006, 0.040, 0.000)}
# Take -> weight [N]; the takes of one set-up were recorded without moving the cameras or the clamp between them.
SET_UPS = {
    "gravity": {"gravity_a": 0.0, "gravity_b": 0.0},
    "loads": {"load52_a": 0.51012, "load52_b": 0.51012, "load101_a": 1.00062, "load101_b": 1.00062},
}
HEADER = """\
Where six markers on a clamped silicone beam came to rest: means and standard deviations over the last 0.5 s of a take.
Derived by derive.py from the motion capture files of srl-ethz/diffPD_sim2real (MIT License, Copyright (c) 2021 Soft
Robotics Lab, ETH Zürich), python/realbeam_experiments/Measurement_data/beam_{gravity,load52,load101}_V2_{a,b}.c3d, which
belong to: M. Dubied, M. Y. Michelis, A. Spielberg, R. K. Katzschmann, Sim-to-real for soft robots using differentiable
FEM: recipes for meshing, damping, and actuation, IEEE Robotics and Automation Letters 7(2), 5015-5022, 2022.
Frame: x along the beam from the clamp, z up, laid on the base markers of each set-up: position = R (motion capture) + t.
"""


@dataclass(frozen=True)
class Rest:
    """Places of the markers at rest, in the order of `LABELS`: mean and standard deviation [m], shape (6, 3)."""

    mean: Floats
    sd: Floats


def at_rest(path: Path) -> Rest:
    """The end of a take in the motion capture's own frame."""
    data = average(read_c3d(path, LABELS), last=REST)
    channels = [[data.channels[f"{marker}.{axis}"] for axis in "xyz"] for marker in LABELS]
    return Rest(
        np.array([[channel.values[0] for channel in row] for row in channels]),
        np.array([[channel.sigma for channel in row] for row in channels]),
    )


def laid_on_base(takes: Mapping[str, Rest]) -> tuple[Floats, Floats]:
    """R and t [m] that bring the mean places of the base markers nearest to where they were meant to sit."""
    rows = [list(LABELS).index(marker) for marker in BASE]
    seen = np.mean([take.mean[rows] for take in takes.values()], axis=0)
    wanted = np.array(list(BASE.values()))
    turn, _ = Rotation.align_vectors(wanted - wanted.mean(axis=0), seen - seen.mean(axis=0))
    R = turn.as_matrix()
    return R, wanted.mean(axis=0) - R @ seen.mean(axis=0)


def write_positions(folder: Path, out: Path) -> None:
    """positions.csv from the takes in a folder."""
    comments = HEADER.splitlines()
    rows: list[list[str]] = []
    for set_up, loads in SET_UPS.items():
        takes = {take: at_rest(folder / f"beam_{take[:-2]}_V2_{take[-1]}.c3d") for take in loads}
        R, t = laid_on_base(takes)
        numbers = "; ".join(" ".join(f"{value:.6f}" for value in row) for row in R)
        comments.append(f"{set_up}: R = [{numbers}], t = [{' '.join(f'{value:.6f}' for value in t)}] m")
        for take, rest in takes.items():
            places = rest.mean @ R.T + t
            spread = np.sqrt(rest.sd**2 @ (R**2).T)
            cells = [f"{value:.4f}" for pair in zip(places, spread, strict=True) for part in pair for value in 1e3 * part]
            rows.append([take, set_up, f"{loads[take]:g}", *cells])
    names = [f"{marker}.{axis}{end} [mm]" for marker in LABELS for end in ("", "_sd") for axis in "xyz"]
    with out.open("w", encoding="utf-8", newline="") as stream:
        stream.writelines(f"# {comment}\n" for comment in comments)
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["take", "set-up", "load [N]", *names])
        writer.writerows(rows)


def write_beam(out: Path) -> None:
    """beam.msh: bricks of a centimetre, six tetrahedra each."""
    write_mesh(box_mesh((LENGTH, WIDTH, WIDTH), (10, 3, 3)), out)


def main() -> None:
    """Write the files beside this script, or where --out says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="the .c3d files")
    parser.add_argument("--mesh", action="store_true", help="write beam.msh")
    parser.add_argument("--out", type=Path, default=HERE, help="where to write")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.mesh:
        write_beam(arguments.out / "beam.msh")
    if arguments.folder is not None:
        write_positions(arguments.folder, arguments.out / "positions.csv")


if __name__ == "__main__":
    main()
