"""Tables as no instrument should write them: read right, or refused in a sentence; whatever their length."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from softcal.errors import DatasetError, InputError, StorageError
from softcal.experiments import columns as columns_of
from softcal.experiments.dataset import Dataset
from softcal.experiments.plausibility import check_plausible
from softcal.experiments.prepare import prepare
from softcal.experiments.read import read_table
from softcal.experiments.table_format import ColumnSpec, TableFormat

COLUMNS = {"time": ColumnSpec("Time"), "tension": ColumnSpec("Force", unit="N")}
HEADER = "Time [s],Force [N]\n"
ROWS = "".join(f"{0.1 * i:.1f},{1.5 * i}\n" for i in range(6))


def read(folder: Path, content: bytes | str, **options: object) -> Dataset:
    path = folder / "bench.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_table(path, COLUMNS, TableFormat(**options))  # type: ignore[arg-type]


REFUSED: dict[str, tuple[bytes | str, str]] = {
    "nothing": ("", "the file is empty"),
    "blank lines": ("\n\n  \n", "the file is empty"),
    "only a header": (HEADER, "no data below the column names"),
    "only a header without an end": (HEADER.strip(), "no data below the column names"),
    "a header and blank rows": (HEADER + ",\n , \n", "no data below the column names"),
    "only comments": ("# a\n# b\n", "no line with column names|no column 'Time'|no data"),
    "only numbers": ("1,2\n3,4\n", "no line with column names"),
    "text in a cell": (HEADER + ROWS + "0.6,overload\n", r"column 'Force \[N\]', line 8: .*; got 'overload'"),
    "a huge text in a cell": (HEADER + ROWS + "0.6," + "x" * 5000 + "\n", r"line 8: .*; got 'x{39}…'"),
    "NaN": (HEADER + ROWS + "NaN,1\n", r"line 8: .*; got 'NaN'"),
    "infinity": (HEADER + ROWS + "0.6,inf\n", r"line 8: .*; got 'inf'"),
    "a number beyond all": (HEADER + ROWS + "0.6,1e400\n", r"line 8: .*; got '1e400'"),
    "an empty cell": (HEADER + ROWS + ",1\n", r"line 8: .*; got nothing.*time and what drives the robot need"),
    "a spreadsheet's error in the first cell": (HEADER + ROWS + "#DIV/0!,1\n", r"line 8: .*; got '#DIV/0!'"),
    "a value that a spreadsheet lacks": (HEADER + ROWS + "#N/A,1\n", r"line 8: .*; got '#N/A'"),
    "a German spreadsheet's error": ((HEADER + ROWS).replace(",", ";") + "#WERT!;1\n", r"line 8: .*; got '#WERT!'"),
    "a hexadecimal number": (HEADER + ROWS + "0.6,0x1F\n", r"line 8: .*; got '0x1F'"),
    "a number with an underscore": (HEADER + ROWS + "0.6,1_000\n", r"line 8: .*; got '1_000'"),
    "digits of another script": (HEADER + ROWS + "0.6,\u0663\n", r"line 8: .*; got '\u0663'"),
    "a number with a NUL": ((HEADER + ROWS + "0.6,1\x002\n").encode(), r"line 8: .*; got '1\\x002'"),
    "NULs in the place of a row": ((HEADER + ROWS).encode() + bytes(64) + b"\n" + ROWS.encode(), "line 8"),
    "NULs in the place of a file": (bytes(5000), "bench.csv"),
    "a longer row": (HEADER + ROWS + "0.6,1,2\n", r"line 8: 1 row\(s\) have more fields .* got 3 fields"),
    "longer rows": (HEADER + "0.0,1,2\n" * 9, r"line 2: 9 row\(s\) have more fields"),
    "decimal commas between commas": (HEADER + "0,1,1,5\n", r"more fields than there are column names"),
    "two columns of one name": (
        HEADER.replace("Time [s]", "Force [N],Time") + "1,2,3\n",
        "2 columns have the name .* Try: rename one of them",
    ),
    "a column that is missing": ("Time [s],Kraft [N]\n0,1\n", "no column 'Force'"),
    "time that runs backwards": (HEADER + ROWS + "0.3,1\n", r"time runs backwards 1 time\(s\).*'0.3' after '0.5'"),
    "time that runs backwards often": (
        HEADER + "1,1\n0,1\n" * 9,
        r"lines 3, 5, 7, 9, 11, …: time runs backwards 9 time",
    ),
    "a quoted field beyond all limits": (
        HEADER + ROWS + '0.6,"' + "1" * 200_000 + '"\n',
        "line 8: the line cannot be cut",
    ),
    "a line beyond all limits": (HEADER + ROWS + "1" * 1_000_001 + "\n", "line 8: the line is too long"),
    "no ends of lines": ("1," * 700_000, "line 1: the line is too long"),
    "half an UTF-16": (HEADER.encode("utf-16") + b"\0", "not text"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20, "bench.csv"),
    "an empty cell between white space": (
        "Time Force Pitch\n0 1 2\n1   5\n2 3 4\n",
        r"line 3: 1 row\(s\) have fewer fields",
    ),
    "names with blanks between white space": (
        "Load cell [N] Time [s] Force [N]\n0 1 2\n1 2 5\n",
        r"line 2: 2 row\(s\) have fewer fields .* quotes around names with blanks",
    ),
    "marks between thousands": (
        (HEADER + ROWS).replace(",", ";").replace(".", ",") + "0,6;1.050,5\n",
        r"got '1\.050,5'.* Try: numbers without a mark between thousands\.$",
    ),
    "two rows of names": (
        HEADER + HEADER + ROWS,
        r"line 2: 2 value.* has the units, or header_row: 2, if it has the names",
    ),
    "text above the rows": (HEADER + "0.0,x\n" + ROWS, r"got 'x'; .* Try: units_row: 2, if it has the units\.$"),
    "a unit of the table's own": (HEADER.replace("[s]", "[Sek.]") + ROWS, r"got 'Sek\.'; .* Try: unit: s, in the"),
    "a unit after a word, and another in the project": (HEADER.replace("[N]", "in kN") + ROWS, "'N' in the project"),
    "a workbook": (b"PK\x03\x04" + bytes(300), "not text; got an archive.*save the sheet as CSV"),
    "an archive": (b"PK\x03\x04" + bytes(range(255, 0, -1)) * 20, "bench.csv"),
    "numbers in letters of another script": (HEADER + "０.１,１.５\n".replace("１", "一"), "line 2"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_read_is_refused(case: str, tmp_path: Path) -> None:
    content, message = REFUSED[case]
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, content)
    assert "bench.csv" in str(caught.value)
    assert len(str(caught.value)) < 1000


EXPECTED = 1.5 * np.arange(6)
READ: dict[str, bytes | str] = {
    "as it should be": HEADER + ROWS,
    "without a last end": (HEADER + ROWS).rstrip(),
    "with carriage returns": (HEADER + ROWS).replace("\n", "\r\n"),
    "with old carriage returns": (HEADER + ROWS).replace("\n", "\r"),
    "with a mark of its encoding": b"\xef\xbb\xbf" + (HEADER + ROWS).encode(),
    "in UTF-16": (HEADER + ROWS).encode("utf-16"),
    "in UTF-16 without a mark": (HEADER + ROWS).encode("utf-16-le"),
    "in Latin-1, with a degree": "Specimen: 20 °C\n".encode("latin-1") + (HEADER + ROWS).encode(),
    "in two encodings": "Prüf\n".encode() + "Prüf\n".encode("latin-1") + (HEADER + ROWS).encode(),
    "with quotes": HEADER + "".join(f'"{0.1 * i:.1f}","{1.5 * i}"\n' for i in range(6)),
    "with blanks": (HEADER + ROWS).replace(",", " , "),
    "with blanks that do not break": (HEADER + ROWS).replace(",", ",\u00a0"),
    "with comments between": HEADER + ROWS.replace("\n", "\n# a remark, of, many, cells\n"),
    "with rows that are commented out": HEADER + ROWS.replace("\n", "\n#0.1,7\n#N: 7, 8\n#STOP! moved\n"),
    "with empty rows between": HEADER + ROWS.replace("\n", "\n\n,\n"),
    "with an empty column at the end": (HEADER + ROWS).replace("\n", ",\n"),
    "with a row of units": "Time,Force\ns,N\n" + ROWS,
    "with a row of units and a sign for none": "Time,Force,Cycle\ns,N,-\n" + ROWS.replace("\n", ",1\n"),
    "with units after a word": "Time in s;Force in N\n" + ROWS.replace(",", ";"),
    "by tabs": (HEADER + ROWS).replace(",", "\t"),
    "by semicolons, with decimal commas": (HEADER + ROWS).replace(",", ";").replace(".", ","),
    "with plus signs and exponents": HEADER + "".join(f"+{i}e-1,+{15 * i}E-1\n" for i in range(6)),
    "with a form feed in a remark": "a\x0cb\n" + HEADER + ROWS,
    "below a long preamble": "machine: 7\n" * 900 + HEADER + ROWS,
}


@pytest.mark.parametrize("case", READ)
def test_what_can_be_read_is_read_right(case: str, tmp_path: Path) -> None:
    found = read(tmp_path, READ[case])
    np.testing.assert_allclose(found.values("tension"), EXPECTED, rtol=1e-15)
    np.testing.assert_allclose(found.values("time"), 0.1 * np.arange(6), atol=1e-15)


@pytest.mark.parametrize("delimiter", ["", ";;", "ab", "a", "."])
def test_a_delimiter_is_one_character(delimiter: str) -> None:
    with pytest.raises(InputError, match="delimiter: this character cannot separate columns"):
        TableFormat(delimiter=delimiter)


@pytest.mark.parametrize("option", ["header_row", "units_row"])
def test_a_row_that_is_not_there(option: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="row is not a line"):
        read(tmp_path, HEADER + ROWS, **{option: 99})
    for line in (0, 10**12):
        with pytest.raises(InputError, match=f"{option}: there are too .* lines before the data"):
            TableFormat(**{option: line})


@pytest.mark.parametrize("option", ["skip_rows", "skip_footer"])
def test_all_rows_skipped(option: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"the file is empty; got 7 line\(s\), 7 of them skipped"):
        read(tmp_path, HEADER + ROWS, **{option: 10**6})


def test_a_footer_is_skipped_and_lines_are_those_of_the_file(tmp_path: Path) -> None:
    text = "bench 7\n" + HEADER + ROWS + "end of test\n"
    np.testing.assert_allclose(read(tmp_path, text, skip_footer=1).values("tension"), EXPECTED)
    with pytest.raises(DatasetError, match=r"line 9: .*; got 'end of test'.* Try: skip_footer: 1, to leave the end"):
        read(tmp_path, text)
    with pytest.raises(DatasetError) as caught:
        read(tmp_path, HEADER + ROWS + "Stop,end\n")
    assert len(caught.value.faults) == 1, "one line, one fault"
    assert "columns 'Time [s]', 'Force [N]', line 8: 2 value(s) are not numbers; got 'Stop', 'end'" in str(caught.value)
    further = "".join(f"{k},{k}\n" for k in range(8, 20))
    with pytest.raises(DatasetError, match=r"got 'odd'; allowed: numbers with a decimal point\.$"):
        read(tmp_path, HEADER + ROWS + "7.5,odd\n" + further)


@pytest.mark.parametrize("cell", ["", "NaN", "n/a"])
def test_an_empty_cell_of_a_channel_is_a_missing_value(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "pull.csv"
    angles = [170.0 + 3.0 * i if i < 4 else -190.0 + 3.0 * i for i in range(30)]  # a full turn is taken out
    path.write_text("Force [N],Pitch [deg]\n" + "".join(f"{i},{cell if i == 8 else p}\n" for i, p in enumerate(angles)))
    columns = {"tension": ColumnSpec("Force [N]"), "pitch": ColumnSpec("Pitch [deg]")}
    found = read_table(path, columns)
    expected = np.deg2rad(170.0 + 3.0 * np.arange(30))
    expected[8] = np.nan
    np.testing.assert_allclose(found.values("pitch"), expected)
    assert found.incomplete == ("pitch",)
    assert "pitch is missing in 1 row(s)" in found.provenance[0].outcome
    with pytest.raises(DatasetError, match=r"line 10: 1 value\(s\) are not numbers"):
        read_table(path, columns, complete=["pitch"])
    assert prepare(found, [{"zero": {"channel": "tension"}}]).incomplete == ("pitch",)
    for step in ({"zero": {"channel": "pitch"}}, {"take_branch": "loading"}):
        with pytest.raises(DatasetError, match=r"cannot be applied to missing values; got pitch; .* the rows in which"):
            prepare(found, [step])


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, Path("/dev/zero")):
        if path.exists():
            with pytest.raises(StorageError, match="cannot be read"):
                read_table(path, COLUMNS)


def test_a_filter_goes_across_blocks(tmp_path: Path) -> None:
    """A table of several blocks, each with rows of every test."""
    n = 90_000
    lines = ["Test,Time [s],Force [N]", *(f"{i % 3},{1e-3 * i:.3f},{i}" for i in range(n)), ""]
    path = tmp_path / "bench.csv"
    path.write_text("\n".join(lines))
    assert path.stat().st_size > 1 << 20
    found = read_table(path, COLUMNS, where={"Test": [0, 2]})
    np.testing.assert_array_equal(found.values("tension"), [i for i in range(n) if i % 3 != 1])
    with pytest.raises(DatasetError, match=r"no row holds '7'.*'0', '1', '2'"):
        read_table(path, COLUMNS, where={"Test": [0, 7]})
    path.write_text("\n".join(lines).replace(f"{1e-3 * 59_000:.3f},", "x,"))
    with pytest.raises(DatasetError, match=r"line 59002: .*; got 'x'"):
        read_table(path, COLUMNS)


def test_a_table_beyond_all_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(columns_of, "MOST_VALUES", 11)
    with pytest.raises(DatasetError, match="the table is too long"):
        read(tmp_path, HEADER + ROWS)


# VmHWM: the largest memory of this process alone; the resource module tells that of its parent where that is larger.
LONG = """
from pathlib import Path
from softcal.experiments.prepare import prepare
from softcal.experiments.read import read_table
from softcal.experiments.table_format import ColumnSpec
names = {{"time": "Time", "shortening": "Displacement", "tension": "Force", "pitch": "Pitch"}}
found = read_table({path!r}, {{channel: ColumnSpec(name) for channel, name in names.items()}})
peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(found.n_samples, float(found.values("tension").sum()), peak.split()[1])
"""


@pytest.mark.long  # a minute and a half
def test_ten_million_rows_take_less_than_one_and_a_half_gigabytes(tmp_path: Path) -> None:
    path, n = tmp_path / "long.csv", 10_000_000
    with path.open("w") as file:
        file.write("Time [s],Displacement [mm],Force [N],Pitch [deg]\n")
        for first in range(0, n, 100_000):
            rows = range(first, first + 100_000)
            file.writelines(f"{i * 1e-4:.4f},{i % 20000 * 1e-3:.3f},{i % 7}.25,{i % 50}.5\n" for i in rows)
    done = subprocess.run(
        [sys.executable, "-c", LONG.format(path=str(path))], capture_output=True, text=True, check=True
    )
    n_samples, total, kilobytes = done.stdout.split()
    assert int(n_samples) == n
    assert float(total) == pytest.approx(sum(range(7)) * (n // 7) + sum(range(n % 7)) + 0.25 * n)
    assert int(kilobytes) < 1_500_000


NAMED: dict[str, tuple[str, str, int]] = {
    "a factor in the brackets": ("Force [x1000 N]", "N", 1),
    "a power in the brackets": ("Force [10^3 N]", "N", 1),
    "a unit after a word": ("Force as kN", "N", 1),
    "a unit in other brackets": ("Force {kN}", "N", 1),
    "a unit before a remark": ("Force [kN] (filtered)", "N", 1),
    "a remark": ("Force (filtered)", "N", 0),
    "the unit after a word": ("Force as kN", "kN", 0),
    "the unit before a remark": ("Force N (filtered)", "N", 0),
    "a name that is a unit": ("N", "N", 0),
}


@pytest.mark.parametrize("case", NAMED)
def test_a_unit_in_a_name_that_is_not_read_is_warned_of(case: str, tmp_path: Path) -> None:
    name, unit, count = NAMED[case]
    path = tmp_path / "bench.csv"
    path.write_text(f"Time [s],{name}\n{ROWS}")
    found = read_table(path, {"time": ColumnSpec("Time"), "tension": ColumnSpec(name, unit=unit)})
    assert sum("does its name say another unit" in sentence for sentence in check_plausible(found)) == count


@pytest.mark.parametrize(("word", "meant"), [("force", "tension"), ("displacement", "shortening")])
def test_a_channel_by_another_word_has_a_remedy(word: str, meant: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text(HEADER + ROWS)
    with pytest.raises(DatasetError, match=f"no channel has the name '{word}'.* Try: '{meant}'"):
        read_table(path, {word: ColumnSpec("Force")})


@pytest.mark.parametrize("header", ["TL X (mm)", "TL_x [mm]", "tl:X [mm]", "TL.x_mm", "TL x"])
def test_a_marker_is_read_by_the_separators_of_other_programs(header: str, tmp_path: Path) -> None:
    path = tmp_path / "markers.csv"
    path.write_text(f"{header};TR X (mm)\n1,5;2,5\n-;3,5\nn/a;4,5\n")
    unit = None if "mm" in header else "mm"
    found = read_table(path, {"tip.x": ColumnSpec("TL.x", unit=unit), "tip.y": ColumnSpec("TR.x")}).values("tip.x")
    np.testing.assert_allclose(found, [1.5e-3, np.nan, np.nan])


def test_missing_columns_of_a_table_are_one_fault(tmp_path: Path) -> None:
    columns = {"time": ColumnSpec("Tme"), "tension": ColumnSpec("Forse"), "a.x": ColumnSpec("xyz")}
    path = tmp_path / "bench.csv"
    path.write_text(HEADER + ROWS)
    with pytest.raises(DatasetError, match=r"no columns 'Tme', 'Forse', 'xyz'; .*Try: 'Time', 'Force'\.$") as caught:
        read_table(path, columns)
    assert len(caught.value.faults) == 1


def test_a_mass_and_a_pressure_by_the_end_of_their_names(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text("Gewicht_g,Druck_mbar\n50,200\n100,400\n")
    found = read_table(path, {"c.mass": ColumnSpec("Gewicht"), "a.pressure": ColumnSpec("Druck")})
    np.testing.assert_allclose([found.values("c.mass"), found.values("a.pressure")], [[0.05, 0.1], [2e4, 4e4]])


@pytest.mark.parametrize(("unit", "scale", "warned"), [("m", 1, True), ("mm", 1, False), ("m", 0.001, False)])
def test_a_coordinate_in_another_unit_than_the_others_is_suspected(
    unit: str, scale: float, warned: bool, tmp_path: Path
) -> None:
    path = tmp_path / "markers.csv"
    path.write_text(f"x [mm],y [{unit}],z [mm]\n1,17,3\n2,92,4\n")
    columns = {f"tip.{one}": ColumnSpec(one, scale=scale if one == "y" else 1) for one in "xyz"}
    said = "\n".join(check_plausible(read_table(path, columns)))
    assert ("tip.x in mm, tip.y in m, tip.z in mm: is a header wrong?" in said) == warned
    assert ("tip.y reaches 92 m, above 10 m: mm read as m?" in said) == warned


def test_a_label_that_is_missing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text("state,m4.x [mm]\na,1\n,2\n")
    with pytest.raises(DatasetError, match=r"line 3: 1 row\(s\) have no label"):
        read_table(path, {"m4.x": ColumnSpec("m4.x")}, label="state")


def test_a_name_and_the_row_below_with_two_units_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two units of this column; got 'N' in the name, 'kN' in the row below"):
        read(tmp_path, HEADER + "s,kN\n" + ROWS)
    found = read(tmp_path, HEADER + "sec,N\n" + ROWS)
    np.testing.assert_allclose(found.values("tension"), EXPECTED)
