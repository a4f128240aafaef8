"""Contact of the neck's grooves: its tension without and with contact, and with other settings; of the shipped neck,
and of one whose elliptic domes meet the waists in a cusp.

python -m benchmarks.contact [--out FOLDER]

Takes five minutes. Writes the numbers of docs/contact.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from benchmarks.neck_case import TENSION, neck_robot, pull
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.checks import Floats
from softcal.geometry.neck import Neck
from softcal.mechanics.contact import ContactTerm
from softcal.project.project import load
from softcal.twin.barrier import Contact
from softcal.twin.build import twin_of
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "contact.md"
ELEMENTS = ("P1", "P2P1")
FORMER = Neck(dome="ellipse", tets=2000, waist_refinement=12.0, sectors=6)
SHORTENINGS = np.array([0.2, 2.0, 5.5, 10.0, 20.0, 30.0, 40.0, 50.0, 58.0]) * 1e-3
FINE = np.arange(1e-3, 40e-3, 0.5e-3)
STIFFER, THINNER = 4.0, 0.5  # times


@dataclass(frozen=True)
class Found:
    """Of one element: rows of the table of tensions; and of contact, the largest change of these by other settings [-],
    the overlap at rest [m], the shortening [m] from which the tension differs, and the one [mm] from which the twin
    without contact says that it intersects itself.
    """

    rows: Sequence[Sequence[str]]
    changes: float
    overlap: float
    differs: float
    intersects: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=PAGE.parent, help="folder of contact.md")
    out = parser.parse_args().out
    robot = load(ROOT / "examples" / "neck" / "project.yaml").robot
    (body,) = robot.bodies
    numbers = {
        "tets": f"{body.mesh.n_tets:,}",
        "E": f"{1e-6 * body.parameters['youngs_modulus']:.2g}",
        "ratio": f"{body.parameters['poissons_ratio']:.2g}",
    }
    former = neck_robot(
        FORMER.mesh(), "P1", body.parameters["youngs_modulus"], body.parameters["poissons_ratio"], FORMER
    )
    found = {f"{element}{name}": _of_element(one, element) for name, one in (("", robot), (", former", former))
             for element in ELEMENTS}  # fmt: skip
    numbers["former tets"] = f"{former.bodies[0].mesh.n_tets:,}"
    text = written_page(PAGE, {**numbers, **values(found)})
    (out / PAGE.name).write_text(text, encoding="utf-8")
    print(f"Written: {out / PAGE.name}")


def values(found: Mapping[str, Found]) -> dict[str, str]:
    """What the page has of every element, and the machine, by the names of its marks."""
    told = {"machine": "\n".join(table(["", ""], machine()))}
    for element, one in found.items():
        header = [
            f"{element.partition(',')[0]}: tension [N] at",
            *(f"{1e3 * d:g} mm" for d in SHORTENINGS),
            "factorisations",
            "CPU",
        ]
        told |= {
            element: "\n".join(table(header, one.rows)),
            f"{element} changes": f"{100 * one.changes:.1f} %",
            f"{element} overlap": f"{1e3 * one.overlap:g} mm",
            f"{element} differs": f"{1e3 * one.differs:.1f} mm",
            f"{element} intersects": f"{one.intersects} mm",
        }
    return told


def _of_element(robot: Robot, element: str) -> Found:
    (body,) = robot.bodies
    free = replace(robot, bodies=(replace(body, element=element),), contact=None)
    own = Contact().fitted(free.bodies, free.rods, free.plates)
    usual = replace(free, contact=own)
    pressure = own.pressure(free.bodies).at(parameter_values(free))
    stiffer = replace(free, contact=replace(own, stiffness=STIFFER * pressure))
    thinner = replace(free, contact=replace(own, depth=THINNER * own.depth))
    cases = {
        "no contact": free,
        "contact": usual,
        f"contact, {STIFFER:.0f} times as stiff": stiffer,
        f"contact, {THINNER:g} times the depth": thinner,
    }
    rows: list[list[str]] = []
    tensions: list[Floats] = []
    for name, case in cases.items():
        twin_of(case)
        begun = time.process_time()
        found = simulate(case, pull(SHORTENINGS))
        if not found.succeeded:
            raise RuntimeError(f"{element}, {name}: {found.status}")
        took = time.process_time() - begun
        cost = [str(found.n_factorisations), f"{took:.1f} s"]
        tensions.append(found.channels[TENSION])
        rows.append([name, *(f"{value:.4g}" for value in found.channels[TENSION]), *cost])
        print(element, *rows[-1], flush=True)
    _, own_tension, *others = tensions
    changes = max(float(np.abs(other / own_tension - 1.0).max()) for other in others)
    return Found(rows, changes, *_begins(free, usual))


def _begins(free: Robot, touching: Robot) -> tuple[float, float, str]:
    """The overlap at rest [m], and where contact begins, by the force [m] and by the check of the twin without contact
    [mm].
    """
    alone, pressed = (simulate(one, pull(FINE), curve_tolerance=0.0) for one in (free, touching))
    ratio = pressed.channels[TENSION] / alone.channels[TENSION] - 1.0
    acts = float(FINE[int(np.argmax(np.abs(ratio) > 1e-6))])
    said = simulate(free, pull(SHORTENINGS)).crossings.split("from ")[1].split(" ")[0]
    system = twin_of(touching).system
    (contact,) = system.of(ContactTerm)
    return contact.overlap(system.layout.X), acts, said


if __name__ == "__main__":
    main()
