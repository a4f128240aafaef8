"""From a project's `rods` to Rods: centrelines with nodes at every station, sections, supports."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from softcal.checks import Ints
from softcal.geometry.centreline import Centreline
from softcal.geometry.placement import placed_centreline
from softcal.limits import LIMITS
from softcal.project.document import Findings, KeyPath
from softcal.project.rod_schema import RodSection
from softcal.twin.robot import Rod


def build_rod(name: str, rod: RodSection, plates: Iterable[str], findings: Findings) -> Rod | None:
    """One rod, or None where it has a fault; every fault goes to `findings`."""
    path: KeyPath = ("robot", "rods", name)
    n_faults = len(findings.faults)
    plates = list(plates)
    for plate in rod.clamped:
        if plate not in plates:
            findings.unknown((*path, "clamped", plate), "plate", plate, plates)
    if not rod.fixed and not any(rod.clamped.values()):
        findings.add(
            path,
            "the rod is not attached",
            got="neither clamped nor fixed",
            allowed="clamped: {PLATE: station}, or fixed: station",
            attempt="fixed: start",
        )
    key, shape = rod.shape
    with findings.at((*path, key)):
        shape.require_fitting(rod.section.constants.outer_diameter)
        clamped = {
            plate: _arcs(where, shape.length, (*path, "clamped", plate), findings)
            for plate, where in rod.clamped.items()
        }
        fixed = _arcs(rod.fixed, shape.length, (*path, "fixed"), findings)
        elements = rod.elements or shape.elements
        LIMITS["elements of a rod"].check(elements)
        line = shape.centreline(sorted({*fixed, *(s for arcs in clamped.values() for s in arcs)}), elements)
        if rod.placement is not None:
            with findings.at((*path, "placement")):
                line = placed_centreline(line, rod.placement.pose)
        if len(findings.faults) > n_faults:
            return None
        with findings.at(path):
            parameters = {"youngs_modulus": rod.youngs_modulus, "poissons_ratio": rod.poissons_ratio}
            held = {plate: _nodes(line, shape.length, arcs) for plate, arcs in clamped.items()}
            return Rod(name, line, rod.section, parameters, held, _nodes(line, shape.length, fixed), rod.density)
    return None


def _arcs(stations: Iterable[float | str], length: float, path: KeyPath, findings: Findings) -> list[float]:
    """Stations as arc lengths [m]; those off the rod are faults."""
    arcs: list[float] = []
    for station in stations:
        if isinstance(station, str):
            arcs.append(0.0 if station == "start" else length)
        elif station > length * (1.0 + 1e-9):
            findings.add(
                path,
                "the station is not on the rod",
                got=f"{1e3 * station:.6g} mm",
                allowed=f"0 to {1e3 * length:.6g} mm",
            )
        else:
            arcs.append(min(station, length))
    return arcs


def _nodes(line: Centreline, length: float, arcs: list[float]) -> Ints:
    """The nodes at arc lengths; the curve through refined points may differ in length by rounding."""
    stations = line.stations * (length / line.stations[-1])
    return np.unique([int(np.argmin(np.abs(stations - arc))) for arc in arcs]).astype(np.int64)
