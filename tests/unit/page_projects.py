"""Small projects, and calibrated runs of them, behind the names that the commands of the documents use."""

from __future__ import annotations

import atexit
import functools
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
from coupon_case import MOONEY_RIVLIN, strains_of, write_coupon
from fleet_case import write_fleet
from mechanics_cases import hanging_finger
from project_case import write_project
from project_text import changed

import softcal
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh
from softcal.twin.actuators.chamber import Chamber

NECK = """\
softcal: 1
name: a neck with a stem
robot:
  bodies:
    neck:
      mesh: {file: neck.msh, unit: m}
      element: P1
      youngs_modulus: 2 MPa
      poissons_ratio: 0.42
      density: 1100 kg/m^3
      regions: {foot: {group: z0}, head: {group: z1}}
      fixed: foot
  rods:
    stem:
      straight: {start: [0 mm, 0 mm, 100 mm], end: [0 mm, 0 mm, 182 mm]}
      elements: 4
      section: {diameter: 16 mm}
      youngs_modulus: 30 MPa
      poissons_ratio: 0.4
      clamped: {plate: start, tip: end}
  plates:
    plate: {body: neck, region: head, reference: [0 mm, 0 mm, 100 mm], mass: 50 g}
    tip: {reference: [0 mm, 0 mm, 182 mm]}
  cables:
    front: {via: [{on: tip, at: [30 mm, 0 mm, 182 mm]}, {on: plate, at: [30 mm, 0 mm, 100 mm]}, {at: [30 mm, 0 mm, 0 mm]}]}
    left: {via: [{on: tip, at: [-15 mm, 26 mm, 182 mm]}, {on: plate, at: [-15 mm, 26 mm, 100 mm]}, {at: [-15 mm, 26 mm, 0 mm]}]}
    right: {via: [{on: tip, at: [-15 mm, -26 mm, 182 mm]}, {on: plate, at: [-15 mm, -26 mm, 100 mm]}, {at: [-15 mm, -26 mm, 0 mm]}]}
experiments:
  pull:
    cable: front
    plate: plate
    drive: shortening
    files: [{path: table.csv, columns: {shortening: {name: "front.shortening [m]"}, tension: {name: "front.tension [N]"},
      pitch: {name: "plate.pitch [rad]"}}}]
    noise: {tension: 0.05 N, pitch: 0.2 deg}
parameters:
  neck.youngs_modulus: {bounds: [1 MPa, 3 MPa], scale: log}
  neck.poissons_ratio: {bounds: [0.35, 0.48]}
calibration: {method: least-squares, starts: 1, loss: likelihood}
"""  # noqa: E501
FINGER = """\
softcal: 1
name: a finger with a chamber
robot:
  bodies:
    finger:
      mesh: {file: finger.msh, unit: m}
      element: P1
      youngs_modulus: 400 kPa
      poissons_ratio: 0.45
      regions: {foot: {group: foot}, wall: {group: wall}}
      fixed: foot
  actuators: {main: {actuator: chamber, walls: {finger: wall}, dead_volume: 20 ml}}
experiments:
  blown:
    drive: [main.pressure]
    files: [{path: table.csv, columns: {main.pressure: {name: "main.pressure [Pa]"},
      main.volume: {name: "main.volume [m^3]"}}}]
    noise: {main.volume: 0.01 ml}
parameters: {finger.youngs_modulus: {bounds: [0.1 MPa, 2 MPa], scale: log}}
calibration: {method: least-squares, starts: 1, loss: likelihood}
"""
SERVO = """\
softcal: 1
name: a rod between two cables
robot:
  rods:
    spine:
      straight: {start: [0 mm, 0 mm, 0 mm], end: [0 mm, 0 mm, 100 mm]}
      elements: 6
      section: {diameter: 3 mm}
      youngs_modulus: 0.8 GPa
      poissons_ratio: 0.35
      fixed: start
      clamped: {tip: end}
  plates: {tip: {reference: [0 mm, 0 mm, 100 mm]}}
  cables:
    left: {via: [{at: [10 mm, 0 mm, 0 mm]}, {on: tip, at: [10 mm, 0 mm, 100 mm]}], pulled_end: first}
    right: {via: [{at: [-10 mm, 0 mm, 0 mm]}, {on: tip, at: [-10 mm, 0 mm, 100 mm]}], pulled_end: first}
  actuators:
    servo: {actuator: drive, cables: {left: 1, right: -1}, radius: 8 mm, spring_rate: 5 N/mm, pretension: 1 N, gear_backlash: 4 deg}
experiments:
  sweep:
    drive: [servo.angle]
    plate: tip
    files: [{path: table.csv, columns: {servo.angle: {name: "servo.angle [rad]"}, servo.torque: {name: "servo.torque [N*m]"},
      pitch: {name: "tip.pitch [rad]"}}}]
    noise: {servo.torque: 0.5 mN*m, pitch: 0.1 deg}
parameters: {spine.youngs_modulus: {bounds: [0.2 GPa, 5 GPa], scale: log}}
calibration: {method: least-squares, starts: 1, loss: likelihood}
"""  # noqa: E501
# What turns that project into one of an arm: names alone.
ARM = (("front", "cable1"), ("left:", "cable2:"), ("plate: {body", "S4: {body"), ("on: plate", "on: S4"),
       ("plate: plate", "plate: S4"),       ("{plate: start", "{S4: start"), ("plate.pitch", "S4.pitch"))  # fmt: skip


def _write(folder: Path, text: str, values: np.ndarray, **truth: float) -> None:
    """The project, and the table that its twin makes at the true values, with noise of a hundredth."""
    path, (drive, *read) = folder / "project.yaml", re.findall(r'name: "([^"]+)"', text)
    path.write_text(text.partition("experiments:")[0], encoding="utf-8")
    actuator, control = drive.partition(" ")[0].split(".")
    robot = softcal.with_parameters(softcal.load(path).robot, {k.replace("__", "."): v for k, v in truth.items()})
    seen = softcal.simulate(robot, softcal.Protocol({actuator: softcal.Command(control, values)})).channels
    chance = np.random.default_rng(2)
    columns = [values]
    for name in read:
        exact = seen[name.partition(" ")[0]]
        columns.append(exact + 0.01 * np.abs(exact).max() * chance.standard_normal(len(exact)))
    write_coupon(folder / "table.csv", dict(zip((drive, *read), columns, strict=True)))
    path.write_text(text, encoding="utf-8")


def _neck(folder: Path) -> None:
    write_mesh(box_mesh((0.02, 0.02, 0.1), (1, 1, 5), origin=(-0.01, -0.01, 0.0)), folder / "neck.msh")
    _write(folder, NECK, np.linspace(0.0, 0.02, 12), neck__youngs_modulus=1.5e6)


def _arm(folder: Path) -> None:
    _neck(folder)
    path, table = folder / "project.yaml", folder / "table.csv"
    path.write_text(changed(path.read_text(encoding="utf-8"), ARM), encoding="utf-8")
    table.write_text(table.read_text("utf-8").replace("front", "cable1").replace("plate", "S4"), encoding="utf-8")


def _finger(folder: Path) -> None:
    (body,), (part,) = (robot := hanging_finger("P1", is_open=True)).bodies, robot.actuators
    assert isinstance(part.actuator, Chamber)
    groups = {"foot": body.fixed}, {"wall": np.asarray(part.actuator.surfaces["finger"], dtype=np.int64)}
    write_mesh(TetMesh(body.mesh.points, body.mesh.tets, *groups), folder / "finger.msh")
    _write(folder, FINGER, np.linspace(0.0, 2e4, 8), finger__youngs_modulus=3e5)


def _grip(folder: Path) -> None:
    _finger(folder)
    for path in (folder / "project.yaml", folder / "table.csv"):
        path.write_text(path.read_text(encoding="utf-8").replace("main", "grip"), encoding="utf-8")


def _servo(folder: Path) -> None:
    _write(folder, SERVO, np.linspace(0.1, 0.8, 8), spine__youngs_modulus=1e9)


def _bar(folder: Path) -> None:
    write_project(folder)


def _fleet(folder: Path) -> None:
    table = "specimen,file,filament\na,p1.csv,soft\nb,p2.csv,soft\nc,p3.csv,hard\nd,p4.csv,hard\n"
    write_fleet(folder, (1.0, 1.05, 1.4, 1.45), table)


def _coupons(folder: Path) -> None:
    for name, test in (("uniaxial", "uniaxial"), ("planar", "planar"), ("another", "shear")):
        strain = strains_of(test, 2.0, 12)[:, 0]
        measured = {"shear": "amount_of_shear", "uniaxial": "stretch", "planar": "stretch"}[test]
        stress = MOONEY_RIVLIN[test](0.3, 0.1, strain)
        kind = "shear_stress [MPa]" if test == "shear" else "nominal_stress [MPa]"
        write_coupon(folder / f"{name}.csv", {measured: strain, kind: stress})
    for name, rate in (("slow", 0.01), ("fast", 1.0), ("between", 0.1)):
        shear = np.linspace(0.0, 1.0, 12)
        time = shear / rate
        stress = 0.4 * shear + 0.2 * rate * 5.0 * (1.0 - np.exp(-time / 5.0))
        columns = {"time [s]": time, "amount_of_shear": shear, "shear_stress [MPa]": stress}
        write_coupon(folder / f"{name}.csv", columns)


KINDS = {
    "neck": _neck,
    "arm": _arm,
    "finger": _finger,
    "grip": _grip,
    "servo": _servo,
    "bar": _bar,
    "fleet": _fleet,
    "coupons": _coupons,
}
RUN = "run"


@functools.cache
def home(kind: str) -> Path:
    """A folder with the files of a kind of project, once in a process."""
    folder = Path(tempfile.mkdtemp(prefix=f"softcal-{kind}-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    KINDS[kind](folder)
    return folder


@functools.cache
def calibrated(kind: str) -> Path:
    """Its folder with a calibrated run."""
    folder = home(kind)
    softcal.calibrate(folder / "project.yaml", out=folder / RUN)
    return folder


def put(kind: str, folder: Path, *, run: Path | None = None) -> None:
    """The files of a project in a folder, in the place of those there; run: where its run is to be."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copytree(home(kind), folder, ignore=shutil.ignore_patterns(RUN), dirs_exist_ok=True)
    if run is not None and not run.exists():
        shutil.copytree(calibrated(kind) / RUN, run)
