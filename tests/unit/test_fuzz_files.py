"""Files changed at random: read, or refused in a sentence; no other error, no hang, and no end of the memory."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from fake_twin import fake_experiment, fake_robot, soft_necks_fail
from hypothesis import HealthCheck, given, settings
from mutations import Mutation, mutated, mutations
from project_case import write_project
from test_bad_camera_files import BASE, CAMERA
from test_calibration_store import MODULUS, RATIO
from test_motion_capture import MARKERS, written
from test_stored_files import write_study

from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.trial_journal import stored_trials
from softcal.calibration.run import calibrate
from softcal.cli import main
from softcal.errors import InputError
from softcal.experiments.motion_capture import read_c3d
from softcal.experiments.read import read_table
from softcal.experiments.table_format import ColumnSpec
from softcal.geometry.primitives import box_mesh
from softcal.geometry.read import read_mesh
from softcal.geometry.stl import checked_stl
from softcal.geometry.surface import boundary_faces
from softcal.geometry.write import write_mesh
from softcal.plugins.markers.camera_file import read_camera
from softcal.project.base_file import read_base
from softcal.workflows.mesh_study import MESH_STUDY
from softcal.workflows.run_folder import load_run

LONGEST = 60  # seconds

Reader = Callable[[Path], object]


class Hang(BaseException):
    """No reader catches it."""


@contextlib.contextmanager
def limited() -> Generator[None]:
    """Raise `Hang` in here after a minute."""

    def late(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def problem() -> Problem:
    experiments = [fake_experiment("pull", noise=0.02)]
    return make_problem(fake_robot(), experiments, [MODULUS, RATIO], None, soft_necks_fail)


def resumed(method: str) -> Reader:
    trials = {"least-squares": 40, "tpe": 4}[method]
    return lambda path: calibrate(problem(), method=method, trials=trials, store=path.parent, resume=True)  # type: ignore[arg-type]


TABLE = "machine: 7\nTest;Time;Force;Way\n;s;N;mm\n" + "".join(f"A;{0.1 * i:.1f};{i},5;{i}\n" for i in range(20))
COLUMNS = {"time": ColumnSpec("Time"), "tension": ColumnSpec("Force"), "shortening": ColumnSpec("Way")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One file of each kind, as softcal or an instrument writes it, with what belongs to it beside it."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "bench.csv").write_text(TABLE.replace(".", ","))
    (folder / "camera.yaml").write_text(CAMERA)
    (folder / "base.yaml").write_text(BASE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        written(folder)
    write_study(folder / "study")
    calibrate(problem(), store=folder / "squares")
    calibrate(problem(), method="tpe", trials=4, store=folder / "tpe")
    project = write_project(folder / "project")
    with pytest.raises(SystemExit):
        main(["calibrate", str(project), "--out", str(folder / "run"), "--no-report"])
    return folder


KINDS: dict[str, tuple[str, Reader]] = {
    "a table": ("bench.csv", lambda path: read_table(path, COLUMNS)),
    "a filtered table": ("bench.csv", lambda path: read_table(path, COLUMNS, where={"Test": "A"}, label="Way")),
    "a camera file": ("camera.yaml", read_camera),
    "a base file": ("base.yaml", lambda path: read_base(str(path))),
    "motion capture": ("take.c3d", lambda path: read_c3d(path, MARKERS)),
    "a mesh study": ("study/mesh-study.json", lambda path: MESH_STUDY.read(path.parent)),
    "a result": ("squares/result.json", lambda path: load_result(path.parent)),
    "a result's trials": ("squares/trials.csv", lambda path: load_result(path.parent)),
    "a result's response": ("squares/response-pull.csv", lambda path: load_result(path.parent)),
    "a store's record": ("squares/run.json", resumed("least-squares")),
    "a store's trials": ("squares/optuna.journal", resumed("least-squares")),
    "a store's trials of TPE": ("tpe/optuna.journal", resumed("tpe")),
    "a store's arrays": ("squares/arrays/2.npz", lambda path: resumed("least-squares")(path.parent)),
    "a run's trials": ("squares/optuna.journal", lambda path: stored_trials(path.parent)),
    "a run's record": ("run/run.json", lambda path: load_run(path.parent)),
}
# Those whose reader searches or loads a project are slower.
EXAMPLES = {kind: 25 if "store" in kind or "run's" in kind else 100 for kind in KINDS}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_changed_at_random_is_read_or_refused(
    kind: str, whole: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file, read = KINDS[kind]
    first = file.split("/")[0]
    raw = (whole / file).read_bytes()

    @settings(max_examples=EXAMPLES[kind], suppress_health_check=list(HealthCheck))
    @given(changes=mutations())
    def check(changes: list[Mutation]) -> None:
        folder = tmp_path_factory.mktemp("changed")
        source = whole / first
        (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / first)
        path = folder / file
        path.write_bytes(mutated(raw, changes))
        with limited(), contextlib.suppress(InputError):
            read(path)
        shutil.rmtree(folder)

    check()


# Texts of Python, NumPy and its codecs, which are no sentences for a user.
OF_PYTHON = re.compile(
    r"\w(Error|Exception|Iteration)\b|\b(literal|codec|NoneType|out of (range|bounds)|reshape|string to)\b"
)


def written_mesh(path: Path) -> bytes:
    """A box in the format of the path's suffix."""
    meshio, mesh = pytest.importorskip("meshio"), box_mesh((0.1, 0.2, 0.3), (1, 1, 1))
    if path.suffix in (".msh", ".vtu"):
        write_mesh(mesh, path)
    elif path.suffix == ".stl":
        meshio.Mesh(mesh.points, [("triangle", boundary_faces(mesh))]).write(path, binary=False)
    else:
        options = {"binary": False} if path.suffix == ".vtk" else {}
        meshio.Mesh(mesh.points, [("tetra", mesh.tets)], point_sets=mesh.node_sets).write(path, **options)
    return path.read_bytes()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", [".msh", ".vtu", ".vtk", ".inp", ".stl"])
def test_a_mesh_file_changed_at_random_is_read_or_refused_without_a_text_of_python(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"box{suffix}"
    raw, read = written_mesh(path), checked_stl if suffix == ".stl" else read_mesh
    refused: list[str] = []

    @settings(max_examples=60, suppress_health_check=list(HealthCheck))
    @given(changes=mutations())
    def check(changes: list[Mutation]) -> None:
        path.write_bytes(mutated(raw, changes))
        try:
            with limited():
                read(path)
        except InputError as error:
            refused.append(str(error))

    check()
    assert refused
    assert not [one for one in refused if OF_PYTHON.search(one) or "\n" in one]


WORKER = """
import json, resource, signal, sys
resource.setrlimit(resource.RLIMIT_DATA, (2 * 10**9, 2 * 10**9))
from softcal.cli import main
for line in sys.stdin:
    arguments = json.loads(line)
    signal.alarm({longest})
    try:
        main(arguments)
    except SystemExit as left:
        print(json.dumps(left.code or 0), flush=True)
    signal.alarm(0)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "file",
    [
        "run.json",
        "calibrations/pull/result.json",
        "calibrations/pull/run.json",
        "calibrations/pull/optuna.journal",
        *(
            pytest.param(one, marks=pytest.mark.long)
            for one in (
                "calibrations/pull/arrays/0.npz",
                "calibrations/pull/trials.csv",
                "calibrations/pull/response-pull.csv",
                "inputs/data/pull.csv",
            )
        ),
    ],
)
def test_commands_on_a_run_with_a_file_changed_at_random_end_with_0_or_2(
    file: str, whole: Path, tmp_path: Path
) -> None:
    """A process with a limit of 2 GB: a traceback, a minute without an end, or another exit code ends it."""
    raw = (whole / "run" / file).read_bytes()
    found: list[list[Mutation]] = []

    @settings(max_examples=15, database=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(changes=mutations())
    def collect(changes: list[Mutation]) -> None:
        found.append(changes)

    collect()
    project = str(whole / "project" / "project.yaml")
    commands: list[list[str]] = []
    for i, changes in enumerate(found):
        run = tmp_path / f"run{i}"
        shutil.copytree(whole / "run", run)
        (run / file).write_bytes(mutated(raw, changes))
        commands.append(["export", "sofa", str(run), "--out", str(tmp_path / f"scene{i}")])
        commands.append(["calibrate", project, "--out", str(run), "--resume", "--no-report"])
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", WORKER.format(longest=LONGEST)],
        input="".join(json.dumps(command) + "\n" for command in commands),
        capture_output=True,
        text=True,
        check=False,
    )
    codes = [json.loads(line) for line in done.stdout.splitlines() if line.isdecimal()]
    assert "Traceback" not in done.stderr, done.stderr[-3000:]
    assert done.returncode == 0, done.stderr[-3000:]
    assert len(codes) == len(commands)
    assert set(codes) == {0, 2}
