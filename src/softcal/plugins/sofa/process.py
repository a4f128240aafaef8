"""One simulation in a SOFA process: its job file, its answer, and its failures."""

from __future__ import annotations

import json
import signal
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softcal.plugins.sofa.install import Sofa
from softcal.plugins.sofa.robot import LinearRobot
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.settings import SofaSettings
from softcal.processes import exit_code
from softcal.twin.protocol import Protocol

JOB, ANSWER, LOG = "job.json", "answer.jsonl", "sofa.log"


@dataclass(frozen=True)
class ProcessOutcome:
    """Result of a SOFA process.

    Attributes
    ----------
    records
        A record of each state at rest, the slack one first.
    failure
        Why it ended before the last state, or "".
    steps
        Number of time steps, including repeated states.
    """

    records: tuple[Mapping[str, Any], ...]
    failure: str
    steps: int


def run_states(
    sofa: Sofa,
    linear: LinearRobot,
    protocol: Protocol,
    states: Sequence[Mapping[str, float]],
    settings: SofaSettings,
    *,
    shapes: bool = False,
) -> ProcessOutcome:
    """Run every state to rest in one process, limited to `timeout`."""
    job = {"states": [dict(state) for state in states], "rest": settings.rest, "shapes": shapes, "out": ANSWER}
    with tempfile.TemporaryDirectory(prefix="softcal-sofa-") as name:
        folder = Path(name)
        write_scene(linear, scene_parameters(linear, protocol, settings=settings), folder)
        (folder / JOB).write_text(json.dumps(job), encoding="utf-8")
        command = [sofa.python, "run.py", "--job", JOB]
        code = exit_code(command, folder, folder / LOG, timeout=settings.timeout, environment=sofa.environment())
        ended = f"ended with exit code {code}"
        if code is None:
            ended = f"was ended after {settings.timeout:g} s without an answer"
        elif code < 0:
            ended = f"crashed ({signal.Signals(-code).name})"
        lines = [] if not (folder / ANSWER).is_file() else (folder / ANSWER).read_text(encoding="utf-8").splitlines()
        said = (folder / LOG).read_text(encoding="utf-8", errors="replace").strip().splitlines()
    answers: list[dict[str, Any]] = []
    for line in lines:
        try:
            answer = json.loads(line, parse_constant=int)  # a ValueError for NaN
        except ValueError:  # the last one may be cut off
            break
        if not isinstance(answer, dict) or answer.get("state", len(answers)) != len(answers):
            break
        answers.append(answer)
    records = tuple(answer for answer in answers if "state" in answer)
    last = answers[-1] if answers else {}
    steps = int(last.get("steps", 0)) if "state" not in last else sum(int(record["steps"]) for record in records)
    if last.get("done") and len(records) > len(states):
        return ProcessOutcome(records, "", steps)
    where = f"State {len(records)} of {len(states)}: " if records else "The rest state with slack cables: "
    if "failed" in last:
        return ProcessOutcome(records, f"{where}{last['failed']}", steps)
    good = f"; the last good time is {float(records[-1]['time']):.6g} s" if records else ""
    error = _last_error(said)
    return ProcessOutcome(records, f"{where}SOFA {ended}{good}" + (f": {error}" if error else ""), steps)


def _last_error(lines: list[str]) -> str:
    """The last line that reports an error, or ""."""
    errors = [line for line in lines if "ERROR" in line or "Error" in line]
    return errors[-1].strip()[-300:] if errors else ""
