"""Write what this example ships: positions.csv from the motion capture files, and beam.msh.

    python derive.py DIR               DIR holds beam_gravity_V2_a.c3d … beam_load101_V2_b.c3d
    python derive.py --mesh            beam.msh alone; nothing else is needed

The files are in srl-ethz/diffPD_sim2real, python/realbeam_experiments/Measurement_data. In each take the beam is held
straight by hand for half a second, let go, and comes to rest; the last half second is averaged.

The motion capture's own frame lies anywhere. Positions are therefore told in a frame that is laid, once for each
set-up, on all six markers while the beam is held straight: turned and moved so that their mean places are nearest to
where they were meant to sit. That is as good as a hand holds straight, about a millimetre and a degree; the calibration
finds out the rest. (Laid on the three base markers alone it would be wrong by two to four degrees: their triangle is
small, and one of the three sits a millimetre or two beside its place.)
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
from softcal.experiments.dataset import Dataset
from softcal.experiments.motion_capture import read_c3d
from softcal.experiments.steps.averaging import average
from softcal.experiments.steps.sampling import window
from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh

HERE = Path(__file__).parent
REST = 0.5  # [s] at the end of a take
HELD = 0.3  # [s] at its beginning; the earliest release is at 0.43 s
LENGTH, WIDTH = 0.1, 0.03  # [m]
LABELS = {f"{part.lower()}{n}": f"{part} - {n}" for part in ("Tip", "Base") for n in (1, 2, 3)}
# Where the authors say that the markers sit [m]; they count x from the tip, we from the clamp.
MEANT = np.array(
    [
        (0.1, 0.015, 0.036),
        (0.1, -0.006, 0.024),
        (0.1, 0.036, 0.006),
        (0.006, -0.010, -0.001),
        (0.006, 0.040, 0.0275),
        (0.006, 0.040, 0.000),
    ]
)
# Take -> weight [N]; the takes of one set-up were recorded without moving the cameras or the clamp between them.
SET_UPS = {
    "gravity": {"gravity_a": 0.0, "gravity_b": 0.0},
    "loads": {"load52_a": 0.51012, "load52_b": 0.51012, "load101_a": 1.00062, "load101_b": 1.00062},
}
HEADER = """\
Where six markers on a clamped silicone beam came to rest: means and standard deviations over the last 0.5 s of a take.
Derived by derive.py from the motion capture files of srl-ethz/diffPD_sim2real (MIT License, Copyright (c) 2021 Soft
Robotics Lab, ETH Zürich), python/realbeam_experiments/Measurement_data/beam_{gravity,load52,load101}_V2_{a,b}.c3d,
which belong to: M. Dubied, M. Y. Michelis, A. Spielberg, R. K. Katzschmann, Sim-to-real for soft robots using
differentiable FEM: recipes for meshing, damping, and actuation, IEEE Robotics and Automation Letters 7(2), 5015-5022,
2022.
Frame: x along the beam from the clamp, z up, laid on the markers of each set-up while the beam was held straight:
position = R (motion capture) + t.
"""


@dataclass(frozen=True)
class Places:
    """Places of the markers in the order of `LABELS`: mean and standard deviation [m], shape (6, 3)."""

    mean: Floats
    sd: Floats


@dataclass(frozen=True)
class Take:
    """A take in the motion capture's own frame: held straight, and at rest."""

    held: Places
    rest: Places


def read_take(path: Path) -> Take:
    """Both ends of a take."""
    data = read_c3d(path, LABELS)
    return Take(_places(average(window(data, "time", upper=HELD))), _places(average(data, last=REST)))


def _places(data: Dataset) -> Places:
    channels = [[data.channels[f"{marker}.{axis}"] for axis in "xyz"] for marker in LABELS]
    return Places(
        np.array([[channel.values[0] for channel in row] for row in channels]),
        np.array([[channel.sigma for channel in row] for row in channels]),
    )


def laid_on_markers(takes: Mapping[str, Take]) -> tuple[Floats, Floats]:
    """R and t [m] that bring the markers of the beam held straight nearest to where they were meant to sit."""
    seen = np.mean([take.held.mean for take in takes.values()], axis=0)
    turn, _ = Rotation.align_vectors(MEANT - MEANT.mean(axis=0), seen - seen.mean(axis=0))
    R = turn.as_matrix()
    return R, MEANT.mean(axis=0) - R @ seen.mean(axis=0)


def write_positions(folder: Path, out: Path) -> None:
    """positions.csv from the takes in a folder."""
    comments = HEADER.splitlines()
    rows: list[list[str]] = []
    for set_up, loads in SET_UPS.items():
        takes = {take: read_take(folder / f"beam_{take[:-2]}_V2_{take[-1]}.c3d") for take in loads}
        R, t = laid_on_markers(takes)
        numbers = "; ".join(" ".join(f"{value:.6f}" for value in row) for row in R)
        comments.append(f"{set_up}: R = [{numbers}], t = [{' '.join(f'{value:.6f}' for value in t)}] m")
        for take, ends in takes.items():
            places = ends.rest.mean @ R.T + t
            spread = np.sqrt(ends.rest.sd**2 @ (R**2).T)
            numbers = 1e3 * np.stack([places, spread], axis=1).ravel()
            cells = [f"{value:.4f}" for value in numbers]
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
