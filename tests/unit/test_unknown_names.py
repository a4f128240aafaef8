"""A name that does not exist is answered with those that do: all of few, else the nearest three."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import pytest
from project_case import write_project

import softcal
from softcal.cli import main
from softcal.errors import FEW, Names, nearest, unknown
from softcal.twin.parameters import unknown_name

MANY = [f"part{k}.mass" for k in range(20)] + ["t.slack", "t.friction_coefficient", "t.stiffness", "t.compliance"]


def test_few_names_are_all_there_and_the_nearest_is_tried():
    fault = unknown("there is no such cable", "pull", "frnt", ["front", "back"])
    assert str(fault) == "pull: there is no such cable; got 'frnt'; allowed: front, back. Try: 'front'."
    assert fault.told(verbose=True) == str(fault)
    assert unknown("x", "", "a", []).allowed == "none"
    assert unknown("x", "", "a", [], none="none is defined").allowed == "none is defined"


def test_of_many_names_the_nearest_three_are_there_and_all_with_verbose():
    fault = unknown("there is no such parameter", "t.slak", "t.slak", MANY, got="")
    assert str(fault).startswith("t.slak: there is no such parameter; allowed: one of 24 names (--verbose lists them).")
    tried = re.findall(r"'([^']+)'", fault.attempt)
    assert (len(tried), tried[0]) == (3, "t.slack")
    assert ", ".join(MANY) in fault.told(verbose=True)
    assert fault.told(verbose=True).endswith(f"Try: {fault.attempt}.")


def test_names_of_the_same_part_come_first():
    of_it = ["t.slack", "t.friction_coefficient"]
    fault = unknown("there is no such parameter", "", "t.mass", MANY, among=of_it)
    tried = re.findall(r"'([^']+)'", fault.attempt)
    assert sorted(tried[:2]) == sorted(of_it)
    assert re.fullmatch(r"part\d+\.mass", tried[2])


def test_the_list_goes_with_the_fault():
    fault = unknown("x", "", "a", [f"name{k}" for k in range(FEW + 1)], more="; or a number")
    assert isinstance(fault.allowed, Names)
    error = pickle.loads(pickle.dumps(softcal.InputError(fault)))
    assert error.told(verbose=True).endswith("name7, name8; or a number. Try: " + fault.attempt + ".")
    assert "one of 9 names (--verbose lists them); or a number" in str(error)


def test_the_nearest_name_is_similar():
    assert nearest("youngs_moduls", ["youngs_modulus", "density"]) == "'youngs_modulus'"
    assert nearest("zzz", ["youngs_modulus", "density"]) == ""


def test_a_name_of_which_it_is_a_part_comes_first():
    assert nearest("a", ["yaw", "a.pressure", "b.pressure"]) == "'a.pressure'"
    assert nearest("a.pressure", ["b.presure", "a"]) == "'a'"


def test_the_command_line_lists_all_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = str(write_project(tmp_path))
    command = ["check", path, "--no-solve", "--no-pictures"]
    text = Path(path).read_text(encoding="utf-8")

    def said(*options: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main([*command, *options])
        assert ended.value.code == 2
        return capsys.readouterr().err

    Path(path).write_text(text + "\nparametrs: {}\n", encoding="utf-8")
    short, full = said(), said("--verbose")
    assert "unknown key; got 'parametrs'; allowed: one of " in short
    assert "Try: 'parameters', " in short
    assert "experiments" not in short.partition("Try")[0]
    assert all(key in full for key in ("experiments", "parameters", "calibration", "sweep"))


def test_the_compliance_of_a_cable_that_has_none_is_stated_in_its_line():
    of_cable = {"front.slack": 0.0, "front.friction_coefficient": 0.0}
    assert unknown_name("front.compliance", of_cable).attempt.startswith(
        "`line: {compliance: 0 mm/N}` of the cable front"
    )
    assert "line:" not in unknown_name("front.stifness", of_cable).attempt
    assert "line:" not in unknown_name("neck.compliance", of_cable).attempt
