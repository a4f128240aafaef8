"""The camera file: the result of `softcal camera`, with units, readable and used by `softcal markers`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from softcal.errors import Fault, ProjectFileError
from softcal.plugins.markers.camera import Camera
from softcal.plugins.markers.charuco import Calibration
from softcal.project.document import Findings
from softcal.project.section import Section, validated
from softcal.project.yaml_file import read_document
from softcal.quantities import QUANTITIES

FORMAT = 1

Pixels = Annotated[float, QUANTITIES["pixel"]]
Focal = Annotated[float, QUANTITIES["focal length"]]
Width = Annotated[float, QUANTITIES["width in pixels"]]
Distortion = Annotated[float, QUANTITIES["distortion coefficient"]]


class MatrixSection(Section):
    """Focal lengths and principal point."""

    fx: Focal
    fy: Focal
    cx: Pixels
    cy: Pixels


class DistortionSection(Section):
    """Brown's coefficients."""

    k1: Distortion = 0.0
    k2: Distortion = 0.0
    p1: Distortion = 0.0
    p2: Distortion = 0.0
    k3: Distortion = 0.0


class CameraSection(Section):
    """The part of a camera file needed to use the camera; the rest documents the calibration."""

    camera: int
    resolution: tuple[Width, Width]
    matrix: MatrixSection
    distortion: DistortionSection = DistortionSection()
    reprojection_error: Annotated[float, QUANTITIES["reprojection error"]] | None = None
    calibration: dict[str, Any] | None = None


def read_camera(path: Path) -> Camera:
    """The camera in a camera file.

    Raises
    ------
    ProjectFileError
        With everything that is wrong in the file.
    StorageError
        Where it cannot be read.
    """
    keys = "camera, resolution, matrix, distortion"
    document = read_document(path, "camera file", keys, "softcal camera IMAGES writes one")
    findings = Findings(document)
    section = validated(CameraSection, dict(document.data), (), findings)
    if section is not None and section.camera != FORMAT:
        findings.add(("camera",), "the format is not known", got=repr(section.camera)[:60], allowed=str(FORMAT))
    if section is not None:
        for i, number in enumerate(section.resolution):
            if number != round(number):
                findings.add(("resolution", i), "the resolution must be in whole pixels", got=f"{number:g} px")
    findings.raise_if_any()
    if section is None:
        raise ProjectFileError(Fault("the camera file is incomplete", document.name))
    m, d = section.matrix, section.distortion
    matrix = np.array([[m.fx, 0.0, m.cx], [0.0, m.fy, m.cy], [0.0, 0.0, 1.0]])
    width, height = (round(number) for number in section.resolution)
    for key, centre, size in (("cx", m.cx, width), ("cy", m.cy, height)):
        if not -size <= centre <= 2 * size:
            findings.add(("matrix", key), "the principal point is far off the image", got=f"{centre:g} px")
    camera = Camera(width, height, matrix, np.array([d.k1, d.k2, d.p1, d.p2, d.k3]))
    if not camera.is_reversible:
        shown = ", ".join(f"{key} {value:g}" for key, value in section.distortion.model_dump().items())
        findings.add(
            ("distortion",), "the distortion is not invertible: a pixel has several directions or none", got=shown
        )
    findings.raise_if_any()
    return camera


def camera_text(calibration: Calibration, board: str, skipped: Sequence[str] = ()) -> str:
    """The text of a camera file.

    Parameters
    ----------
    calibration
        The calibration.
    board
        Description of the board.
    skipped
        Images in which it was not found.
    """
    camera = calibration.camera
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    k1, k2, p1, p2, k3 = (f"{value:.9g}" for value in camera.distortion)
    focal_sd, centre_sd = (", ".join(f"{v:.3g} px" for v in sd) for sd in (calibration.focal_sd, calibration.centre_sd))
    images = [f"    {_quoted(image)}: {rms:.4g} px" for image, rms in calibration.rms_by_image.items()]
    return "\n".join(
        [
            "# A calibrated camera (pinhole with Brown's distortion, in OpenCV's order and conventions).",
            f"camera: {FORMAT}",
            f"resolution: [{camera.width} px, {camera.height} px]",
            f"matrix: {{fx: {fx:.9g} px, fy: {fy:.9g} px, cx: {cx:.9g} px, cy: {cy:.9g} px}}",
            f"distortion: {{k1: {k1}, k2: {k2}, p1: {p1}, p2: {p2}, k3: {k3}}}",
            f"reprojection_error: {calibration.rms:.4g} px  # rms over all images",
            "calibration:",
            f"  made_by: softcal {version('softcal')}",
            f"  board: {_quoted(board)}",
            f"  focal_length_sd: [{focal_sd}]",
            f"  principal_point_sd: [{centre_sd}]",
            f"  coverage: {calibration.coverage:.3g}  # share of the image in which the board was seen",
            "  images:  # with the reprojection error of each",
            *images,
            f"  skipped: [{', '.join(_quoted(image) for image in skipped)}]  # the board was not found in these",
            "",
        ]
    )


def _quoted(text: str) -> str:
    """Text as a YAML scalar in double quotes."""
    return json.dumps(text, ensure_ascii=False)
