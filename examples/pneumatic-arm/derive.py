"""Write what this example ships: fit.csv and predict.csv from the motion capture files, and arm.msh.

    python derive.py DIR                        DIR holds arm_100mbar_V3.c3d … arm_450mbar_V3.c3d
    python derive.py DIR --predict 150 350      predict.csv of these pressures, whose files are in DIR too
    python derive.py --mesh                     arm.msh alone; nothing else is needed

The files are in srl-ethz/diffPD_sim2real, python/1segment_arm/Measurement_data. In each take the arm hangs at rest,
one of its chambers is put under pressure for three seconds or more, and let go. It creeps all the while; the states are
those from 2.4 s to 2.8 s after the tip has moved by 1 mm.

The motion capture's own frame lies anywhere. Here z is down along the arm from its base, by a fit of all seven markers
to their nominal places, and the chamber is on the side of +x, opposite to the mean motion of the tip at the five
pressures of fit.csv. The markers of the tip are where the cameras saw them at rest, before these takes.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from softcal.checks import Floats
from softcal.experiments.motion_capture import read_c3d
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.quality import drop_unreferenced
from softcal.geometry.regions import Cavity, Plane
from softcal.geometry.write import write_mesh

HERE = Path(__file__).parent
FIT, PREDICT = (100, 200, 250, 300, 400), (450,)  # [mbar]
LABELS = {
    **{f"base{n}": f"Base - {n}" for n in range(1, 5)},
    **{f"tip{n}": f"Tip - {n}" for n in range(1, 4)},
}
RATE = 100  # [Hz]
REST, WINDOW = slice(25, 45), slice(240, 280)  # frames: of a take, and after its start
MOVED = 1e-3  # [m]
# Where the authors say that the markers sit [m]; they count z from the tip upwards, we from the base downwards.
MEANT = 1e-3 * np.array(
    [
        (-50.5, 20.5, -2.0),
        (-30.5, 50.5, -2.0),
        (-10.5, -50.5, -2.0),
        (-50.5, -23.5, -2.0),
        (-9.645, 26.5, 100.0),
        (-9.645, -26.5, 100.0),
        (-28.2, 0.0, 100.0),
    ]
)
HEADER = """\
Where three markers on the tip of a pneumatic arm are under a pressure in one of its chambers: means from 2.4 s to 2.8 s
after the tip has moved by 1 mm. Derived by derive.py from the motion capture files of srl-ethz/diffPD_sim2real (MIT
License, Copyright (c) 2021 Soft Robotics Lab, ETH Zürich), python/1segment_arm/Measurement_data/*mbar_V3.c3d, which
belong to: M. Dubied, M. Y. Michelis, A. Spielberg, R. K. Katzschmann, Sim-to-real for soft robots using differentiable
FEM: recipes for meshing, damping, and actuation, IEEE Robotics and Automation Letters 7(2), 5015-5022, 2022.
"""

# Of the cross-section [m]: the outer radius is that of the authors' surface; walls, hole and plug are in remarks of
# their code; that the webs are as thick as the wall around the hole is assumed.
RADIUS, LENGTH = 22.2e-3, 100e-3
WALL, CORE, WEB = 2.03e-3, 2.27e-3, 2.27e-3
HOLE = 10.11e-3 / np.sqrt(2.0)  # half the side of the square hole
PLUG = 6.93e-3  # of the tip, beyond the chambers
SIDES = 4  # chambers


def read_take(path: Path) -> Floats:
    """Positions of the markers (n_frames, 7, 3) [m] in the motion capture's own frame."""
    channels = read_c3d(path, LABELS).channels
    return np.stack([[channels[f"{marker}.{axis}"].values for axis in "xyz"] for marker in LABELS], axis=0).T.swapaxes(
        1, 2
    )


def state(take: Floats) -> tuple[Floats, Floats]:
    """Places of the markers (7, 3) [m] at rest, and under pressure."""
    rest = take[REST].mean(axis=0)
    start = int(np.argmax(np.linalg.norm(take[:, 4] - rest[4], axis=1) > MOVED))
    return rest, take[start:][WINDOW].mean(axis=0)


def robots_frame(states: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    """R and t [m] from the motion capture's frame to the robot's."""
    rest = np.mean([rest for rest, _ in states], axis=0)
    turn, _ = Rotation.align_vectors(MEANT - MEANT.mean(axis=0), rest - rest.mean(axis=0))
    R = turn.as_matrix()
    t = MEANT.mean(axis=0) - R @ rest.mean(axis=0)
    x, y, _ = R @ np.sum([(bent - rest)[4:].mean(axis=0) for rest, bent in states], axis=0)
    about = Rotation.from_euler("z", -np.arctan2(-y, -x)).as_matrix()
    return about @ R, about @ t


def write_tables(folder: Path, out: Path, predict: Sequence[int] = PREDICT) -> None:
    """fit.csv and predict.csv from the takes in a folder."""
    states = {p: state(read_take(folder / f"arm_{p}mbar_V3.c3d")) for p in (*FIT, *predict)}
    R, t = robots_frame([states[p] for p in FIT])
    places = {p: (bent @ R.T + t)[4:] for p, (_, bent) in states.items()}
    rest = np.mean([states[p][0] for p in FIT], axis=0) @ R.T + t
    at = "; ".join(
        f"{name} {' '.join(f'{x:.3f}' for x in 1e3 * place)}" for name, place in zip(LABELS, rest, strict=True)
    )
    _write(out / "fit.csv", {p: places[p] for p in FIT}, f"At rest [mm]: {at}")
    _write(out / "predict.csv", {p: places[p] for p in predict}, "In the frame of fit.csv.")


def _write(out: Path, places: Mapping[int, Floats], remark: str) -> None:
    with out.open("w", encoding="utf-8", newline="") as stream:
        stream.writelines(f"# {comment}\n" for comment in (*HEADER.splitlines(), remark))
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["take", "pressure [mbar]", *(f"tip{n}.{axis} [mm]" for n in (1, 2, 3) for axis in "xyz")])
        for pressure, place in places.items():
            writer.writerow([f"{pressure}mbar", pressure, *(f"{value:.3f}" for value in 1e3 * place.ravel())])


def arm_mesh(columns: int = 2, layers: int = 5, *, wall: float = WALL, core: float = CORE, web: float = WEB) -> TetMesh:
    """Quadratic tets of the arm: z from its base down, a chamber on the sides of +x, +y, -x and -y.

    Its node set "base", its face set "cavity" of the chamber at +x, and its element set "sleeve", the outer wall.

    Parameters
    ----------
    columns
        Elements around a chamber; one more is its web.
    layers
        Elements along the chambers.
    wall, core, web
        Thickness of the outer wall, of that around the hole, and between chambers [m].
    """
    around = columns + 1
    bricks = box_mesh((3, SIDES * around, layers + 1), (3, SIDES * around, layers + 1))
    i, j, k = np.floor(bricks.points[bricks.tets].mean(axis=1)).astype(int).T
    is_hollow = (i == 1) & (j % around < columns) & (k < layers)
    grid = to_quadratic(drop_unreferenced(TetMesh(bricks.points, bricks.tets[~is_hollow])))
    u, v, w = grid.points.T

    def ring(half: float, *, is_square: bool) -> Floats:
        """Points (n, 2) at v of a square by half its side, or of a circle by its radius."""
        edge = np.arctan2(half - web / np.sqrt(2.0), half) if is_square else 0.25 * np.pi - np.arcsin(0.5 * web / half)
        one = np.linspace(-edge, edge, around)
        angles = np.append((one + 0.5 * np.pi * np.arange(SIDES)[:, None]).ravel(), 2.0 * np.pi - edge)
        angle = np.interp(v, np.arange(SIDES * around + 1), angles)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        return half * way / np.abs(way).max(axis=1, keepdims=True) if is_square else half * way

    rings = np.array(
        [
            ring(HOLE, is_square=True),
            ring(HOLE + core, is_square=True),
            ring(RADIUS - wall, is_square=False),
            ring(RADIUS, is_square=False),
        ]
    )
    low = np.minimum(u.astype(int), 2)
    share, number = (u - low)[:, None], np.arange(len(u))
    across = (1.0 - share) * rings[low, number] + share * rings[low + 1, number]
    along = np.interp(w, [0.0, layers, layers + 1.0], [0.0, LENGTH - PLUG, LENGTH])
    points = np.column_stack([across, along])
    _, first, which = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    points, tets = points[first], which.ravel()[grid.tets]
    mesh = TetMesh(points, tets)
    return TetMesh(
        points,
        tets,
        node_sets={
            "base": np.flatnonzero(points[:, 2] < 1e-9),
            "tip": np.flatnonzero(points[:, 2] > LENGTH - 1e-9),
        },
        face_sets={"cavity": Cavity((15e-3, 0.0, 30e-3), (Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),)).faces(mesh)},
        element_sets={"sleeve": np.flatnonzero(grid.points[grid.tets, 0].min(axis=1) >= 2.0)},
    )


def main() -> None:
    """Write the files beside this script, or where --out says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="the .c3d files")
    parser.add_argument("--predict", type=int, nargs="+", default=PREDICT, metavar="MBAR", help="rows of predict.csv")
    parser.add_argument("--mesh", action="store_true", help="write arm.msh")
    parser.add_argument("--out", type=Path, default=HERE, help="where to write")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.mesh:
        write_mesh(arm_mesh(), arguments.out / "arm.msh")
    if arguments.folder is not None:
        write_tables(arguments.folder, arguments.out, arguments.predict)


if __name__ == "__main__":
    main()
