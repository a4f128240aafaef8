"""
A camera: positions from photographs of markers
===============================================

Three photographs of a manipulator whose sixth cable is pulled by 2 kgf, with ArUco markers on its discs and on the
frame. ``softcal markers`` finds their positions relative to the frame. The photographs are rendered, from a bench of
which all is known but for the gluing of the markers, to 0.2 mm. Distances between markers need no common frame.
"""

import csv
import subprocess
import sys
import tempfile
from itertools import combinations
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

bench, state = Path("../../examples/manipulator"), "cable6_2kgf"
discs = ("front1", "front2", "front3", "front4")
names = ",".join(f"{number}={name}" for number, name in zip((11, 12, 13, 14), discs, strict=True))
with tempfile.TemporaryDirectory() as folder:
    table = Path(folder, "markers.csv")
    options = ["--size", "24mm", "--sizes", "0=40mm,1=40mm,2=40mm,3=40mm", "--base", "0,1,2,3", "--names", names]
    files = [str(bench / "images"), "--camera", str(bench / "camera.yaml"), "--out", str(table)]
    subprocess.run([sys.executable, "-m", "softcal", "markers", *files, *options], check=True, capture_output=True)
    row = next(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
measured = {name: np.array([float(row[f"{name}.{axis} [m]"]) for axis in "xyz"]) for name in discs}
sd = {name: max(float(row[f"{name}.{axis}_sd [m]"]) for axis in "xyz") for name in discs}
print({name: f"± {1e3 * s:.2f} mm" for name, s in sd.items()})

# %%
# The twin of the project at the values that the bench was made with, and the same cable pulled.
true = {f"spring{k}.youngs_modulus": E for k, E in enumerate((0.86e9, 0.70e9, 0.92e9, 0.78e9), start=1)}
true |= {f"spring{k}.poissons_ratio": 0.41 for k in range(1, 5)} | {f"S{k}.mass": 0.0206 for k in range(1, 5)}
robot = softcal.with_parameters(
    softcal.load(bench / "project.yaml").robot, {**true, "cable6.friction_coefficient": 0.04}
)
pull = softcal.pull(robot, "cable6", "tension", 2 * 9.80665, samples=12)
channels = softcal.simulate(robot, pull).channels
twin = {name: np.array([channels[f"marker{name[-1]}.{axis}"][-1] for axis in "xyz"]) for name in discs}


def apart(points):
    return np.array([np.linalg.norm(points[a] - points[b]) for a, b in combinations(discs, 2)])


print("between markers [mm], photographs:", (1e3 * apart(measured)).round(2), "twin:", (1e3 * apart(twin)).round(2))
assert np.abs(apart(measured) - apart(twin)).max() < 0.6e-3  # three times what the gluing of a marker errs by
assert max(sd.values()) < 0.5e-3

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
left.imshow(plt.imread(bench / "images" / f"{state}_01.jpg"), cmap="gray")
left.set_axis_off()
pairs = list(combinations(discs, 2))
glued = 0.2e-3 * np.sqrt(2.0)
errors = [1e3 * np.hypot(glued, np.hypot(sd[a], sd[b])) for a, b in pairs]
right.errorbar(range(len(pairs)), 1e3 * (apart(measured) - apart(twin)), errors, fmt="o", capsize=4)
right.axhline(0.0, color="0.6", linewidth=1.0)
right.set_xticks(range(len(pairs)), [f"{a[-1]}, {b[-1]}" for a, b in pairs])
right.set(xlabel="discs of the two markers", ylabel="their distance, photographs less twin [mm]")
