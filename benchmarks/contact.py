"""Contact of the shipped neck's grooves: its tension without and with contact, and with other settings.

python -m benchmarks.contact [--out FOLDER]

Takes three minutes. Writes docs/contact.md.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from benchmarks.neck_case import TENSION, pull
from benchmarks.section import table
from softcal.mechanics.contact import ContactTerm
from softcal.project.project import load
from softcal.twin.barrier import Contact
from softcal.twin.build import twin_of
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

ROOT = Path(__file__).resolve().parents[1]
SHORTENINGS = np.array([0.2, 2.0, 5.5, 10.0, 20.0, 30.0, 40.0, 50.0, 58.0]) * 1e-3
FINE = np.arange(1e-3, 40e-3, 0.5e-3)
STIFFER = 4.0  # times
INTRODUCTION = """# Contact in the grooves of the neck

Computed by `python -m benchmarks.contact`. The neck of `examples/neck` ({tets:,} tets) at E {modulus:.2g} MPa and
ν {ratio:.2g}, pulled to 58 mm. Contact has no gap: points on a surface press on the core of the surface that they
meet ([how](mechanics.md)). What is left to choose is how far surfaces overlap: at the `depth`, by default 0.04 of the
mean edge of the surface, the pressure is the `stiffness`, by default four times the mean modulus. {stiffer:.0f}
times as stiff, the overlap is about a quarter. When to set contact, and how to see it: [parts that touch](touching.md).
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of contact.md")
    out = parser.parse_args().out
    robot = load(ROOT / "examples" / "neck" / "project.yaml").robot
    (body,) = robot.bodies
    modulus, ratio = 1e-6 * body.parameters["youngs_modulus"], body.parameters["poissons_ratio"]
    head = INTRODUCTION.format(tets=body.mesh.n_tets, modulus=modulus, ratio=ratio, stiffer=STIFFER)
    parts = [head, *(_of_element(robot, element) for element in ("P1", "P2P1"))]
    text = "\n".join([*parts, "## Machine", "", *table(["", ""], machine()), ""])
    (out / "contact.md").write_text(text, encoding="utf-8")
    print(f"Written: {out / 'contact.md'}")


def _of_element(robot: Robot, element: str) -> str:
    """The section of one element."""
    (body,) = robot.bodies
    free = replace(robot, bodies=(replace(body, element=element),), contact=None)
    usual = replace(free, contact=Contact())
    assert usual.contact is not None
    pressure = usual.contact.pressure(usual.bodies).at(parameter_values(usual))
    stiffer = replace(free, contact=replace(usual.contact, stiffness=STIFFER * pressure))
    cases = {"no contact": free, "contact": usual, f"contact, {STIFFER:.0f} times as stiff": stiffer}
    rows: list[list[str]] = []
    for name, case in cases.items():
        twin_of(case)
        begun = time.process_time()
        found = simulate(case, pull(SHORTENINGS))
        if not found.succeeded:
            raise RuntimeError(f"{element}, {name}: {found.status}")
        took = time.process_time() - begun
        cost = [str(found.n_factorisations), f"{took:.1f} s"]
        rows.append([name, *(f"{value:.4g}" for value in found.channels[TENSION]), *cost])
        print(element, *rows[-1], flush=True)
    header = [f"{element}: tension [N] at", *(f"{1e3 * d:g} mm" for d in SHORTENINGS), "factorisations", "CPU"]
    return "\n".join([f"## {element}", "", *table(header, rows), "", _begins(free, usual), ""])


def _begins(free: Robot, touching: Robot) -> str:
    """Where contact begins, by the force and by the check of the twin without contact."""
    alone, pressed = (simulate(one, pull(FINE), curve_tolerance=0.0) for one in (free, touching))
    ratio = pressed.channels[TENSION] / alone.channels[TENSION] - 1.0
    acts = 1e3 * FINE[int(np.argmax(np.abs(ratio) > 1e-6))]
    said = simulate(free, pull(SHORTENINGS)).crossings.split("from ")[1].split(" ")[0]
    system = twin_of(touching).system
    (contact,) = system.of(ContactTerm)
    rest = contact.overlap(system.layout.X)
    return (
        f"At rest the largest overlap is {1e3 * rest:g} mm. The tension first differs by more than 1e-6 at\n"
        f"{acts:.1f} mm (in steps of 0.5 mm); without contact, `simulate` states that the neck intersects itself\n"
        f"from {said} mm on."
    )


if __name__ == "__main__":
    main()
