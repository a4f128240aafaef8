"""Cross-check of a project: selected engines, the final state of each experiment or pull, and the result files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from softcal.calibration.problem.problem import SOFTCAL
from softcal.calibration.search.outcome import installed_versions
from softcal.csv_text import csv_text
from softcal.declare import Declared
from softcal.errors import Fault, InputError
from softcal.executors.each import Workers, executor_of, results
from softcal.export.engine import ENGINES
from softcal.plugins.calculix.crosscheck import AGREES, Crosscheck, crosscheck
from softcal.project.project import Project
from softcal.workflows.cases import Case
from softcal.workflows.output import new_folder

TABLE, RECORD = "differences.csv", "crosscheck.json"
NOTHING_MOVES = "nothing moves the robot, so there is nothing to compare"


def crosscheck_project(
    project: Project,
    cases: Mapping[str, Case],
    engines: Sequence[str] = (),
    *,
    timeout: float | None = None,
    workers: Workers = 1,
    progress: Callable[[str, str], None] = lambda state, engine: None,
) -> dict[str, Crosscheck]:
    """Case name -> cross-check of its furthest state in the engines; see `crosscheck`.

    Parameters
    ----------
    project
        The project, for the settings of its engines.
    cases
        Robots with their protocols.
    engines
        Names in `ENGINES`; all by default.
    timeout
        Limit [s] of each engine's process; None for the engine's own.
    workers
        An executor, or a number of processes: a state for each.
    progress
        Called with state and engine, or with each state as it is done by others.

    Raises
    ------
    InputError
        For an unknown engine, no engine besides softcal, or a timeout that is not positive; if nothing moves the robot
        in any state that an engine can solve.
    """
    known = [SOFTCAL, *ENGINES]
    chosen = list(dict.fromkeys(engines)) or known
    faults = [ENGINES.unknown(name, "--engines", known) for name in chosen if name not in known]
    if not faults and chosen == [SOFTCAL]:
        faults.append(Fault("there is nothing to compare softcal with", "--engines", SOFTCAL, ", ".join(known)))
    if timeout is not None and not timeout > 0.0:
        faults.append(Fault("the timeout must be positive", "--timeout", f"{timeout:g} s", "> 0 s, such as 10min"))
    if faults:
        raise InputError(faults)

    def one(name: str, case: Case) -> Crosscheck:
        return crosscheck(
            case.robot,
            case.protocol,
            chosen,
            timeout=timeout,
            stated=project.engines,
            progress=lambda engine: progress(name, engine),
        )

    with executor_of(workers) as executor:
        if executor.alone:
            found = {name: one(name, case) for name, case in cases.items()}
        else:
            asked_of = _CrosscheckCall(list(cases.values()), tuple(chosen), timeout, project.engines)
            found = {}
            for name, result in zip(
                cases, results(executor, _crosschecked, asked_of, [(k,) for k in range(len(cases))]), strict=True
            ):
                found[name] = result
                progress(name, "each engine")
    asked = [result for result in found.values() if result.comparisons or result.failed or result.still]
    if asked and all(result.still and not result.failed for result in asked):
        raise InputError(Fault(NOTHING_MOVES, attempt="--pull ACTUATOR=VALUE"))
    return found


@dataclass(frozen=True)
class _CrosscheckCall:
    cases: Sequence[Case]
    engines: Sequence[str]
    timeout: float | None
    stated: Mapping[str, Declared]


def _crosschecked(asked: _CrosscheckCall, k: int) -> Crosscheck:
    case = asked.cases[k]
    return crosscheck(case.robot, case.protocol, asked.engines, timeout=asked.timeout, stated=asked.stated)


def write_crosscheck(project: Project, found: Mapping[str, Crosscheck], folder: Path) -> None:
    """Write all differences (`differences.csv`), and the verdicts with their settings (`crosscheck.json`), completely
    or not at all.

    Parameters
    ----------
    project
        The project that was compared.
    found
        Case name -> cross-check.
    folder
        The folder, new or empty.

    Raises
    ------
    StorageError
        Where the folder holds files, or cannot be written.
    """
    record = {
        "project": project.name,
        "agreement": AGREES,
        "parameters": {name: {"value": info.value, "unit": info.unit} for name, info in project.parameters.items()},
        "states": {state or "at rest": _as_json(result) for state, result in found.items()},
        "hashes": dict(project.hashes),
        "versions": installed_versions(),
    }
    with new_folder(folder) as part:
        header = ["state", "engine", "quantity", "unit", "in_softcal", "in_engine", "difference", "relative"]
        rows = [
            [
                state or "at rest",
                comparison.engine,
                one.quantity,
                one.unit,
                *(f"{number:.9g}" for number in (one.softcal, one.engine, one.absolute, one.relative)),
            ]
            for state, result in found.items()
            for comparison in result.comparisons
            for one in comparison.differences
        ]
        (part / TABLE).write_text(csv_text(header, rows), encoding="utf-8", newline="")
        (part / RECORD).write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def _as_json(result: Crosscheck) -> dict[str, object]:
    """Engine -> agreement and verdict, or why there is none."""
    compared = {
        one.engine: {"agrees": one.agrees, "verdict": one.verdict, "limit": one.limit, "changed": list(one.changed)}
        for one in result.comparisons
    }
    failed = {engine: {"failed": why} for engine, why in result.failed.items()}
    refused = {engine: {"refused": why} for engine, why in result.refused.items()}
    absent = {engine: {"absent": why} for engine, why in result.absent.items()}
    still = {engine: {"still": NOTHING_MOVES} for engine in result.still}
    return {**compared, **failed, **refused, **absent, **still}
