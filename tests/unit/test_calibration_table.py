"""What is printed of a calibration: values with standard errors, and intervals of what all experiments share."""

from __future__ import annotations

import re
from dataclasses import replace

from report_example import E_NAME, bench_experiment, tpe_result

from softcal.calibration.results.digits import interval_text
from softcal.calibration.results.result import Distance
from softcal.calibration.search.outcome import bound_note
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.cli.calibration_table import print_results, value_text


def test_an_interval_is_told_in_the_unit_of_its_value():
    assert interval_text(Estimate(2.8e5, "Pa", False, 1e4, 1e6, 1e4, (2.58e5, 3.07e5))) == "258 to 307 kPa"
    assert interval_text(Estimate(2.8e5, "Pa", False, 1e4, 1e6, 1e4)) == ""
    held = Estimate(2e5, "Pa", True, 2e5, 1e6, None, (2e5, 2.01e5), beyond=27.0)
    assert interval_text(held) == "200 to 201.00 kPa"


def test_only_shared_parameters_have_a_line_for_their_interval(capsys):
    experiments = [bench_experiment("20mm", 0.02, 1.2e6), bench_experiment("30mm", 0.03, 1.2e6)]
    result = tpe_result(experiments, 1.2e6, 0.45, n_trials=20, errors=(2e4, 0.01), slack=True)
    within = {
        name: replace(estimate, interval=(estimate.value * 0.9, estimate.value * 1.1))
        for name, estimate in result.parameters.items()
        if name == E_NAME or "[" in name
    }
    print_results({"joint": replace(result, parameters={**result.parameters, **within})}, samples(experiments))
    lines = capsys.readouterr().out.splitlines()
    told = [line for line in lines if "95 % interval" in line]
    assert len(told) == 1
    assert "1.08 to 1.32 MPa" in told[0]
    assert E_NAME in lines[lines.index(told[0]) - 1]


def samples(experiments):
    return {experiment.name: experiment.prepared for experiment in experiments}


def test_what_is_poor_or_decided_by_a_bound_is_a_warning_before_the_status(capsys):
    experiments = [bench_experiment("20mm", 0.02, 1.2e6), bench_experiment("30mm", 0.03, 1.2e6)]
    good = tpe_result(experiments, 1.2e6, 0.45, n_trials=20)
    print_results({"joint": good}, samples(experiments))
    assert "Warning" not in capsys.readouterr().err
    fit = good.experiments["30mm"]
    poor = replace(fit, rmse={**fit.rmse, "pitch": 0.5 * max(fit.measured["pitch"])})
    note = bound_note(E_NAME, Estimate(1e5, "Pa", True, 1e5, 4e7))
    bad = replace(good, experiments={**good.experiments, "30mm": poor}, notes=(*good.notes, note))
    print_results({"joint": bad}, samples(experiments))
    told = capsys.readouterr()
    assert "Warning: joint, 30mm: the twin reproduces" in told.err
    assert "that is poor (the pitch above 10 % of its range)" in told.err
    assert "20mm" not in told.err
    assert f"Warning: joint: {note}" in told.err
    assert note.text not in told.out


def test_numbers_of_the_table_are_as_people_write_them(capsys):
    wide = Estimate(7.07e5, "Pa", False, 5e4, 1e7, 1.4e6, (5e4, 1e7))
    assert value_text(wide) == "700 kPa (not determined)"  # an error that the bounds do not allow says nothing
    assert value_text(replace(wide, standard_error=4e5, interval=(3e5, 1.6e6))) == "710 ± 400 kPa"
    assert value_text(replace(wide, value=5e4, at_bound=True)) == "50 kPa (not determined)"  # nor does the bound
    assert interval_text(wide) == "50 to 10000 kPa"
    assert value_text(Estimate(0.49999, "1", True, 0.3, 0.49999)) == "0.49999 (at a bound)"
    experiments = [bench_experiment("20mm", 0.02, 1.2e6)]
    result = tpe_result(experiments, 1.2e6, 0.45, n_trials=20)
    fit = result.experiments["20mm"]
    poor = replace(fit, rmse={**fit.rmse, "pitch": 0.5})
    print_results({"20mm": replace(result, experiments={"20mm": poor})}, samples(experiments))
    told = capsys.readouterr()
    (line,) = [line for line in told.out.splitlines() if "RMSE of pitch" in line]
    assert "28.6 deg" in line
    assert "rad" not in line
    assert "Warning: 20mm: the twin reproduces" in told.err  # its experiment has the calibration's name


def test_of_many_tests_the_ten_worst_have_a_line_and_the_others_are_counted(capsys):
    experiments = [bench_experiment("20mm", 0.02, 1.2e6)]
    one = tpe_result(experiments, 1.2e6, 0.45, n_trials=20)
    fit = one.experiments["20mm"]
    fits = {f"t{i}": replace(fit, rmse={"tension": 0.001 * i, "pitch": 0.001}) for i in range(200)}
    offset = Estimate(0.1, "N", False, -1.0, 1.0, 0.01)
    own = {f"front.tension_offset[t{i}]": replace(offset, value=0.001 * i, at_bound=i == 7) for i in range(200)}
    note = bound_note(E_NAME, Estimate(1e5, "Pa", True, 1e5, 4e7))
    notes = [replace(note, text=f"{note.text} {i}") for i in range(60)]
    many = replace(one, experiments=fits, parameters={**one.parameters, **own}, notes=tuple(notes))
    print_results({"joint": many})
    short = capsys.readouterr().out
    assert len(short.splitlines()) < 25
    (line,) = [line for line in short.splitlines() if "front.tension_offset" in line]
    assert " 0 to 0.199 N (200 values)" in line  # which is no interval
    (line,) = [line for line in short.splitlines() if "RMSE of tension" in line]
    assert "at most 0.199 N" in line
    print_results({"joint": many}, verbose=True)
    told = capsys.readouterr()
    lines = told.out.splitlines()
    assert len(lines) < 60
    assert len([line for line in lines if "RMSE of tension, t" in line]) == 10
    assert any("RMSE of tension, t199" in line for line in lines)
    assert any("RMSE of tension, 190 more" in line and "at most 0.189 N" in line for line in lines)
    assert any("front.tension_offset[t7]" in line for line in lines)
    assert any("front.tension_offset, 190 more" in line and "0.199 N" in line for line in lines)
    assert "Warning: 50 more such warnings are in the report." in told.err
    print_results({f"t{i}": replace(one, loss=float(i)) for i in range(30)})
    assert "20 more calibrations, of smaller losses" in capsys.readouterr().out


def test_by_default_what_decides_on_the_answer_is_printed_and_the_rest_is_counted(capsys):
    one = tpe_result([bench_experiment("20mm", 0.02, 1.2e6)], 1.2e6, 0.45, n_trials=12)
    remark, warning = Remark("remark"), Remark("warning of the answer", "warning")
    other = replace(one, notes=(Remark("warning of another fit", "warning"),))
    both = dict.fromkeys(("a", "b"), one.experiments["20mm"])
    results = {"a": other, "b": other, "joint": replace(one, experiments=both, notes=(remark, warning))}
    print_results(results)
    short = capsys.readouterr()
    assert short.err.splitlines() == ["Warning: joint: warning of the answer"]
    n = int(re.findall(r"^(\d+) more remarks: --verbose, or the report.$", short.out, re.MULTILINE)[0])
    print_results(results, verbose=True)
    long = capsys.readouterr()
    assert long.err.splitlines() == ["Warning: joint: warning of the answer", "Warning: a, b: warning of another fit"]
    assert "Note (joint): remark" in long.out
    after = long.out[long.out.rindex("└") :].splitlines()[1:]
    assert n == len(after) - len(short.out[short.out.rindex("└") :].splitlines()[2:]) + 1  # and the warning
    assert "more remarks" not in long.out


def test_the_largest_distances_of_several_tests_are_each_the_largest(capsys):
    """The test whose mean is largest need not have the largest distance."""
    one = tpe_result([bench_experiment("20mm", 0.02, 1.2e6)], 1.2e6, 0.45, n_trials=12)
    fit = one.experiments["20mm"]
    far = {"a": Distance(0.003, 0.004, 0.002, 10), "b": Distance(0.002, 0.009, 0.002, 10)}
    fits = {name: replace(fit, distances={"m": distance}, length=0.1) for name, distance in far.items()}
    print_results({"joint": replace(one, experiments=fits)})
    assert "at most 3 and 9 mm (3 and 9 %)" in capsys.readouterr().out


def test_a_fit_without_the_values_of_other_tests_has_an_empty_cell(capsys):
    """Of more tests than have a line, a separate fit has its own value and none of those that are put together."""
    one = tpe_result([bench_experiment("20mm", 0.02, 1.2e6)], 1.2e6, 0.45, n_trials=12)
    fits = dict.fromkeys([f"t{i}" for i in range(12)], one.experiments["20mm"])
    slacks = {f"front.slack[t{i}]": Estimate(1e-3, "m", False, 0.0, 1e-2, 1e-4 * (i + 1)) for i in range(12)}
    alone = replace(one, parameters={**one.parameters, "front.slack[t11]": slacks["front.slack[t11]"]})
    joint = replace(one, experiments=fits, parameters={**one.parameters, **slacks})
    print_results({"t11": alone, "joint": joint}, verbose=True)
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "front.slack, 2 more" in line]
    assert [cell.strip() for cell in line.split("│")[2:4]] == ["", "1.00 mm (2 values)"]


def test_whose_intervals_include_the_mesh_is_in_the_table(capsys):
    one = tpe_result([bench_experiment("20mm", 0.02, 1.2e6)], 1.2e6, 0.45, n_trials=12)
    estimate = replace(one.parameters[E_NAME], shares={"noise": 0.4, "mesh": 0.6})
    joint = replace(one, parameters={**one.parameters, E_NAME: estimate})
    print_results({"a": one, "joint": joint})
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "error of the mesh" in line]
    assert [cell.strip() for cell in line.split("│")[2:4]] == ["not included", "included"]
    print_results({"a": one, "b": one})
    assert "error of the mesh" not in capsys.readouterr().out
