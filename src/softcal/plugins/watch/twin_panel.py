"""The twin at the best trial in three dimensions, to be turned with the mouse, with its colours explained."""

from __future__ import annotations

from typing import Any

from softcal.plugins.watch.twin import TwinShape
from softcal.plugins.watch.watched import WatchedSearch
from softcal.units import format_quantity

AWAY = (3.8, -10.6, 3.8)  # of the camera from the twin, which is 10 long
STILL, TURNED = 2, 20  # pictures in a second; without a graphics card each takes the browser a twentieth of one


class TwinPanel:
    """The elements of the view."""

    def __init__(self) -> None:
        from nicegui import ui

        ui.label("The twin at the best trial").classes("sc-title")
        camera = ui.scene.perspective_camera(fov=45, near=0.1, far=200)
        self._scene: Any = ui.scene(
            width=460, height=380, grid=False, camera=camera, background_color="#ffffff", click_events=[], fps=STILL
        ).classes("sc-scene")
        self._scene.on("pointerenter", lambda: self._draw(TURNED), args=[])
        self._scene.on("pointerleave", lambda: self._draw(STILL), args=[])
        self._scene.move_camera(*AWAY, 0, 0, 0, 0, 0, 1, duration=0)
        with ui.element("div").classes("sc-legend sc-hidden") as self._legend:
            ui.label("Displacement from rest: 0")
            ui.element("div").classes("sc-shades")
            self._largest = ui.label().props('data-fact="displacement"')
            ui.label("Lines: at rest. Turn with the mouse.")
        self._note = ui.label().classes("sc-note").props('data-fact="twin"')
        self._shown = ""

    def _draw(self, rate: int) -> None:
        """So many pictures in a second from now on: as often as a hand needs where the mouse is over the twin."""
        self._scene.props["fps"] = rate

    def show(self, search: WatchedSearch, shape: TwinShape | None, *, busy: bool) -> None:
        """Show a shape, or a sentence on why there is no shape.

        Parameters
        ----------
        search
            The calibration.
        shape
            The twin at its best trial; None where there is none.
        busy
            A newer shape is in work.
        """
        if shape is None:
            self._note.set_text(
                "Simulating the twin …" if busy else "" if search.best else "No trial was completed yet."
            )
            self._clear()
            return
        self._note.set_text(caption(search, shape))
        if not shape.glb:
            self._clear()
            return
        self._largest.set_text(format_quantity(shape.largest, "m", digits=3))
        self._legend.classes(remove="sc-hidden")
        if shape.name != self._shown:
            self._shown = shape.name
            self._scene.clear()
            # The view was measured when it came, which may have been before there was anything to show.
            self._scene.run_method("resize")
            with self._scene:
                self._scene.gltf(f"/twin/{shape.name}.glb")

    def _clear(self) -> None:
        self._legend.classes(add="sc-hidden")
        if self._shown:
            self._scene.clear()
            self._shown = ""


def caption(search: WatchedSearch, shape: TwinShape) -> str:
    """Caption of a shape: its trial, its load, and whether the shape of a better trial will follow."""
    if shape.trial is None:
        return shape.trouble or shape.title
    best = search.best
    better = best is not None and best.number != shape.trial
    later = f" Trial {best.number} is better, and is drawn next." if best is not None and better else ""
    return f"Trial {shape.trial}: {(shape.trouble or shape.title).removesuffix('.')}.{later}"


def fit_text(shape: TwinShape) -> str:
    """Caption of the figures of the fit: their trial, and the experiments that they lack."""
    of = f"Trial {shape.trial}." if shape.fits and shape.trial is not None else ""
    return f"{of} {shape.missing}".strip()
