"""Write docs/neck.gif: the calibrated neck of examples/neck as its cable is pulled, and its tension beside the bench's.

Needs the extra `pictures`; takes two minutes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

import softcal
from softcal.report.scene import Scene, bending_camera, extent_points
from softcal.report.scene_render import render_scenes
from softcal.report.scene_twin import bending_axes, displacements, twin_parts
from softcal.report.style import BLUE, MUTED, ORANGE, house_style, new_figure
from softcal.report.twin_view import TwinView
from softcal.workflows.calibration import calibrated

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "neck.gif"
TEST = "pull_60mm"
N_FRAMES, FRAME, LAST = 40, 70, 1200  # and milliseconds of a frame, and of the last
SIZE, DPI = (7.2, 3.4), 100  # [in]


def main() -> None:
    """Calibrate all tests together, pull the twin as in the longest, draw."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    project = softcal.load(ROOT / "examples" / "neck" / "project.yaml")
    found = softcal.calibrate(project, fit="joint", seed=1).headline
    fit, slack = found.experiments[TEST], found.parameters[f"front.slack[{TEST}]"].value
    robot = calibrated(project, found).robot
    end = fit.measured["shortening"].max()
    protocol = softcal.pull(robot, "front", "shortening", end - slack, samples=N_FRAMES)
    response = softcal.simulate(robot, protocol, snapshots="samples")
    view = TwinView(robot, response.snapshots[0], response.snapshots[-1], response.tets)
    moved = [displacements(view.rest, shape) for shape in response.snapshots]
    largest = max(float(values.max()) for values in moved[-1].values())
    scenes = tuple(
        Scene("", twin_parts(view, shape, by, largest)[0], ())
        for shape, by in zip(response.snapshots, moved, strict=True)
    )
    camera = bending_camera(extent_points((scenes[0], scenes[-1])), *bending_axes(view))
    rendering = render_scenes(scenes, (camera,) * len(scenes))
    if rendering.note:
        raise SystemExit(rendering.note)
    shortening = 1e3 * (response.channels["front.shortening"] + slack)
    tension = response.channels["front.tension"]
    modulus = found.parameters["neck.youngs_modulus"]
    frames: list[Image.Image] = []
    with house_style():
        for k, picture in enumerate(rendering.pictures):
            figure = new_figure(*SIZE)
            figure.set_layout_engine("none")
            robot_axes = figure.add_axes((0.0, 0.02, 0.44, 0.96))
            robot_axes.imshow(picture)
            robot_axes.set_axis_off()
            axes = figure.add_axes((0.54, 0.16, 0.43, 0.72))
            axes.plot(1e3 * fit.measured["shortening"], fit.measured["tension"], ".", color=MUTED, label="bench")
            axes.plot(shortening[: k + 1], tension[: k + 1], color=BLUE, linewidth=2.0, label="twin")
            axes.plot(shortening[k], tension[k], "o", color=ORANGE)
            axes.set(xlim=(0, 1e3 * end * 1.03), ylim=(0, 1.1 * fit.measured["tension"].max()))
            axes.set_xlabel("cable pulled [mm]")
            axes.set_ylabel("tension [N]")
            low, high = (1e-6 * value for value in modulus.interval)
            axes.set_title(f"E = {1e-6 * modulus.value:.2f} MPa (95 %: {low:.2f} to {high:.2f} MPa)")
            axes.legend(loc="upper left")
            figure.set_dpi(DPI)
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
            frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    palette = frames[-1].quantize(128, method=Image.Quantize.MEDIANCUT)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    pauses = [FRAME] * (N_FRAMES - 1) + [LAST]
    drawn[0].save(PICTURE, save_all=True, append_images=drawn[1:], duration=pauses, loop=0, optimize=True)


if __name__ == "__main__":
    main()
