"""What every benchmark case keeps: its data, split, licence and README, and a score of zero for what was measured."""

from __future__ import annotations

import json
import re
import signal
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from softcal.calibration.results.stored import as_json, as_record
from softcal.cli import app
from softcal.errors import DatasetError, StorageError
from softcal.plugins.bench.case import CASES, BenchmarkCase
from softcal.plugins.bench.page import read_scores, write_page
from softcal.plugins.bench.predictions import Predictions, read_predictions
from softcal.plugins.bench.project_case import ProjectCase
from softcal.plugins.bench.record import PREDICT, CaseRecord
from softcal.plugins.bench.run import run_case, score_file
from softcal.plugins.bench.score import Score, score
from softcal.project.project import Project
from softcal.workflows.run_folder import load_run

EVERY = pytest.mark.parametrize("name", sorted(CASES))


@cache
def record_of(name: str) -> CaseRecord:
    """The record of a case, read once for all tests."""
    return CASES[name].record()


def measured(case: BenchmarkCase) -> Predictions:
    """What was measured, as predictions."""
    record = record_of(case.name)
    return Predictions(record.samples, {name: np.array(held) for name, held in record.channels.items()}, method="truth")


@EVERY
def test_a_case_has_samples_to_predict_a_licence_and_a_readme_that_tells_its_traps(name: str) -> None:
    case = CASES[name]
    record = record_of(name)
    assert (~record.is_fit).sum() > 0
    assert len(set(record.samples)) == len(record.samples)
    assert case.licence
    assert case.source
    text = case.readme.read_text(encoding="utf-8")
    assert len(text) > 500
    if case.licence.startswith("MIT"):
        assert "Permission is hereby granted" in (case.folder / "LICENSE").read_text(encoding="utf-8")
    assert case.robot().markers or not record.points


@EVERY
def test_a_case_that_fits_something_to_its_predicted_samples_says_so(name: str) -> None:
    case = CASES[name]
    if isinstance(case, ProjectCase):
        text = (case.project_folder / "project.yaml").read_text(encoding="utf-8")
        assert ("per: experiment" in text) == ("fitted to that" in case.remarks)


@pytest.mark.slow
def test_without_the_examples_their_cases_are_refused_and_the_others_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softcal.plugins.bench.project_case.EXAMPLES", tmp_path / "absent")
    listed = CliRunner().invoke(app, ["bench", "list"])
    assert listed.exit_code == 0, listed.output
    lines = {line.split(":")[0]: line for line in listed.output.splitlines() if "Licence:" in line}
    assert lines.keys() == set(CASES)
    for name, case in CASES.items():
        absent = isinstance(case, ProjectCase) and bool(case.example)
        assert ("not in this installation" in lines[name]) == absent
        assert ("README:" in lines[name]) == (not absent)
    for arguments in (["run", "beam", "--out", str(tmp_path / "out")], ["score", "beam", "mine.csv"]):
        ran = CliRunner().invoke(app, ["bench", *arguments])
        assert ran.exit_code == 2
        assert "not in this installation of softcal" in " ".join(ran.output.split())
    assert not (tmp_path / "out").exists()


@EVERY
def test_what_was_measured_scores_zero_through_a_file_in_any_order(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    record, truth = record_of(case.name), measured(case)
    turned = slice(None, None, -1)
    channels = {channel: values[turned] for channel, values in truth.channels.items()}
    path = tmp_path / "truth.csv"
    text = replace(truth, samples=truth.samples[turned], channels=channels).text(record.units)
    path.write_text(text, encoding="utf-8")
    found = score(name, record, read_predictions(path, record), aligned=case.aligned)
    predicted = found.splits[PREDICT]
    if predicted.all_points is not None:
        assert predicted.all_points.largest < 1e-8
    assert all(one.largest < 1e-6 for one in predicted.channels.values())
    assert found == as_record(Score, json.dumps(as_json(found)).encode(), path, "the score")


@EVERY
def test_an_error_of_one_point_scores_as_large_as_it_is(name: str) -> None:
    case = CASES[name]
    record, truth = record_of(case.name), measured(case)
    shift = np.where(np.arange(len(record.samples)) % 2 == 0, 3e-3, -3e-3)
    channels = dict(truth.channels)
    first = record.points[0] + ".x" if record.points else record.others[0]
    channels[first] = channels[first] + shift
    found = score(name, record, replace(truth, channels=channels), aligned=False).splits[PREDICT]
    error = found.points[record.points[0]] if record.points else found.channels[first]
    assert error.rms == pytest.approx(3e-3, rel=1e-9)


def tentacle_text(change: dict[str, str] | None = None) -> str:
    record = record_of("tentacle")
    text = measured(CASES["tentacle"]).text(record.units)
    for old, new in (change or {}).items():
        assert re.search(old, text, flags=re.MULTILINE), old
        text = re.sub(old, new, text, flags=re.MULTILINE)
    return text


FAULTS = {
    "samples": ({r"^m2_u018.*\n": ""}, "1 of 6 samples to predict are missing; got m2_u018"),
    "some of the fit": ({r"^m1_u01,.*\n": ""}, "1 of 8 samples to fit are missing"),
    "column": ({r"M2.y \[m\]": "M9.y [m]"}, "the case has no such channel; got 'M9.y"),
    "unit": ({r"M2.y \[m\]": "M2.y [N]"}, "the unit of the column is missing or wrong; got 'M2.y"),
    "no unit": ({r"M2.y \[m\]": "M2.y"}, "the unit of the column is missing or wrong"),
    "number": ({r"^(m1_u005,)[^,]*": r"\1what"}, "1 value(s) of M1.x are no allowed number; got m1_u005: 'what'"),
    "huge": ({r"^(m1_u005,)[^,]*": r"\g<1>1e308"}, "1 value(s) of M1.x are no allowed number; got m1_u005: '1e308'"),
    "a long cell": ({r"^(m1_u005,)[^,]*": rf"\1{'x' * 300_000}"}, "mine.csv: the table cannot be cut into cells"),
    "a long word": ({r"^(m1_u005,)[^,]*": rf"\1{'x' * 3000}"}, f"got m1_u005: '{'x' * 40}'; allowed"),
    "evaluations": ({r"\A": f"# evaluations: {'9' * 5000}\n"}, "the number of evaluations is no whole number"),
    "method": (
        {r"^# method: .*": f"# method: {'x' * 5000}"},
        "the name of the method is too long; got 5000 characters",
    ),
    "underscore": ({r"^(m1_u005,)[^,]*": r"\g<1>2_2"}, "1 value(s) of M1.x are no allowed number; got m1_u005: '2_2'"),
    "another script": (
        {r"^(m1_u005,)[^,]*": r"\g<1>２"},
        "1 value(s) of M1.x are no allowed number; got m1_u005: '２'",
    ),
    "not a number": ({r"^(m1_u005,)[^,]*": r"\1nan"}, "1 value(s) of M1.x are no allowed number"),
    "decimal commas": ({r"^(m1_u005,[^,]*)[.]": r"\1,"}, "1 row(s) have more or fewer cells; got m1_u005"),
    "a cell too few": ({r"^(m1_u005,.*),.*$": r"\1"}, "1 row(s) have more or fewer cells; got m1_u005"),
    "unknown sample": ({r"^m1_u005,": "m1_u006,"}, "the case has no such sample (1); got m1_u006"),
    "many rows": ({r"^(m1_u005,.*\n)": r"\1" * 200}, "mine.csv: the table has too many rows; got 129; allowed: 128"),
    "many comments": ({r"\A": "# a: 1\n" * 200}, "mine.csv: the table has too many comments; got 129; allowed: 128"),
    "a wide row": ({r"^(m1_u005,.*\n)": rf"\1{',' * 200}\n"}, "mine.csv: the table has too many columns; got 201"),
    "twice": ({r"^(m1_u005,.*\n)": r"\1\1"}, "1 sample(s) occur more than once"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_table_that_is_wrong_is_refused_with_what_is_wrong(kind: str, tmp_path: Path) -> None:
    change, message = FAULTS[kind]
    path = tmp_path / "mine.csv"
    path.write_text(tentacle_text(change), encoding="utf-8")
    with pytest.raises(DatasetError) as refused:
        read_predictions(path, record_of("tentacle"))
    assert message in str(refused.value)


def test_all_that_is_wrong_is_told_at_once_and_nothing_is_written(tmp_path: Path) -> None:
    change = {key: new for kind in ("samples", "unit", "number") for key, new in FAULTS[kind][0].items()}
    path = tmp_path / "mine.csv"
    path.write_text(tentacle_text(change), encoding="utf-8")
    ran = CliRunner().invoke(app, ["bench", "score", "tentacle", str(path), "--out", str(tmp_path / "out")])
    assert ran.exit_code == 2
    assert "3 faults" in ran.output
    assert "Traceback" not in ran.output
    assert not (tmp_path / "out").exists()


def moved(kind: str, name: str = "tentacle") -> Predictions:
    truth = measured(CASES[name])
    x = {point: truth.positions(point) for point in record_of(name).points}
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    changed = {
        "unit": lambda at: 1e3 * at,
        "frame": lambda at: at @ turn.T,
        "origin": lambda at: at + [0.4, 0.0, 0.0],
    }[kind]
    new = {point: changed(at) for point, at in x.items()}
    channels = {f"{point}.{axis}": new[point][:, i] for point in x for i, axis in enumerate("xyz")}
    return replace(truth, channels=channels)


@pytest.mark.parametrize(
    ("kind", "message"), [("unit", "in another unit"), ("frame", "in another frame"), ("origin", "from another origin")]
)
def test_positions_in_another_unit_or_frame_are_refused(kind: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    record = record_of("tentacle")
    path.write_text(moved(kind).text(record.units), encoding="utf-8")
    with pytest.raises(DatasetError, match=message):
        read_predictions(path, record)


@pytest.mark.parametrize(("kind", "message"), [("unit", "in another unit"), ("frame", "in another frame")])
def test_where_a_translation_is_taken_off_the_unit_and_the_turn_still_count(
    kind: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(moved(kind, "opencr-v4").text(record_of("opencr-v4").units), encoding="utf-8")
    with pytest.raises(DatasetError, match=message):
        score_file("opencr-v4", path)


@pytest.mark.slow
def test_where_a_translation_is_taken_off_any_origin_will_do(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(moved("origin", "opencr-v4").text(record_of("opencr-v4").units), encoding="utf-8")
    assert score_file("opencr-v4", path).splits[PREDICT].points["tip"].largest < 1e-8


@pytest.mark.parametrize(("kind", "message"), [("unit", "in another unit"), ("origin", "")])
def test_of_one_sample_alone_a_motion_of_all_points_is_an_error_and_no_frame(
    kind: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.csv"
    record = record_of("pneumatic-arm")
    assert (~record.is_fit).sum() == 1
    path.write_text(moved(kind, "pneumatic-arm").text(record.units), encoding="utf-8")
    if message:
        with pytest.raises(DatasetError, match=message):
            score_file("pneumatic-arm", path)
    else:
        assert score_file("pneumatic-arm", path).splits[PREDICT].points["tip1"].rms == pytest.approx(0.4)


def test_a_column_may_be_in_another_unit_of_its_dimension(tmp_path: Path) -> None:
    header, *rows = (line for line in tentacle_text().splitlines() if not line.startswith("#"))
    assert header.split(",")[1] == "M1.x [m]"
    cells = [row.split(",") for row in rows]
    lines = [header.replace("M1.x [m]", "M1.x [mm]"), *(",".join([a, str(1e3 * float(b)), *c]) for a, b, *c in cells)]
    path = tmp_path / "mine.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert score_file("tentacle", path).splits[PREDICT].points["M1"].largest < 1e-8


def test_a_poor_prediction_in_the_right_frame_is_scored(tmp_path: Path) -> None:
    """Such as one that knows nothing: every point at its mean."""
    record, truth = record_of("tentacle"), measured(CASES["tentacle"])
    path = tmp_path / "mine.csv"
    channels = {name: np.full_like(values, values.mean()) for name, values in truth.channels.items()}
    path.write_text(replace(truth, channels=channels).text(record.units), encoding="utf-8")
    assert score_file("tentacle", path).splits[PREDICT].points["M4"].rms > 0.05


def test_bands_have_the_share_of_what_they_hold(tmp_path: Path) -> None:
    case = CASES["tentacle"]
    record, truth = record_of(case.name), measured(case)
    channels = dict(truth.channels, **{"M1.x": truth.channels["M1.x"] + 2e-3})
    bands = {name: np.full(len(record.samples), 1e-3) for name in ("M1.x", "M1.y", "M1.z")}
    path = tmp_path / "mine.csv"
    path.write_text(replace(truth, channels=channels, bands=bands).text(record.units), encoding="utf-8")
    assert score_file("tentacle", path).splits[PREDICT].coverage == pytest.approx(2 / 12)  # the others have no band


def test_further_samples_take_the_place_of_those_to_predict(tmp_path: Path) -> None:
    case = CASES["tentacle"]
    own = (case.folder / "predict.csv").read_text().splitlines()
    path = tmp_path / "more.csv"
    path.write_text("\n".join([own[0], own[2].replace("m1_u012", "again")]) + "\n")
    record = case.record(path)
    assert record.samples[-1] == "again"
    assert (~record.is_fit).sum() == 1
    assert record.is_fit.sum() == record_of(case.name).is_fit.sum()


def test_a_further_sample_named_as_one_to_fit_is_refused(tmp_path: Path) -> None:
    case = CASES["tentacle"]
    own = (case.folder / "predict.csv").read_text().splitlines()
    path = tmp_path / "more.csv"
    path.write_text("\n".join([own[0], own[2].replace("m1_u012", "m1_u01")]) + "\n")
    with pytest.raises(DatasetError, match=r"several samples have one name.*m1_u01"):
        case.record(path)


@pytest.mark.slow
def test_sorosims_first_shapes_are_within_a_twentieth_of_a_per_cent_on_average(tmp_path: Path) -> None:
    case = CASES["sorosim-tpu"]
    lines = (case.folder / "tpu.csv").read_text().splitlines()
    few = tmp_path / "few.csv"
    few.write_text("\n".join(lines[: 2 + 6 * 6]) + "\n")
    out = tmp_path / "out"
    ran = CliRunner().invoke(app, ["bench", "run", case.name, "--data", str(few), "--out", str(out)])
    assert ran.exit_code == 0, ran.output
    found = score_file(case.name, out / "predictions.csv", data=few)
    assert found.splits[PREDICT].points["tip"].mean < 5e-4 * case.length
    assert found.evaluations == 0  # nothing is fitted


def test_all_faults_of_a_file_of_shapes_are_told_at_once_and_blank_lines_are_none(tmp_path: Path) -> None:
    case = CASES["sorosim-tpu"]
    lines = (case.folder / "tpu.csv").read_text().splitlines()[: 2 + 3 * 6]
    path = tmp_path / "shapes.csv"
    path.write_text("\n".join([*lines[:8], "", ",", *lines[8:], ""]))
    assert len(case.record(path).samples) == 3
    label, _, *rest = lines[3].split(",")
    wrong = [*lines[:3], ",".join([label, "nan", *rest]), *lines[4:9], *lines[10:15], lines[15].rpartition(",")[0]]
    path.write_text("\n".join([*wrong, *lines[16:]]))
    with pytest.raises(DatasetError) as told:
        case.record(path)
    for part in ("line 4", "'nan'", "shape s002 needs 6 lines", "17 cells"):
        assert part in str(told.value)
    path.write_text("\n".join([*lines[:2], *(lines[2 + 6 * shape + line] for line in range(6) for shape in range(3))]))
    with pytest.raises(DatasetError, match="the lines of the shapes are not in order; got EulX of s001, EulX of s002"):
        case.record(path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "shown"), [("more.csv", "more.csv"), ("more\udcff.csv", "more?.csv")])
def test_a_score_names_the_file_of_further_samples(name: str, shown: str, tmp_path: Path) -> None:
    case = CASES["tentacle"]
    more, mine, out = tmp_path / name, tmp_path / "mine.csv", tmp_path / "out"
    more.write_text((case.folder / "predict.csv").read_text().replace("m1_u012", "again"))
    record = case.record(more)
    mine.write_text(replace(measured(case), samples=record.samples, channels=record.channels).text(record.units))
    assert score_file(case.name, mine, data=more, out=out).data == shown
    (_, kept), *_ = read_scores(tmp_path)
    assert kept.data == shown
    ran = CliRunner().invoke(app, ["bench", "score", case.name, str(mine), "--data", str(more)])
    assert shown in ran.output
    write_page(tmp_path, tmp_path / "page.md")
    assert f"predicts {shown}" in (tmp_path / "page.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "tentacl"], "there is no such case; got 'tentacl'"),
        (["score", "tentacle", "absent.csv"], "absent.csv: the data file cannot be read; got No such file"),
        (["run", "sorosim-tpu", "--data", "absent.csv"], "absent.csv: the data file cannot be read; got No such file"),
        (["run", "beam", "--data", "absent.csv"], "the case takes no further samples"),
        (["page", "absent"], "there is no score.json below the folder"),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(arguments: list[str], message: str, tmp_path: Path) -> None:
    folder = ["--out", str(tmp_path / "out")] if arguments[0] == "run" else []
    ran = CliRunner().invoke(app, ["bench", *arguments, *folder])
    assert ran.exit_code == 2, ran.output
    assert message in " ".join(ran.output.split())


@pytest.mark.slow
def test_a_run_keeps_its_fit_and_is_resumed_after_a_stop(tmp_path: Path) -> None:
    def stop(stage: str) -> None:
        if " 2 trials" in stage:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run_case("beam", tmp_path / "out", progress=stop)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["fit"]
    with pytest.raises(StorageError, match="not empty"):
        run_case("beam", tmp_path / "out")
    resumed = run_case("beam", tmp_path / "out", resume=True)
    whole = run_case("beam", tmp_path / "whole")
    names = ["fit", "predictions.csv", "score.json"]
    assert sorted(path.name for path in resumed.folder.iterdir()) == names
    assert resumed.score.splits == whole.score.splits
    assert load_run(tmp_path / "out" / "fit").results
    for folder, why in ((tmp_path / "out", "the folder has a finished run"), (tmp_path / "none", "no fit to resume")):
        with pytest.raises(StorageError, match=why):
            run_case("beam", folder, resume=True)


def test_what_a_case_leaves_out_is_neither_fitted_nor_to_be_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    class AskedError(Exception):
        pass

    def asked(project: Project, **settings: Any) -> None:
        raise AskedError(sorted(settings["hold_out"]), sorted(project.calibration.hold_out))

    monkeypatch.setattr("softcal.plugins.bench.project_case.calibrate", asked)
    with pytest.raises(AskedError) as found:
        CASES["opencr-v4"].run(progress=lambda told: None)
    assert found.value.args == (["predict", "pulls"], ["predict", "pulls"])
    record = record_of("opencr-v4")
    assert record.is_fit[[name.startswith("pulls:") for name in record.samples]].all()
    assert np.count_nonzero(~record.is_fit) == 443
