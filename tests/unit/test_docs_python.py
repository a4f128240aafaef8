"""The Python of the documents runs as it stands; docs/python.md lists the public names with the first sentence of each
docstring.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
import sys
import textwrap
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mechanics_cases import blown_box
from project_case import write_project
from sweep_case import write_sweep

import softcal
from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.experiments.step import STEPS
from softcal.export.reduced import evaluator_of
from softcal.geometry.centreline import straight
from softcal.geometry.section import RoundBar
from softcal.materials.catalogue import LAWS
from softcal.plugins.bench.case import CASES
from softcal.report.figure import FIGURES
from softcal.sensing.sensor import SENSORS
from softcal.workflows.export import EXPORTS


@pytest.mark.slow
def test_the_blocks_run_in_their_order(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    page = (repository / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) > 6
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    families = (EXPORTS, FIGURES, LAWS, LOSSES, OPTIMISERS, SENSORS, STEPS)
    before = [set(family) for family in families]
    try:
        for block in blocks:
            exec(compile(block, "docs/python.md", "exec"), names)
    finally:  # other tests of this process register their own
        for family, known in zip(families, before, strict=True):
            for name in set(family) - known:
                family.remove(name)
    assert abs(names["miss"]) < 1e-9
    assert names["jacobian"].shape == (3, 2)
    low, high = names["estimate"].interval
    assert low < 0.9e6 < high
    assert "the robot has no such cable  'middle' left, right" in capsys.readouterr().out
    assert names["motion"].succeeded


def first_sentence(name: str) -> str:
    text = " ".join((inspect.getdoc(getattr(softcal, name)) or "").split("\n\n")[0].split())
    return re.split(r"(?<=\.)\s", text)[0].removesuffix(".").replace("|", r"\|")


def test_the_names_are_listed_with_what_they_are(repository: Path) -> None:
    page = (repository / "docs" / "python.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \| (.*) \|$", page, re.MULTILINE)
    assert listed == [(name, first_sentence(name)) for name in dir(softcal)]
    assert all(told for _, told in listed)


# Documents with Python -> what each block of theirs finds: files in its folder, and names beside softcal.
FINDS: dict[str, Callable[[Path, pytest.MonkeyPatch], dict[str, Any]]] = {}
NOT_HERE = {
    "docs/python.md": "above",
    "docs/sofa.md": "runs in SOFA; tests/verification/test_sofa.py",
    "README.md": "minutes; below",
}


def finds(document: str) -> Callable[[Any], Any]:
    return lambda function: FINDS.setdefault(document, function)


@finds("docs/cluster.md")
def _a_cluster(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A project, and in the place of both clusters this process."""
    on = softcal.executor_on

    @contextmanager
    def here(name: str):
        assert name in ("dask:tcp://10.0.0.5:8786", "dask:tcp://scheduler:8786")
        with on("local", 1) as executor:
            yield executor

    @contextmanager
    def kubernetes(*, name: str, image: str, n_workers: int, worker_command: str):
        assert "--nthreads 1" in worker_command
        yield SimpleNamespace(scheduler_address="tcp://scheduler:8786")

    operator = ModuleType("dask_kubernetes.operator")
    operator.KubeCluster = kubernetes  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "dask_kubernetes", ModuleType("dask_kubernetes"))
    monkeypatch.setitem(sys.modules, "dask_kubernetes.operator", operator)
    monkeypatch.setattr(softcal, "executor_on", here, raising=False)
    return {"project": softcal.load(write_project(folder))}


@finds("docs/sweep.md")
def _a_manipulator(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    write_sweep(folder)
    return {}


@finds("docs/mesh-study.md")
def _a_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    softcal.calibrate(write_project(folder), out=folder / "run")
    return {}


@finds("docs/exports.md")
def _a_reduced_model(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    weight = "robot:\n", "robot:\n  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]\n"
    request = softcal.ExportRequest(softcal.load(write_project(folder / "project", weight)))
    reach = "front=4N,plate.mass=0g..200g"
    for file in softcal.write_export("reduced", request, folder / "reduced", reach=reach, samples=20):
        shutil.copy(file, folder)
    monkeypatch.syspath_prepend(folder)
    return {"model": evaluator_of(json.loads((folder / "model.json").read_text()))}


@finds("docs/control.md")
def _a_reduced_model_in_a_loop(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The model, and in the place of ROS 2 and MuJoCo what the blocks call of them."""
    _a_reduced_model(folder, monkeypatch)
    published: list[list[float]] = []

    def spin(node: Any) -> None:
        node.step()
        assert published == []
        for place in ((0.004, 0.0985), (0.006, 0.098)):
            at = SimpleNamespace(point=SimpleNamespace(x=place[0], y=0.0, z=place[1]))
            node.take_goal(at)
            node.step()
            node.take_measured(at)
        assert [len(one) for one in published] == [1, 1]
        assert 0.0 < published[0][0] < published[1][0] <= 4.0
        assert node.payload.covariance[0, 0] < 0.05**2

    class Node:
        def __init__(self, name: str) -> None:
            assert name == "tip"

        def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
            return SimpleNamespace(publish=lambda message: published.append(message.data))

        def create_subscription(self, kind: Any, topic: str, callback: Callable[..., None], depth: int) -> None:
            assert topic in ("goal", "measured")

        def create_timer(self, period: float, callback: Callable[[], None]) -> None:
            assert period > 0.0

    class MjData:
        def __init__(self, scene: Any) -> None:
            self.time, self.mocap_pos, self.mocap_quat = 0.0, np.zeros((1, 3)), np.zeros((1, 4))

    def step(scene: Any, data: Any) -> None:
        assert np.linalg.norm(data.mocap_quat[0]) == pytest.approx(1.0)
        data.time += 0.1

    scene = SimpleNamespace(body=lambda name: SimpleNamespace(mocapid=[0]))
    stand_ins: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda: None, "spin": spin},
        "rclpy.node": {"Node": Node},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"PointStamped": object},
        "std_msgs": {},
        "std_msgs.msg": {"Float64MultiArray": SimpleNamespace},
        "mujoco": {
            "MjModel": SimpleNamespace(from_xml_path=lambda path: scene),
            "MjData": MjData,
            "mj_step": step,
        },
    }
    for name, parts in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(parts)
        monkeypatch.setitem(sys.modules, name, module)
    return {}


@finds("docs/chambers.md")
def _a_box_with_a_cavity(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    robot = blown_box("P1", is_open=True, medium="gas")
    (body,), (part,) = robot.bodies, robot.actuators
    return {"mesh": body.mesh, "fixed": body.fixed, "faces": part.actuator.surfaces["box"]}


@finds("docs/drives.md")
def _a_rod_between_cables(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    height = 0.1
    own = {"youngs_modulus": 1e9, "poissons_ratio": 0.35}
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, height), 6)
    spine = softcal.Rod("spine", line, RoundBar(0.003), own, clamped={"tip": [6]}, fixed=[0])
    sides = {"left": 0.01, "right": -0.01}
    via = {n: (softcal.ViaPoint([x, 0.0, 0.0]), softcal.ViaPoint([x, 0.0, height], "tip")) for n, x in sides.items()}
    left, right = (softcal.Cable(name, points, pulled_end="first") for name, points in via.items())
    return {"spine": spine, "tip": softcal.Plate("tip", {}, [0.0, 0.0, height]), "left": left, "right": right}


@finds("docs/bench-cases.md")
def _nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    return {}


def python_of(document: str) -> list[str]:
    """The blocks of Python of a document: in fences, or indented lines that are Python and no command."""
    text = (ROOT / document).read_text(encoding="utf-8")
    fenced = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    rest = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    indented = [textwrap.dedent(one) for one in re.findall(r"(?<=\n\n)((?:(?: {4}.*)?\n)+)", rest)]
    return [*fenced, *filter(_is_python, indented)]


def _is_python(block: str) -> bool:
    try:
        tree = ast.parse(block)
    except SyntaxError:
        return False
    kinds = (ast.Import, ast.ImportFrom, ast.Call, ast.FunctionDef)
    return any(isinstance(node, kinds) for node in ast.walk(tree))


ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [path for place in (".", "docs", "examples/*") for path in sorted(ROOT.glob(f"{place}/*.md"))]


@finds("docs/linearise.md")
def _a_heavy_bar(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    write_project(folder, ("      fixed: foot\n", "      fixed: foot\n      density: 1100 kg/m^3\n"))
    return {}


@finds("docs/reach.md")
@finds("docs/touching.md")
@finds("docs/workspace.md")
def _a_bar(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    write_project(folder)
    return {}


BLOCKS = [(document, k) for document in FINDS for k in range(len(python_of(document)))]


def test_no_python_of_the_documents_is_left_out() -> None:
    documents = [path.relative_to(ROOT).as_posix() for path in DOCUMENTS]
    assert {document for document in documents if python_of(document)} == {*FINDS, *NOT_HERE}


@pytest.mark.parametrize(("document", "k"), BLOCKS)
def test_a_block_runs(document: str, k: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        names = {"softcal": softcal, **FINDS[document](tmp_path, monkeypatch)}
        monkeypatch.chdir(tmp_path)
        exec(compile(python_of(document)[k], document, "exec"), names)
    finally:
        if "our-tentacle" in CASES:
            CASES.remove("our-tentacle")


@pytest.mark.slow  # two minutes
def test_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(ROOT / "examples" / "neck", tmp_path / "examples" / "neck", ignore=shutil.ignore_patterns("runs"))
    monkeypatch.chdir(tmp_path)
    (block,) = python_of("README.md")
    exec(compile(block, "README.md", "exec"), {})
    assert "neck.youngs_modulus" in capsys.readouterr().out
    assert (tmp_path / "runs" / "neck" / "report.html").is_file()
