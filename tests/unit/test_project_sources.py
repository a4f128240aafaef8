"""Where a public function takes a project, it takes the path of its file too, and anything else is refused in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from project_case import bar_robot, write_project

import softcal
from softcal.workflows.study_source import study_source

# What takes a project, with the least that it needs beside it.
OF_A_PROJECT: dict[str, Callable[[object], object]] = {
    "simulate": softcal.simulate,
    "calibrate": softcal.calibrate,
    "check": lambda given: softcal.check(given, solve=False),
    "sweep": lambda given: softcal.sweep(given, over={"bar.youngs_modulus": ["1 MPa"]}),
    "validate": softcal.validate,
    "validate several": lambda given: softcal.validate({"a": given}),
    "compare_records": lambda given: softcal.compare_records(given, None),
    "importance": softcal.importance,
    "mesh_study": softcal.mesh_study,
    "ExportRequest": softcal.ExportRequest,
}  # fmt: skip
# What takes a path alone.
OF_A_PATH: dict[str, Callable[[object], object]] = {
    "load": softcal.load,
    "load_run": softcal.load_run,
    "write_report": softcal.write_report,
    "watch_run": softcal.watch_run,
    "intervals": softcal.intervals,
    "next_test": softcal.next_test,
    "fleet": lambda given: softcal.fleet(given, out="never"),
    "read_coupons": lambda given: softcal.read_coupons(given, "uniaxial"),
    "read_mesh": lambda given: softcal.read_mesh(given, unit="mm"),
}


NO_PATH = r"this is of the wrong kind; got {}.*; allowed: a path\."


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_project(tmp_path_factory.mktemp("project"))


@pytest.mark.parametrize("kind", [str, Path])
def test_the_path_of_a_project_file_is_as_good_as_the_project(path: Path, kind: type):
    loaded, source = softcal.load(path), kind(path)
    assert softcal.simulate(source).channels.keys() == softcal.simulate(loaded).channels.keys()
    assert softcal.check(source, solve=False).rows == softcal.check(loaded, solve=False).rows
    over = {"bar.youngs_modulus": ["1 MPa", "1.3 MPa"]}
    assert softcal.sweep(source, over=over).result.loss == softcal.sweep(loaded, over=over).result.loss
    found = softcal.calibrate(source, starts=1)
    assert found.headline.loss == softcal.calibrate(loaded, starts=1).headline.loss
    compared = softcal.compare_records(source, found.headline)
    assert compared.keys() == softcal.compare_records(loaded, found.headline).keys()
    assert softcal.ExportRequest(source).project.name == loaded.name


def test_a_study_takes_a_project_and_the_path_of_its_file(path: Path):
    loaded = softcal.load(path, values={"bar.poissons_ratio": "0.45"})
    assert [study_source(one).project.name for one in (path, str(path), loaded)] == ["a square bar"] * 3
    with pytest.raises(softcal.InputError, match=r"values: a project has its values already; got .*load\(path, values"):
        softcal.mesh_study(loaded, values={"bar.poissons_ratio": "0.4"})


def test_models_to_validate_are_one_project_or_several_by_label(path: Path):
    with pytest.raises(softcal.ParameterError, match="one experiment cannot be left out; got pull"):
        softcal.validate(path)  # one experiment: it was loaded
    nameless = replace(softcal.load(path), experiments={})
    with pytest.raises(softcal.ParameterError, match="there is no experiment to calibrate with"):
        softcal.validate({"a": path, "b": nameless})


@pytest.mark.parametrize("given", [None, 3, bar_robot()], ids=["none", "number", "robot"])
@pytest.mark.parametrize("function", OF_A_PROJECT)
def test_what_is_no_project_is_refused_in_words(function: str, given: object):
    if function == "simulate" and isinstance(given, softcal.Robot):
        assert softcal.simulate(given).succeeded  # a robot is enough
        return
    with pytest.raises(softcal.InputError, match=r"this is of the wrong kind; got .*; allowed: a Project or a path"):
        OF_A_PROJECT[function](given)


@pytest.mark.parametrize("function", OF_A_PATH)
def test_what_is_no_path_is_refused_in_words(path: Path, function: str):
    with pytest.raises(softcal.InputError, match=NO_PATH.format("Project")):
        OF_A_PATH[function](softcal.load(path))
    with pytest.raises(softcal.InputError, match=NO_PATH.format("None")):
        OF_A_PATH[function](None)


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(softcal.StorageError, match=r"missing\.yaml"):
        softcal.calibrate(tmp_path / "missing.yaml")
