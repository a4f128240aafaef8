"""Detection of ArUco markers in an image, with four refined corners each.

References
----------
Garrido-Jurado et al., Automatic generation and detection of highly reliable fiducial markers under occlusion, Pattern
Recognition 47 (2014).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.plugins.markers.camera import Camera, Image
from softcal.plugins.markers.edges import refine_corners
from softcal.plugins.markers.fiducials import find_dictionary, marker_modules


@dataclass(frozen=True)
class Detection:
    """The markers in an image.

    Attributes
    ----------
    corners
        Marker -> corners (4, 2) [px], clockwise from the upper left of the marker.
    unclear
        Detected markers without clear edges (partly hidden, out of focus, too small, or without a white margin).
    """

    corners: Mapping[int, Floats]
    unclear: tuple[int, ...] = ()


def detect_markers(image: Image, dictionary: str, camera: Camera, *, where: str = "image") -> Detection:
    """Find the markers of a dictionary.

    Parameters
    ----------
    image
        Grey image (height, width).
    dictionary
        Name of the markers' dictionary.
    camera
        The camera of the image.
    where
        Name of the image, for errors.

    Raises
    ------
    DatasetError
        If the image has another resolution than the camera, no marker, or a marker twice.
    """
    import cv2

    height, width = image.shape
    if (width, height) != (camera.width, camera.height):
        raise DatasetError(
            Fault(
                "the image has another resolution than the camera file",
                where,
                f"{width} x {height} px",
                f"{camera.width} x {camera.height} px",
                "a calibration of the camera at the resolution of the images (softcal camera)",
            )
        )
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(find_dictionary(dictionary), settings)
    squares, ids, _ = detector.detectMarkers(image)
    found = [] if ids is None else [int(one) for one in np.ravel(ids)]
    if not found:
        raise DatasetError(
            Fault(
                f"there is no marker of {dictionary} in the image",
                where,
                attempt="look at the image: sharp, lit, markers at least some 20 px wide with white around them, and "
                "--dictionary as they were printed",
            )
        )
    twice = sorted({one for one in found if found.count(one) > 1})
    if twice:
        raise DatasetError(
            [
                Fault(
                    f"marker {one} is in the image {found.count(one)} times",
                    where,
                    "centres at "
                    + ", ".join(
                        "({:.0f}, {:.0f}) px".format(*np.asarray(square, dtype=np.float64).reshape(4, 2).mean(axis=0))
                        for square, number in zip(squares, found, strict=True)
                        if number == one
                    ),
                    "each marker once",
                )
                for one in twice
            ]
        )
    modules = marker_modules(dictionary)
    sharp = {
        number: refine_corners(image, np.asarray(square, dtype=np.float64).reshape(4, 2), modules, camera)
        for number, square in sorted(zip(found, squares, strict=True), key=lambda pair: pair[0])
    }
    return Detection(
        {number: corners for number, corners in sharp.items() if corners is not None},
        tuple(number for number, corners in sharp.items() if corners is None),
    )
