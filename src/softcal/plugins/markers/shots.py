"""Image files: their grouping into states of the robot, and reading.

By name, `cable6_2kgf_01.png` and `cable6_2kgf_02.png` are images 01 and 02 of the state `cable6_2kgf`: a number at the
end, after `_`, `-` or a space, distinguishes images of one state. By folder, the images in one folder show one state.
By image, each shows its own.
"""

from __future__ import annotations

import contextlib
import glob
import io
import os
import re
import tempfile
import warnings
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from softcal.errors import DatasetError, Fault, InputError, StorageError
from softcal.extras import require_extra
from softcal.plugins.markers.camera import Image
from softcal.regular_file import not_a_file

require_extra("markers", "cv2", where="markers")

Grouping = Literal["name", "folder", "image"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm")

_LARGEST = 2**29  # bytes of a file
_TAIL = 2**16  # bytes at the end of a JPEG file that are searched for its end marker
_MOST_PIXELS = 2**26  # of an image, of which some decoders take eight bytes each
_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP", "PPM")  # Pillow's names of those of SUFFIXES

_ORIENTATION = 274  # a tag's number

_NUMBERED = re.compile(r"(?P<group>.*[^\W_].*?)[-_ ]+(?P<number>\d+)")


@dataclass(frozen=True)
class Shot:
    """An image. group: its state; number: distinguishes the images of a state, "" if there is only one."""

    path: Path
    group: str
    number: str


def find_shots(given: Sequence[str | Path], group_by: Grouping = "name") -> tuple[Shot, ...]:
    """The images given by files, folders (with one level of subfolders) and patterns such as `run1/*.png`.

    Raises
    ------
    InputError
        For an unknown grouping.
    StorageError
        If an argument matches no image; all of them are named.
    DatasetError
        If two images of one state have the same number.
    """
    if group_by not in get_args(Grouping):
        allowed = ", ".join(get_args(Grouping))
        raise InputError(Fault("unknown grouping of the images", "--group-by", f"'{group_by}'", allowed))
    faults: list[Fault] = []
    paths: dict[Path, None] = {}
    for one in given:
        path = Path(one).expanduser()
        if os.path.isfile(path):  # unlike Path.is_file, False for a path that the system cannot handle
            found = [path]
        elif os.path.isdir(path):
            found = _pictures(path.glob("*")) or _pictures(path.glob("*/*"))
        else:
            found = _pictures(Path(entry) for entry in glob.glob(str(path), recursive=True))
        if not found:
            kinds = ", ".join(suffix.lstrip(".") for suffix in SUFFIXES)
            faults.append(Fault("there is no image", str(one), allowed=f"a file, folder or pattern of {kinds}"))
        paths.update(dict.fromkeys(found))
    if not given:
        faults.append(Fault("no image is given", allowed="files, folders or patterns such as 'run1/*.png'"))
    if faults:
        raise StorageError(faults)
    shots: list[Shot] = []
    for path in paths:
        match = _NUMBERED.fullmatch(path.stem)
        number = match["number"] if match else ""
        if group_by == "folder":
            shots.append(Shot(path, path.absolute().parent.name, path.stem))
        elif group_by == "image" or match is None:
            shots.append(Shot(path, path.stem, number))
        else:
            shots.append(Shot(path, match["group"], number))
    first: dict[tuple[str, str], Shot] = {}
    for shot in shots:
        other = first.setdefault((shot.group, shot.number), shot)
        if other is not shot:
            faults.append(
                Fault(
                    f"two images have the same name and number in the state '{shot.group}'",
                    str(shot.path),
                    f"{other.path} as well",
                    attempt="--group-by folder, where each folder holds the images of one state",
                )
            )
    if faults:
        raise DatasetError(faults)
    return tuple(shots)


def read_image(path: Path) -> Image:
    """The image in grey, shape (height, width).

    Raises
    ------
    StorageError
        If the file cannot be read or contains no image.
    """
    import cv2

    if kind := not_a_file(path):
        raise StorageError(Fault("the image cannot be read", str(path), kind, "a regular file"))
    try:
        with path.open("rb") as file:
            is_large = os.fstat(file.fileno()).st_size > _LARGEST
            raw = b"" if is_large else file.read(_LARGEST)
    except OSError as error:
        raise StorageError(Fault("the image cannot be read", str(path), error.strerror or str(error))) from error
    if is_large:
        raise StorageError(Fault("the image is too large", str(path), allowed=f"{_LARGEST} bytes"))
    if raw.startswith(b"\xff\xd8") and b"\xff\xd9" not in raw[-_TAIL:]:
        raise StorageError(Fault("the image is cut off", str(path), f"{len(raw)} bytes", "a whole JPEG file"))
    data = np.frombuffer(raw, dtype=np.uint8)
    # A photo's orientation tag is not applied: the calibration refers to the sensor's pixels.
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_ANYDEPTH
    n_images, is_turned = _stated(raw)
    if is_turned:  # which OpenCV applies whatever the flags say
        attempt = "save it without its tag of orientation, such as .png"
        raise StorageError(Fault("the image states that it is turned", str(path), attempt=attempt))
    if n_images > 1:
        raise StorageError(Fault("the file holds several images", str(path), str(n_images), "one image a file"))
    with _error_output() as said:
        try:
            image = cv2.imdecode(data, flags) if n_images else None
        except (cv2.error, MemoryError):
            image = None
    # libjpeg fills what is missing with grey, shifts what follows, and says so there alone.
    rest = re.search(rb"(\d+) extraneous bytes before marker 0xd9", said[0])
    is_padded = rest and not raw[: raw.rfind(b"\xff\xd9")][-int(rest[1]) :].strip(b"\0\xff")
    if b"Corrupt JPEG data" in said[0] and not is_padded:
        image = None
    if image is not None and image.dtype == np.uint16:  # of which a camera of 10 or 12 bits uses a part
        image = cv2.convertScaleAbs(image, alpha=255.0 / max(int(image.max()), 1))
    elif image is not None and image.dtype != np.uint8:
        image = None
    if image is None:
        allowed = f"a whole image of at most {_MOST_PIXELS} pixels"
        raise StorageError(Fault("the file holds no image that can be read", str(path), f"{data.size} bytes", allowed))
    return np.asarray(image, dtype=np.uint8)


@contextlib.contextmanager
def _error_output() -> Generator[list[bytes]]:
    """Context that hides the error output of C libraries; after the block it has the text."""
    said: list[bytes] = []
    try:
        kept = os.dup(2)
    except OSError:  # it is closed
        kept = os.open(os.devnull, os.O_WRONLY)
    try:
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), 2)
            try:
                yield said
            finally:
                os.dup2(kept, 2)
            file.seek(0)
            said.append(file.read())
    finally:
        os.close(kept)


def _stated(raw: bytes) -> tuple[int, bool]:
    """How many images a file says that it has, 0 where their size cannot be decoded (OpenCV takes the memory that any
    names), and whether it is a .tiff that is to be shown turned.
    """
    from PIL import Image

    with warnings.catch_warnings(action="ignore"):  # Pillow's own limit is another
        try:
            with Image.open(io.BytesIO(raw), formats=_FORMATS) as image:
                # A telephone's MPO is a JPEG with a preview behind it.
                n = 1 if image.format == "MPO" else getattr(image, "n_frames", 1)
                is_turned = image.format == "TIFF" and image.getexif().get(_ORIENTATION, 1) != 1
                image.verify()  # that the parts of a PNG are whole
                return n if image.width * image.height <= _MOST_PIXELS else 0, is_turned
        except Exception:  # noqa: BLE001 (whatever the reader of a format raises)
            return 0, False


def _pictures(entries: Iterable[Path]) -> list[Path]:
    return sorted(path for path in entries if path.suffix.lower() in SUFFIXES and path.is_file())
