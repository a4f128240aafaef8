"""A bench with markers, rendered: base, markers on a robot, viewpoints, a calibration board. All poses are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.manipulator.render import Image, Optics, Panel, render
from softcal.geometry.pose import Pose
from softcal.plugins.markers.bundle import square_corners
from softcal.plugins.markers.camera import Camera
from softcal.plugins.markers.fiducials import CharucoBoard, board_texture, marker_modules, marker_texture
from softcal.plugins.markers.marker_scene import Glimpse

DICTIONARY = "DICT_4X4_50"

# A 1080p webcam with a focal length of 1400 px, its lens rather worse than most.
WEBCAM = Camera(
    1920,
    1080,
    np.array([[1400.0, 0.0, 965.0], [0.0, 1402.0, 533.0], [0.0, 0.0, 1.0]]),
    np.array([0.06, -0.12, 0.0008, -0.0006, 0.02]),
)

# The same, for calibrations that take many images.
SMALL = Camera(
    960,
    540,
    np.array([[700.0, 0.0, 482.0], [0.0, 701.0, 266.0], [0.0, 0.0, 1.0]]),
    np.array([0.06, -0.12, 0.0008, -0.0006, 0.02]),
)

# Uneven light, a soft lens, a noisy sensor.
ROUGH = Optics(blur=0.8, noise=2.0, light=(0.25, -0.15), vignetting=0.25)

BOARD = CharucoBoard(9, 6, 0.028, 0.021, DICTIONARY)


@dataclass(frozen=True)
class Bench:
    """Markers in the world, each with its pose and size [m]; the base's frame is that of marker `base`."""

    poses: Mapping[int, Pose]
    sizes: Mapping[int, float]
    base: int = 0

    def in_base(self, number: int) -> Pose:
        """A marker's true pose in the base's frame."""
        return self.poses[self.base].inverse().after(self.poses[number])

    def panels(self) -> list[Panel]:
        """The markers with a white module around each."""
        return [marker_panel(number, self.sizes[number], pose) for number, pose in self.poses.items()]


def marker_panel(number: int, size: float, pose: Pose) -> Panel:
    texture = marker_texture(DICTIONARY, number)
    side = size * len(texture) / marker_modules(DICTIONARY)
    return Panel(texture, side, side, pose)


def looking(place: Sequence[float], at: Sequence[float], up: Sequence[float] = (1.0, 0.0, 0.0)) -> Pose:
    """The viewpoint of a camera at a place [m] that looks at another."""
    eye = np.asarray(place, dtype=np.float64)
    ahead = np.asarray(at, dtype=np.float64) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    return Pose(rotation, -rotation @ eye)


def manipulator(seed: int = 0, *, size: float = 0.02, tilt: float = np.radians(40.0)) -> Bench:
    """A base and four markers along 0.4 m, turned and shifted at random as on a bent manipulator."""
    rng = np.random.default_rng(seed)
    poses = {0: Pose.of((-tilt, 0.0, 0.0), (0.0, -0.19, 0.0))}
    for i in range(1, 5):
        reach = i / 4
        place = (0.04 * reach * rng.uniform(-1, 1), -0.19 + 0.36 * reach, 0.05 * reach * rng.uniform(-1, 1))
        poses[i] = Pose.of(rng.normal(0.0, 0.35, 3), place)
    return Bench(poses, dict.fromkeys(poses, size))


def viewpoints(n: int, distance: float = 0.5) -> list[Pose]:
    """Viewpoints on an arc of 50°; a single one in front."""
    angles = np.radians(np.linspace(-25.0, 25.0, n)) if n > 1 else np.zeros(1)
    return [
        looking((distance * np.sin(a), 0.03 * i, distance * np.cos(a)), (0.0, 0.0, 0.0)) for i, a in enumerate(angles)
    ]


def photograph(
    bench: Bench, viewpoint: Pose, *, camera: Camera = WEBCAM, optics: Optics = ROUGH, seed: int = 0
) -> Image:
    return render(camera, viewpoint, bench.panels(), optics, seed)


def board_poses(n: int, seed: int = 0) -> list[Pose]:
    """The board in front of the camera (which stands in the origin): near and far, all over the image, tilted."""
    rng = np.random.default_rng(seed)
    found: list[Pose] = []
    for i in range(n):
        # Turned to face the camera, then tilted by 20° to 45° about an axis that goes around.
        tilt, about = np.radians(rng.uniform(20, 45)), 2 * np.pi * i / n
        facing = Pose.of((np.pi, 0.0, 0.0))
        turned = Pose.of((tilt * np.cos(about), tilt * np.sin(about), 0.0)).after(facing)
        far = rng.uniform(0.30, 0.42)
        place = ((i % 3 - 1) * 0.09, (i // 3 % 3 - 1) * 0.05, far)
        found.append(Pose(turned.rotation, place))
    return found


def photograph_board(pose: Pose, *, camera: Camera = SMALL, optics: Optics | None = None, seed: int = 0) -> Image:
    texture = np.pad(board_texture(BOARD), 30, constant_values=1.0)
    scale = BOARD.square * BOARD.columns / (texture.shape[1] - 60)
    panel = Panel(texture, texture.shape[1] * scale, texture.shape[0] * scale, pose)
    optics = optics or Optics(rays=13, blur=0.6, noise=2.0, light=(0.25, -0.15), vignetting=0.25)
    return render(camera, Pose.of(), [panel], optics, seed)


def save(path: Path, image: Image) -> Path:
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def glimpse(
    bench: Bench,
    viewpoint: Pose,
    group: str = "rest",
    *,
    name: str = "",
    share: str = "",
    noise: float = 0.0,
    seed: int = 0,
) -> Glimpse:
    """What a camera would find without any image: projected corners, with noise [px] added."""
    rng = np.random.default_rng(seed)
    corners = {
        number: WEBCAM.project(viewpoint.after(pose).apply(square_corners(bench.sizes[number])))
        + rng.normal(0.0, 1.0, (4, 2)) * noise
        for number, pose in bench.poses.items()
    }
    return Glimpse(name or f"{group}.png", group, share or name or group, corners)
