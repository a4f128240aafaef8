"""The Python API: whatever stands in the place of an array, a path or a part, an InputError says so."""

from __future__ import annotations

import copy
import itertools
import pickle
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
from faults.case import Case, assert_proper, parts
from project_case import bar_mesh, bar_robot, write_project

import softcal

api: Any = softcal  # whose kinds of arguments are not kept to here


class Broken:
    """Something that NumPy asks for an array, and that fails."""

    def __array__(self, *_: object, **__: object) -> None:
        raise RuntimeError("no")


class WithUnit(np.ndarray):
    """An array as libraries of units have it, whose unit NumPy drops."""

    unit = "mN"


class NoPath:
    def __fspath__(self) -> str:
        raise RuntimeError("no")


def nested(levels: int) -> list[Any]:
    inner: list[Any] = [1.0]
    for _ in range(levels):
        inner = [inner]
    return inner


def endless() -> list[Any]:
    itself: list[Any] = []
    itself.append(itself)
    return itself


# What is no array of numbers, or too many of them.
ARRAYS: Mapping[str, Callable[[], Any]] = {
    "a number alone": lambda: np.array(0.5),
    "nothing": lambda: None,
    "text": lambda: "0.5",
    "texts": lambda: np.array(["0.5", "1"]),
    "bytes": lambda: b"01",
    "objects": lambda: np.array([0.5, 1.0], object),
    "objects of nothing": lambda: np.array([None, 1.0], object),
    "dates": lambda: np.array(["2026-01-01", "2026-01-02"], "M8[s]"),
    "durations": lambda: np.array([1, 2], "m8[s]"),
    "truths": lambda: np.array([True, False]),
    "complex numbers": lambda: np.array([0.5 + 0j, 1.0]),
    "records": lambda: np.zeros(2, [("a", float)]),
    "masked values": lambda: np.ma.array([0.5, 1.0], mask=[False, True]),
    "masks in a list": lambda: [0.5, np.ma.masked],
    "quantities with a unit": lambda: pint.Quantity(np.array([0.5, 1.0]), "mN"),
    "a list of quantities": lambda: [pint.Quantity(np.array([0.5, 1.0]), "mN")] * 2,
    "an array of a library of units": lambda: np.array([0.5, 1.0]).view(WithUnit),
    "not finite": lambda: np.array([0.5, np.inf]),
    "an integer of many digits": lambda: [0, 10**400],
    "rows of two lengths": lambda: [[0.5], [0.5, 1.0]],
    "a set": lambda: {0.5, 1.0},
    "a mapping": lambda: {0: 0.5},
    "a generator": lambda: (one for one in (0.5, 1.0)),
    "decimals": lambda: [Decimal("0.5"), Decimal(1)],
    "a class": lambda: float,
    "no array at all": Broken,
    "a list in itself": endless,
    "a list of many levels": lambda: nested(3000),
    "a billion": lambda: np.broadcast_to(0.5, (10**9,)),
    "a billion whole numbers": lambda: np.broadcast_to(0, (10**9,)),
    "a range of a billion": lambda: range(10**9),
    "a trillion rows": lambda: np.broadcast_to(0.5, (10**12, 3)),
    "sixty axes": lambda: np.zeros((1,) * 60),
}


def body(**changes: Any) -> object:
    settings: dict[str, Any] = {"fixed": [0], "parameters": {"youngs_modulus": 1e6, "poissons_ratio": 0.4}, **changes}
    return api.Body(**{"name": "a", "mesh": bar_mesh(), **settings})


def live() -> Any:
    """A state of a twin that is driven."""
    return api.LiveTwin(bar_robot()).at({"front": 0.001})


def floating() -> object:
    """A robot of which nothing is fixed."""
    robot = bar_robot()
    bodies = tuple(replace(body, fixed=[]) for body in robot.bodies)
    return api.simulate(replace(robot, bodies=bodies), api.pull(robot, "front", "shortening", 0.006))


def moving(tension: float, *, time_step: float, ramp: float = 1.0, hold: float | None = None) -> object:
    """A robot with a mass in time."""
    robot = bar_robot()
    heavy = replace(robot, bodies=tuple(replace(body, density=1000.0) for body in robot.bodies))
    settings = api.TimeSettings(time_step=time_step, hold=hold)
    return api.simulate_in_time(heavy, api.ramp({"front": ("tension", tension)}, duration=ramp), settings)


# Where arrays come in.
PLACES: Mapping[str, Callable[[Any], object]] = {
    "a command": lambda a: api.Command("tension", a),
    "times": lambda a: api.Protocol({"front": api.Command("tension", [0.0, 1.0])}, a),
    "a channel": lambda a: api.Channel(a, "N"),
    "strains of a coupon": lambda a: api.Coupon("a", "uniaxial", a, [[0.0], [1.0]]),
    "stresses of a coupon": lambda a: api.Coupon("a", "uniaxial", [[1.1], [1.2]], a),
    "points of a mesh": lambda a: api.TetMesh(a, bar_mesh().tets),
    "tets of a mesh": lambda a: api.TetMesh(bar_mesh().points, a),
    "nodes of a set": lambda a: api.TetMesh(bar_mesh().points, bar_mesh().tets, node_sets={"a": a}),
    "nodes that are fixed": lambda a: body(fixed=a),
    "gravity": lambda a: api.Robot(bar_robot().bodies, gravity=a),
    "a via point": api.ViaPoint,
    "a reference": lambda a: api.Plate("a", {"bar": [1]}, a),
    "nodes of a plate": lambda a: api.Plate("a", {"bar": a}, [0.0, 0.0, 0.0]),
}
MAY_BE_NOTHING = ("times",)
ARRAY_CASES = [
    Case("Python", f"{what} as {place}", lambda make=make, use=use: use(make()))
    for (place, use), (what, make) in itertools.product(PLACES.items(), ARRAYS.items())
    if not (what == "nothing" and place in MAY_BE_NOTHING)
]

# What is called with what makes no sense.
CALLS: Mapping[str, Callable[[], object]] = {
    "a set without a name": lambda: api.TetMesh(bar_mesh().points, bar_mesh().tets, node_sets={5: [1]}),
    "a coupon whose time goes back": lambda: api.Coupon("a", "uniaxial", [[1.1], [1.2]], [[0.0], [1.0]], [1, 0]),
    "a coupon before it began": lambda: api.Coupon("a", "uniaxial", [[1.1], [1.2]], [[0.0], [1.0]], [-1, 0]),
    "a cable beyond all": lambda: api.simulate(
        bar_robot(), api.Protocol({"front": api.Command("shortening", [0.0, 1e308])})
    ),
    **{
        f"a whole number beyond all floats as {name}": lambda use=use: use(10**400)
        for name, use in {
            "a bound": lambda n: api.FreeParameter("bar.youngs_modulus", "Pa", 1, n),
            "a modulus": lambda n: body(parameters={"youngs_modulus": n, "poissons_ratio": 0.4}),
            "a density": lambda n: body(density=n),
            "gravity": lambda n: api.Robot(bar_robot().bodies, gravity=[0, 0, n]),
            "a pull": lambda n: api.pull(bar_robot(), "front", n),
            "a value": lambda n: api.simulate(bar_robot(), api.Protocol({}), {"bar.youngs_modulus": n}),
            "a value of a project": lambda n: api.simulate("project.yaml", theta={"bar.youngs_modulus": n}),
            "a cell of a sweep": lambda n: api.sweep("project.yaml", over={"bar.youngs_modulus": [n]}),
        }.items()
    },
    "a tension beyond all": lambda: api.LiveTwin(bar_robot(), "tension").at({"front": 1e300}),
    "fifty million samples": lambda: api.Command("tension", np.broadcast_to(0.5, (49_999_999,))),
    "a robot that floats": floating,
    "a plate on no body": lambda: api.simulate(
        replace(bar_robot(), plates=(*bar_robot().plates, api.Plate("p", {"nobody": [1]}, [0.0, 0.0, 0.0]))),
        api.pull(bar_robot(), "front", "shortening", 0.006),
    ),
    "a motion of a trillion steps": lambda: moving(0.0, time_step=1e-6, ramp=1e6),
    "a motion that waits for a trillion steps": lambda: moving(1.0, time_step=1e-6, hold=1e6),
    "a helix of two nodes": lambda: api.helix((0, 0, 0), (0, 0, 1), diameter=0.02, pitch=0.01, turns=20.0, at=2),
    "an uncertainty below zero": lambda: api.UncertainParameter("bar.youngs_modulus", "Pa", -1.0),
    "no project to validate": lambda: api.validate({}),
    "an option that an export has not": lambda: api.write_export(
        "sofa", api.ExportRequest(api.load("project.yaml")), "out", colour=3
    ),
    "an option of an export of another kind": lambda: api.write_export(
        "reduced", api.ExportRequest(api.load("project.yaml")), "out", samples="many"
    ),
    "a path that is none": lambda: api.simulate(NoPath()),
    "a live twin that is pickled": lambda: pickle.dumps(api.LiveTwin(bar_robot())),
    "a live state that is pickled": lambda: pickle.dumps(live()),
    "a live twin that is copied": lambda: copy.deepcopy(api.LiveTwin(bar_robot())),
    "a derivative of no channel": lambda: live().by_commands()["nobody", "front.shortening"],
    "a derivative by nobody": lambda: live().by_commands()["front.tension", "nobody"],
    "a derivative of one name": lambda: live().by_commands()["front.tension"],
    "rows of one name": lambda: live().by_commands().of("front.tension"),
    "derivatives by a list": lambda: live().by_parameters(["bar.youngs_modulus"]),
    **{
        f"a {what} called {name[:10]!r}": lambda make=make, name=name: make(name)
        for what, make in {
            "body": lambda name: body(name=name),
            "cable": lambda name: replace(bar_robot().cables[0], name=name),
            "plate": lambda name: api.Plate(name, {"bar": [1]}, [0.0, 0.0, 0.0]),
            "material": lambda name: api.Material(name, [1], {"youngs_modulus": 1e6}),
        }.items()
        for name in ("", "a b", "a\nb", "../x", "<b>", "=1+1", "1a", "a" * 500, "rig", "con", "\u202eabc")
    },
    "a float beyond all others": lambda: api.Command("tension", np.array([np.longdouble("1e4000")])),
    **{
        f"{what} to {name}": lambda use=use, path=path: use(path)
        for name, use in {
            "load": api.load,
            "load_run": api.load_run,
            "read_mesh": lambda path: api.read_mesh(f"{path}.msh"),
            "read_coupons": lambda path: api.read_coupons(path, test="uniaxial"),
            "write_report": api.write_report,
            "calibrate": lambda path: api.calibrate("project.yaml", out=path),
        }.items()
        for what, path in {
            "a name of 300 letters": "a" * 300,
            "a path of 6000 letters": "a/" * 3000,
            "half a character": "a\ud800",
            "a zero byte": "a\0",
        }.items()
    },
}
CALL_CASES = [Case("Python", name, call, files=write_project) for name, call in CALLS.items()]


def in_threads() -> None:
    """One live twin in three threads, each of which gets the states of its own commands."""
    twin, alone = api.LiveTwin(bar_robot()), api.LiveTwin(bar_robot())
    pulls = (0.001, 0.004, 0.009, 0.002)
    tensions = {pull: alone.at({"front": pull}).channels["front.tension"] for pull in pulls}
    with ThreadPoolExecutor(3) as threads:
        states = threads.map(lambda pull: (pull, twin.at({"front": pull})), pulls * 15)
        for pull, state in states:
            np.testing.assert_allclose(state.channels["front.tension"], tensions[pull], rtol=1e-6)


CALL_CASES.append(Case("Python", "a live twin in three threads", in_threads, ("solved",)))


@pytest.mark.parametrize("case", parts([*ARRAY_CASES, *CALL_CASES]))
def test_what_makes_no_sense_is_an_error_of_the_input(case: Case, tmp_path: Path) -> None:
    assert_proper(replace(case, says="."), tmp_path)
