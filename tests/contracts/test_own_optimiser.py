"""An optimiser in one file of the user's own: registered, it works from the project file as softcal's do."""

from __future__ import annotations

import json
from collections.abc import Generator
from pathlib import Path
from types import ModuleType

import pytest
from own_module import brought, entry_point, imported
from project_case import MODULUS, write_project
from typer.testing import CliRunner

import softcal
from softcal import Option, calibrate, load, quantity, register_optimiser
from softcal.calibration.search.optimiser import OPTIMISERS, Optimiser
from softcal.cli import app
from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.report.format import method_label
from softcal.workflows.run_folder import load_run

SECTION = """
from softcal import Limit, Optimiser, Option, Proposal, quantity, register_optimiser


@register_optimiser
class GoldenSection(Optimiser):
    \"\"\"Kiefer's search for the minimum of a loss along the diagonal of the box.\"\"\"

    name = "golden-section"
    title = "golden-section search"
    default_trials = 20
    options = (Option("shortest", quantity("share"), 0.0), Option("spare", Limit("spare trials", 9, 0), 0))

    @classmethod
    def begin(cls, problem, settings):
        return cls(problem.space, settings.trials - settings.options["spare"], settings.options["shortest"])

    def __init__(self, space, trials, shortest):
        self._space, self._trials, self._shortest = space, trials, shortest
        self._ends, self._known, self._number = (0.0, 1.0), {}, 0

    def _points(self):
        low, high = self._ends
        return [high - 0.618034 * (high - low), low + 0.618034 * (high - low)]

    def ask(self):
        if self._ends[1] - self._ends[0] < self._shortest:
            return ()
        fresh = [x for x in self._points() if x not in self._known][: self._trials - len(self._known)]
        self._asked = {self._number + i: x for i, x in enumerate(fresh)}
        self._number += len(fresh)
        return tuple(Proposal(i, self._space.to_model([x] * self._space.size)) for i, x in self._asked.items())

    def tell(self, proposal, evaluation):
        self._known[self._asked[proposal.number]] = float("inf") if evaluation.loss is None else evaluation.loss
        (left, right), (low, high) = self._points(), self._ends
        if left in self._known and right in self._known:
            self._ends = (low, right) if self._known[left] < self._known[right] else (left, high)

    @property
    def total(self):
        return self._trials

    @property
    def status(self):
        return f"The minimum lies between {self._ends[0]:.4f} and {self._ends[1]:.4f} of the box."
"""
ONE = ("  front.slack: {bounds: [0 mm, 5 mm], per: experiment}\n", "")
NAMED = ("method: least-squares, starts: 1", "method: golden-section")


@pytest.fixture
def section(tmp_path: Path) -> Generator[ModuleType]:
    """The search, as a module of the user's registers it."""
    yield imported(tmp_path / "golden_section.py", SECTION)
    OPTIMISERS.remove("golden-section")


def test_it_searches_from_a_project_file(section: ModuleType, tmp_path: Path) -> None:
    project = load(write_project(tmp_path, ONE, NAMED))
    result = calibrate(project, out=tmp_path / "run").headline
    assert (result.method, len(result.trials)) == ("golden-section", 20)
    assert result.status.startswith("The minimum lies between")
    assert result.parameters["bar.youngs_modulus"].value == pytest.approx(MODULUS, rel=0.25)  # the slack is held at 0
    assert result.extra["importance_kind"] == "fanova"
    assert load_run(tmp_path / "run").results["pull"].loss == result.loss
    assert method_label("golden-section") == "golden-section search"


def test_the_command_line_knows_it_and_a_run_of_it_goes_on(section: ModuleType, tmp_path: Path) -> None:
    path, run = write_project(tmp_path, ONE), tmp_path / "run"
    command = ["calibrate", str(path), "--method", "golden-section", "--out", str(run), "--no-report", "--trials"]
    assert CliRunner().invoke(app, [*command, "6"]).exit_code == 0
    ended = CliRunner().invoke(app, [*command, "12", "--resume"])
    assert ended.exit_code == 0, ended.output
    resumed = load_run(run).results["pull"]
    assert len(resumed.trials) == 12
    whole = calibrate(load(path), method="golden-section", trials=12).headline
    assert [t.loss for t in resumed.trials] == [t.loss for t in whole.trials]


OPTIONS = ("method: golden-section", "method: golden-section, shortest: 0.2, spare: 3")


@pytest.mark.slow
def test_its_options_are_keys_of_the_project_file_and_of_the_command_line(section: ModuleType, tmp_path: Path) -> None:
    path, run = write_project(tmp_path, ONE, NAMED, OPTIONS), tmp_path / "run"
    result = calibrate(load(path), out=run).headline
    assert (result.extra["shortest"], result.extra["spare"]) == (0.2, 3)
    assert len(result.trials) < 10  # 0.618^4 of the box is shorter than a fifth of it
    assert load_run(run).settings.options["spare"] == 3
    assert len(calibrate(load(path), shortest=0.0).headline.trials) == 17
    command = ["calibrate", str(path), "--option", "shortest=0", "--out", str(tmp_path / "other"), "--no-report"]
    ended = CliRunner().invoke(app, [*command, "--option", "spare=9"])
    assert ended.exit_code == 0, ended.output
    assert len(load_run(tmp_path / "other").results["pull"].trials) == 11
    again = CliRunner().invoke(app, ["calibrate", str(path), "--out", str(run), "--resume", "--option", "spare=4"])
    assert again.exit_code == 2
    assert "the run began with other settings: spare" in " ".join(again.output.split())
    plain = calibrate(load(path), method="grid", trials=4).headline
    assert not {"shortest", "spare", "starts"} & set(plain.extra)


def test_an_option_of_another_method_is_refused_where_it_is_given_and_left_alone_in_the_file(
    section: ModuleType, tmp_path: Path
) -> None:
    project, run = load(write_project(tmp_path, ONE, NAMED, OPTIONS)), tmp_path / "run"
    told = r"--option spare=3: neither the method grid nor the loss papers has this option; allowed: alpha, beta"
    with pytest.raises(ParameterError, match=told):
        calibrate(project, out=run, method="grid", trials=4, spare=3)
    assert not run.exists()
    assert calibrate(project, method="grid", trials=4).headline.method == "grid"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("spare: 3", "spar: 3"), r"calibration\.spar: unknown key; .* Try: 'spare'"),
        (("spare: 3", "spare: 10"), r"calibration\.spare: there are too many spare trials; got 10; allowed: 0 to 9"),
        (("spare: 3", "spare: 1.5"), r"calibration\.spare: this is of the wrong kind; got 1\.5; .* a whole number"),
        (("shortest: 0.2", "shortest: 2"), r"calibration\.shortest: the share is out of range; got 2"),
    ],
)
def test_faults_of_its_options_are_those_of_any_key(
    section: ModuleType, tmp_path: Path, change: tuple[str, str], told: str
) -> None:
    with pytest.raises(ProjectFileError, match=told) as error:
        load(write_project(tmp_path, ONE, NAMED, OPTIONS, change))
    assert len(error.value.faults) == 1


def test_an_option_that_a_loss_has_is_refused() -> None:
    taken = (Option("alpha", quantity("share"), 0.5), Option("trials", quantity("share"), 0.5))
    with pytest.raises(ParameterError) as error:
        register_optimiser(type("Other", (OPTIMISERS["grid"],), {"name": "other", "options": taken}))
    assert "another loss or method has an option of this name" in str(error.value)
    assert "the name is taken by another setting of the calibration; got trials" in str(error.value)


def test_a_package_brings_it_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = SECTION.replace('"golden-section"', '"brought-section"')
    (tmp_path / "brought_section.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    group = "softcal.optimisers"
    with brought(OPTIMISERS, "brought_section:GoldenSection", group, "brought-section", monkeypatch) as optimiser:
        assert optimiser.title == "golden-section search"
    entry_point(OPTIMISERS, "json:dumps", group, monkeypatch)
    with pytest.raises(ParameterError, match=r"method: this is not an optimiser; got <function dumps"):
        OPTIMISERS.named("anything")


def test_a_method_that_nobody_registered_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match=r"calibration\.method: there is no such method; got 'golden-section'"):
        load(write_project(tmp_path, ONE, NAMED))
    with pytest.raises(InputError, match=r"--method: there is no such method; got 'grit'; allowed: .* Try: 'grid'"):
        calibrate(load(write_project(tmp_path)), method="grit")


def test_a_run_of_a_method_that_is_gone_is_refused(tmp_path: Path) -> None:
    run = tmp_path / "run"
    calibrate(load(write_project(tmp_path, ONE)), out=run, method="grid", trials=4)
    record = json.loads((run / "run.json").read_text(encoding="utf-8"))
    record["settings"]["method"] = "golden-section"
    (run / "run.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(InputError, match="there is no such method"):
        load_run(run)


def test_what_is_no_optimiser_is_refused() -> None:
    class Unfinished(Optimiser):
        name = "unfinished"
        statistics = "sensitivity"

    with pytest.raises(ParameterError) as error:
        register_optimiser(Unfinished)
    told = str(error.value)
    for lacking in ("'title'", "'default_trials'", "'begin'", "'ask'", "'tell'", "'total'", "'status'"):
        assert f"{lacking} must be there" in told
    assert "statistics by sensitivity need the jacobian" in told
    with pytest.raises(ParameterError, match="there is another method of this name"):
        register_optimiser(type("Other", (OPTIMISERS["grid"],), {}))
    with pytest.raises(ParameterError, match="softcal's own method cannot be removed"):
        OPTIMISERS.remove("grid")
    assert softcal.Optimiser is Optimiser
    assert "unfinished" not in OPTIMISERS
