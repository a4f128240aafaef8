"""A neck that is its own mirror image: the factorisation of its tangent as a whole and in halves, and its curve."""

from __future__ import annotations

from unittest import mock

import numpy as np

from benchmarks.neck_case import PULL, neck_robot, pull
from benchmarks.section import Section, run_alone
from benchmarks.timing import interleaved, milliseconds, mkl_threads
from softcal.geometry.neck import Neck
from softcal.mechanics.linear_solve import Pardiso
from softcal.mechanics.pattern import Triangle
from softcal.mechanics.state import rest_state
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls
from softcal.twin.build import build_twin
from softcal.twin.finer import halved
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

SHAPE = Neck(tets=2000, sectors=6, waist_refinement=10)
SHORTENING = np.linspace(0.0, PULL, 9)


def measure(quick: bool) -> Section:
    robot = neck_robot(SHAPE.mesh(), "P2P1", shape=SHAPE)
    with mkl_threads(1):
        rows = [_row(one, 3 if quick else repeats) for one, repeats in ((robot, 30), (halved(robot), 5))]
    header = ["tets", "unknowns", "whole", "even half", "odd half", "whole / even", "whole / both"]
    header += ["curve, whole", "curve, halves", "whole / halves"]
    notes = [
        "Milliseconds of MKL PARDISO's phase 22 on one thread, at rest, and seconds of a curve to 40 mm in a twin that "
        "is built for it, with the plan of its halves: medians of calls in turn. P2P1, swept in 6 sectors. The whole "
        "is what a robot without a plane of symmetry takes; along a load path in the plane, the odd half is "
        "factorised only where stability is judged.",
    ]
    return Section("Symmetric robots in halves", header, rows, [], notes)


def _row(robot: Robot, repeats: int) -> list[str]:
    twin = build_twin(robot)
    none = np.zeros(1)
    at = twin.system.linearise(
        rest_state(twin.system.layout), Controls(none == 0.0, none, none), parameter_values(robot)
    )
    (mirror,) = twin.system.mirrors
    split = mirror.split(at.data, None)
    if split is None:
        raise RuntimeError("The neck does not mirror itself.")
    parts: dict[str, tuple[Triangle, np.ndarray]] = {
        "whole": (twin.system.pattern, at.data),
        "even": (mirror.even.triangle, split[0][0]),
        "odd": (mirror.odd.triangle, split[1][0]),
    }
    factors = {name: Pardiso(triangle.indptr, triangle.indices) for name, (triangle, _) in parts.items()}
    times = interleaved(
        {name: lambda own=own, name=name: own.factorise(parts[name][1]) for name, own in factors.items()},
        repeats=repeats,
    )
    for own in factors.values():
        own.release()
    whole, even, odd = (float(np.median(times[name])) for name in parts)

    def curve(robot: Robot) -> None:
        if not simulate(robot, pull(SHORTENING), crossings=False).succeeded:
            raise RuntimeError("The pull did not succeed.")

    def as_a_whole() -> None:
        with mock.patch.object(System, "mirrors", ()):
            curve(Robot(robot.bodies, robot.plates, robot.cables))

    curves = interleaved(
        {"whole": as_a_whole, "halves": lambda: curve(Robot(robot.bodies, robot.plates, robot.cables))},
        repeats=max(3, repeats // 3),
    )
    slow, fast = (float(np.median(curves[name])) for name in ("whole", "halves"))
    return [
        f"{sum(body.mesh.n_tets for body in robot.bodies):,}",
        f"{twin.system.layout.n_unknowns:,}",
        *(milliseconds(seconds) for seconds in (whole, even, odd)),
        f"{whole / even:.1f}",
        f"{whole / (even + odd):.1f}",
        f"{slow:.2f}",
        f"{fast:.2f}",
        f"{slow / fast:.2f}",
    ]


if __name__ == "__main__":
    run_alone(measure)
