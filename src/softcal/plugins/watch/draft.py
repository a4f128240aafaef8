"""A project file in the making: what was chosen and picked, and the text that a person would write for it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.experiments.table import load_table, split_header
from softcal.experiments.table_format import TableFormat
from softcal.geometry.bore import Bore
from softcal.geometry.generate import KINDS, mesh_file
from softcal.geometry.read import read_mesh
from softcal.geometry.regions import ROUNDING, Plane
from softcal.geometry.stl import checked_stl
from softcal.geometry.surface import boundary_triangles
from softcal.units import parse_quantity, unit_factor

MESHES = (*KINDS, ".msh", ".vtk", ".vtu", ".inp")
TABLES = (".csv", ".txt", ".tsv", ".dat")
# [m], of a via point from the mouth of its bore; a diameter from a blind end; a quarter of a short stretch.
INSET = 5e-4
BEYOND = 1e-2  # [m] from the last via point to where the cable is pulled
# Channel -> what it is called in headers.
CHANNELS: Mapping[str, str] = {
    "time": r"time|zeit|\bt\b",
    "shortening": r"displ|short|stroke|travel|weg|position|extension",
    "tension": r"force|tension|load|kraft",
    "pitch": r"pitch|angle|winkel",
    "roll": r"roll",
}
# Channel that is compared -> of a common instrument, the noise of a sample and the drift of the zero during a test.
NOISE: Mapping[str, str] = {"tension": "0.05 N", "pitch": "0.3 deg", "roll": "0.3 deg"}
DRIFT: Mapping[str, str] = {"tension": "20 mN", "pitch": "0.1 deg", "roll": "0.1 deg"}
AXES = ("-z", "+z", "-y", "+y", "-x", "+x")


@dataclass(frozen=True)
class BenchTable:
    """A test.

    Attributes
    ----------
    file
        The table.
    columns
        Channel -> the column's header and its unit ("" where the header has it).
    noise
        Channel -> standard deviation of a sample with its unit, where it is stated; "" for none.
    cable
        The cable that is pulled; that of the draft where there is one.
    """

    file: str
    columns: Mapping[str, tuple[str, str]]
    noise: Mapping[str, str] = field(default_factory=dict[str, str])
    cable: str = ""

    @property
    def drive(self) -> str:
        """The channel that is prescribed."""
        return "shortening" if "shortening" in self.columns else "tension"

    @property
    def compared(self) -> list[str]:
        """The channels that have noise."""
        return [name for name in self.columns if name in NOISE and name != self.drive]


@dataclass(frozen=True)
class DraftCable:
    """A cable.

    Attributes
    ----------
    via
        Its points (k, 3) in the body.
    pulled_at
        Point (3,) in space where it is pulled, behind the last via point.
    """

    via: tuple[Floats, ...] = ()
    pulled_at: Floats | None = None


@dataclass(frozen=True)
class Draft:
    """The choices so far; quantities are text with their unit, points are in metres in the frame of the mesh.

    Attributes
    ----------
    mesh, unit, size
        File of the body, the unit of its coordinates, and the length of an edge where Gmsh fills it.
    youngs_modulus, poissons_ratio, density
        Of the body's material.
    down
        Direction of gravity, of `AXES`; "" for none.
    fixed, top
        The face that is fixed, and the face that a rigid plate holds.
    reference
        Point (3,) of the plate.
    cables
        The cables by their names; one without via points is not there yet.
    tests
        The tables.
    drift
        Channel -> standard deviation of what its instrument's zero moves in a test, where it is stated; "" for none.
    """

    mesh: str = ""
    unit: str = "mm"
    size: str = "4 mm"
    youngs_modulus: str = "10 MPa"
    poissons_ratio: str = "0.45"
    density: str = "1180 kg/m^3"
    down: str = "-z"
    fixed: Plane | None = None
    top: Plane | None = None
    reference: Floats | None = None
    cables: Mapping[str, DraftCable] = field(default_factory=lambda: {"cable": DraftCable()})
    tests: tuple[BenchTable, ...] = ()
    drift: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def body(self) -> str:
        """Name of the body: that of its file."""
        return name_of(PurePath(self.mesh).stem, "body")

    @property
    def experiments(self) -> dict[str, BenchTable]:
        """Names of the tests, by their files; with the folder where two files have one name."""
        stems = [PurePath(test.file).stem for test in self.tests]
        paths = [str(PurePath(test.file).with_suffix("")) for test in self.tests]
        names = [path if stems.count(stem) > 1 else stem for stem, path in zip(stems, paths, strict=True)]
        return {name_of(name, "test"): test for name, test in zip(names, self.tests, strict=True)}

    def pulled(self, test: BenchTable) -> str:
        """The cable that is pulled in a test; the first one where that is not there."""
        return test.cable if test.cable in self.cables else next(iter(self.cables))


def name_of(text: str, kind: str) -> str:
    """A name for a part or test of some kind by the name of its file; it begins with a letter."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")
    return name if name[:1].isalpha() else f"{kind}_{name}".rstrip("_")


def project_text(draft: Draft) -> str:
    """The project file of a draft; what was not chosen yet is not there, and `softcal check` says what is missing."""
    head = (
        "# softcal check project.yaml        checks everything; draws mesh, regions, cables and data",
        "# softcal calibrate project.yaml    finds the parameters and writes a run folder with a report",
        "softcal: 1",
        f"name: {draft.body}",
        "",
    )
    return "\n".join([*head, *_robot(draft), *_tests(draft)]) + "\n"


def _robot(draft: Draft) -> Iterator[str]:
    yield "robot:"
    yield "  bodies:"
    yield f"    {draft.body}:"
    # A STEP file states its unit; of the others only a surface is filled.
    kind = KINDS.get(PurePath(draft.mesh).suffix.lower(), "mesh")
    keys = {
        "step": f"size: {draft.size}, edges_around: 6",
        "stl": f"unit: {draft.unit}, size: {draft.size}",
        "mesh": f"unit: {draft.unit}",
    }
    yield f"      mesh: {{file: {_text(draft.mesh)}, {keys[kind]}}}"
    yield f"      youngs_modulus: {draft.youngs_modulus}    # start of the search"
    yield f"      poissons_ratio: {draft.poissons_ratio}    # fixed"
    yield f"      density: {draft.density}"
    if draft.fixed is not None or draft.top is not None:
        yield "      regions:"
        for name, plane in (("foot", draft.fixed), ("top", draft.top)):
            if plane is not None:
                normal = ", ".join(f"{x:g}" for x in plane.normal)
                on = np.dot(plane.point, plane.normal) * np.array(plane.normal) / np.dot(plane.normal, plane.normal)
                yield f"        {name}: {{plane: {{point: {_point(on)}, normal: [{normal}]}}}}"
    if draft.fixed is not None:
        yield "      fixed: foot"
    if draft.top is not None and draft.reference is not None:
        yield "  plates:"
        yield f"    tip: {{body: {draft.body}, region: top, reference: {_point(draft.reference)}}}"
    if any(cable.via for cable in draft.cables.values()):
        yield "  cables:"
    for name, cable in draft.cables.items():
        if cable.via:
            yield f"    {name}:"
            yield "      via:    # from the knot to where it is pulled"
            yield from (f"        - {{on: {draft.body}, at: {_point(at)}}}" for at in cable.via)
            yield from (f"        - {{at: {_point(at)}}}" for at in [cable.pulled_at] if at is not None)
    if draft.down:
        g = {"+": "9.81", "-": "-9.81"}[draft.down[0]]
        yield f"  gravity: [{', '.join(f'{g if axis == draft.down[1] else 0} m/s^2' for axis in 'xyz')}]"


def _stated(
    compared: Iterable[str], stated: Mapping[str, str], common: Mapping[str, str]
) -> tuple[dict[str, str], str]:
    """Channel -> standard deviation, that of a common instrument where none is stated; and a comment on those."""
    deviations = {channel: stated.get(channel, common[channel]) for channel in compared}
    guesses = ", ".join(channel for channel in deviations if channel not in stated)
    comment = f"    # guesses ({guesses}): state those of your instruments" if guesses else ""
    return {channel: sd for channel, sd in deviations.items() if sd}, comment


def _tests(draft: Draft) -> Iterator[str]:
    if draft.tests:
        yield ""
        yield "experiments:"
    for experiment, test in draft.experiments.items():
        yield f"  {experiment}:"
        yield f"    cable: {draft.pulled(test)}"
        yield from ("    plate: tip" for _ in [0] if draft.top is not None)
        yield f"    drive: {test.drive}"
        yield "    files:"
        yield f"      - path: {_text(test.file)}"
        yield "        columns:"
        for name, (header, unit) in test.columns.items():
            stated = f", unit: {_text(unit)}" if unit else ""
            yield f"          {name}: {{name: {_text(header)}{stated}}}"
        noise, guesses = _stated(test.compared, test.noise, NOISE)
        if noise:
            deviations = ", ".join(f"{name}: {sd}" for name, sd in noise.items())
            yield f"    noise: {{{deviations}}}{guesses}"
        yield from ("    slack: 0.5 mm    # start of the search" for _ in [0] if test.drive == "shortening")
    if draft.tests:
        yield ""
        yield "parameters:"
        low, high = draft.youngs_modulus, draft.youngs_modulus
        if number := re.match(r"\s*\d*\.?\d+(e[+-]?\d+)?", low, re.IGNORECASE):
            low, high = (f"{factor * float(number[0]):g}{low[number.end() :]}" for factor in (0.1, 10.0))
        yield f"  {draft.body}.youngs_modulus: {{bounds: [{low}, {high}], scale: log}}"
        for cable in dict.fromkeys(draft.pulled(test) for test in draft.tests if "shortening" in test.columns):
            yield f"  {cable}.slack: {{bounds: [-1 mm, 3 mm], per: experiment}}"
        compared = dict.fromkeys(name for test in draft.tests for name in test.compared)
        drift, guesses = _stated(compared, draft.drift, DRIFT)
        if drift:
            yield ""
            yield "# How far each instrument's zero may drift during a test."
            yield f"uncertain:{guesses}"
            for name, sd in drift.items():
                cables = dict.fromkeys(draft.pulled(test) for test in draft.tests if name in test.compared)
                for part in cables if name == "tension" else ["tip"]:
                    yield f"  {part}.{name}_drift: {{sd: {sd}, per: experiment}}"
        yield ""
        yield "calibration: {fit: both, method: least-squares, loss: likelihood, seed: 1}"


def _text(word: str) -> str:
    """Text of a YAML file: plain where it is a common file name, else in quotes."""
    is_file = re.fullmatch(r"[A-Za-z][\w/-]*\.[A-Za-z]\w*", word, re.ASCII)
    return word if is_file else '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _point(at: Floats) -> str:
    return "[" + ", ".join(f"{round(1e3 * x, 2) + 0.0:g} mm" for x in at) + "]"


def part_surface(path: Path, unit: str, size: str) -> Floats:
    """The surface of a part (n, 3, 3) [m], normals outwards: of an .stl its own triangles, else those of a mesh.

    Parameters
    ----------
    path
        The file.
    unit
        Unit of its coordinates, where the file does not state it.
    size
        Edge of an element, with its unit, for a STEP file; bores are refined.

    Raises
    ------
    MeshError, UnitError
        If the file cannot be read or filled, or the unit is none of a length.
    """
    kind = path.suffix.lower()
    if kind == ".stl":
        return checked_stl(path)[0] * unit_factor(unit, "m")
    edge = parse_quantity(size, "m", where="edge of an element")
    mesh = mesh_file(path, size=edge, edges_around=12) if kind in KINDS else read_mesh(path, unit=unit)
    return mesh.points[boundary_triangles(mesh.tets)]


def on_plane(triangles: Floats, plane: Plane) -> Floats:
    """The triangles (k, 3, 3) of a surface that lie on a plane."""
    size = float(np.linalg.norm(np.ptp(triangles.reshape(-1, 3), axis=0)))
    return triangles[plane.contains(triangles.reshape(-1, 3), ROUNDING * size).reshape(-1, 3).all(axis=1)]


def middle(triangles: Floats) -> Floats:
    """The middle (3,) of the box around triangles (k, 3, 3)."""
    return 0.5 * (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1)))


def same_plane(a: Plane | None, b: Plane) -> bool:
    """Whether two planes coincide; None is no plane."""
    if a is None or not np.allclose(a.normal, b.normal, atol=1e-6):
        return False
    return abs(float(np.dot(np.subtract(a.point, b.point), b.normal))) < 1e-7


def via_points(bore: Bore) -> tuple[Floats, ...]:
    """Via points in every stretch of a bore, near both mouths."""
    points: list[Floats] = []
    for (first, last), is_blind in zip(bore.stretches, bore.is_blind, strict=True):
        length = float(np.linalg.norm(last - first))
        insets = [min(bore.diameter if blind else INSET, 0.25 * length) for blind in is_blind]
        points += [first + insets[0] * bore.axis, last - insets[1] * bore.axis]
    return tuple(points)


def towards(via: Sequence[Floats], fixed: Plane | None) -> tuple[Floats, ...]:
    """Via points in the order in which a cable runs to the fixed face, where it is pulled; as they are without one."""
    if fixed is None:
        return tuple(via)
    first, last = (abs(float(np.dot(at - np.array(fixed.point), fixed.normal))) for at in (via[0], via[-1]))
    return tuple(via) if first >= last else tuple(via)[::-1]


def pulled_behind(via: Sequence[Floats]) -> Floats:
    """A point (3,) in space behind the last via point, in the direction of the last two."""
    way = via[-1] - via[-2]
    return via[-1] + BEYOND * way / np.linalg.norm(way)


def table_columns(path: Path) -> dict[str, str]:
    """The columns of a table: header -> its unit, "" where it has none.

    Raises
    ------
    DatasetError
        If it is no table, or no column of it begins with a number.
    StorageError
        If it cannot be read.
    """
    table = load_table(path, (), TableFormat())
    first = next(table.rows())[1][0]
    if not any(re.fullmatch(r"[+-]?\d*[.,]?\d+(e[+-]?\d+)?", cell.strip(), re.IGNORECASE) for cell in first):
        raise DatasetError(Fault("no column begins with a number", str(path), allowed="a table of a test"))
    units = [split_header(header)[1] or cell for header, cell in zip(table.headers, table.unit_cells, strict=True)]
    return dict(zip(table.headers, units, strict=True))


def likely_columns(columns: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Channel -> header and "", of those columns of which the header says what they are."""
    likely: dict[str, tuple[str, str]] = {}
    for channel, pattern in CHANNELS.items():
        header = next((one for one in columns if re.search(pattern, one, re.IGNORECASE)), None)
        if header is not None and not any(header == taken for taken, _ in likely.values()):
            likely[channel] = (header, "")
    return likely
