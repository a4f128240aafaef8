"""Bench files as instruments write them: what is read, and how every fault is told."""

from __future__ import annotations

from pathlib import Path

import bench_record
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from softcal.errors import DatasetError, StorageError, UnitError
from softcal.experiments.orientation import plate_angles
from softcal.experiments.read import read_table
from softcal.experiments.table_format import ColumnSpec, TableFormat

NECK = Path(__file__).parents[3] / "shared/data/neck/utm-equilibrium-15mms.csv"
UTM = {
    "time": ColumnSpec("Time", "s"),
    "shortening": ColumnSpec("Disp", "mm"),
    "tension": ColumnSpec("Force", "N"),
}
PLAIN = "Time,Disp,Force\n0.0,0.0,0.5\n0.1,1.5,1.25\n0.2,3.0,2.0\n"


def write(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "bench.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_reads_an_instron_file(tmp_path: Path) -> None:
    moved = bench_record.motion(1)
    tension = bench_record.force(moved)
    path = bench_record.write_instron(tmp_path / "neck.csv", moved, tension)
    columns = {"time": ColumnSpec("Time"), "shortening": ColumnSpec("Extension"), "tension": ColumnSpec("Load")}
    dataset = read_table(path, columns)
    assert dataset.name == "neck"
    assert_allclose(dataset.values("time"), moved.time, atol=1e-3)
    assert_allclose(dataset.values("shortening"), moved.shortening, atol=1e-8)
    assert_allclose(dataset.values("tension"), tension, atol=1e-4)
    record = dataset.provenance[0].settings
    assert (record["delimiter"], record["decimal"], record["encoding"]) == (";", ",", "latin-1")
    assert record["columns"]["tension"]["unit"] == "kN"


def test_reads_the_real_neck() -> None:
    if not NECK.exists():
        pytest.skip("the shared measurements are not here")
    columns = {"shortening": ColumnSpec("displacement_mm"), "tension": ColumnSpec("force_N")}
    counts = [read_table(NECK, columns, where={"target_mm": target}).n_samples for target in ("20", 40, "60.0")]
    assert counts == [78, 154, 231]
    dataset = read_table(NECK, columns, where={"target_mm": "20"})
    assert_allclose(dataset.values("shortening")[[0, -1]], [2.623e-3, 19.931e-3])
    assert_allclose(dataset.values("tension")[0], 1.5)


LAYOUTS = {
    "semicolon and comma": (";", ",", "utf-8"),
    "semicolon and point": (";", ".", "utf-8-sig"),
    "tab": ("\t", ".", "latin-1"),
    "tab and decimal comma": ("\t", ",", "utf-16"),
    "comma": (",", ".", "utf-16-le"),
    "white space": ("   ", ".", "utf-8"),
    "white space and decimal comma": (" ", ",", "utf-8"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_is_found_from_the_file(tmp_path: Path, layout: str) -> None:
    delimiter, decimal, encoding = LAYOUTS[layout]
    rows = [["Time [s]", "Disp [mm]", "Force [N]"], ["0.5", "1", "-2.25"], ["0.75", "1.125", "1e-3"]]
    lines = [delimiter.join(cell.replace(".", decimal) for cell in row) for row in rows]
    path = write(tmp_path, "free text above\n\n" + "\r\n".join(lines) + "\r\n", encoding)
    dataset = read_table(path, {key: ColumnSpec(spec.name) for key, spec in UTM.items()})
    assert_allclose(dataset.values("time"), [0.5, 0.75])
    assert_allclose(dataset.values("shortening"), [1e-3, 1.125e-3])
    assert_allclose(dataset.values("tension"), [-2.25, 1e-3])


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(st.floats(-1e6, 1e6, allow_nan=False), min_size=1, max_size=20),
    layout=st.sampled_from(sorted(LAYOUTS)),
    unit=st.sampled_from([("kN", 1e-3), ("N", 1.0), ("mN", 1e3), ("kgf", 1 / 9.80665)]),
)
def test_numbers_survive_every_layout_and_unit(
    tmp_path_factory: pytest.TempPathFactory, values: list[float], layout: str, unit: tuple[str, float]
) -> None:
    delimiter, decimal, encoding = LAYOUTS[layout]
    lines = [f"No{delimiter}Force"]
    lines += [f"{i}{delimiter}{v * unit[1]!r}".replace(".", decimal) for i, v in enumerate(values)]
    path = write(tmp_path_factory.mktemp("layout"), "\n".join(lines), encoding)
    dataset = read_table(path, {"tension": ColumnSpec("Force", unit[0])}, TableFormat(decimal=decimal))
    assert_allclose(dataset.values("tension"), values, rtol=1e-12, atol=1e-300)


def test_quoted_decimal_commas_between_commas(tmp_path: Path) -> None:
    path = write(tmp_path, 'Time,Disp,Force\n"0,1","1,5","2,25"\n"0,2","3,0","4,5"\n')
    dataset = read_table(path, UTM)
    assert_allclose(dataset.values("tension"), [2.25, 4.5])


def test_byte_order_mark_is_no_part_of_the_first_name(tmp_path: Path) -> None:
    assert_allclose(read_table(write(tmp_path, PLAIN, "utf-8-sig"), UTM).values("time"), [0.0, 0.1, 0.2])


def test_header_in_a_comment_and_comments_between_rows(tmp_path: Path) -> None:
    path = write(tmp_path, "# a run\n# Time Disp Force\n0 0 1\n# pause\n1 2 3\n")
    assert_allclose(read_table(path, UTM).values("tension"), [1.0, 3.0])


def test_a_machine_that_writes_tension_negative(tmp_path: Path) -> None:
    columns = {"tension": ColumnSpec("Force", "N", scale=-1.0)}
    assert_allclose(read_table(write(tmp_path, PLAIN), columns).values("tension"), [-0.5, -1.25, -2.0])


@pytest.mark.parametrize(
    "header", ["Force [kN]", "Force (kN)", "Force_kN", "Force / kN", "force[kN]", "Force\n(kN)", "Force\nkN"]
)
def test_unit_from_the_file(tmp_path: Path, header: str) -> None:
    path = write(tmp_path, header + "\n0.001\n0.002\n")
    dataset = read_table(path, {"tension": ColumnSpec("Force")}, TableFormat(delimiter=","))
    assert_allclose(dataset.values("tension"), [1.0, 2.0])


def test_rows_named_by_number(tmp_path: Path) -> None:
    path = write(tmp_path, "Time,Force\nA,B\nchannel 1,channel 2\ns,N\n0,1\n1,2\nEnd of test\n")
    columns = {"time": ColumnSpec("A"), "tension": ColumnSpec("B")}
    dataset = read_table(path, columns, TableFormat(header_row=2, units_row=4, skip_footer=1))
    assert_allclose(dataset.values("tension"), [1.0, 2.0])


def test_missing_unit(tmp_path: Path) -> None:
    with pytest.raises(UnitError, match=r"line 1, column 'Force'.*unit is missing.*converts to N"):
        read_table(write(tmp_path, PLAIN), {"tension": ColumnSpec("Force")})


@pytest.mark.parametrize("unit", ["mm", "newtonn"])
def test_unit_of_another_dimension_or_unknown(tmp_path: Path, unit: str) -> None:
    with pytest.raises(UnitError, match=rf"column 'Force'.*'{unit}'.*converts to N"):
        read_table(write(tmp_path, PLAIN), {"tension": ColumnSpec("Force", unit)})


def test_unit_against_the_files(tmp_path: Path) -> None:
    path = write(tmp_path, PLAIN.replace("Force", "Force [kN]"))
    with pytest.raises(UnitError, match="'N' in the project, 'kN' in the file"):
        read_table(path, UTM)


def test_missing_column_names_the_nearest_and_all(tmp_path: Path) -> None:
    columns = {**UTM, "tension": ColumnSpec("Forse", "N")}
    with pytest.raises(
        DatasetError, match=r"line 1: no column 'Forse'; got columns 'Time', 'Disp', 'Force'.*'Force'\."
    ):
        read_table(write(tmp_path, PLAIN), columns)


def test_no_wanted_column_at_all(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="columns 'Time', 'Disp', 'Force'"):
        read_table(write(tmp_path, PLAIN), {"pitch": ColumnSpec("Pitch", "deg")})


def test_text_and_nan_are_told_with_their_lines(tmp_path: Path) -> None:
    text = "# run 3\nTime,Disp,Force\n0.0,0.0,0.5\n\n0.1,1.5,NaN\n0.2,oops,2.0\n0.3,2.0,\n0.4,2.5,inf\n"
    with pytest.raises(DatasetError) as caught:
        read_table(write(tmp_path, text), UTM, complete=["tension"])
    told = str(caught.value).splitlines()
    assert len(told) == 2
    assert "column 'Disp', line 6" in told[0]
    assert "'oops'" in told[0]
    assert "column 'Force', lines 5, 7, 8" in told[1]
    assert "'NaN', nothing, 'inf'" in told[1]


def test_all_faults_at_once(tmp_path: Path) -> None:
    text = "Time;Disp;Force\n0,0;x;1,5\n0,2;1,0;2,5\n0,1;2,0;3,5\n"
    columns = {**UTM, "tension": ColumnSpec("Force"), "pitch": ColumnSpec("Pitch", "deg")}
    with pytest.raises(DatasetError) as caught:
        read_table(write(tmp_path, text), columns)
    told = str(caught.value)
    assert len(caught.value.faults) == 4
    for part in ("no column 'Pitch'", "column 'Disp', line 2", "line 4: time runs backwards 1 time", "unit is missing"):
        assert part in told


@pytest.mark.parametrize("text", ["", "\n \n", "Time,Disp,Force\n", "# only\n# comments\n"])
def test_empty_files(tmp_path: Path, text: str) -> None:
    with pytest.raises(DatasetError, match=r"bench\.csv.*(empty|no data|no line with column names)"):
        read_table(write(tmp_path, text), UTM)


def test_doubled_header(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"2 columns have the name 'Force'.*column 3.*column 4"):
        read_table(write(tmp_path, "Time,Disp,Force,Force\n0,0,0,0\n"), UTM)


def test_unquoted_decimal_comma_between_commas(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"line 2.*6 fields.*allowed: 3, as in line 1"):
        read_table(write(tmp_path, "Time,Disp,Force\n0,1,1,5,2,25\n"), UTM)


def test_thousands_separator_is_no_number(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"'1\.200'.*decimal comma"):
        read_table(write(tmp_path, "Time;Disp;Force\n0,5;1,5;1.200\n"), UTM)


@pytest.mark.parametrize("rows", ["1;2;1,200\n2;3;1,300\n", "1,500;2,250;1,200\n"])
def test_a_comma_that_may_be_either_is_refused(tmp_path: Path, rows: str) -> None:
    path = write(tmp_path, f"Time;Disp;Force\n{rows}")
    with pytest.raises(DatasetError, match=r"'1,[25]00'.*Try: decimal: ',' in the project"):
        read_table(path, UTM)
    assert read_table(path, UTM, TableFormat(decimal=",")).values("tension")[0] == pytest.approx(1.2)
    path.write_text(f"Time;Disp;Force\n0,500;1;1,100\n{rows}")
    assert read_table(path, UTM).values("tension")[1] == pytest.approx(1.2)


def test_filter_that_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"no row holds '7'.*'0\.0', '1\.5', '3\.0'"):
        read_table(write(tmp_path, PLAIN), UTM, where={"Disp": "7"})


def test_filtered_rows_need_not_be_numbers(tmp_path: Path) -> None:
    path = write(tmp_path, "test,Force\nA,1\nB,broken\nA,2\n")
    assert_allclose(
        read_table(path, {"tension": ColumnSpec("Force", "N")}, where={"test": "A"}).values("tension"), [1, 2]
    )


def test_a_filter_takes_no_name_for_a_number(tmp_path: Path) -> None:
    path = write(tmp_path, "run,Force\n10,1\n1_0,2\n10.0,3\n")
    assert_allclose(
        read_table(path, {"tension": ColumnSpec("Force", "N")}, where={"run": 10}).values("tension"), [1, 3]
    )


def test_a_filter_may_name_several_values_all_of_which_must_be_there(tmp_path: Path) -> None:
    path = write(tmp_path, "test,load,Force\nA,1,1\nB,2,2\nA,3,3\nC,1,4\n")
    columns = {"tension": ColumnSpec("Force", "N")}
    read = read_table(path, columns, where={"test": ["C", "A"], "load": [1]})
    assert_allclose(read.values("tension"), [1, 4])
    assert_allclose(read_table(path, columns, where={"load": (3, 2)}).values("tension"), [2, 3])
    with pytest.raises(DatasetError, match=r"no row holds 'D'.*'A', 'B', 'C'"):
        read_table(path, columns, where={"test": ["A", "D"]})


def test_missing_file_and_unknown_channel(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"nowhere\.csv"):
        read_table(tmp_path / "nowhere.csv", UTM)
    with pytest.raises(DatasetError, match=r"'tensoin'.*Try: 'tension'"):
        read_table(write(tmp_path, PLAIN), {"tensoin": ColumnSpec("Force", "N")})


def test_angle_that_jumps_by_a_turn(tmp_path: Path) -> None:
    dataset = read_table(write(tmp_path, "Yaw [deg]\n170\n179\n-179\n"), {"yaw": ColumnSpec("Yaw")})
    assert_allclose(np.degrees(dataset.values("yaw")), [170, 179, 181])
    assert "full turn" in dataset.provenance[0].outcome


def plate_rotation(pitch: np.ndarray, roll: np.ndarray) -> Rotation:
    return Rotation.from_euler("YX", np.column_stack([pitch, roll]))


def test_angles_are_the_twins() -> None:
    quaternions = plate_rotation(np.array([0.0, 0.7]), np.array([0.0, -0.2])).as_quat(scalar_first=True)
    pitch, roll, yaw = plate_angles(quaternions, rest_samples=1)
    R = Rotation.from_quat(quaternions[1], scalar_first=True).as_matrix()
    assert_allclose(pitch[1], np.arctan2(R[0, 2], R[2, 2]))
    assert_allclose(roll[1], np.arctan2(-R[1, 2], np.hypot(R[0, 2], R[2, 2])))
    assert_allclose([pitch[1], roll[1], yaw[1]], [0.7, -0.2, 0.0], atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(pitch=st.floats(-1.4, 3.0), roll=st.floats(-1.4, 1.4), seed=st.integers(0, 1000))
def test_angles_do_not_depend_on_heading_or_mounting(pitch: float, roll: float, seed: int) -> None:
    earth = Rotation.random(rng=seed)
    # The sensor lies on its side: the robot's x is the sensor's -y, its y the sensor's x.
    to_robot = Rotation.from_matrix([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = plate_rotation(np.linspace(0, pitch, 50), np.linspace(0, roll, 50))
    quaternions = (earth * to_robot.inv() * moved * to_robot).as_quat(scalar_first=True)
    angles = plate_angles(quaternions, axes=("-y", "x", "z"), rest_samples=1)
    assert_allclose([angles[0][-1], angles[1][-1]], [pitch, roll], atol=1e-9)


def test_quaternion_columns(tmp_path: Path) -> None:
    angle = np.radians([0, 0, 10, 20, 30])
    quaternions = plate_rotation(angle, np.zeros(5)).as_quat(scalar_first=True)
    rows = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in quaternions)
    columns = {key: ColumnSpec(key) for key in ("qw", "qx", "qy", "qz")}
    dataset = read_table(write(tmp_path, "qw qx qy qz\n" + rows), columns, TableFormat(rest_samples=2))
    assert set(dataset.channels) == {"pitch", "roll", "yaw"}
    assert_allclose(dataset.values("pitch"), angle, atol=1e-8)
    with pytest.raises(DatasetError, match="right-handed"):
        read_table(tmp_path / "bench.csv", columns, TableFormat(axes=("y", "x", "z")))
    columns.pop("qw")
    with pytest.raises(DatasetError, match="no qw"):
        read_table(tmp_path / "bench.csv", columns)
