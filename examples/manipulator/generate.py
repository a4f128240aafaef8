"""Render the bench of this example: a manipulator pulled by weights, photographed with markers on it.

    python generate.py                        all images and weights.csv, into runs/bench/: 16 MB in some minutes
    python generate.py --states cable6_2kgf   the images of this state alone (several with commas; `board`: the board's)
    python generate.py --twin                 first truth-states.csv again, by the finer twin: half a minute
    python generate.py --out DIR              somewhere else

Always the same images: every chance comes from the seed in truth.yaml.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from render import Optics, Panel, render
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from softcal.checks import Floats
from softcal.geometry.pose import Pose
from softcal.plugins.markers.camera import Camera, Image
from softcal.plugins.markers.fiducials import CharucoBoard, board_texture, marker_modules, marker_texture
from softcal.twin.manipulator import Cables, Manipulator, Springs, manipulator
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Marker, Robot
from softcal.twin.simulate import simulate
from softcal.units import parse_quantity

HERE = Path(__file__).parent
DICTIONARY = "DICT_4X4_50"
CABLES = Cables(ends={"S2": math.radians(30), "S4": math.radians(90)})
# The moduli are the truth's where states are solved.
SHAPE = Manipulator(springs=Springs(youngs_modulus=1e9, poissons_ratio=0.4), cables=CABLES)
REST = "rest"
BOARD = "board"
FACES = {  # right, up and towards us, on a marker that faces so
    "front": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "side": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
}
AZIMUTHS = {"front": math.radians(270), "side": 0.0}

States = Mapping[str, Mapping[str, Pose]]  # state -> disc -> its pose, that of the disc's middle


def read_truth(path: Path = HERE / "truth.yaml") -> dict[str, Any]:
    """The true values; quantities still as text with a unit."""
    with path.open(encoding="utf-8") as stream:
        return YAML(typ="safe").load(stream)


def si(section: Mapping[str, Any], key: Any, unit: str) -> float:
    """A quantity of the truth in SI."""
    return parse_quantity(section[key], unit, where=str(key))


def vector(values: Sequence[str], unit: str) -> Floats:
    """Quantities of the truth in SI."""
    return np.array([parse_quantity(value, unit) for value in values])


# --- the finer twin ---------------------------------------------------------------------------------------------------


def true_robot(truth: Mapping[str, Any]) -> Robot:
    """The finer twin at the true values."""
    springs = truth["springs"]
    true = replace(
        SHAPE.springs,
        youngs_modulus={name: si(springs["youngs_modulus"], name, "Pa") for name in SHAPE.spring_names},
        poissons_ratio=float(springs["poissons_ratio"]),
        density=si(springs, "density", "kg/m^3"),
        elements_per_turn=truth["twin"]["elements_per_turn"],
    )
    discs = replace(SHAPE.discs, mass=si(truth["discs"], "mass", "kg"))
    cables = replace(CABLES, friction_coefficient=float(truth["cables"]["friction_coefficient"]))
    return manipulator(replace(SHAPE, springs=true, discs=discs, cables=cables))


def pulls(truth: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """State -> the cable that is pulled, and by what it is said to be."""
    weights = truth["weights"]["values"]
    return {f"{cable}_{weight.replace(' ', '')}": (cable, weight) for cable in SHAPE.cable_names for weight in weights}


def solve_states(truth: Mapping[str, Any]) -> States:
    """Where the discs of the finer twin come to rest in every state."""
    robot = true_robot(truth)
    arm, axes = 0.05, np.vstack([np.zeros(3), np.eye(3)])
    middles = {disc: SHAPE.on_disc(k + 1, 0.0, 0.0) for k, disc in enumerate(SHAPE.disc_names)}
    points = [Marker(f"{disc}_{i}", disc, middles[disc] + arm * axes[i]) for disc in SHAPE.disc_names for i in range(4)]
    robot = Robot(
        plates=robot.plates, cables=robot.cables, rods=robot.rods, markers=tuple(points), gravity=robot.gravity
    )
    random = np.random.Generator(np.random.PCG64([truth["seed"], 1]))
    states: dict[str, dict[str, Pose]] = {}

    def note(names: Sequence[str], protocol: Protocol) -> None:
        response = simulate(robot, protocol, curve_tolerance=0.0)
        if not response.succeeded:
            raise SystemExit(response.status)
        for i, name in enumerate(names):
            places = {m.name: np.array([response.channels[f"{m.name}.{axis}"][i] for axis in "xyz"]) for m in points}
            states[name] = {
                disc: Pose(
                    np.column_stack([(places[f"{disc}_{j}"] - places[f"{disc}_0"]) / arm for j in (1, 2, 3)]),
                    places[f"{disc}_0"],
                )
                for disc in SHAPE.disc_names
            }

    note([REST], Protocol({}))
    for cable in SHAPE.cable_names:
        names = [name for name, (pulled, _) in pulls(truth).items() if pulled == cable]
        forces = vector(truth["weights"]["values"], "N")
        forces = forces + si(truth["weights"], "sd", "N") * random.standard_normal(len(forces))
        note(names, Protocol({cable: Command("tension", forces)}))
    return states


def write_states(states: States, path: Path) -> None:
    """Write the discs' poses as a table."""
    lines = ["# The finer twin at the values of truth.yaml, by generate.py --twin"]
    lines.append("state,disc,x_mm,y_mm,z_mm,rx,ry,rz")
    for name, discs in states.items():
        for disc, pose in discs.items():
            place = ",".join(f"{1e3 * value:.4f}" for value in pose.position)
            turn = ",".join(f"{value:.7f}" for value in pose.rotation_vector)
            lines.append(f"{name},{disc},{place},{turn}")
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def read_states(path: Path = HERE / "truth-states.csv") -> States:
    """The discs' poses as they were written."""
    states: dict[str, dict[str, Pose]] = {}
    for name, disc, *numbers in list(csv.reader(path.read_text(encoding="utf-8").splitlines()))[2:]:
        values = np.array(numbers, dtype=np.float64)
        states.setdefault(name, {})[disc] = Pose.of(values[3:], 1e-3 * values[:3])
    return states


# --- the scene --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tag:
    """A marker: its number, the side of its black square [m], and its pose in the frame of what it is glued to."""

    number: int
    side: float
    pose: Pose


def frame_tags(truth: Mapping[str, Any]) -> list[Tag]:
    """The markers on the frame, in the robot's frame."""
    frame = truth["tags"]["frame"]
    return [
        Tag(
            number,
            si(frame, "side", "m"),
            Pose(
                Rotation.from_rotvec(vector(one["turn"], "rad")).as_matrix() @ np.array(FACES[one["faces"]]).T,
                vector(one["at"], "m"),
            ),
        )
        for number, one in frame.items()
        if isinstance(number, int)
    ]


def disc_tags(truth: Mapping[str, Any]) -> dict[str, dict[str, Tag]]:
    """Disc -> "front" or "side" -> the marker there, in the disc's frame, as it was really glued on."""
    tags = truth["tags"]
    random = np.random.Generator(np.random.PCG64([truth["seed"], 2]))
    found: dict[str, dict[str, Tag]] = {disc: {} for disc in SHAPE.disc_names}
    for face, numbers in tags["discs"].items():
        for disc, number in zip(SHAPE.disc_names, numbers, strict=True):
            azimuth = AZIMUTHS[face]
            place = si(tags, "radius", "m") * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            place = place + si(tags, "sd", "m") * random.standard_normal(3)
            turn = Rotation.from_rotvec(si(tags, "turn_sd", "rad") * random.standard_normal(3)).as_matrix()
            found[disc][face] = Tag(number, si(tags, "side", "m"), Pose(turn @ np.array(FACES[face]).T, place))
    return found


def true_places(truth: Mapping[str, Any], states: States) -> dict[str, dict[str, Floats]]:
    """State -> front1, side1, … -> the marker's true place [m] in the frame of marker 0."""
    tags, to_base = disc_tags(truth), next(tag for tag in frame_tags(truth) if tag.number == 0).pose.inverse()
    return {
        state: {
            f"{face}{disc.removeprefix('S')}": to_base.after(pose.after(tag.pose)).position
            for disc, pose in discs.items()
            for face, tag in tags[disc].items()
        }
        for state, discs in states.items()
    }


def tag_panels(tag: Tag, pose: Pose) -> list[Panel]:
    """A marker on its paper, and the paper's back."""
    texture = marker_texture(DICTIONARY, tag.number)
    side = tag.side * len(texture) / marker_modules(DICTIONARY)
    turned = pose.after(Pose.of((math.pi, 0.0, 0.0), (0.0, 0.0, -5e-4)))
    return [Panel(texture, side, side, pose), Panel(np.full((1, 1), 0.7), side, side, turned)]


def disc_panels(pose: Pose, diameter: float, thickness: float) -> list[Panel]:
    """A disc: two faces and a rim of flat pieces."""
    n = 61
    x = (np.arange(n) + 0.5) / n - 0.5
    round_one = np.where(x[:, None] ** 2 + x**2 <= 0.25, 0.3, np.nan)
    half = thickness / 2
    panels = [
        Panel(round_one, diameter, diameter, pose.after(Pose.of((0.0, 0.0, 0.0), (0.0, 0.0, half)))),
        Panel(0.9 * round_one, diameter, diameter, pose.after(Pose.of((math.pi, 0.0, 0.0), (0.0, 0.0, -half)))),
    ]
    pieces = 32
    width = diameter * math.tan(math.pi / pieces)
    for i in range(pieces):
        a = 2 * math.pi * i / pieces
        out = np.array([math.cos(a), math.sin(a), 0.0])
        turn = np.column_stack([(-math.sin(a), math.cos(a), 0.0), (0.0, 0.0, 1.0), out])
        shade = np.full((1, 1), 0.22 + 0.05 * out[0])
        panels.append(Panel(shade, width, thickness, pose.after(Pose(turn, 0.5 * diameter * out))))
    return panels


def line_panels(points: Floats, width: float, eye: Floats, shades: Sequence[float]) -> Iterator[Panel]:
    """A wire or cable through points (n, 3) as flat pieces that face the eye, shaded across."""
    for start, end in itertools.pairwise(points):
        along = end - start
        length = float(np.linalg.norm(along))
        along = along / length
        towards = eye - (start + end) / 2
        towards = towards - (towards @ along) * along
        towards = towards / np.linalg.norm(towards)
        rotation = np.column_stack([along, np.cross(towards, along), towards])
        yield Panel(np.array(shades)[:, None], length + 0.3 * width, width, Pose(rotation, (start + end) / 2))


def spring_points(before: Pose, after: Pose, thick: tuple[float, float], n: int = 37) -> Floats:
    """A picture's coil (n, 3) between two discs of given thickness: nothing that is measured hangs on it."""
    out = SHAPE.outwards
    start = before.apply(0.5 * thick[0] * out[None])[0]
    end = after.apply(-0.5 * thick[1] * out[None])[0]
    turn = Rotation.from_matrix(before.rotation.T @ after.rotation).as_rotvec()
    s = np.linspace(0.0, 1.0, n)
    length = SHAPE.spring_length
    t0, t1 = length * before.rotation @ out, length * after.rotation @ out
    h = [2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, -2 * s**3 + 3 * s**2, s**3 - s**2]
    middle = h[0][:, None] * start + h[1][:, None] * t0 + h[2][:, None] * end + h[3][:, None] * t1
    angle = -2 * math.pi * SHAPE.springs.turns * s
    around = 0.5 * SHAPE.springs.coil_diameter * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    turned = [before.rotation @ Rotation.from_rotvec(f * turn).as_matrix() @ a for f, a in zip(s, around, strict=True)]
    return middle + np.array(turned)


def bar_panels() -> list[Panel]:
    """The aluminium frame that the base hangs from: a bar in front and one on the right."""

    def face(middle: Sequence[float], across: float, up: float, axes: Sequence[Sequence[float]], shade: float) -> Panel:
        return Panel(np.full((1, 1), shade), across, up, Pose(np.array(axes, dtype=np.float64).T, np.array(middle)))

    below = ((1, 0, 0), (0, 1, 0), (0, 0, -1))
    below = (below[0], tuple(-v for v in below[1]), below[2])
    return [
        face((-0.085, -0.0445, 0.022), 0.29, 0.06, FACES["front"], 0.55),
        face((0.0585, 0.075, 0.022), 0.25, 0.06, FACES["side"], 0.6),
        face((-0.085, -0.0245, -0.008), 0.29, 0.04, below, 0.2),
        face((0.0385, 0.095, -0.008), 0.04, 0.21, below, 0.2),
    ]


def scene(truth: Mapping[str, Any], discs: Mapping[str, Pose], eye: Floats) -> list[Panel]:
    """Everything that a camera may see of a state from the place of its eye."""
    thick = [SHAPE.base.thickness, *[SHAPE.discs.thickness] * len(discs)]
    bodies = [Pose.of(position=SHAPE.on_disc(0, 0.0, 0.0)), *discs.values()]
    panels = bar_panels()
    for tag in frame_tags(truth):
        panels += tag_panels(tag, tag.pose)
    for disc, faces in disc_tags(truth).items():
        for tag in faces.values():
            panels += tag_panels(tag, discs[disc].after(tag.pose))
    for pose, thickness, diameter in zip(
        bodies, thick, [SHAPE.base.diameter, *[SHAPE.discs.diameter] * len(discs)], strict=True
    ):
        panels += disc_panels(pose, diameter, thickness)
    for i in range(len(discs)):
        points = spring_points(bodies[i], bodies[i + 1], (thick[i], thick[i + 1]))
        panels += line_panels(points, SHAPE.springs.wire_diameter, eye, (0.33, 0.42, 0.38, 0.28, 0.2))
    ends = np.repeat([1 + SHAPE.disc_names.index(end) for end in CABLES.ends], CABLES.per_end)
    for azimuth, end in zip(SHAPE.cable_azimuths, ends, strict=True):
        hole = CABLES.radius * np.array([[math.cos(azimuth), math.sin(azimuth), 0.0]])
        panels += line_panels(np.vstack([body.apply(hole) for body in bodies[: end + 1]]), 1e-3, eye, (0.12,))
    return panels


# --- the camera -------------------------------------------------------------------------------------------------------


def true_camera(truth: Mapping[str, Any]) -> Camera:
    """The webcam."""
    camera = truth["camera"]
    m = camera["matrix"]
    matrix = np.array([[m["fx"], 0.0, m["cx"]], [0.0, m["fy"], m["cy"]], [0.0, 0.0, 1.0]])
    return Camera(*camera["resolution"], matrix, np.array(camera["distortion"]))


def optics(truth: Mapping[str, Any], rays: int) -> Optics:
    """Light, lens and sensor."""
    told = truth["optics"]
    return Optics(
        rays=rays, blur=told["blur"], noise=told["noise"], light=tuple(told["light"]), vignetting=told["vignetting"]
    )


def eyes(truth: Mapping[str, Any], state: str) -> list[tuple[Floats, Floats]]:
    """Where the camera is held for each image of a state, and at what it looks [m]."""
    places = truth["camera"]["places"]
    random = np.random.Generator(np.random.PCG64([truth["seed"], 3, zlib.crc32(state.encode())]))
    distance, sd = si(places, "distance", "m"), si(places, "sd", "m")
    found: list[tuple[Floats, Floats]] = []
    for azimuth in vector(places["azimuths"], "rad"):
        eye = np.array([distance * math.cos(azimuth), distance * math.sin(azimuth), si(places, "height", "m")])
        target = np.array([0.0, 0.0, -0.19])
        found.append((eye + sd * random.standard_normal(3), target + sd * random.standard_normal(3)))
    return found


def looking(eye: Floats, target: Floats) -> Pose:
    """The viewpoint of a camera that is held upright."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    return Pose(rotation, -rotation @ eye)


def photographs(truth: Mapping[str, Any], state: str, discs: Mapping[str, Pose]) -> Iterator[tuple[str, Image]]:
    """The images of a state with their names."""
    camera = true_camera(truth)
    for i, (eye, target) in enumerate(eyes(truth, state)):
        name = f"{state}_{i + 1:02d}.jpg"
        panels = scene(truth, discs, eye)
        yield name, render(camera, looking(eye, target), panels, optics(truth, 55), zlib.crc32(name.encode()))


def board_photographs(truth: Mapping[str, Any]) -> Iterator[tuple[str, Image]]:
    """The images of the board with their names: near and far, all over the image, tilted."""
    told = truth["board"]
    board = CharucoBoard(told["columns"], told["rows"], si(told, "square", "m"), si(told, "marker", "m"), DICTIONARY)
    margin = 30
    texture = np.pad(board_texture(board), margin, constant_values=1.0)
    scale = board.square * board.columns / (texture.shape[1] - 2 * margin)
    random = np.random.Generator(np.random.PCG64([truth["seed"], 4]))
    for i in range(told["images"]):
        tilt, about = math.radians(random.uniform(20, 45)), 2 * math.pi * i / told["images"]
        turned = Pose.of((tilt * math.cos(about), tilt * math.sin(about), 0.0)).after(Pose.of((math.pi, 0.0, 0.0)))
        place = ((i % 3 - 1) * 0.11, (i // 3 % 3 - 1) * 0.06, random.uniform(0.30, 0.42))
        panel = Panel(texture, texture.shape[1] * scale, texture.shape[0] * scale, Pose(turned.rotation, place))
        name = f"board_{i + 1:02d}.jpg"
        yield name, render(true_camera(truth), Pose.of(), [panel], optics(truth, 21), zlib.crc32(name.encode()))


# --- files ------------------------------------------------------------------------------------------------------------


def write_images(folder: Path, images: Iterator[tuple[str, Image]], quality: int) -> None:
    """Write images as a webcam does, compressed."""
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    for name, image in images:
        if not cv2.imwrite(str(folder / name), image, [cv2.IMWRITE_JPEG_QUALITY, quality]):
            raise SystemExit(f"{folder / name} could not be written")


def write_weights(path: Path, truth: Mapping[str, Any]) -> None:
    """What hung from which cable in which state, as a person writes it down."""
    lines = ["group,cable,weight [kgf]"]
    lines += [f"{state},{cable},{weight.split()[0]}" for state, (cable, weight) in pulls(truth).items()]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def main() -> None:
    """Write the bench."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "runs" / "bench")
    parser.add_argument("--states", default="")
    parser.add_argument("--twin", action="store_true")
    told = parser.parse_args()
    truth = read_truth()
    if told.twin:
        write_states(solve_states(truth), HERE / "truth-states.csv")
    states = read_states()
    wanted = [name for name in told.states.split(",") if name] or [*states, BOARD]
    strange = [name for name in wanted if name not in states and name != BOARD]
    if strange:
        raise SystemExit(f"there is no state {', '.join(strange)}; there are {', '.join([*states, BOARD])}")
    told.out.mkdir(parents=True, exist_ok=True)
    write_weights(told.out / "weights.csv", truth)
    quality = truth["camera"]["jpeg_quality"]
    for name in wanted:
        if name == BOARD:
            write_images(told.out / BOARD, board_photographs(truth), quality)
        else:
            write_images(told.out / "images", photographs(truth, name, states[name]), quality)


if __name__ == "__main__":
    main()
