"""What users meet in Python is shown: as a short text, and in a notebook as a small table.

A class that becomes public, or that a public function returns, joins by itself.
"""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from coupon_case import mooney_coupon
from fleet_case import write_fleet
from project_case import write_project
from sweep_case import write_sweep
from test_notebook import Cells

import softcal
from softcal.analysis.importance import ImportanceStudy, Index, OutputImportance, Pair, Range
from softcal.analysis.validation import Prediction, Validation
from softcal.calibration.results.result import HeldOut
from softcal.display import LONGEST, brief, displayed

SCRIPT = "<script>alert(1)</script>"
TIME = softcal.TimeSettings(time_step=0.01)
LARGEST = 40_000  # characters of a table, without its pictures


def softcal_classes(annotation: object) -> Iterable[type]:
    """The classes of softcal in an annotation such as dict[str, RecordFit]."""
    if inspect.isclass(annotation) and annotation.__module__.startswith("softcal"):
        yield annotation
    for part in typing.get_args(annotation):
        yield from softcal_classes(part)


def shown_classes() -> list[type]:
    """Public classes but exceptions, whose text is their message, and those that public functions return."""
    public = [getattr(softcal, name) for name in softcal.__all__]
    classes = [one for one in public if inspect.isclass(one) and not issubclass(one, Exception)]
    functions = [one for one in public if inspect.isfunction(one)]
    returned = [c for f in functions for c in softcal_classes(typing.get_type_hints(f).get("return"))]
    return list(dict.fromkeys([*classes, *returned]))


SHOWN = shown_classes()


@pytest.mark.parametrize("cls", SHOWN, ids=lambda cls: cls.__name__)
def test_it_has_a_short_text_and_a_table(cls: type):
    assert cls.__repr__ is not object.__repr__
    assert cls is softcal.Fault or not made_by_dataclass(cls), f"@displayed of softcal.display on {cls.__name__}"
    assert hasattr(cls, "_repr_html_")


def made_by_dataclass(cls: type) -> bool:
    """Whether the text of a class is the one that a dataclass makes, of all that it holds."""
    code = getattr(inspect.unwrap(cls.__repr__), "__code__", None)
    return code is not None and not code.co_filename.startswith(str(Path(softcal.__file__).parent))


@pytest.fixture(scope="module")
def met(tmp_path_factory: pytest.TempPathFactory) -> list[object]:
    """What a session gives: of a project, a run and its studies, a sweep, a fleet, coupons; and all that they hold."""
    home = tmp_path_factory.mktemp("session")
    path = write_project(home / "bar")
    project = softcal.load(path)
    calibrations = softcal.calibrate(project, out=home / "run", starts=1)
    sweep = softcal.sweep(write_sweep(home / "sweep"))
    tests = [mooney_coupon("a", "uniaxial", (2e5, 5e4)), mooney_coupon("b", "planar", (2e5, 5e4))]
    table = "specimen,experiments.pull.file\np1,p1.csv\np2,p2.csv\n"
    fleet = softcal.fleet(write_fleet(home / "fleet", (1.0, 1.1), table), out=home / "fleet-run", starts=1)
    (body,) = project.robot.bodies
    heavy = replace(project.robot, bodies=(replace(body, density=1100.0),))
    best = calibrations.headline
    left_out = replace(best, held_out={"pull": HeldOut(1.0, best.experiments["pull"])})
    return [
        project,
        softcal.simulate(project, snapshots=True),
        softcal.check(project, solve=False),
        calibrations,
        replace(calibrations, results={"a": calibrations.headline, "b": calibrations.headline}),
        softcal.load_run(home / "run"),
        softcal.intervals(home / "run"),
        softcal.next_test(home / "run"),
        softcal.mesh_study(path, halvings=0),
        softcal.compare_records(project, calibrations.headline),
        softcal.LiveTwin(project.robot),
        sweep,
        fleet,
        softcal.compare_laws(tests, ["mooney-rivlin", "gent"]),
        importance(),
        softcal.reach(path, {"plate.pitch": 0.05}),
        softcal.workspace(path, ["plate.x"], limits={"tension": (0.0, 2.0)}, states=20),
        softcal.linearise(heavy, {"front": 1.0}, modes=2),
        Validation({"bar": (Prediction(("pull",), left_out),)}),
        softcal.simulate_in_time(heavy, softcal.ramp({"front": ("tension", 1.0)}, 0.05), TIME),
        softcal.Schedule(np.array([0.0, 1.0]), {}),
        softcal.straight((0, 0, 0), (0, 0, 0.1), 4),
        softcal.Limit("points", 10),
        softcal.Fault("a", "b", "c"),
    ]


def importance() -> ImportanceStudy:
    first, total, pair = Index(0.7, 0.05), Index(0.8, 0.05), Index(0.1, 0.05)
    one = OutputImportance({"E": first}, {"E": total}, (Pair(("E", "nu"), pair),), 0.01)
    return ImportanceStudy({"loss": one}, {"E": Range(1e5, 1e6, "Pa", "log")}, ("a note",), {"simulations": 9.0}, 1.0)


def held(thing: object, found: dict[type, object], depth: int = 0) -> None:
    """One object of every class of softcal in a thing, by class."""
    if type(thing).__module__.startswith("softcal") and not isinstance(thing, type):
        found.setdefault(type(thing), thing)
    if depth > 5:
        return
    if is_dataclass(thing) and not isinstance(thing, type):
        for one in fields(thing):
            held(getattr(thing, one.name), found, depth + 1)
    elif isinstance(thing, Mapping):
        for one in list(thing.values())[:3]:
            held(one, found, depth + 1)
    elif isinstance(thing, Sequence) and not isinstance(thing, str):
        for one in thing[:3]:
            held(one, found, depth + 1)


def test_what_is_met_is_shown_shortly(met: list[object]):
    found: dict[type, object] = {}
    for thing in met:
        held(thing, found)
    shown = {cls: thing for cls, thing in found.items() if hasattr(thing, "_repr_html_")}
    assert len(shown) > 40
    texts = {cls.__name__: repr(thing) for cls, thing in shown.items()}
    long = {name: text for name, text in texts.items() if len(text) > LONGEST + 60 or "\n" in text}
    assert long == {}
    for thing in [*met, *shown.values()]:
        if hasattr(thing, "_repr_html_"):
            cells = Cells(thing._repr_html_())  # type: ignore[attr-defined]
            assert cells.texts, type(thing).__name__
            assert sum(map(len, cells.texts)) < LARGEST, type(thing).__name__
    both = next(one for one in met if isinstance(one, softcal.Calibrations) and len(one.results) > 1)
    result = both.headline
    cells = Cells(both._repr_html_()).texts
    assert cells[:3] == ["2 calibrations", "calibration", "parameter"]
    assert [cells.count(label) for label in both.results] == [len(result.parameters)] * 2
    name = next(iter(result.parameters))
    assert re.match(rf"CalibrationResult\({name} = 1\.3 MPa \(.* to .*\), .*, loss = [0-9.e-]+\)$", repr(result))


def test_the_text_of_an_object_has_what_is_not_by_default():
    bar = softcal.RoundBar(0.002)
    assert repr(bar) == "RoundBar(diameter=0.002)"
    assert repr(softcal.Limit("points", 1000)) == "Limit(of='points', most=1000)"
    plate = softcal.Plate("tip", {"finger": np.arange(3)}, reference=np.array([0.0, 0.0, 0.08]), mass=0.002)
    assert (
        repr(plate)
        == "Plate(name='tip', nodes=[finger], reference=[0, 0, 0.08], mass=0.002, centre_of_mass=[0, 0, 0.08])"
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros((3, 2)), "array (3, 2)"),
        (np.array([1, 2]), "[1, 2]"),
        (np.float64(0.5), "0.5"),
        ({"a": [1], "b": 2.0}, "[a, b: 2]"),
        (list(range(100)), "100 entries"),
        ("x" * 100, repr("x" * 60 + "…")),
        (len, "len"),
        (softcal.Robot, "Robot"),
        (None, "None"),
    ],
)
def test_values_are_brief(value: object, text: str):
    assert brief(value) == text


def test_names_are_escaped_and_a_long_text_is_cut():
    @displayed
    @dataclass(frozen=True)
    class Thing:
        name: str
        others: tuple[str, ...]
        more: str = ""
        further: str = ""

    thing = Thing(SCRIPT, tuple(f"{k}" * 30 for k in range(4)), "y" * 200, "z" * 200)
    assert len(repr(thing)) <= LONGEST + 3
    assert repr(thing).endswith("…)")
    assert Cells(thing._repr_html_()).texts[0] == f"Thing {SCRIPT}"  # type: ignore[attr-defined]


def test_a_text_that_is_written_stays():
    @displayed
    @dataclass(frozen=True, repr=False)
    class Own:
        def __repr__(self) -> str:
            return "mine"

        def _repr_html_(self) -> str:
            return "<b>mine</b>"

    assert (repr(Own()), Own()._repr_html_()) == ("mine", "<b>mine</b>")
