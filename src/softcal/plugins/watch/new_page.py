"""The page of `softcal new`: a part is clicked, tables are chosen, and the project file is checked as it grows."""

from __future__ import annotations

import asyncio
import hashlib
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import InputError, SoftcalError, StorageError
from softcal.geometry.bore import bore_at
from softcal.geometry.regions import plane_at
from softcal.geometry.stl import RECORD
from softcal.limits import LIMITS
from softcal.plugins.watch.draft import (
    AXES,
    CHANNELS,
    DRIFT,
    MESHES,
    NOISE,
    TABLES,
    BenchTable,
    Draft,
    DraftCable,
    likely_columns,
    middle,
    name_of,
    on_plane,
    part_surface,
    project_text,
    pulled_behind,
    same_plane,
    table_columns,
    towards,
    via_points,
)
from softcal.workflows.output import write_new_file

if TYPE_CHECKING:
    from fastapi import Request
    from fastapi.responses import Response

PROJECT = "project.yaml"
LONG = 10.0  # of the part in the view
AWAY = (4.2, -13.5, 4.2)
PART, FIXED, TOP, CABLE = "#d1d5db", "#4b5563", "#2563eb", "#d97706"
TURN, FOOT, PLATE, BORE = "turn", "fixed face", "face of the plate", "bore of the cable"
UNITS = ("mm", "cm", "m", "in")
LATER = 0.6  # [s] without a change before the file is checked
LOOK = 2.0  # [s] between two looks at the folder's files
# Files that are dropped onto the page are copied into the folder.
_DROP = """
document.addEventListener('dragover', event => event.preventDefault());
document.addEventListener('drop', async event => {
  event.preventDefault();
  for (const file of event.dataTransfer.files) {
    const answer = await fetch('files/' + encodeURIComponent(file.name), {method: 'PUT', body: file});
    emitEvent('softcal_dropped', await answer.text());
  }
});
"""


@dataclass(frozen=True)
class DraftFindings:
    """The result of `softcal check` for a project file, without solving anything: faults, or rows and warnings."""

    faults: tuple[str, ...] = ()
    rows: tuple[tuple[str, str], ...] = ()
    warnings: tuple[str, ...] = ()


class NewProject:
    """Data that the pages of a server share: the folder, a place to check a draft, and surfaces for their views.

    The draft is checked in a folder of its own with links to the user's files: in theirs nothing is written but the
    project file, when they ask for it.
    """

    def __init__(self, folder: Path, scratch: Path) -> None:
        self.folder, self._scratch, self._one = folder, scratch, threading.Lock()
        self._surfaces: dict[str, bytes] = {}

    def files(self, kinds: Sequence[str]) -> list[str]:
        """The files of some kinds in the folder and in those in it."""
        files: list[Path] = []
        for folder in (self.folder, *(one for one in self.folder.iterdir() if one.is_dir())):
            with suppress(OSError):  # which may not be read
                files += [one for one in folder.iterdir() if one.suffix.lower() in kinds and one.name[0] != "."]
        return sorted(one.relative_to(self.folder).as_posix() for one in files)

    def findings(self, draft: Draft) -> DraftFindings:
        """The result of `softcal check` for a draft."""
        from softcal.project.project import load
        from softcal.workflows.checking import check

        with self._one:
            for name in {Path(file).parts[0] for file in (draft.mesh, *(test.file for test in draft.tests))}:
                link, own = self._scratch / name, (self.folder / name).resolve()
                if not link.is_symlink():
                    link.symlink_to(own, target_is_directory=own.is_dir())
            (self._scratch / PROJECT).write_text(project_text(draft), encoding="utf-8")
            try:
                report = check(load(self._scratch / PROJECT), solve=False)
            except InputError as error:
                return DraftFindings(tuple(str(fault).replace(f"{self._scratch}/", "") for fault in error.faults))
            except (SoftcalError, OSError) as error:
                return DraftFindings((str(error).replace(f"{self._scratch}/", ""),))
            return DraftFindings((), report.rows, report.warnings)

    def surface(self, triangles: Floats) -> str:
        """The address of triangles (k, 3, 3) as a file for the view."""
        records = np.zeros(len(triangles), RECORD)
        records["corners"] = triangles
        records["normal"] = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        records["normal"] /= np.linalg.norm(records["normal"], axis=1, keepdims=True)
        data = bytes(80) + np.uint32(len(records)).tobytes() + records.tobytes()
        name = hashlib.sha256(data).hexdigest()[:16]
        self._surfaces = {**dict([*self._surfaces.items()][-30:]), name: data}
        return f"/surface/{name}.stl"

    def surface_bytes(self, name: str) -> bytes:
        """The bytes of the file of an address; empty where it does not exist."""
        return self._surfaces.get(name, b"")


def application(folder: Path, scratch: Path) -> Any:
    """The application of a folder; drafts are checked in `scratch`."""
    from fastapi import FastAPI
    from fastapi import Request as AnyRequest
    from fastapi.responses import PlainTextResponse
    from fastapi.responses import Response as AnyResponse

    from softcal.plugins.watch.server import with_page

    app, project = FastAPI(docs_url=None, redoc_url=None, openapi_url=None), NewProject(folder, scratch)

    def surface(name: str) -> Response:
        return AnyResponse(project.surface_bytes(name), media_type="model/stl")

    async def take(name: str, request: AnyRequest) -> Response:
        said, status = await taken(folder, name, request)
        return PlainTextResponse(said, status)

    take.__annotations__["request"] = AnyRequest  # which FastAPI looks up by name
    app.get("/surface/{name}.stl", response_model=None)(surface)
    app.put("/files/{name}", response_model=None)(take)
    return with_page(app, "softcal new", lambda: NewPage(project))


async def taken(folder: Path, name: str, request: Request) -> tuple[str, int]:
    """Copy a file that was dropped onto the page into the folder; what is said of it, and the status of the answer."""
    kinds = (*MESHES, *TABLES)
    if name != Path(name).name or name.startswith(".") or Path(name).suffix.lower() not in kinds:
        return f"{name} is no file of a kind that is read here: {', '.join(kinds)}.", 415
    path = folder / name
    try:
        with path.open("xb") as file:
            try:
                async for part in request.stream():
                    file.write(part)
            except BaseException:  # the page was closed while it sent
                path.unlink()
                raise
    except FileExistsError:
        return f"{name} is in the folder already, and was not replaced.", 409
    except OSError as error:
        return f"{name} could not be written: {error.strerror}.", 507
    return f"{name} was copied into the folder.", 201


class NewPage:
    """The elements of one browser's page, and its draft."""

    def __init__(self, project: NewProject) -> None:
        from nicegui import ui

        self._project, self._draft = project, Draft()
        self._surface: Floats | None = None
        self._scale, self._middle = 1.0, np.zeros(3)
        self._read: tuple[str, str] = ("", "")
        self._shown_tables: list[str] | None = None
        self._checked = ""
        self._pulled: list[Any] = []  # of each table, the choice of the cable that is pulled
        ui.add_body_html(f"<script>{_DROP}</script>")
        ui.on("softcal_dropped", lambda event: ui.notify(str(event.args)))
        with ui.element("main").classes("sc-page"):
            with ui.element("header").classes("sc-head"):
                ui.label("A project").classes("sc-name")
                place, home = project.folder.resolve(), Path.home().resolve()
                shown = Path("~", place.relative_to(home)) if place.is_relative_to(home) else place
                ui.label(str(shown)).classes("sc-stage")
            with _card("sc-7", "1  Click what is fixed, what a plate holds, and the bore of the cable"):
                self._mode = ui.toggle([TURN, FOOT, PLATE, BORE], value=TURN).props("dense no-caps").mark("mode")
                camera = ui.scene.perspective_camera(fov=45, near=0.1, far=200)
                self._scene: Any = ui.scene(
                    width=700, height=430, grid=False, camera=camera, background_color="#ffffff", on_click=self._click,
                    click_events=["click"],
                ).classes("sc-scene sc-tall")  # fmt: skip
                self._scene.move_camera(*AWAY, 0, 0, 0, 0, 0, 1, duration=0)
                self._said = ui.label("Choose a part, or drop its file and your tables onto this page.").classes(
                    "sc-note"
                )
                self._said.props('data-fact="said"')
            with _card("sc-5", "2  Part and material"):
                self._part = _choice("Mesh, STL or STEP", [], self._take_part)
                self._unit = _choice("Unit of its coordinates", list(UNITS), self._take_part, "mm")
                for label, name in (
                    ("Edge of an element", "size"),
                    ("Young's modulus, start of the search", "youngs_modulus"),
                    ("Poisson's ratio", "poissons_ratio"),
                    ("Density", "density"),
                ):
                    _line(label, getattr(self._draft, name), lambda value, name=name: self._take(**{name: value}))
                _choice("Gravity", ["none", *AXES], lambda way: self._take(down="" if way == "none" else way), "-z")
            with _card("sc-7", "3  Cables: points [mm], from the knot to the last one, in space, where it is pulled"):
                with ui.element("div").classes("sc-pair"):
                    names = [*self._draft.cables]
                    self._cable = _choice("Cable", names, self._show_cable, names[0])
                    self._name = _line("Its name", str(self._cable.value), self._rename_cable)
                    ui.button("Another cable", on_click=self._add_cable).props("no-caps flat dense")
                self._via: Any = ui.textarea(on_change=lambda event: self._take_via(str(event.value or "")))
                self._via.props("dense outlined rows=9 data-fact=via").classes("sc-code")
            with _card("sc-5", "What softcal check says"):
                self._state = ui.label().props('data-fact="state"')
                self._findings = ui.element("div").classes("sc-stack sc-findings").props('data-fact="findings"')
                ui.button(f"Write {PROJECT}", on_click=self._write).props("no-caps unelevated").classes("sc-write")
                self._written = ui.label().classes("sc-note").props('data-fact="written"')
            with _card("sc-12", "4  Tests"):
                self._tables = ui.element("div")
                with ui.element("div").classes("sc-pair"):
                    self._drift: dict[str, Any] = {
                        channel: _line(
                            f"drift of {channel} in a test (sd)",
                            sd,
                            lambda text, channel=channel: self._take(drift={**self._draft.drift, channel: text}),
                        )
                        for channel, sd in DRIFT.items()
                    }
            with _card("sc-12", PROJECT):
                self._text = ui.label().classes("sc-code sc-file").props('data-fact="file"')
        self._look()
        self._show_text()
        ui.timer(LOOK, self._look)
        ui.timer(LATER, self._check)

    def _look(self) -> None:
        """Show the files that the folder has now; each table with a column for each channel where it is a test."""
        from nicegui import ui

        meshes, tables = self._project.files(MESHES), self._project.files(TABLES)
        if list(self._part.options) != meshes:
            self._part.set_options(meshes, value=self._part.value or (meshes[0] if len(meshes) == 1 else None))
        if tables != self._shown_tables:
            self._shown_tables = tables
            self._tables.clear()
            self._pulled.clear()
            with self._tables:
                if not tables:
                    ui.label("No table is in the folder yet: drop it onto this page.").classes("sc-note")
                for file in tables:
                    try:
                        columns = table_columns(self._project.folder / file)
                    except SoftcalError as error:
                        ui.label(str(error)).classes("sc-note sc-warn")
                        continue
                    with ui.expansion(file).classes("sc-test").props(f'dense data-table="{file}"'):
                        self._show_columns(file, columns)

    def _take(self, **changes: Any) -> None:
        """The draft with changes, and its text."""
        self._draft = replace(self._draft, **changes)
        self._show_text()

    def _show_text(self) -> None:
        self._text.set_text(project_text(self._draft))
        for channel, line in self._drift.items():
            line.set_visibility(any(channel in test.compared for test in self._draft.tests))

    async def _take_part(self, _: str) -> None:
        """Read and show the chosen part; a STEP file with elements of the present size, which may be changed before."""
        file, unit = str(self._part.value or ""), str(self._unit.value)
        if not file or (file, unit) == self._read:
            return
        self._read = (file, unit)
        self._said.set_text(f"Reading {file} …")
        try:
            surface = await asyncio.to_thread(part_surface, self._project.folder / file, unit, self._draft.size)
        except (SoftcalError, OSError) as error:
            self._read = ("", "")
            self._part.set_value(None)
            self._said.set_text(str(error).replace(f"{self._project.folder}/", ""))
            return
        self._surface, self._middle = surface, middle(surface)
        self._scale = LONG / float(np.ptp(surface.reshape(-1, 3), axis=0).max())
        self._take(mesh=file, unit=unit, fixed=None, top=None, reference=None)
        self._take_cables({name: DraftCable() for name in self._draft.cables})
        size = " × ".join(f"{1e3 * x:.3g}" for x in np.ptp(surface.reshape(-1, 3), axis=0))
        self._said.set_text(f"{file}: {size} mm. Turn and zoom it with the mouse; choose above what a click picks.")
        self._draw()

    def _draw(self) -> None:
        """The part, the faces that are picked, and the cable."""
        if self._surface is None:
            return
        self._scene.clear()
        self._scene.run_method("resize")
        with self._scene:
            cables = [cable for cable in self._draft.cables.values() if cable.via]
            faces = [(self._surface, PART, 0.6 if cables else 1.0)]
            for plane, colour in ((self._draft.fixed, FIXED), (self._draft.top, TOP)):
                if plane is not None:
                    lifted = on_plane(self._surface, plane) + 2e-3 / self._scale * np.array(plane.normal)
                    faces.append((lifted, colour, 1.0))
            for triangles, colour, opacity in faces:
                if len(triangles):
                    address = self._project.surface(self._scale * (triangles - self._middle))
                    self._scene.stl(address).material(colour, opacity, side="both").with_name("surface")
            for cable in cables:
                points = [at for at in (*cable.via, cable.pulled_at) if at is not None]
                drawn = [(self._scale * (at - self._middle)).tolist() for at in points]
                for at in drawn:
                    self._scene.sphere(0.09).material(CABLE).move(*at)
                for first, last in pairwise(drawn):
                    self._scene.line(first, last).material(CABLE)

    async def _click(self, event: Any) -> None:
        """Pick what the mode says at the point of the part that was clicked."""
        hit = next((one for one in event.hits if one.object_name == "surface"), None)
        if self._surface is None or self._mode.value == TURN:
            return
        if hit is None:
            self._said.set_text("The part is not there: nothing was picked.")
            return
        at, surface = np.array([hit.x, hit.y, hit.z]) / self._scale + self._middle, self._surface
        if self._mode.value == BORE:
            self._said.set_text("Following the bore …")
            bore = await asyncio.to_thread(bore_at, surface, at)
            if bore is None:
                self._said.set_text("No straight bore has its wall there: click in a bore, or type the points below.")
                return
            self._take_cables({**self._draft.cables, self._cable.value: self._led(via_points(bore))})
            stretches = f"in {len(bore.stretches)} stretches of the part" if len(bore.stretches) > 1 else "straight"
            self._said.set_text(f"A bore {1e3 * bore.diameter:.2g} mm wide, {stretches}.")
            return
        plane = plane_at(surface, at)
        if plane is None:
            self._said.set_text("The surface is curved there: click a flat face.")
            return
        is_foot = self._mode.value == FOOT
        own, other = (self._draft.fixed, self._draft.top) if is_foot else (self._draft.top, self._draft.fixed)
        if same_plane(other, plane):
            self._said.set_text(f"That face is the {PLATE if is_foot else FOOT} already: it cannot be both.")
            return
        centre = middle(on_plane(surface, plane))
        if same_plane(own, plane):
            self._said.set_text(f"The {self._mode.value} is no longer picked.")
            self._take(**({"fixed": None} if is_foot else {"top": None, "reference": None}))
        else:
            self._said.set_text(f"The {self._mode.value}: all of the part in the plane through ({_shown(centre)}) mm.")
            self._take(**({"fixed": plane} if is_foot else {"top": plane, "reference": centre}))
        if is_foot:
            self._take_cables({name: self._led(cable.via) for name, cable in self._draft.cables.items()})
        self._draw()

    def _led(self, via: Sequence[Floats]) -> DraftCable:
        """The cable through these points to the fixed face, pulled behind it."""
        if len(via) < 2:
            return DraftCable(tuple(via))
        via = towards(via, self._draft.fixed)
        return DraftCable(via, pulled_behind(via))

    def _take_cables(self, cables: Mapping[str, DraftCable], current: str = "") -> None:
        """The draft with other cables, of which the points of one are shown."""
        self._take(cables=cables)
        name = current or str(self._cable.value)
        for choice in (self._cable, *self._pulled):
            choice.set_options([*cables], value=choice.value if choice.value in cables else name)
        for choice in self._pulled:
            choice.set_visibility(len(cables) > 1)
        self._cable.set_value(name)
        self._show_cable(name)

    def _show_cable(self, name: str) -> None:
        cable = self._draft.cables[name]
        self._name.set_value(name)
        points = [at for at in (*cable.via, cable.pulled_at) if at is not None]
        self._via.set_value("\n".join(map(_shown, points)))

    def _add_cable(self) -> None:
        """One more cable, whose bore is picked next."""
        number = next(k for k in count(2) if f"cable{k}" not in self._draft.cables)
        self._take_cables({**self._draft.cables, f"cable{number}": DraftCable()}, f"cable{number}")
        self._said.set_text(f"cable{number}: click its bore, or type its points below.")

    def _rename_cable(self, text: str) -> None:
        old, new = str(self._cable.value), name_of(text, "cable")
        if not text or new == old or new in self._draft.cables:
            return
        tests = tuple(replace(one, cable=new) if one.cable == old else one for one in self._draft.tests)
        self._take(tests=tests)
        self._take_cables({new if name == old else name: one for name, one in self._draft.cables.items()}, new)

    def _take_via(self, text: str) -> None:
        """The cable by the lines of its points."""
        points: list[Floats] = []
        for line in text.splitlines():
            try:
                numbers = [float(word) for word in line.replace(",", " ").split()]
            except ValueError:
                numbers = []
            if len(numbers) == 3 and np.isfinite(numbers).all():
                points.append(1e-3 * np.array(numbers))
            elif line.strip():
                self._said.set_text(f"Not a point of three numbers [mm]: {line.strip()}")
                return
        cable = DraftCable(tuple(points[:-1]), points[-1] if len(points) > 1 else None)
        self._take(cables={**self._draft.cables, str(self._cable.value): cable})
        self._draw()

    def _show_columns(self, file: str, columns: dict[str, str]) -> None:
        """The channels of a table; the likely columns are chosen when it is made a test."""
        from nicegui import ui

        kept = next((test for test in self._draft.tests if test.file == file), None)
        chosen = dict(likely_columns(columns) if kept is None else kept.columns)
        noise, fields = dict(kept.noise if kept is not None else {}), dict[str, Any]()

        def take() -> None:
            tests = [test for test in self._draft.tests if test.file != file]
            test = BenchTable(file, dict(chosen), dict(noise), str(cable.value or ""))
            if is_test.value and "tension" in chosen:
                tests.append(test)
            for channel, one in fields.items():
                one.set_visibility(channel in test.compared)
            missing.set_text("Choose the column of the tension." if is_test.value and "tension" not in chosen else "")
            self._take(tests=tuple(sorted(tests, key=lambda test: test.file)))

        def column(channel: str, header: str) -> None:
            if header == "none":
                chosen.pop(channel, None)
            else:
                chosen[channel] = (header, chosen.get(channel, ("", ""))[1])
            take()

        def unit(channel: str, text: str) -> None:
            if channel in chosen:
                chosen[channel] = (chosen[channel][0], text)
                take()

        def deviation(channel: str, text: str) -> None:
            noise[channel] = text
            take()

        is_test: Any = ui.checkbox("This is a test", value=kept is not None, on_change=take)
        missing = ui.label().classes("sc-note sc-warn")
        cables = [*self._draft.cables]
        at = kept.cable if kept is not None and kept.cable in cables else cables[0]
        cable = _choice("Cable that is pulled", cables, lambda _: take(), at)
        cable.set_visibility(len(cables) > 1)
        self._pulled.append(cable)
        with ui.element("div").classes("sc-pair"):
            for channel in CHANNELS:
                at = chosen.get(channel, ("none", ""))[0]
                _choice(channel, ["none", *columns], lambda header, channel=channel: column(channel, header), at)
                if not all(columns.values()):
                    _line("unit, if the header has none", chosen.get(channel, ("", ""))[1],
                          lambda text, channel=channel: unit(channel, text))  # fmt: skip
                if channel in NOISE:
                    fields[channel] = _line(f"noise of {channel} (sd)", noise.get(channel, NOISE[channel]),
                                            lambda text, channel=channel: deviation(channel, text))  # fmt: skip
        take()

    async def _check(self) -> None:
        """Check the draft where it has changed since the last time."""
        from nicegui import ui

        text = project_text(self._draft)
        if text == self._checked or not self._draft.mesh:
            return
        self._checked = text
        self._state.set_text("Checking …")
        found = await asyncio.to_thread(self._project.findings, self._draft)
        n = len(found.faults)
        self._state.set_text("No fault." if not n else "A fault:" if n == 1 else f"{n} faults:")
        self._state.classes(**{"remove" if n else "add": "sc-good"})
        self._findings.clear()
        with self._findings:
            for fault in found.faults:
                ui.label(fault).classes("sc-note sc-warn")
            for warning in found.warnings:
                ui.label(f"Warning: {warning}").classes("sc-note sc-warn")
            for part, said in found.rows:
                ui.label(f"{part.strip()}: {said}").classes("sc-note")

    def _write(self) -> None:
        """Write the project file, if there is none."""
        if not self._draft.mesh:
            self._written.set_text("Choose a part first.")
            return
        if (self._project.folder / PROJECT).exists():
            self._written.set_text(f"{PROJECT} is in the folder already, and was not replaced.")
            return
        try:
            write_new_file(self._project.folder / PROJECT, project_text(self._draft))
        except StorageError as error:
            self._written.set_text(str(error))
            return
        self._written.set_text(f"{PROJECT} is written. Next: softcal check {PROJECT}")


def serve_new(folder: Path, *, port: int | None, ready: Callable[[str], None]) -> None:
    """Serve the page of a folder, to this machine alone, until Ctrl-C or another signal.

    Parameters
    ----------
    folder
        Where the user's files are, and where the project file is written.
    port
        Any free one where 0; None for the first free one from 8085 on.
    ready
        Called with the page's address when it answers.

    Raises
    ------
    InputError
        Where the port cannot be had.
    KeyboardInterrupt
        When it is ended.
    """
    from softcal.plugins.watch.server import LOOPBACK, serve_application

    most = LIMITS["bytes of a mesh file"].most
    with tempfile.TemporaryDirectory(prefix="softcal-new-") as scratch:
        made = partial(application, folder, Path(scratch))
        serve_application(made, host=LOOPBACK, port=port, ready=ready, most_bytes=most)


def _card(width: str, title: str) -> Any:
    from nicegui import ui

    card = ui.element("section").classes(f"sc-card {width}")
    with card:
        ui.label(title).classes("sc-title")
    return card


def _choice(label: str, options: list[str], take: Callable[[str], Any], value: str | None = None) -> Any:
    from nicegui import ui

    element: Any = ui.select(options, label=label, value=value, on_change=lambda event: take(str(event.value)))
    return element.props(f'dense outlined options-dense data-choice="{label}"').classes("sc-input")


def _line(label: str, value: str, take: Callable[[str], None]) -> Any:
    from nicegui import ui

    element: Any = ui.input(label, value=value, on_change=lambda event: take(" ".join(str(event.value or "").split())))
    return element.props("dense outlined").classes("sc-input")


def _shown(at: Floats) -> str:
    return ", ".join(f"{round(1e3 * x, 2) + 0.0:g}" for x in at)
