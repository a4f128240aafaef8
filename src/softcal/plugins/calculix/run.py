"""Running CalculiX on a deck in a separate process."""

from __future__ import annotations

import re
import shutil
import signal
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.plugins.calculix.deck import DECK, Deck
from softcal.plugins.calculix.format import MM
from softcal.processes import exit_code

TIMEOUT = 1800.0  # [s]
LOG = "ccx.log"
HOW_TO_GET = "there is no ccx on the PATH; Debian: apt-get install calculix-ccx"


def find_calculix() -> str | None:
    """The path of ccx, or None if it is not installed."""
    return shutil.which("ccx")


def run_calculix(deck: Deck, folder: Path, *, timeout: float = TIMEOUT) -> Floats:
    """Displacements of all nodes at every state of the deck (n_states, n, 3) [m].

    Parameters
    ----------
    deck
        What CalculiX is to solve.
    folder
        Where CalculiX's files are made, and stay.
    timeout
        Limit [s] of the process.

    Raises
    ------
    SimulationError
        If ccx is not installed, does not converge, crashes, or takes longer than `timeout` [s].
    """
    ccx = find_calculix()
    if ccx is None:
        raise SimulationError(f"CalculiX was not found: {HOW_TO_GET}.")
    (folder / DECK).write_text(deck.text, encoding="utf-8")
    stem = DECK.removesuffix(".inp")
    try:
        code = exit_code([ccx, "-i", stem], folder, folder / LOG, timeout=timeout)
    except OSError as error:
        raise SimulationError(f"CalculiX could not be started: {ccx}: {error.strerror}.") from error
    found = _displacements(folder / f"{stem}.dat", deck.n_nodes)
    reached = f"it reached {len(found)} of {deck.n_states} states"
    if code is None:
        raise SimulationError(f"CalculiX did not end within {timeout:g} s; {reached}.")
    if len(found) < deck.n_states:
        log = (folder / LOG).read_text(encoding="utf-8", errors="replace")
        lines = [" ".join(line.split()) for line in log.splitlines()]
        said = [line for line in lines if "*ERROR" in line] or [line for line in lines if "divergence" in line]
        last = said[-1].lstrip("*") if said else ""
        how = f" ({last})" if last else f" (exit code {code})"
        how = f" (it crashed: {signal.Signals(-code).name})" if code < 0 else how
        raise SimulationError(f"CalculiX did not reach the full load{how}; {reached}. Try a smaller pull.")
    return np.array(found)


def _displacements(path: Path, n_nodes: int) -> list[Floats]:
    """Displacements of the reached states in order, up to a table that is not whole; they end at the times 1, 2, …"""
    if not path.is_file():
        return []
    _, *tables = re.split(r"displacements .* for set ALL and time\s+", path.read_text("ascii", "replace"))
    states: list[Floats] = []
    for table in tables:
        time, *lines = table.splitlines()
        try:
            if float(time) != len(states) + 1:
                continue
            # Fortran leaves the E of an exponent of three digits out: 1.56-106.
            rows = np.array(
                [re.sub(r"(\d)([-+]\d{3})\b", r"\1E\2", line).split() for line in lines if line.strip()], float
            )
        except ValueError:
            break
        n = len(states[0]) if states else max(len(rows), n_nodes)
        if rows.shape != (n, 4) or not np.isfinite(rows).all():
            break
        if (rows[:, 0] != np.arange(1, len(rows) + 1)).any():
            break
        states.append(MM * rows[:, 1:])
    return states
