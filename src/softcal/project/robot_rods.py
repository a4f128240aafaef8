"""From a project's `rods` to Rods: centrelines with nodes at every station, sections, supports."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from softcal.checks import Ints
from softcal.errors import Fault, MeshError
from softcal.geometry import section as sections
from softcal.geometry.centreline import Centreline, curve_through, helix, polyline, spaced, straight
from softcal.geometry.placement import placed_centreline
from softcal.geometry.section import CrossSection
from softcal.limits import LIMITS
from softcal.project.document import Findings, KeyPath
from softcal.project.rod_schema import BarSection, HelixSection, RodSection
from softcal.twin.manipulator import ELEMENTS_PER_TURN
from softcal.twin.robot import Rod

ELEMENTS = 40  # of a straight rod by default


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
            "nothing holds the rod",
            got="neither clamped nor fixed",
            allowed="clamped: {PLATE: station}, or fixed: station",
            attempt="fixed: start",
        )
    with findings.at((*path, "section")):
        section = _section(rod.section)
        shape = next(key for key in ("straight", "helix", "polyline") if getattr(rod, key) is not None)
        with findings.at((*path, shape)):
            length = _length(rod)
            if rod.helix is not None:
                _check_coils(rod.helix, section)
            clamped = {
                plate: _arcs(where, length, (*path, "clamped", plate), findings) for plate, where in rod.clamped.items()
            }
            fixed = _arcs(rod.fixed, length, (*path, "fixed"), findings)
            LIMITS["elements of a rod"].check(rod.elements or _elements(rod))
            line = _centreline(rod, sorted({*fixed, *(s for arcs in clamped.values() for s in arcs)}))
            if rod.placement is not None:
                with findings.at((*path, "placement")):
                    line = placed_centreline(line, rod.placement.pose)
            if len(findings.faults) > n_faults:
                return None
            with findings.at(path):
                parameters = {"youngs_modulus": rod.youngs_modulus, "poissons_ratio": rod.poissons_ratio}
                held = {plate: _nodes(line, length, arcs) for plate, arcs in clamped.items()}
                return Rod(name, line, section, parameters, held, _nodes(line, length, fixed), rod.density)
    return None


def _section(given: BarSection) -> CrossSection:
    if given.diameter is not None:
        return sections.circular(given.diameter, inner_diameter=given.inner_diameter or 0.0)
    if given.width is not None and given.height is not None:
        return sections.rectangular(given.width, given.height)
    constants = [value or 0.0 for value in (given.area, given.I1, given.I2, given.J)]
    if given.shear_coefficients is None:
        return sections.given(*constants)
    return sections.given(*constants, shear_coefficients=given.shear_coefficients)


def _length(rod: RodSection) -> float:
    """The arc length of the whole rod [m]."""
    if rod.straight is not None:
        length = math.dist(rod.straight.start, rod.straight.end)
        if not length > 0.0:
            raise MeshError(Fault("a rod's ends coincide", got=str(list(rod.straight.start)), allowed="two points"))
        return length
    if rod.helix is not None:
        return rod.helix.turns * math.hypot(math.pi * rod.helix.coil_diameter, _pitch(rod.helix))
    points = [] if rod.polyline is None else rod.polyline.points
    return float(polyline(points).stations[-1])


def _pitch(shape: HelixSection) -> float:
    return shape.pitch if shape.pitch is not None else (shape.height or 0.0) / shape.turns


def _check_coils(shape: HelixSection, section: CrossSection) -> None:
    """Coils of one wire that overlap; the wire's thickness is its section's outer diameter."""
    pitch = _pitch(shape)
    apart = pitch / math.hypot(1.0, pitch / (math.pi * shape.coil_diameter))
    if shape.turns > 1.0 and apart < section.outer_diameter:
        raise MeshError(
            Fault(
                "the coils of the spring overlap at rest",
                got=f"{1e3 * apart:.4g} mm from wire to wire, {1e3 * (section.outer_diameter - apart):.3g} mm deep",
                allowed=f"at least the wire's {1e3 * section.outer_diameter:.4g} mm",
                attempt="a larger pitch, fewer turns or a thinner wire",
            )
        )


def _arcs(stations: Iterable[float | str], length: float, path: KeyPath, findings: Findings) -> list[float]:
    """Stations as arc lengths [m]; those off the rod are faults."""
    arcs: list[float] = []
    for station in stations:
        if isinstance(station, str):
            arcs.append(0.0 if station == "start" else length)
        elif station > length * (1.0 + 1e-9):
            findings.add(
                path,
                "the station lies off the rod",
                got=f"{1e3 * station:.6g} mm",
                allowed=f"0 to {1e3 * length:.6g} mm",
            )
        else:
            arcs.append(min(station, length))
    return arcs


def _centreline(rod: RodSection, arcs: list[float]) -> Centreline:
    length = _length(rod)
    at = spaced([s / length for s in arcs], 1.0 / (rod.elements or _elements(rod)))
    if rod.straight is not None:
        return straight(rod.straight.start, rod.straight.end, at, first=rod.straight.first)
    if rod.helix is not None:
        shape = rod.helix
        return helix(
            shape.base,
            shape.axis,
            diameter=shape.coil_diameter,
            pitch=_pitch(shape),
            turns=shape.turns,
            at=at,
            towards=shape.towards,
            left_handed=shape.left_handed,
        )
    points, first = ([], None) if rod.polyline is None else (rod.polyline.points, rod.polyline.first)
    return curve_through(points, arcs, length / (rod.elements or 1), first=first)


def _elements(rod: RodSection) -> int:
    return ELEMENTS if rod.helix is None else math.ceil(ELEMENTS_PER_TURN * rod.helix.turns - 1e-9)


def _nodes(line: Centreline, length: float, arcs: list[float]) -> Ints:
    """The nodes at arc lengths; the curve through refined points may differ in length by rounding."""
    stations = line.stations * (length / line.stations[-1])
    return np.unique([int(np.argmin(np.abs(stations - arc))) for arc in arcs]).astype(np.int64)
