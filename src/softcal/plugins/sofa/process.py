"""One simulation in a SOFA process: its job file, its answer, and its failures."""

from __future__ import annotations

import json
import signal
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softcal.plugins.sofa.install import Sofa
from softcal.plugins.sofa.robot import LinearRobot
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.settings import SofaSettings
from softcal.processes import exit_code
from softcal.twin.protocol import Protocol

POSE = (7,)  # position and unit quaternion
LARGEST, TURNED = 1e9, 1e-3  # numbers of a state [SI]; difference of a quaternion's length from one
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
    """Run every state to rest in one process.

    Parameters
    ----------
    sofa
        The installed program.
    linear
        The robot with laws that SOFA has.
    protocol
        Its commands, for the controls of the actuators.
    states
        Cable or chamber -> shortening [m], tension [N] or pressure [Pa], of each state.
    settings
        The limits of the run, and when the robot is at rest.
    shapes
        The points of bodies and rods are recorded too.
    """
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
        raw = (folder / ANSWER).read_bytes() if (folder / ANSWER).is_file() else b""
        said = (folder / LOG).read_text(encoding="utf-8", errors="replace").strip().splitlines()
    answers: list[dict[str, Any]] = []
    # Of each number in the record of a state its shape.
    state: dict[str, Any] = {
        **dict.fromkeys(("time", "dt", "steps"), ()),
        "cables": {cable.name: {"tension": (), "shortening": (), "points": (None, 3)} for cable in linear.robot.cables},
        "chambers": {part.name: {"pressure": (), "volume": ()} for part in linear.chambers},
        "plates": {plate.name: POSE for plate in linear.robot.plates},
        "markers": {marker.name: (3,) for marker in linear.robot.markers},
    }
    if shapes:
        state["points"] = {body.name: (body.mesh.n_points, 3) for body in linear.robot.bodies}
        state["rods"] = {rod.name: (len(rod.centreline.nodes), 3) for rod in linear.robot.rods}
    for number, line in enumerate(raw.decode(errors="replace").splitlines(), start=1):
        answer: dict[str, Any] = {}
        try:
            answer = json.loads(line)
            is_whole = _holds(answer, state if "state" in answer else {"steps": ()}) and answer["steps"] >= 0
            if "state" in answer:
                begun = answers[-1]["time"] if answers else 0.0
                is_next = answer["state"] == len(answers) <= len(states)
                is_whole = is_whole and is_next and answer["time"] >= begun and answer["dt"] > 0.0
        except (ValueError, TypeError, RecursionError):  # the last one may be cut off
            is_whole = False
        if not is_whole:
            ended += f"; line {number} of its answer is not whole"
            break
        answers.append(answer)
        if "state" not in answer:
            break
    records = tuple(answer for answer in answers if "state" in answer)
    last = answers[-1] if answers else {}
    steps = int(last.get("steps", 0)) if "state" not in last else sum(int(record["steps"]) for record in records)
    if last.get("done") is True and len(records) == len(states) + 1:
        return ProcessOutcome(records, "", steps)
    where = f"State {len(records)} of {len(states)}: " if records else "The rest state with slack cables: "
    if "failed" in last:
        return ProcessOutcome(records, where + str(last["failed"]).encode(errors="replace").decode(), steps)
    good = f"; the last good time is {float(records[-1]['time']):.6g} s" if records else ""
    error = _last_error(said)
    return ProcessOutcome(records, f"{where}SOFA {ended}{good}" + (f": {error}" if error else ""), steps)


def _holds(answer: Any, wanted: Any) -> bool:
    """Whether numbers have these shapes, None for any, and are as large as those of a robot; poses are turned ones."""
    if isinstance(wanted, dict):
        return isinstance(answer, dict) and all(
            name in answer and _holds(answer[name], wanted[name]) for name in wanted
        )
    numbers = np.array(answer)
    if numbers.dtype.kind not in "iuf" or not (np.abs(numbers) < LARGEST).all():
        return False
    fits = numbers.ndim == len(wanted) and all(n in (None, m) for n, m in zip(wanted, numbers.shape, strict=True))
    return fits and (wanted != POSE or abs(float(np.linalg.norm(numbers[3:])) - 1.0) < TURNED)


def _last_error(lines: list[str]) -> str:
    """The last line that reports an error, or ""."""
    errors = [line for line in lines if "ERROR" in line or "Error" in line]
    return errors[-1].strip()[-300:] if errors else ""
