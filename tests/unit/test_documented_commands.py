"""Every command in the documents is one that softcal takes, and those of the examples run as they are written there."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import page_projects
import pytest
import typer
import yaml
from command_line import run

from scripts.reference import FILE, entries
from softcal.cli import app

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("examples/*/README.md"))
)
# Of the examples' commands: those that take longer than a test may, and where what they do is tested.
TOO_LONG = {
    "softcal calibrate project.yaml --out runs/fit": "a minute; tests/recovery/test_finger.py",
    "python generate.py --out runs/bench": "four minutes",
    "python generate.py --out runs/again --twin": "Gmsh and a minute",
    "softcal camera runs/bench/board --out runs/camera.yaml": "needs the images of the line before it",
    "softcal markers runs/bench/images": "needs those images; the command on the images here runs",
    "softcal sweep project.yaml": "half a minute; tests/unit/test_sweep.py",
    "softcal calibrate project.yaml --out runs/one": "a minute; tests/recovery/test_manipulator_bench.py",
    "softcal calibrate project.yaml --split": "a minute; tests/recovery/test_manipulator_bench.py",
    "softcal validate project.yaml": "minutes; tests/unit/test_cli.py",
    "softcal calibrate project.yaml --out runs/least-squares": "a minute; tests/recovery/test_neck_bench.py",
    "softcal calibrate project.yaml --out runs/tpe": "4000 trials",
    "softcal calibrate cycles.yaml --out runs/cycles": "two minutes; tests/recovery/test_neck_cycles.py",
    "softcal calibrate project.yaml --out runs/free": "two minutes; tests/validation/test_every_printed_sentence.py",
    "softcal calibrate project.yaml --set neck.poissons_ratio=0.45": "two minutes; the same",
    "softcal calibrate project.yaml --out runs/beam": "seconds; tests/validation/test_real_beam.py",
    "python vary.py": "a minute; tests/validation/test_real_beam.py",
}


def commands(document: str) -> list[str]:
    """The indented lines of a document that begin with a program, without the remark behind two spaces or `#`."""
    text = (ROOT / document).read_text(encoding="utf-8").replace("\\\n", "")
    found = re.findall(r"^    ((?:softcal|python) .*)$", text, re.MULTILINE)
    spoken = [re.split(r"\s{2,}(?=[^-\s])|\s+#", line)[0].strip() for line in found]
    return [re.sub(r"\[(--[^]]*)\]", r"\1", line) for line in spoken]


@pytest.mark.parametrize("document", DOCUMENTS)
def test_softcal_takes_every_command(document: str):
    """Options and arguments are read as on the command line; nothing is run."""
    for line in commands(document):
        program, *words = shlex.split(line)
        if program == "softcal":
            words = ["vtk" if word == "KIND" else word for word in words]
            command: Any = typer.main.get_command(app)
            while hasattr(command, "commands"):
                command = command.get_command(None, words.pop(0))
            command.make_context(line, words)


def test_python_m_softcal_is_softcal():
    done = subprocess.run([sys.executable, "-m", "softcal", "--version"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("softcal ")


OF_EXAMPLES = [document for document in DOCUMENTS if document.startswith("examples/")]
EXAMPLES = [(document, line) for document in OF_EXAMPLES for line in commands(document)]
LONG = [  # a quarter of a minute and more, each by its example; the check of the neck stands for those of the others
    ("bellows", "python generate.py --out runs/again"),
    ("bellows", "softcal check project.yaml --out runs/check"),
    ("finger", "python generate.py --out runs/again"),
    ("finger", "softcal check project.yaml --out runs/check"),
    ("fleet", "softcal fleet . --out runs/fleet --workers 2"),
    ("manipulator", "softcal check project.yaml --out runs/check"),
    ("neck-bench", "python generate_cycles.py --out runs/again"),
    ("neck-bench", "softcal check project.yaml --out runs/check"),
    ("pneumatic-arm", "softcal bench run pneumatic-arm --out runs/bench-arm"),
    ("pneumatic-arm", "softcal calibrate project.yaml --out runs/arm"),
    ("pneunet", "python generate.py --out runs/again"),
    ("pneunet", "softcal check project.yaml --out runs/check"),
]
RUN = [
    pytest.param(document, line, marks=pytest.mark.long if (document.split("/")[1], line) in LONG else ())
    for document, line in EXAMPLES
    if not any(line.startswith(known) for known in TOO_LONG)
]


def test_what_is_too_long_is_still_documented():
    assert [known for known in TOO_LONG if not any(line.startswith(known) for _, line in EXAMPLES)] == []
    assert {*LONG} <= {(document.split("/")[1], line) for document, line in EXAMPLES}


@pytest.mark.slow
@pytest.mark.parametrize(("document", "line"), RUN)
def test_the_command_runs(document: str, line: str, tmp_path: Path):
    folder = tmp_path / "example"
    shutil.copytree((ROOT / document).parent, folder, ignore=shutil.ignore_patterns("runs"))
    program, *words = shlex.split(line)
    command = [sys.executable, "-m", "softcal", *words] if program == "softcal" else [sys.executable, *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    if line.startswith("softcal check"):
        assert "The project is in order." in done.stdout
        assert "intersects itself" not in done.stdout


def in_prose(document: str) -> list[str]:
    """The commands between backticks, with what they may have behind them left out."""
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(r"`softcal ([a-z][^`\n]*)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


@pytest.mark.parametrize("document", DOCUMENTS)
def test_commands_in_prose_have_names_and_options_that_there_are(document: str):
    """They may leave out arguments, which the sentence is not about."""
    for line in in_prose(document):
        command: Any = typer.main.get_command(app)
        words = line.split()
        while hasattr(command, "commands"):
            if not words or words[0] == "…":
                break
            assert words[0] in command.list_commands(None), line
            command = command.get_command(None, words.pop(0))
        known = {name for one in command.params for name in (*one.opts, *one.secondary_opts)} | {"--help"}
        assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known, line


def yaml_blocks(document: str) -> list[str]:
    """Indented or fenced blocks that begin with a section of a project file."""
    text = (ROOT / document).read_text(encoding="utf-8")
    fenced = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    indented = re.findall(r"(?<=\n\n)((?:(?: {4}.*)?\n)+)", text)
    begins = tuple(f"{key}:" for key in sections())
    return [*fenced, *(block for one in indented if (block := textwrap.dedent(one)).lstrip().startswith(begins))]


def sections() -> set[str]:
    return {*(place.partition(".")[0] for place in FILE), "softcal", "name"}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_blocks_of_a_project_file_are_yaml_with_keys_that_there_are(document: str):
    for block in yaml_blocks(document):
        read = yaml.safe_load(block)
        assert isinstance(read, dict), block
        if set(read) & sections():
            assert set(read) <= sections(), block
        for place, kind in FILE.items():
            section = place.removesuffix(".NAME")
            own = read.get(section)
            named = list(own.values()) if own and place.endswith(".NAME") else [own]
            known = {name for name, _, _ in entries(kind)}
            for one in named:
                assert not isinstance(one, dict) or set(one) - {"<<"} <= known, (place, block)


PAGES = [document for document in DOCUMENTS if document not in OF_EXAMPLES and commands(document)]
# Of the pages' commands: those that cannot run here, why, and where what they do is tested.
NOT_HERE = {
    "softcal new my-robot": "serves a page until it is closed; tests/browser/test_new_page.py",
    "softcal watch runs/neck": "serves a page until it is closed; tests/unit/test_watch_command.py",
    "softcal bench list": "reads the data of every case; tests/contracts/test_bench_contract.py",
    "softcal bench run tentacle": "a case as it is; tests/validation/test_every_printed_sentence.py",
    "softcal bench run pneumatic-arm": "a case as it is; tests/validation/test_real_arm.py",
    "softcal bench score tentacle mine.csv": "another program's predictions; tests/contracts/test_bench_contract.py",
    "softcal bench page runs": "runs of cases; tests/contracts/test_bench_page.py",
    "softcal coupon uniaxial.csv --test uniaxial": "fits all laws; tests/unit/test_coupon_command.py",
    "softcal coupon slow.csv fast.csv": "half a minute; tests/unit/test_coupon_history.py",
    "softcal coupon --from runs/tpu": "needs the fit of the line before it; tests/unit/test_coupon_prediction.py",
    "softcal calibrate my-finger/project.yaml": "as on docs/start.md; tests/unit/test_cli.py",
    "softcal calibrate finger/project.yaml": "as on docs/start.md; tests/unit/test_chambers.py",
    "softcal calibrate project.yaml --out run": "as on docs/start.md; tests/unit/test_cli.py",
    "softcal export web runs/arm": "ten seconds; tests/unit/test_export_reduced.py",
    "softcal export reduced project.yaml --out controller --reach front": "long; tests/unit/test_export_reduced.py",
    "softcal importance": "ten seconds; tests/unit/test_importance_command.py",
    "softcal intervals RUN --by posterior": "minutes; tests/unit/test_calibration_posterior.py",
    "softcal intervals RUN --by jackknife --over markers": "a dozen fits; tests/unit/test_intervals_command.py",
    "softcal intervals RUN --by bootstrap --over experiments": "a hundred fits; tests/unit/test_intervals_command.py",
    "softcal simulate finger/project.yaml --pull tendon=20mm": "the finger; tests/unit/test_crossings.py",
    "softcal sweep project.yaml --over": "a hundred cells; tests/unit/test_sweep.py",
    "softcal reach run --to tip.x=20mm,tip.x_stiffness=300N/m": "minutes; tests/verification/test_reach.py",
    "softcal workspace run --of tip.x,tip.z": "half a minute; tests/verification/test_workspace.py",
    "softcal workspace run --of tip.x,tip.y,tip.z": "minutes; tests/verification/test_workspace.py",
    "softcal workspace project.yaml --of plate.pitch": "ten seconds; tests/unit/test_workspace.py",
    "softcal workspace project.yaml --of tip.x,tip.y": "half a minute; tests/verification/test_workspace.py",
    "softcal calibrate project.yaml --on dask:tcp://10.0.0.5:8786": "a cluster; tests/unit/test_cluster.py",
    "softcal calibrate project.yaml --on dask:tcp://localhost:8786": "a cluster; tests/unit/test_cluster.py",
    "softcal fleet . --on dask:tcp://bench1:8786": "a cluster; tests/unit/test_cluster_commands.py",
    "softcal sweep project.yaml --on slurm:long": "a cluster; tests/unit/test_cluster_commands.py",
    "softcal crosscheck project.yaml --engines softcal,calculix,sofa": "SOFA; tests/verification/test_crosscheck.py",
    "softcal simulate PROJECT --pull front=40mm --engine sofa": "SOFA; tests/unit/test_sofa_engine.py",
    "softcal calibrate PROJECT --engine sofa": "SOFA; tests/unit/test_sofa_engine.py",
    "softcal camera board-images/": "photographs; tests/unit/test_camera.py",
    "softcal markers images/": "photographs; tests/unit/test_markers.py",
    "softcal calibrate examples/neck/project.yaml --method tpe": "at /shared; tests/unit/test_shared_study.py",
}
# What a command says -> the kind of the project behind its names; the first that is there, or else a neck.
KIND_BY = {
    "main=": "finger", "finger/project.yaml": "finger", "grip=": "grip", "servo=": "servo", "tip.x=5mm": "servo",
    "intervals": "servo", "cable1": "arm", "export calculix": "bar", "fleet": "fleet", "coupon": "coupons",
}  # fmt: skip
BESIDE = {
    "circle.csv": "time [s],tip.x [mm],tip.y [mm]\n1,2,0\n2,0,2\n3,-2,0\n",
    "around.yaml": "obstacles:\n  table: {half_space: {point: [0 mm, 0 mm, -10 mm], normal: [0, 0, 1]}}\n",
}


@pytest.mark.parametrize("entry", NOT_HERE)
def test_what_cannot_run_here_is_on_a_page_and_tested_elsewhere(entry: str):
    assert any(line.startswith(entry) for page in PAGES for line in commands(page))
    assert (ROOT / NOT_HERE[entry].rpartition("; ")[2]).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run_in_their_order(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """On small projects behind the names that the page has; what `init` writes is tested with the examples."""
    monkeypatch.chdir(tmp_path)
    for name, text in BESIDE.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    made: dict[Path, str] = {}  # the kinds of the runs that are here
    for line in commands(page):
        if any(line.startswith(entry) for entry in NOT_HERE):
            continue
        _, *words = (word.replace("RUN_OR_", "").replace("PROJECT", "project.yaml") for word in shlex.split(line))
        kind = next((kind for said, kind in KIND_BY.items() if said in line), "neck")
        for word in words[1:] if words[0] != "init" else ():
            path = Path(word)
            if word == "." or path.name == "project.yaml" or path.suffix == ".csv":
                page_projects.put(kind, path if word == "." else path.parent)
            elif path.name in ("run", "RUN") or path.parent.name == "runs":
                if words[words.index(word) - 1] != "--out":
                    if made.setdefault(path, kind) != kind:
                        shutil.rmtree(path)
                    page_projects.put(kind, path.parent, run=path)
        if "--out" in words and made:  # of several commands for one name a reader takes one
            shutil.rmtree(words[words.index("--out") + 1], ignore_errors=True)
        code, told, wrong = run(capsys, *words)
        assert code == 0, f"{line}\n{told}\n{wrong}"
