"""From a project's `rods` to Rods: centrelines with nodes at every station, sections, supports."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.centreline import Centreline, place_on_rod
from softcal.geometry.placement import placed_centreline
from softcal.geometry.section import CrossSection
from softcal.geometry.varied_section import VariedSection
from softcal.limits import LIMITS
from softcal.project.document import Findings, KeyPath
from softcal.project.rod_schema import RodSection
from softcal.twin.material import Material
from softcal.twin.robot import Rod

SAME = 1e-6  # of a rod's length: stations as near as that are one


def build_rod(
    name: str, rod: RodSection, plates: Iterable[str], carried: Sequence[Floats], findings: Findings
) -> Rod | None:
    """One rod; None with a fault, which goes to `findings`.

    Parameters
    ----------
    name
        Name in the project file.
    rod
        Its section of the file.
    plates
        Names of all plates.
    carried
        Points (3,) [m] on the rod, such as via points; it gets nodes in their sections.
    findings
        Collects the faults and warnings.
    """
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
    materials = {
        part: _arcs(material.between, shape.length, (*path, "materials", part, "between"), findings)
        for part, material in rod.materials.items()
    }
    for part, ends in materials.items():
        if len(ends) == 2 and abs(ends[1] - ends[0]) <= SAME * shape.length:
            where = (*path, "materials", part, "between")
            got = " and ".join(f"{1e3 * end:.6g} mm" for end in ends)
            findings.add(where, "the stretch has no length", got=got, allowed="two different stations")
    section, stations = _section(rod, shape.length, path, findings)
    if section is None:
        return None
    with findings.at((*path, key)):
        shape.require_fitting(section.constants.outer_diameter)
        clamped = {
            plate: _arcs(where, shape.length, (*path, "clamped", plate), findings)
            for plate, where in rod.clamped.items()
        }
        fixed = _arcs(rod.fixed, shape.length, (*path, "fixed"), findings)
        elements = rod.elements or shape.elements
        LIMITS["elements of a rod"].check(elements)
        held = [*fixed, *(s for arcs in (*clamped.values(), *materials.values()) for s in arcs), *stations]
        line = _placed(shape.centreline(sorted({*held}), elements), rod, path, findings)
        if carried:
            # Nodes in the sections that contain the points; points at nearly the same arc length share a section.
            places = [place_on_rod(line, point) for point in carried]
            at = [line.stations[place.node] + place.share * line.lengths[place.node] for place in places]
            scale, same = shape.length / line.stations[-1], SAME * shape.length
            arcs, found = np.array([0.0, *line.stations * scale]), list[float]()
            for arc in sorted(set((np.array(at) * scale).tolist())):
                if np.abs(arcs - arc).min() > same and (not found or arc - found[-1] > same):
                    found.append(arc)
            held += found
            line = _placed(shape.centreline(sorted({*held}), elements), rod, path, findings)
        if len(findings.faults) > n_faults:
            return None
        with findings.at(path):
            held = {plate: _nodes(line, shape.length, arcs) for plate, arcs in clamped.items()}
            inclusions = [
                Material(
                    part,
                    np.arange(*_nodes(line, shape.length, materials[part])),
                    material.constants,
                    rod.density if material.density is None else material.density,
                )
                for part, material in rod.materials.items()
            ]
            ends = _nodes(line, shape.length, fixed)
            return Rod(
                name=name,
                centreline=line,
                section=section,
                parameters=rod.at_small_strain,
                clamped=held,
                fixed=ends,
                density=rod.density,
                inclusions=tuple(inclusions),
                history=rod.history,
                law=rod.law or "",
            )
    return None


def _placed(line: Centreline, rod: RodSection, path: KeyPath, findings: Findings) -> Centreline:
    if rod.placement is None:
        return line
    with findings.at((*path, "placement")):
        return placed_centreline(line, rod.placement.pose)
    return line


def _section(
    rod: RodSection, length: float, path: KeyPath, findings: Findings
) -> tuple[CrossSection | None, list[float]]:
    """Section of a rod, None with a fault, and the arc lengths [m] of its stated sections."""
    if rod.section is not None or rod.sections is None:
        return rod.section, []
    arcs = _arcs([one.at for one in rod.sections], length, (*path, "sections"), findings)
    with findings.at((*path, "sections")):
        return VariedSection(tuple(arc / length for arc in arcs), tuple(one.section for one in rod.sections)), arcs
    return None, arcs


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
