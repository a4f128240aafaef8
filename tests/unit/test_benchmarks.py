"""The benchmarks' own arithmetic: goals, verdicts, and what they hand over."""

from __future__ import annotations

import time

import numpy as np
import pytest

from benchmarks.assembly import AGREEMENT, difference
from benchmarks.laws import of_law
from benchmarks.mesh_table import Kind, Row, verdict
from benchmarks.neck_case import standard_robot
from benchmarks.peers import Task, felupe_assembler, scikit_fem_assembler, softcal_assembler
from benchmarks.same_numbers import difference as apart
from benchmarks.same_numbers import numbers
from benchmarks.section import Goal, Section
from benchmarks.timing import interleaved
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.materials.catalogue import LAWS


def test_a_goal_is_met_up_to_its_limit():
    assert Goal("x", 1.8, 1.8).met
    assert not Goal("x", 1.81, 1.8).met
    assert not Goal("x", float("nan"), 1.8).met


def test_a_section_survives_its_json():
    section = Section("Title", ["a", "b"], [["1", "2"]], [Goal("what", 1.0, 2.0, "s")], ["note"])
    assert Section.from_json(section.to_json()) == section
    assert section.markdown() == "## Title\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n\nnote\n"


def test_a_section_that_measured_nothing_says_why_and_has_no_table():
    assert Section("Title", ["a"], [], notes=["Not measured."]).markdown() == "## Title\n\nNot measured.\n"


def test_interleaved_calls_all_in_turn_and_times_each():
    calls: list[str] = []
    times = interleaved(
        {"short": lambda: calls.append("short"), "long": lambda: (calls.append("long"), time.sleep(0.01))}, repeats=4
    )
    assert calls == ["short", "long"] * 5
    assert len(times["short"]) == 4
    assert np.median(times["long"]) > 0.01 > np.median(times["short"])


def row(kind: Kind, n_tets: int, tension: float) -> Row:
    return Row(kind, n_tets, 3 * n_tets, tension, 43.0, 1.0, 12)


def test_the_verdict_names_the_smallest_mesh_that_is_near_enough():
    even, graded = Kind("even", "P2P1"), Kind("graded", "P2P1", 4.0)
    families = [
        [row(even, 1000, 13.0), row(even, 4500, 11.5), row(even, 37000, 11.0)],
        [row(graded, 1000, 12.0), row(graded, 2500, 11.3), row(graded, 4500, 11.1), row(graded, 37000, 10.6)],
    ]
    first, second = verdict(families).splitlines()
    assert "is reached within 3 % by graded on 2,500 tets, 14.8 times fewer (+2.7 %)" in first
    assert "is **not** reached within 3 %; nearest is graded on 4,500 tets" in second


def test_a_mesh_that_is_not_eight_times_smaller_does_not_count():
    even = Kind("even", "P2P1")
    assert "**not**" in verdict([[row(even, 1000, 13.0), row(even, 5000, 11.0), row(even, 37000, 11.0)]])


@pytest.mark.parametrize("name", LAWS)
def test_the_neck_of_any_law_has_the_moduli_of_the_first(name: str):
    neck = standard_robot("P1")
    (body,), law = of_law(neck, name).bodies, LAWS[name]
    shear = LAWS[neck.bodies[0].law].shear_modulus(neck.bodies[0].parameters)
    assert body.law == name
    assert law.shear_modulus(body.parameters) == pytest.approx(shear)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("build", [felupe_assembler, scikit_fem_assembler])
def test_the_peers_compute_the_same(build, order):
    pytest.importorskip("felupe" if build is felupe_assembler else "skfem")
    mesh = box_mesh((0.03, 0.03, 0.06), (1, 1, 2))
    mesh = mesh if order == 1 else to_quadratic(mesh)
    case = Task(mesh, 0.1 * mesh.points[:, [1, 2, 0]] * mesh.points[:, :1] / 0.03, 8e5, 5e6)
    ours, theirs = softcal_assembler(case), build(case)
    reference = ours.common(ours.assemble())
    assert difference(theirs.common(theirs.assemble()), reference) < AGREEMENT
    stiffer = build(Task(mesh, case.u, 8.1e5, 5e6))
    assert difference(stiffer.common(stiffer.assemble()), reference) > AGREEMENT


def test_axes_of_sweeps_are_compared_and_options_where_both_checkouts_have_them():
    mine = {"loss": 2.0, "wall_s": 3.0, "extra": {"axes": {"E": [1e6, 2e6]}, "starts": 3}}
    its = {"loss": 2.0, "wall_s": 4.0, "extra": {"axes": {"E": [1e6, 2e6]}}}

    def both(mine: dict, its: dict) -> tuple[float, str]:
        return apart(*(({f"sweep/result.json {place}": value for place, value in numbers(one)}) for one in (mine, its)))

    assert both(mine, its) == (0.0, "")
    worst, where = both(mine, {**its, "extra": {"axes": {"E": [1e6, 4e6]}}})
    assert (worst, where) == (0.5, "sweep/result.json extra.axes.E[1]: 2000000 and 4000000")
    assert both(mine, {"extra": its["extra"]}) == (float("inf"), "sweep/result.json loss is in one alone")
