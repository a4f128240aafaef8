"""What other laws, and a history, cost beside the neo-Hookean law."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.neck_case import PULL, TENSION, pull, standard_robot
from benchmarks.newton_iteration import Midway, midway
from benchmarks.section import Goal, Section, run_alone
from benchmarks.timing import interleaved, milliseconds, mkl_threads
from softcal.materials.catalogue import LAWS
from softcal.mechanics.statics import Statics
from softcal.twin.material import Winding
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

OTHER_LAWS, WHOLE_RECORD = 1.5, 30.0  # goals: times the neo-Hookean iteration, seconds
CYCLES, POINTS, SPEEDS = 8, 41, (0.015, 0.005)  # of a record: samples of each way [-], speeds [m/s] of its halves
HISTORY = {
    "relaxing_share1": 0.2, "relaxation_time1": 1.0, "relaxing_share2": 0.1, "relaxation_time2": 10.0,
    "softening_amount": 2.0, "softening_energy": 1e4,
}  # fmt: skip


def of_law(robot: Robot, name: str) -> Robot:
    """The robot with another law of the same moduli at small strain."""
    (body,), law = robot.bodies, LAWS[name]
    mu = LAWS[body.law].shear_modulus(body.parameters)
    kappa = LAWS["neo-hooke-isochoric"].bulk_modulus(body.parameters)
    typical = {one.name: body.parameters.get(one.name, one.typical) for one in law.parameters}
    if "youngs_modulus" not in typical:
        scale = mu / law.shear_modulus(typical)
        typical = {
            one.name: typical[one.name] * (scale if one.quantity.unit == "Pa" else 1.0) for one in law.parameters
        }
        typical["bulk_modulus"] = kappa
    winding = Winding(np.radians(30.0)) if law.n_directions > 1 else None  # around the neck's axis
    return replace(robot, bodies=(replace(body, law=name, parameters=typical, winding=winding),))


def measure(quick: bool) -> Section:
    rows: list[list[str]] = []
    worst = {"P1": 0.0, "P2P1": 0.0}
    with mkl_threads(1):
        for element, repeats in (("P1", 100), ("P2P1", 20)):
            cases: dict[str, Midway] = {}
            for name in LAWS:
                if element == "P1" or name != "stvenant-kirchhoff":  # which P2P1 does not unlock
                    cases[name] = midway(element, of_law(standard_robot(element), name))
            statics = {name: Statics(case.twin.system, case.theta) for name, case in cases.items()}
            times = interleaved(
                {name: partial(case.iterate, statics[name]) for name, case in cases.items()},
                repeats=max(5, repeats // 5) if quick else repeats,
                seconds=120.0,
            )
            for one in statics.values():
                one.release()
            base = float(np.median(times["neo-hooke"]))
            for name, taken in times.items():
                ratio = float(np.median(taken)) / base
                worst[element] = max(worst[element], ratio)
                rows.append([element, name, milliseconds(float(np.median(taken))), f"{ratio:.2f}"])
        seconds, n_samples, largest = _record(quick)
    rows.append(["P1", f"softening, relaxation-2: {n_samples} samples", f"{1e3 * seconds:.0f}", "–"])
    goals = [
        Goal(f"Newton iteration of the dearest law over the neo-Hookean one, {element}", ratio, OTHER_LAWS)
        for element, ratio in worst.items()
    ]
    goals.append(
        Goal("eight cycles at two speeds, softening and two branches, P1, one thread", seconds, WHOLE_RECORD, "s")
    )
    notes = [
        "Milliseconds. One Newton iteration of the neck pulled by 20 mm, as above, of every law with the same moduli "
        "at small strain, called in turn with one MKL thread. The last row is a whole record: "
        f"{CYCLES} pulls to 40 mm at 15 and 5 mm/s, {largest:.3g} N, whose samples are solved in their order."
    ]
    return Section("Laws and histories", ["element", "law", "ms", "over neo-hooke"], rows, goals, notes)


def _record(quick: bool) -> tuple[float, int, float]:
    """Processor seconds of a record with a history, its samples, and its largest tension [N]."""
    robot = standard_robot("P1")
    (body,) = robot.bodies
    parameters = {**body.parameters, **HISTORY}
    robot = replace(robot, bodies=(replace(body, parameters=parameters, history=("softening", "relaxation-2")),))
    once = PULL * np.concatenate([np.linspace(0.0, 1.0, POINTS), np.linspace(1.0, 0.0, POINTS)[1:]])
    way = np.concatenate([once, *[once[1:]] * (1 if quick else CYCLES - 1)])
    speed = np.where(np.arange(len(way) - 1) < len(way) // 2, *SPEEDS)
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way)) / speed)])
    protocol = Protocol(pull(way).commands, times)
    simulate(robot, protocol.take(np.arange(3)), crossings=False)
    start = time.process_time()
    response = simulate(robot, protocol, crossings=False)
    seconds = time.process_time() - start
    if not response.succeeded:
        raise RuntimeError(response.status)
    return seconds, len(way), float(response.channels[TENSION].max())


if __name__ == "__main__":
    run_alone(measure)
