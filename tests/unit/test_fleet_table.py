"""The table of a fleet: what its columns mean, and every fault of the whole table at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from fleet_case import FILE, write_fleet

from softcal.errors import Fault, InputError
from softcal.plugins.fleet.table import FleetTable, merged, parse_fleet, read_fleet, row_project
from softcal.project.project import load

GOOD = f"specimen,{FILE},filament,infill [%]\none,p1.csv,A,20\ntwo,p2.csv,B,40\n"


def read(folder: Path, table: str, *changes: tuple[str, str], by: tuple[str, ...] = ()) -> FleetTable:
    return read_fleet(write_fleet(folder, [1.0, 1.1], table, *changes), by=by)


def faults(folder: Path, table: str, *changes: tuple[str, str]) -> str:
    """Those of the table and of its specimens, as the command tells them."""
    try:
        found, known = parse_fleet(write_fleet(folder, [1.0, 1.1], table, *changes))
    except InputError as error:
        return str(error)
    own: list[Fault] = []
    for row in found.rows:
        try:
            row_project(found.template, row)
        except InputError as error:
            own += error.faults
    return "\n".join(map(str, merged([*known, *own])))


def test_a_row_says_by_what_a_specimen_differs_from_the_template(tmp_path: Path) -> None:
    table = read(tmp_path, GOOD)
    assert [row.name for row in table.rows] == ["one", "two"]
    assert table.sets == (FILE,)
    assert dict(table.factors) == {"filament": "", "infill": "%"}
    second = table.rows[1]
    assert second.factors == {"filament": "B", "infill": pytest.approx(0.4)}
    project = load(table.template, changes=second.changes, values=second.values)
    assert dict(project.changes) == {"experiments.pull.files[0].path": "p2.csv"}
    assert project.records["pull"].n_samples == 25
    assert set(project.inputs) == {"bar.msh", "p2.csv"}


def test_a_column_file_is_the_file_of_all_experiments_that_share_one(tmp_path: Path) -> None:
    table = read(tmp_path, "specimen,file\none,p1.csv\n")
    assert {key: one.value for key, one in table.rows[0].changes.items()} == {
        "experiments.pull.files[0].path": "p1.csv"
    }


def test_the_measured_files_of_a_row_are_those_of_all_experiments(tmp_path: Path) -> None:
    table = read(tmp_path, f"specimen,{FILE},a\none,p1.csv,A\ntwo,p2.csv,\n")
    assert [row.measured for row in table.rows] == [("p1.csv",), ("p2.csv",)]
    assert read(tmp_path / "b", "specimen,a\none,A\n").rows[0].measured == ("data/pull.csv",)


def test_columns_set_keys_and_parameters_with_units(tmp_path: Path) -> None:
    text = f"specimen,{FILE},experiments.pull.slack [mm],bar.poissons_ratio,robot.bodies.bar.youngs_modulus\n"
    table = read(tmp_path, f"{text}one,p1.csv,1.5,0.40,2.5 MPa\ntwo,p2.csv,,,\n")
    one, two = (load(table.template, changes=row.changes, values=row.values) for row in table.rows)
    assert one.experiments["pull"].rig.slack == pytest.approx(1.5e-3)
    assert one.held == {"bar.poissons_ratio": 0.4}
    assert one.robot.bodies[0].parameters["youngs_modulus"] == pytest.approx(2.5e6)
    assert two.robot.bodies[0].parameters["youngs_modulus"] == pytest.approx(2e6)
    assert two.held == {}
    assert table.factors == {}


def test_a_german_table_with_decimal_commas(tmp_path: Path) -> None:
    table = read(
        tmp_path, f"specimen;{FILE};experiments.pull.slack [mm];infill [%]\none;p1.csv;1,5;22,5\ntwo;p2.csv;0,5 mm;30\n"
    )
    one, two = (load(table.template, changes=row.changes) for row in table.rows)
    assert one.experiments["pull"].rig.slack == pytest.approx(1.5e-3)
    assert two.experiments["pull"].rig.slack == pytest.approx(0.5e-3)
    assert [row.factors["infill"] for row in table.rows] == [pytest.approx(0.225), pytest.approx(0.3)]


def test_print_infill_sets_the_template_too(tmp_path: Path) -> None:
    table = read(tmp_path, f"specimen,{FILE},print.infill [%]\none,p1.csv,55\n")
    project = load(table.template, changes=table.rows[0].changes)
    assert project.print_infill is not None
    assert project.print_infill.infill == pytest.approx(0.55)
    assert table.rows[0].factors == {"infill": pytest.approx(0.55)}


def test_numbers_and_dates_of_factors(tmp_path: Path) -> None:
    table = read(tmp_path, f"specimen,{FILE},nozzle [degC],made,batch\none,p1.csv,220,2026-11-23,1A\n")
    assert table.rows[0].factors == {"nozzle": "220 degC", "made": "2026-11-23", "batch": "1A"} or table.rows[
        0
    ].factors == {
        "nozzle": 220.0,
        "made": "2026-11-23",
        "batch": "1A",
    }


def test_a_serial_number_is_text(tmp_path: Path) -> None:
    table = read(tmp_path, f"specimen,{FILE},serial\none,p1.csv,007\ntwo,p2.csv,7\nthree,p2.csv,0.7\nfour,p2.csv,0\n")
    assert [row.factors["serial"] for row in table.rows] == ["007", 7.0, 0.7, 0.0]


def test_what_is_no_finite_number_is_text(tmp_path: Path) -> None:
    cells = ["1e999", "-2E999", "9" * 401, "9" * 5000, "1e308", "9" * 30]
    rows = "".join(f"s{k},p1.csv,{cell}\n" for k, cell in enumerate(cells))
    table = read(tmp_path, f"specimen,{FILE},serial\n{rows}")
    assert [row.factors["serial"] for row in table.rows] == [*cells[:4], 1e308, float("9" * 30)]
    assert "line 2: the number is not finite" in faults(tmp_path, f"specimen,{FILE},infill\none,p1.csv,1e999\n")
    slack = ("    noise:", "    slack: 1 mm\n    noise:")
    found = faults(tmp_path, f"specimen,{FILE},experiments.pull.slack [mm]\none,p1.csv,1e999\n", slack)
    assert "line 2: the number is not finite" in found
    found = faults(tmp_path, f"specimen,{FILE},bar.poissons_ratio\none,p1.csv,{'9' * 401}\n")
    assert "line 2: the number is not finite" in found


def test_only_the_named_factors_are_compared(tmp_path: Path) -> None:
    assert list(read(tmp_path, GOOD, by=("filament",)).factors) == ["filament"]
    with pytest.raises(InputError, match=r"the table has no such factor.*'filament'"):
        read(tmp_path / "b", GOOD, by=("filamnt",))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            f"specimen,{FILE}\none,p1.csv\none,p2.csv\n",
            "line 3: two rows have the same name; got 'one', and 'one' in line 2",
        ),
        (f"specimen,{FILE}\none,p1.csv\nOne,p2.csv\n", "two names differ only in capitals"),
        (f"specimen,{FILE}\nP1/20,p1.csv\n", "line 2: this cannot be a name; got 'P1/20'"),
        (f"specimen,{FILE}\n,p1.csv\n", "line 2: a specimen has no name"),
        (f"specimen,{FILE}\np1.json,p1.csv\n", "a specimen's name cannot end in '.json', as files of the fleet do"),
        (f"specimen,{FILE}\np1.JSON.part,p1.csv\n", "cannot end in '.json.part'"),
        (f"specimen,{FILE}\np1.failed-12,p1.csv\n", "line 2: a specimen's name cannot end in '.failed-12'"),
        (f"name,{FILE}\none,p1.csv\n", "the column with the specimens' names is missing"),
        ("specimen,experiments.pul.file\none,p1.csv\n", "this column sets nothing; got 'experiments.pul.file'"),
        (f"specimen,{FILE},experiments.pull.slak [mm]\none,p1.csv,2\n", "unknown key; got 'slak'"),
        (
            f"specimen,{FILE},slack [mm]\none,p1.csv,2\n",
            "Try: 'experiments.pull.slack', or --by slack if it is a factor",
        ),
        (
            f"specimen,{FILE},bar.density [kg/m^3],robot.bodies.bar.density [kg/m^3]\none,p1.csv,1,2\n",
            "columns 'bar.density [kg/m^3]' and 'robot.bodies.bar.density [kg/m^3]': two columns mean the same",
        ),
        (f"specimen,{FILE},{FILE}\none,p1.csv,p2.csv\n", f"columns '{FILE}' and '{FILE}': two columns mean the same"),
        (f"specimen,{FILE},name\none,p1.csv,Red arm\n", "this column sets nothing; got 'name'"),
        (f"specimen,{FILE},name\none,p1.csv,Red arm\n", "Try: another name, or --by name if it is a factor"),
        (f"specimen,{FILE},robot\none,p1.csv,Red arm\n", "this column sets nothing; got 'robot'"),
        (f"specimen,{FILE},bar.youngs_modulu [MPa]\none,p1.csv,2\n", "youngs_modulu"),
        (f"specimen,{FILE},bar.poissons_ratio\none,p1.csv,0.7\n", "line 2: Poisson's ratio is out of range"),
        (f"specimen,{FILE},experiments.pull.slack [N]\none,p1.csv,2\n", "line 2: the unit does not fit; got 'N'"),
        (f"specimen,{FILE},experiments.pull.slack\none,p1.csv,2\n", "line 2: the unit is missing"),
        (f"specimen,{FILE},infill\none,p1.csv,0\n", "line 2: the infill is out of range"),
        (f"specimen,{FILE},infill\none,p1.csv,30\n", "line 2: the infill is out of range"),
        (f"specimen,{FILE},infill [mm]\none,p1.csv,30\n", "line 2: the unit does not fit"),
        (
            f"specimen,{FILE},a\none,p1.csv,A\ntwo,,B\n",
            f"column '{FILE}', line 3: the specimen has no measured file here",
        ),
        ("specimen,file,a\none,,A\ntwo,,B\n", "column 'file', lines 2, 3: the specimen has no measured file here"),
        (
            f'specimen,{FILE},bar.youngs_modulus [kPa]\none,p1.csv,"2,000"\ntwo,p2.csv,"2,100"\n',
            "a comma may be the decimal sign, or stand between thousands; got '2,000' and 1 like it",
        ),
        (f"specimen,{FILE}\n", "no data below the column names"),
        (f"specimen,{FILE},\none,p1.csv,x\n", "fields than there are column names"),
    ],
)
def test_a_fault_of_the_table_is_told_with_its_place(tmp_path: Path, table: str, said: str) -> None:
    found = (
        faults(tmp_path, table, ("slack", "slack"))
        if "slack" not in table
        else faults(tmp_path, table, ("    noise:", "    slack: 1 mm\n    noise:"))
    )
    assert said in found


def test_columns_that_mean_the_same_are_named_once(tmp_path: Path) -> None:
    found = faults(tmp_path, f"specimen,{FILE},infill,infill [%],a,a,a\none,p1.csv,0.2,20,A,A,A\n")
    assert [line for line in found.replace(f"{tmp_path}/", "").splitlines() if "same" in line] == [
        "fleet.csv, columns 'infill' and 'infill [%]': two columns mean the same; allowed: one.",
        "fleet.csv, columns 'a' and 'a' and 'a': several columns mean the same; allowed: one.",
    ]
    found = faults(tmp_path, f"specimen,{FILE},infill,print.infill [%]\none,p1.csv,0.2,20\n")
    assert found.count("the same") == 1
    assert "columns 'infill' and 'print.infill [%]': two columns mean the same" in found


def test_a_key_without_a_dot_can_be_named_a_factor(tmp_path: Path) -> None:
    write_fleet(tmp_path, [1.0], f"specimen,{FILE},name\none,p1.csv,Red arm\n")
    (row,) = read_fleet(tmp_path, by=("name",)).rows
    assert row.factors == {"name": "Red arm"}
    assert set(row.changes) == {"experiments.pull.files[0].path"}


def test_a_name_that_is_nearly_a_key_is_no_factor(tmp_path: Path) -> None:
    changes = ("    noise:", "    slack: 1 mm\n    noise:")
    found = faults(tmp_path, f"specimen,{FILE},slak [mm]\none,p1.csv,2\n", changes)
    assert "column 'slak [mm]': this column sets nothing" in found
    assert "Try: 'experiments.pull.slack', or --by slak if it is a factor" in found
    assert read_fleet(tmp_path, by=("slak",)).rows[0].factors == {"slak": "2 mm"}


def test_faults_of_table_and_specimens_are_told_together(tmp_path: Path) -> None:
    found = faults(tmp_path, "specimen,experiments.pul.file,bar.poissons_ratio\none,p1.csv,0.7\none,p2.csv,0.4\n")
    assert "column 'experiments.pul.file': this column sets nothing" in found
    assert "two rows have the same name" in found
    assert "Poisson's ratio is out of range" in found
    with pytest.raises(InputError, match="this column sets nothing"):
        read_fleet(tmp_path)


def test_every_missing_file_is_named_in_one_fault(tmp_path: Path) -> None:
    found = faults(tmp_path, f"specimen,{FILE}\none,p1.csv\ntwo,no.csv\nthree,none.csv\n")
    assert found.count("there is no such") == 1
    assert "lines 3, 4" in found
    assert "'no.csv', 'none.csv'" in found


def test_faults_of_several_columns_are_told_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, f"specimen,{FILE},bar.poissons_ratio\none,no.csv,0.4\ntwo,p2.csv,0.7\n")
    assert "no.csv" in found
    assert "bar.poissons_ratio" in found
