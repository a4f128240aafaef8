"""What is of the right kind and hostile: laws by their energy, images and camera files, shared studies, and scores and
predictions of a benchmark.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import struct
import threading
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from faults.case import Case, End, assert_proper, parts
from faults.hostile import HOSTILE, Place, attacked, holding, in_place
from project_case import write_project
from test_bad_camera_files import BASE, BASES, CAMERA, CAMERAS

CHECK = ("check", "project.yaml", "--no-solve", "--no-pictures")
SOLVED = "solved"  # in the place of a message, where nothing is wrong

# Laws of a project file
NEO, MODULI = "mu/2*(I1_bar - 3)", "{mu: modulus, kappa: modulus}"


def with_law(keys: Mapping[str, str], name: str = "own") -> Callable[[Path], object]:
    """Writes the small project with a law of its own; keys: text by key, in the place of those of a good one."""
    law = {"energy": f'"{NEO}"', "constants": MODULI, **keys}
    text = f"laws:\n  {name}:\n" + "".join(f"    {key}: {value}\n" for key, value in law.items() if value)
    return lambda folder: write_project(
        folder,
        ("robot:\n", f"{text}robot:\n"),
        (
            "      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n",
            f"      law: {name}\n      mu: 0.7 MPa\n      kappa: 4 MPa\n",
        ),
        ("  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n", ""),
    )


def doubling(step: str, count: int, first: str = "I1_bar - 3") -> str:
    """Symbols each of which has the last one several times."""
    symbols = ", ".join(f'a{k}: "{step.replace("X", f"a{k - 1}")}"' for k in range(1, count))
    return f'{{a0: "{first}", {symbols}}}'


# Energy -> what is said of it.
ENERGIES: Mapping[str, tuple[str, str]] = {
    "a tower of powers": (f"{NEO} + 0*9**9**9**9**9", "too large"),
    "a tower of a symbol": (f"{NEO} + 0*mu**mu**mu**mu**mu**mu**mu**mu", SOLVED),
    "a power in brackets": (f"{NEO}*((2**64)**64)**64/((2**64)**64)**64", "too"),
    "a power of sums": ("mu*(1+J+I1+I2)**999*(I1_bar - 3)", ""),
    "a power of a fraction": (f"{NEO} + 0*(1/3)**99999999", "too"),
    "a negative power": (f"{NEO} + 0*2**(-99999999999)", "too"),
    "a power of a decimal": (f"{NEO} + 0*1.0000001**(10**15)", ""),
    "a product of long numbers": (f"{NEO} + 0*" + "*".join(["9" * 400] * 40), ""),
    "a number of many digits": (f"{NEO} + 0*" + "9" * 20_000, ""),
    "a number too large": (f"{NEO}*1e999", "too large"),
    "a number too small": (f"{NEO}*1e-999", ""),
    "a factorial": ("mu/2*(I1_bar - 3) + 0*factorial(99999999)", "no such"),
    "a binomial": (f"{NEO} + 0*binomial(10**9, 10**8)", "no such"),
    "a sum without end": (f"{NEO} + Sum(1/J**k, (k, 1, oo))", ""),
    "an integral": ("Integral(mu, J)", ""),
    "many brackets": ("(" * 5000 + NEO + ")" * 5000, ""),
    "brackets that do not end": ("(" * 3000, ""),
    "many signs": ("-" * 5000 + NEO, ""),
    "many functions": ("exp(" * 80 + "J" + ")" * 80, ""),
    "functions of functions": ("mu*(log(" + "cosh(" * 12 + "J" + ")" * 12 + ") - 1)", ""),
    "many terms": ("+".join(f"mu/{k}*(I1_bar - 3)**{k}" for k in range(2, 400)), ""),
    "a text of a megabyte": (f"{NEO}" + " + 0*J" * 140_000, ""),
    "nothing": ("", "energy"),
    "blanks": ("   ", "energy"),
    "a comma": (f"{NEO},", "energy"),
    "a tuple": (f"({NEO}, {NEO})", "energy"),
    "a list": (f"[{NEO}]", "energy"),
    "a comparison": ("mu > J", "energy"),
    "an equation": (f"W = {NEO}", "energy"),
    "a walrus": (f"(W := {NEO})", "energy"),
    "a condition": (f"{NEO} if J > 1 else 0", "energy"),
    "a comprehension": ("sum(mu for k in range(9**9))", "energy"),
    "a lambda": ("(lambda: mu)()", "energy"),
    "an attribute": ("mu.__class__", "energy"),
    "an attribute of a number": ("(1).__class__.__base__.__subclasses__()", "energy"),
    "an entry": ("mu[0]", "energy"),
    "an f-string": ("f'{mu}'", "energy"),
    "a text": ("'mu'", "energy"),
    "bytes": ("b'mu'", "energy"),
    "an import": ("__import__('os').system('touch owned')", "energy"),
    "eval": ("eval('open(chr(47))')", "energy"),
    "open": ("open('owned', 'w')", "energy"),
    "a decorator": ("@mu", "energy"),
    "two statements": (f"{NEO}; import os", "energy"),
    "await": ("await mu", "energy"),
    "a star": ("exp(*mu)", "energy"),
    "a keyword": ("exp(J, evaluate=False)", "energy"),
    "too many arguments": ("mu*exp(J, J, J)", "energy"),
    "no argument": ("mu*exp()", "energy"),
    "a function that is none": ("mu*mu(J)", "energy"),
    "S of a text": ("S('__import__')", "energy"),
    "a truth": ("True", "energy"),
    "nobody": ("None", "energy"),
    "an ellipsis": ("...", "energy"),
    "a complex number": ("mu*1j*(I1_bar - 3)", "energy"),
    "the root of a negative": ("mu*sqrt(-2 - J**2)*(I1_bar - 3)", "energy"),
    "the logarithm of a negative": ("mu*log(-1)*(I1_bar - 3)", "energy"),
    "infinite": ("mu*oo*(I1_bar - 3)", "energy"),
    "not a number": ("mu*nan*(I1_bar - 3)", "energy"),
    "a pole at rest": ("mu/(I1_bar - 3)", "energy"),
    "a division by zero": ("mu/0*(I1_bar - 3)", "energy"),
    "zero by zero": ("mu*(0/0)*(I1_bar - 3)", "energy"),
    "a hidden zero": ("mu/(J - J)*(I1_bar - 3)", "energy"),
    "zero to the power of zero": (f"{NEO}*0**0", SOLVED),
    "zero to a negative power": (f"{NEO}*0**(-1)", "energy"),
    "a logarithm of zero": ("mu*log(J - J)*(I1_bar - 3)", "energy"),
    "a floor division": ("mu//2*(I1_bar - 3)", "energy"),
    "a remainder": ("mu % 2*(I1_bar - 3)", "energy"),
    "bits": ("mu ^ 2", "energy"),
    "a matrix product": ("mu @ J", "energy"),
    "zero": ("0", "energy"),
    "a constant": ("1", "energy"),
    "an unknown symbol": ("mu*(I1_bar - 3) + q", "symbol"),
    "a dunder": ("__builtins__", "energy"),
    "letters of another script": ("μ/2*(I1_bar - 3)", "energy"),
    "digits of another script": ("mu/٢*(I1_bar - 3)", "energy"),
    "a minus of typography": ("mu/2*(I1_bar − 3)", "energy"),
    "a blank of no width": ("mu\\u200b/2*(I1_bar - 3)", "energy"),
    "right to left": ("\\u202emu/2*(I1_bar - 3)", "energy"),
    "NUL": ("mu\\0/2*(I1_bar - 3)", "energy"),
    "half a pair": ("mu\\ud800/2*(I1_bar - 3)", ""),
    "a line break": ("mu/2\\n*(I1_bar - 3)", ""),
    "a backslash": ("mu\\\\\\n/2*(I1_bar - 3)", SOLVED),
    "a comment": (f"{NEO} # and more", SOLVED),
    "an escape": ("mu\\e[2J*(I1_bar - 3)", "energy"),
    "marks of a template": ("{{ mu }}%s{0}", "energy"),
}
# Keys of a law -> what is said.
LAWS: Mapping[str, tuple[dict[str, str], str]] = {
    "symbols that double": ({"energy": "mu/2*a24", "symbols": doubling("X+X*J", 25)}, "laws"),
    "symbols that square": ({"energy": "mu/2*a24", "symbols": doubling("X*X", 25)}, "laws"),
    "symbols in functions": ({"energy": "mu/2*a15", "symbols": doubling("exp(X)-log(X)", 16)}, "laws"),
    "a thousand symbols": ({"energy": "mu/2*a999", "symbols": doubling("X", 1000)}, SOLVED),
    "symbols in a ring": ({"symbols": '{a: "b", b: "c", c: "a"}'}, "leads back"),
    "a symbol of a number": ({"symbols": "{a: 7}"}, ""),
    "a symbol of nothing": ({"symbols": "{a: ''}"}, "laws"),
    "a symbol of null": ({"symbols": "{a: null}"}, "laws"),
    "a symbol of a list": ({"symbols": "{a: [1]}"}, "laws"),
    "symbols of a list": ({"symbols": "[a, b]"}, "laws"),
    "a symbol with a dunder": ({"symbols": '{__class__: "J"}'}, SOLVED),
    "a symbol with a dot": ({"symbols": '{"a.b": "J"}'}, "laws"),
    "a symbol of blanks": ({"symbols": '{" ": "J"}'}, "laws"),
    "a symbol of a number's name": ({"symbols": '{7: "J"}'}, "laws"),
    "a symbol of a keyword": ({"symbols": '{lambda: "J"}'}, "laws"),
    "a symbol of another script": ({"symbols": '{"ſ": "J"}'}, "laws"),
    "a symbol like a constant": ({"symbols": '{mu: "J"}'}, "laws"),
    "a symbol like an invariant": ({"symbols": '{J: "I1"}'}, "laws"),
    "a symbol like a function": ({"symbols": '{exp: "J"}'}, "laws"),
    "no constants": ({"constants": "{}"}, "laws"),
    "constants of a list": ({"constants": "[mu, kappa]"}, "laws"),
    "constants of null": ({"constants": "null"}, "laws"),
    "a constant of no kind": ({"constants": "{mu: '', kappa: modulus}"}, "laws"),
    "a constant of a number": ({"constants": "{mu: 7, kappa: modulus}"}, "laws"),
    "a constant of a section": ({"constants": "{mu: {a: b}, kappa: modulus}"}, "laws"),
    "a constant with a dunder": ({"constants": "{mu: modulus, kappa: modulus, __init__: ratio}"}, ""),
    "a constant called self": ({"constants": "{mu: modulus, kappa: modulus, self: ratio}"}, ""),
    "a constant called law": ({"constants": "{mu: modulus, kappa: modulus, law: ratio}"}, "laws"),
    "a constant of a keyword": ({"constants": "{mu: modulus, kappa: modulus, class: ratio}"}, "laws"),
    "a constant of a sentence": ({"constants": "{mu: modulus, kappa: modulus, a b c: ratio}"}, "laws"),
    "a constant of a long name": ({"constants": "{mu: modulus, kappa: modulus, %s: ratio}" % ("a" * 5000)}, ""),
    "a constant like an invariant": ({"constants": "{mu: modulus, kappa: modulus, I1: ratio}"}, "laws"),
    "a constant of another script": ({"constants": "{mu: modulus, kappa: modulus, ﬁ: ratio}"}, "laws"),
    "two thousand constants": ({"constants": f"{{mu: modulus, {', '.join(f'c{k}: ratio' for k in range(2000))}}}"}, ""),
    "no bulk": ({"bulk": "''"}, "laws"),
    "a bulk of a list": ({"bulk": "[kappa]"}, "laws"),
    "a bulk below zero": ({"bulk": "-kappa"}, "laws"),
    "a bulk that is complex": ({"bulk": "kappa*sqrt(-1)"}, "laws"),
    "a bulk of code": ({"bulk": "__import__('os').getcwd()"}, "laws"),
    "a bulk of towers": ({"bulk": "kappa**9**9**9**9"}, ""),
    "a bulk of another constant": ({"bulk": "lame"}, "laws"),
    "a bulk that is infinite": ({"bulk": "kappa/(mu - mu)"}, "laws"),
    "a volume strain of code": ({"volumetric_strain": "J.__class__"}, "laws"),
    "a volume strain with a pole": ({"volumetric_strain": "1/(J - 1)"}, "laws"),
    "a volume strain of one": ({"volumetric_strain": "'1'"}, "laws"),
    "a volume strain of towers": ({"volumetric_strain": "J**9**9**9 - 1"}, "laws"),
    "a volume strain of logarithms": ({"volumetric_strain": "log(log(log(J)))"}, "laws"),
    "a reference of a list": ({"reference": "[a]"}, "laws"),
    "a reference with an escape": ({"reference": '"\\e[2J<script>"'}, SOLVED),
    "an energy that is a list": ({"energy": "[mu]"}, "laws"),
    "an energy of a section": ({"energy": "{mu: 1}"}, "laws"),
    "an energy of null": ({"energy": "null"}, "laws"),
    "an energy of a number": ({"energy": "7"}, "laws"),
    "no energy": ({"energy": ""}, "laws"),
}  # fmt: skip
NAMES: Mapping[str, tuple[str, str]] = {
    "a dunder": ("__class__", SOLVED),
    "a keyword": ("class", SOLVED),
    "a number": ("7", ""),
    "null": ("null", ""),
    "a sentence": ("'a b c'", SOLVED),
    "a path": ("'../../x'", SOLVED),
    "blanks": ("'  '", "laws"),
    "nothing": ("''", ""),
    "another script": ("'ﬁbre'", SOLVED),
    "an escape": ('"\\e[2J"', ""),
    "a name of the catalogue": ("ogden-4", "another law of this name"),
    "a long name": ("a" * 5000, ""),
}


def ended(says: str) -> tuple[End, ...]:
    return ("solved",) if says == SOLVED else ("refused",)


LAW_CASES = [
    Case("law", what, CHECK, ended(says), files, rf"project\.yaml.*{says}")
    for what, files, says in (
        *((f"an energy of {what}", with_law({"energy": f'"{text}"'}), says) for what, (text, says) in ENERGIES.items()),
        *((what, with_law(keys), says) for what, (keys, says) in LAWS.items()),
        *((f"called {what}", with_law({}, name), says) for what, (name, says) in NAMES.items()),
    )
]


@pytest.mark.parametrize("case", parts(LAW_CASES))
def test_a_hostile_law(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)


# Images, and the files that measurements from them need
def encoded(suffix: str, shape: tuple[int, ...] = (480, 640), kind: type = np.uint8, fill: int = 255) -> bytes:
    return cv2.imencode(suffix, np.full(shape, fill, kind))[1].tobytes()


def picture() -> bytes:
    """Markers 0 and 1 on white, 640 x 480 px."""
    sheet = np.full((480, 640), 255, np.uint8)
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, left in ((0, 100), (1, 400)):
        sheet[180:300, left : left + 120] = cv2.aruco.generateImageMarker(markers, number, 120)
    return cv2.imencode(".png", sheet)[1].tobytes()


def png(*chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG file of chunks, each with its sum."""
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(held)) + name + held + struct.pack(">I", zlib.crc32(name + held)) for name, held in chunks
    )


def header(width: int, height: int, depth: int = 8, colour: int = 0, interlace: int = 0) -> tuple[bytes, bytes]:
    return b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlace)


END = (b"IEND", b"")


def blanks(width: int, height: int, depth: int = 8, colour: int = 0, interlace: int = 0) -> bytes:
    """A PNG of black, whose data are as many as its size wants."""
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]
    packed, row = zlib.compressobj(9), bytes(1 + width * channels * depth // 8)
    data = b"".join(packed.compress(row) for _ in range(height)) + packed.flush()
    palette = [(b"PLTE", bytes(3))] if colour == 3 else []
    return png(header(width, height, depth, colour, interlace), *palette, (b"IDAT", data), END)


def webp(width: int, height: int) -> bytes:
    """A WebP file of one colour, whose pixels take no bits."""
    bits = f"{width - 1:014b}"[::-1] + f"{height - 1:014b}"[::-1] + "0" + "000" + "000" + "1000" * 5
    body = b"\x2f" + int(bits[::-1], 2).to_bytes(-(-len(bits) // 8) + 8, "little")
    chunk = b"VP8L" + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)
    return b"RIFF" + struct.pack("<I", 4 + len(chunk)) + b"WEBP" + chunk


def tiff(width: int, height: int, bits: int = 8, rows: int | None = None) -> bytes:
    """A TIFF file of one strip, without its data."""
    tags = {
        256: width,
        257: height,
        258: bits,
        259: 1,
        262: 1,
        273: 8,
        277: 1,
        278: height if rows is None else rows,
        279: 64,
    }
    held = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(tags.items()))
    return b"II*\0" + struct.pack("<I", 80) + bytes(72) + struct.pack("<H", len(tags)) + held + bytes(4)


WHOLE = picture()
IMAGES: Mapping[str, tuple[str, bytes]] = {
    "no markers": (".png", encoded(".png")),
    "another size": (".png", encoded(".png", (48, 64))),
    "one pixel": (".png", encoded(".png", (1, 1))),
    "no pixels": (".png", png(header(0, 0), (b"IDAT", zlib.compress(b"")), END)),
    "no rows": (".png", png(header(640, 0), (b"IDAT", zlib.compress(b"")), END)),
    "a row of a million": (".png", blanks(1_000_000, 1)),
    "a column of a million": (".png", blanks(1, 1_000_000)),
    "2e8 pixels of 200 kB": (".png", blanks(15_000, 14_000)),
    "6e7 pixels of 16 bits": (".png", blanks(8000, 8000, 16)),
    "6e7 pixels in colour": (".png", blanks(8000, 8000, 8, 6)),
    "6e7 pixels, interlaced": (".png", blanks(8000, 8000, 8, 0, 1)),
    "a size of 4e9": (".png", png(header(60_000, 60_000), (b"IDAT", zlib.compress(bytes(1000))), END)),
    "a size of 2e18": (".png", png(header(2**31 - 1, 2**31 - 1), (b"IDAT", zlib.compress(bytes(1000))), END)),
    "a size beyond all": (".png", png(header(2**32 - 1, 2**32 - 1), (b"IDAT", b""), END)),
    "16 bits": (".png", encoded(".png", kind=np.uint16)),
    "transparency": (".png", encoded(".png", (480, 640, 4))),
    "a palette": (".png", blanks(640, 480, 8, 3)),
    "a palette that is missing": (".png", png(header(640, 480, 8, 3), (b"IDAT", zlib.compress(bytes(641 * 480))), END)),
    "a depth of 7 bits": (".png", png(header(640, 480, 7), (b"IDAT", zlib.compress(bytes(641 * 480))), END)),
    "data of a gigabyte": (".png", png(header(640, 480), (b"IDAT", zlib.compress(bytes(200_000_000), 9)), END)),
    "text of a gigabyte": (
        ".png",
        png(
            header(640, 480),
            (b"zTXt", b"a\0\0" + zlib.compress(bytes(200_000_000), 9)),
            (b"IDAT", zlib.compress(bytes(641 * 480))),
            END,
        ),
    ),
    "a chunk of 4 GB": (".png", png(header(640, 480)) + b"\xff\xff\xff\xffIDAT"),
    "a filter that is none": (".png", png(header(640, 480), (b"IDAT", zlib.compress(b"\x09" * 641 * 480)), END)),
    "no data": (".png", png(header(640, 480), END)),
    "a header alone": (".png", png(header(640, 480))),
    "a signature alone": (".png", png()),
    "frames of an animation": (
        ".png",
        png(
            header(640, 480),
            (b"acTL", struct.pack(">II", 2**31 - 1, 0)),
            (b"IDAT", zlib.compress(bytes(641 * 480))),
            END,
        ),
    ),
    "half of it": (".png", WHOLE[: len(WHOLE) // 2]),
    "all but its last bytes": (".png", WHOLE[:-20]),
    "a wrong sum": (".png", WHOLE[:60] + bytes([WHOLE[60] ^ 255]) + WHOLE[61:]),
    "a WebP of 3e8 pixels": (".webp", webp(16_383, 16_383)),
    "a WebP of 6e7 pixels": (".webp", webp(8000, 8000)),
    "half a WebP": (".webp", encoded(".webp")[:30]),
    "half a JPEG": (".jpg", encoded(".jpg")[:300]),
    "a JPEG of 4e9 pixels": (".jpg", encoded(".jpg").replace(struct.pack(">HH", 480, 640), b"\xff\xf0\xff\xf0")),
    "a TIFF of 4e18 pixels": (".tif", tiff(2**31 - 1, 2**31 - 1)),
    "a TIFF of 1e9 pixels": (".tif", tiff(32_000, 32_000)),
    "a TIFF of 64 bits": (".tif", tiff(8000, 8000, 64)),
    "a TIFF that leads to itself": (".tif", b"II*\0\x08\0\0\0" + struct.pack("<H", 0) + struct.pack("<I", 8)),
    "a TIFF of many strips": (".tif", tiff(640, 480, rows=0)),
    "a PGM of 1e10 pixels": (".pgm", b"P5\n99999 99999\n255\n" + bytes(1000)),
    "a PGM of no sense": (".pgm", b"P5\n" + b"9" * 5000 + b"\n"),
    "a PGM in letters": (".pgm", b"P2\n640 480\n255\n" + b"7 " * 5000),
    "a bitmap of 4e18 pixels": (".bmp", encoded(".bmp")[:18] + b"\xff\xff\xff\x7f" * 2 + encoded(".bmp")[26:]),
    "a bitmap upside down": (".bmp", encoded(".bmp")[:22] + struct.pack("<i", -(2**31)) + encoded(".bmp")[26:]),
    "a picture of rays": (".png", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n" + bytes(1000)),
    "a picture of a phone": (".png", b"\0\0\0\x1cftypavif" + bytes(400)),
    "a GIF": (".png", b"GIF89a\xff\xff\xff\xff\xf0\0\0" + bytes(400)),
    "JPEG 2000": (".png", b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(400)),
    "SVG": (".png", b'<svg xmlns="http://www.w3.org/2000/svg"><image href="file:///etc/passwd"/></svg>'),
}  # fmt: skip
MARKERS = ("--camera", "camera.yaml", "--base", "0", "--size", "20 mm", "--out", "markers.csv")


def bench(image: str = "b_02.png") -> Callable[[Path], None]:
    """Writes two images of a bench, the second of a name, the camera's file and one of the base."""

    def files(folder: Path) -> None:
        for name in ("a_01.png", image):
            (folder / name).write_bytes(WHOLE)
        (folder / "camera.yaml").write_text(CAMERA)
        (folder / "base.yaml").write_text(BASE)

    return files


def replaced(name: str, text: str, old: str, new: str) -> Callable[[Path], None]:
    assert old in text
    return attacked(bench(), name, holding(text.replace(old, new).encode("utf-8", "surrogatepass")))


IMAGE_COMMANDS = {
    "markers": ("markers", "a_01.png", "b_02{}", *MARKERS),
    "board": ("camera", "a_01.png", "b_02{}", "--out", "own.yaml"),
}
IMAGE_CASES = [
    *(
        Case(
            f"image of {door}", what, tuple(word.format(suffix) for word in words), ("refused",),
            attacked(bench(f"b_02{suffix}"), f"b_02{suffix}", place), rf"b_02\{suffix}",
        )
        for door, words in IMAGE_COMMANDS.items()
        for what, (suffix, place) in {
            **{what: (".png", place) for what, place in HOSTILE.items()},
            **{what: (suffix, holding(raw)) for what, (suffix, raw) in IMAGES.items()},
            "a folder of devices": (
                ".png", in_place(lambda path: [path.mkdir(), (path / "c.png").symlink_to("/dev/zero")]),
            ),
            "a link to nothing": (".png", in_place(lambda path: path.symlink_to("nothing"))),
        }.items()
    ),
]  # fmt: skip
# Key of a file -> what stands there; those that are not refused above all.
CAMERA_VALUES: Mapping[str, tuple[str, str]] = {
    "a resolution of many pixels": ("640 px, 480 px", "1e9 px, 1e9 px"),
    "a resolution of three": ("640 px, 480 px", "640 px, 480 px, 3 px"),
    "a resolution that is not finite": ("640 px", ".nan px"),
    "a focal length of an atom": ("fx: 600 px", "fx: 1e-9 px"),
    "a focal length of many digits": ("fx: 600 px", f"fx: {'9' * 5000} px"),
    "focal lengths that differ a lot": ("fx: 600 px", "fx: 1e9 px"),
    "a distortion without end": ("k1: 0.1", "k1: .inf"),
    "distortions that cancel": ("k1: 0.1, k2: -0.05", "k1: 1e12, k2: -1e12"),
    "a distortion of text": ("k1: 0.1", "k1: much"),
    "a distortion of a list": ("{k1: 0.1, k2: -0.05, p1: 0.001, p2: 0, k3: 0}", "[0.1, -0.05]"),
    "no distortion but a null": ("{k1: 0.1, k2: -0.05, p1: 0.001, p2: 0, k3: 0}", "null"),
    "a matrix of null": ("{fx: 600 px, fy: 601 px, cx: 321 px, cy: 239 px}", "null"),
    "an error that is not finite": ("0.2 px", ".inf px"),
    "a calibration of a list": ("camera: 1", "camera: 1\ncalibration: [1]"),
    "a key twice": ("camera: 1", "camera: 1\ncamera: 1"),
    "an object of Python": ("camera: 1", "camera: !!python/name:os.system"),
    "a key of no text": ("camera: 1", "camera: 1\n? [a]\n: 1"),
    "a link in the text": ("camera: 1", "camera: &a [*a]"),
    "a tab": ("camera: 1", "\tcamera: 1"),
    "half a pair": ("camera: 1", "camera: 1\nx: \ud800"),
}
BASE_VALUES: Mapping[str, tuple[str, str]] = {
    "a marker that no dictionary has": ("  5:", f"  {'9' * 400}:"),
    "a marker twice": ("  5:", "  0:"),
    "a marker of another script": ("  5:", "  ٥:"),
    "a marker with a sign": ("  5:", "  +5:"),
    "a marker of blanks": ("  5:", "  ' 5':"),
    "a size of an atom": ("size: 30 mm", "size: 1e-30 m"),
    "a size beyond all": ("size: 30 mm", "size: 1e30 m"),
    "a turn beyond all": ("90 deg", "1e300 deg"),
    "a list of markers": (BASE.partition("markers:")[2], " [0, 5]\n"),
    "null": (BASE.partition("markers:")[2], " null\n"),
    "an anchor in itself": ("base: 1", "base: &a [*a]"),
}
FILE_CASES = [
    Case(
        f"{name.partition('.')[0]} file", what, ("markers", "a_01.png", *MARKERS, *options), ("refused",), files,
        name.partition(".")[0],
    )
    for name, options, text, values in (
        ("camera.yaml", (), CAMERA, {**{k: v[:2] for k, v in CAMERAS.items()}, **CAMERA_VALUES}),
        ("base.yaml", ("--base", "base.yaml"), BASE, {**{k: v[:2] for k, v in BASES.items()}, **BASE_VALUES}),
    )
    for what, files in {
        **{what: attacked(bench(), name, place) for what, place in HOSTILE.items()},
        **{what: replaced(name, text, old, new) for what, (old, new) in values.items()},
    }.items()
]  # fmt: skip


@pytest.mark.parametrize("case", parts([*IMAGE_CASES, *FILE_CASES]))
def test_a_hostile_image_or_camera_file(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)


def test_the_images_that_are_attacked_can_be_measured(tmp_path: Path) -> None:
    assert_proper(Case("image", "whole", ("markers", "a_01.png", *MARKERS), ("solved",), bench()), tmp_path)


# Studies that processes share
TPE = ("calibration: {method: least-squares, starts: 1}", "calibration: {method: tpe, trials: 3}")
STUDY = "study.journal"
SHARED = ("calibrate", "project.yaml", "--storage", f"journal:{STUDY}", "--no-report", "--out")
Lines = list[dict[str, Any]]
Edit = Callable[[Lines], object]
ABOUT, NEW, VALUE, OUTCOME, STATE = (
    1,
    2,
    3,
    5,
    6,
)  # lines of a journal: the study's record, and those of its first trial


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose study is shared."""
    folder = tmp_path_factory.mktemp("shared")
    assert_proper(Case("shared study", "whole", (*SHARED, "run"), ("solved",), lambda f: write_project(f, TPE)), folder)
    return folder / "case"


def lined(edit: Edit) -> Place:
    """Changes the lines of a journal."""

    def place(path: Path) -> None:
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        edit(lines)
        path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))

    return place


def line(number: int, **values: object) -> Place:
    """Sets entries of a line."""
    return lined(lambda lines: lines[number].update(values))


def outcome_with(**values: object) -> Place:
    """Sets entries of what the first trial gave."""
    return lined(lambda lines: lines[OUTCOME]["user_attr"]["softcal"].update(values))


def about_with(**values: object) -> Place:
    """Sets entries of what the study is."""
    return lined(lambda lines: lines[ABOUT]["user_attr"]["softcal"].update(values))


def raw(change: Callable[[bytes], bytes]) -> Place:
    """Changes the bytes of a journal."""
    return lambda path: [path.write_bytes(change(path.read_bytes()))][0] and None


def others(path: Path) -> None:
    """The study of another program's."""
    path.write_text(
        '{"op_code":0,"worker_id":"a","study_name":"softcal/a square bar/pull","directions":[1]}\n'
        '{"op_code":4,"worker_id":"a","study_id":0,"datetime_start":"2026-01-01T00:00:00"}\n'
    )


REFUSED: tuple[End, ...] = ("refused",)
# What is wrong with a journal -> the change of a whole one, and the ends that are proper.
JOURNALS: Mapping[str, tuple[Place, tuple[End, ...]]] = {
    "another program's study": (others, REFUSED),
    "a study of two aims": (line(0, directions=[1, 2]), REFUSED),
    "a study to be maximised": (line(0, directions=[2]), REFUSED),
    "a study of no aim": (line(0, directions=[]), REFUSED),
    "an aim of text": (line(0, directions="down"), REFUSED),
    "a name of a number": (line(0, study_name=7), ("refused", "solved")),
    "a study twice": (lined(lambda lines: lines.insert(1, lines[0])), ("refused", "solved")),
    "an unknown code": (line(NEW, op_code=77), REFUSED),
    "a code of text": (line(NEW, op_code="x"), REFUSED),
    "a code of null": (line(NEW, op_code=None), REFUSED),
    "a code below zero": (line(NEW, op_code=-1), REFUSED),
    "no code": (lined(lambda lines: lines[NEW].pop("op_code")), REFUSED),
    "no worker": (lined(lambda lines: lines[NEW].pop("worker_id")), REFUSED),
    "a worker of a list": (line(NEW, worker_id=[1]), ("refused", "solved")),
    "a beginning of text": (line(NEW, datetime_start="yesterday"), REFUSED),
    "a trial that is not there": (line(VALUE, trial_id=99), REFUSED),
    "a value of text": (line(VALUE, param_value_internal="much"), REFUSED),
    "a value that is not a number": (line(VALUE, param_value_internal=float("nan")), REFUSED),
    "a value that is infinite": (line(VALUE, param_value_internal=float("inf")), REFUSED),
    "a value out of its bounds": (line(VALUE, param_value_internal=1e300), REFUSED),
    "a value of null": (line(VALUE, param_value_internal=None), REFUSED),
    "a parameter of another name": (line(VALUE, param_name="nobody"), REFUSED),
    "a parameter of a number": (line(VALUE, param_name=7), REFUSED),
    "a distribution of text": (line(VALUE, distribution="wide"), REFUSED),
    "a distribution of nothing": (line(VALUE, distribution="{}"), REFUSED),
    "a distribution of another kind": (
        line(VALUE, distribution='{"name": "CategoricalDistribution", "attributes": {"choices": [1]}}'),
        REFUSED,
    ),
    "a distribution that is upside down": (
        line(
            VALUE,
            distribution='{"name": "FloatDistribution", "attributes": {"step": null, "low": 9, "high": 1, "log": 1}}',
        ),
        REFUSED,
    ),
    "no outcome": (lined(lambda lines: lines.pop(OUTCOME)), REFUSED),
    "an outcome of null": (line(OUTCOME, user_attr={"softcal": None}), REFUSED),
    "an outcome of a list": (line(OUTCOME, user_attr={"softcal": [1]}), REFUSED),
    "an outcome of nothing": (line(OUTCOME, user_attr={"softcal": {}}), REFUSED),
    "an outcome in pieces that are missing": (line(OUTCOME, user_attr={"softcal": {"pieces": 10**9}}), REFUSED),
    "an outcome in pieces of text": (line(OUTCOME, user_attr={"softcal": {"pieces": "x"}}), REFUSED),
    "attributes of a list": (line(OUTCOME, user_attr=[1]), REFUSED),
    "seconds of text": (outcome_with(seconds="long"), REFUSED),
    "seconds that are not a number": (outcome_with(seconds=float("nan")), REFUSED),
    "seconds below zero": (outcome_with(seconds=-1), REFUSED),
    "solves of a fraction": (outcome_with(n_solves=0.5), REFUSED),
    "solves beyond all": (outcome_with(n_solves=10**400), REFUSED),
    "a reason of a list": (outcome_with(reason=[1]), REFUSED),
    "a reason of escapes": (outcome_with(reason="\x1b[2J<script>"), ("refused", "solved")),
    "losses of a list": (outcome_with(experiment_losses=[1]), REFUSED),
    "losses that are not numbers": (outcome_with(experiment_losses={"pull": float("nan")}), REFUSED),
    "losses of another experiment": (outcome_with(experiment_losses={"nobody": 1.0}), ("refused", "solved")),
    "errors of text": (outcome_with(errors="none"), REFUSED),
    "an outcome with more": (outcome_with(more=1), ("refused", "solved")),
    "a loss that is not a number": (line(STATE, values=[float("nan")]), REFUSED),
    "a loss that is infinite": (line(STATE, values=[float("-inf")]), REFUSED),
    "a loss below zero": (line(STATE, values=[-1e300]), ("refused", "solved")),
    "two losses": (line(STATE, values=[1.0, 2.0]), REFUSED),
    "a loss of text": (line(STATE, values=["low"]), REFUSED),
    "no loss": (line(STATE, values=None), REFUSED),
    "a state that is none": (line(STATE, state=77), REFUSED),
    "a state of text": (line(STATE, state="done"), REFUSED),
    "an end twice": (lined(lambda lines: lines.insert(STATE, lines[STATE])), ("refused", "solved")),
    "a format of the future": (about_with(format=2), REFUSED),
    "a format of text": (about_with(format="1"), REFUSED),
    "an identity of a list": (about_with(identity=[1]), REFUSED),
    "another robot": (about_with(identity={"robot": "0"}), REFUSED),
    "no identity": (about_with(identity={}), REFUSED),
    "settings of null": (about_with(settings=None), REFUSED),
    "other settings": (about_with(settings={"seed": 9}), REFUSED),
    "settings that are not numbers": (about_with(settings={"seed": float("nan")}), REFUSED),
    "a record of text": (line(ABOUT, user_attr={"softcal": "mine"}), REFUSED),
    "a record in endless pieces": (line(ABOUT, user_attr={"softcal": {"pieces": 10**12}}), REFUSED),
    "lines of a number": (raw(lambda text: text + b"7\n"), REFUSED),
    "lines of null": (raw(lambda text: text + b"null\n"), REFUSED),
    "lines of a list": (raw(lambda text: text + b"[1]\n"), REFUSED),
    "lines that are empty": (raw(lambda text: text + b"\n\n"), REFUSED),
    "an empty line between": (raw(lambda text: text.replace(b"\n", b"\n\n", 1)), REFUSED),
    "ends of lines of Windows": (raw(lambda text: text.replace(b"\n", b"\r\n")), ("refused", "solved")),
    "NUL between": (raw(lambda text: text.replace(b"\n", b"\n" + bytes(4000), 1)), REFUSED),
    "NUL at the end": (raw(lambda text: text + bytes(4000) + b"\n"), REFUSED),
    "noise at the end": (raw(lambda text: text + np.random.default_rng(1).bytes(4000) + b"\n"), REFUSED),
    "noise between": (raw(lambda text: text.replace(b"\n", b"\n\xff\xfe\n", 1)), REFUSED),
    "half a line between": (raw(lambda text: text.replace(b"\n", b'\n{"op_code"\n', 1)), REFUSED),
    "brackets without end": (raw(lambda text: text + b"[" * 100_000 + b"\n"), REFUSED),
    "braces without end between": (
        raw(lambda text: text.replace(b"\n", b"\n" + b'{"a":' * 100_000 + b"\n", 1)), REFUSED,
    ),
    "a number of many digits": (raw(lambda text: text + b'{"op_code":' + b"9" * 10_000 + b"}\n"), REFUSED),
    "a line of forty megabytes": (
        raw(lambda text: text + b'{"op_code":4,"a":"' + b"x" * 40_000_000 + b'"}\n'), REFUSED,
    ),
    "UTF-16": (raw(lambda text: text.decode().encode("utf-16")), REFUSED),
    "a mark of the order of bytes": (raw(lambda text: b"\xef\xbb\xbf" + text), REFUSED),
    "half a pair": (raw(lambda text: text.replace(b"softcal/a", b"softcal/a\\ud800")), ("refused", "solved")),
    "two gigabytes after its lines": (lambda path: os.truncate(path, 2 << 30), REFUSED),
}  # fmt: skip
STUDY_CASES = [
    Case("shared study", f"{what}, {how}", (*SHARED, *words), ends, says="journal")
    for how, words in (("joined", ("again",)), ("resumed", ("run", "--resume")))
    for what, ends in {
        **{what: ("refused", "solved") if what in ("nothing", "NUL", "no file") else REFUSED for what in HOSTILE},
        **{what: ends for what, (_, ends) in JOURNALS.items()},
    }.items()
]


@pytest.mark.parametrize("case", parts(STUDY_CASES))
def test_a_journal_of_a_stranger(case: Case, shared: Path, tmp_path: Path) -> None:
    what = case.name.rpartition(", ")[0]
    place = JOURNALS[what][0] if what in JOURNALS else HOSTILE[what]

    def files(folder: Path) -> None:
        shutil.copytree(shared, folder, dirs_exist_ok=True)
        place(folder / STUDY)

    assert_proper(Case(case.door, case.name, case.run, case.ends, files, case.says), tmp_path)


SECRET = "hunter2"
POSTGRES, MYSQL = f"postgresql+pg8000://me:{SECRET}", f"mysql+pymysql://me:{SECRET}@127.0.0.1:1/d"
URLS = (
    "", ":", "journal", "journal:", "journal: ", "journal:/", "journal:/dev/zero", "journal:/proc/self/mem",
    "journal:nobody/study", f"journal:{'x' * 5000}", "journal:\0", "journal:project.yaml", "journal:data",
    f"sqlite:///{SECRET}.db", f"redis://me:{SECRET}@127.0.0.1", f"file:///etc/passwd?{SECRET}",
    f"http://me:{SECRET}@127.0.0.1/x",
    f"postgresql://me:{SECRET}", f"postgresql:me:{SECRET}@h/d", f"postgresql+nobody://me:{SECRET}@h/d",
    f"{POSTGRES}@127.0.0.1:1/d", f"{POSTGRES}@127.0.0.1:99999/d",
    f"{POSTGRES}@127.0.0.1:-1/d", f"{POSTGRES}@127.0.0.1:port/d",
    f"{POSTGRES}@{'h' * 300}/d", f"{POSTGRES}@nobody.invalid/d",
    f"{POSTGRES}@[::1]:1/d", f"{POSTGRES}@[::/d", f"{POSTGRES}@/d",
    f"{POSTGRES}@192.0.2.1/d", f"{POSTGRES}/@@127.0.0.1/d",
    f"postgresql+pg8000://{SECRET}%00@127.0.0.1:1/d", f"postgresql+pg8000://me:%zz{SECRET}@127.0.0.1:1/d",
    f"postgresql+pg8000://me@127.0.0.1:1/d?password={SECRET}", f"postgresql+pg8000://me@127.0.0.1:1/d?nobody={SECRET}",
    f"{POSTGRES}@127.0.0.1:1/{{d}}", f"{POSTGRES}\udcff@127.0.0.1:1/d",
    MYSQL, f"{MYSQL}?charset=nobody",
    f"{MYSQL}?read_timeout=x", f"{MYSQL}?local_infile=1",
    f"{MYSQL}?init_command={SECRET}", f"{MYSQL}?ssl_ca=/dev/zero",
    f"{MYSQL}?read_default_file=/etc/passwd", f"{MYSQL}?unix_socket=/dev/zero",
)  # fmt: skip
# What answers at the address of a database: bytes sent again and again, or None for silence.
SERVERS: Mapping[str, bytes | None] = {
    "silence": None,
    "an end at once": b"",
    "a page": b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "NUL": bytes(1 << 16),
    "noise": np.random.default_rng(1).bytes(1 << 16),
    "a message of 2 GB": b"NR\x7f\xff\xff\xff" + bytes(1 << 24),
    "a parameter of 2 GB": b"NS\x7f\xff\xff\xff" + bytes(1 << 24),
    "a packet of 16 MB": b"\xff\xff\xff\x00\x0a" + b"5" * (1 << 16),
}
DRIVERS = ("postgresql+pg8000", "mysql+pymysql")


def asked_of(answer: bytes | None, driver: str) -> Callable[[], object]:
    """Calibrates with a database at whose address something else answers."""

    def talk(listening: socket.socket) -> None:
        while True:
            peer, _ = listening.accept()
            with peer, contextlib.suppress(OSError):
                while answer:
                    peer.sendall(answer)

    def run() -> None:
        from softcal.cli import main

        listening = socket.create_server(("127.0.0.1", 0))
        if answer is not None:
            threading.Thread(target=talk, args=(listening,), daemon=True).start()
        url = f"{driver}://me:{SECRET}@127.0.0.1:{listening.getsockname()[1]}/d"
        main(["calibrate", "project.yaml", "--storage", url, "--out", "run"])

    return run


URL_CASES = [
    *(
        Case("storage", f"{i}, {url[:60]!r}", ("calibrate", "project.yaml", "--storage", url, "--out", "run"), REFUSED)
        for i, url in enumerate(URLS)
    ),
    *(
        Case("storage", f"{what} for {driver}", asked_of(answer, driver), REFUSED)
        for driver in DRIVERS
        for what, answer in SERVERS.items()
    ),
]


@pytest.mark.parametrize("case", parts(URL_CASES))
def test_a_storage_that_is_none_or_does_not_answer(case: Case, tmp_path: Path) -> None:
    unsaid = rf"\A(?!.*{SECRET}).*(--storage|cannot be reached|no journal|file)"
    assert_proper(replace(case, files=lambda folder: write_project(folder, TPE), says=unsaid), tmp_path)


# Scores of a benchmark: the text of the file, or keys in the place of those of a good one; what is said of it.
SCORE: Mapping[str, object] = {
    "case": "beam", "method": "m", "evaluations": 3, "wall_s": 1.0, "parameters": {"E": "1 MPa"}, "splits": {},
}  # fmt: skip
ERROR = {"rms": 1.0, "mean": 1.0, "most_95": 1.0, "largest": 1.0}
SPLIT = {"n_samples": 2, "points": {}, "all_points": None, "channels": {}, "coverage": None}
SHORT = r"(?=.{1,2000}\Z)"  # what a message has at most, whatever the length of a text that it shows
SCORES: Mapping[str, tuple[str | Mapping[str, object], str]] = {
    "parameters in a list": ({"parameters": [1]}, "parameters"),
    "a parameter that is a number": ({"parameters": {"E": 1}}, "parameters.E"),
    "a method of many levels": ('{"case": "beam", "method": ' + "[" * 50_000, "recursion"),
    "a method that is half a sign": ('{"case": "beam", "method": "\\ud800", "splits": {}}', "escape"),
    "a method of a megabyte": ({"method": "m" * 1_000_000}, "method: string should have at most 255"),
    "a count of many digits": ({"evaluations": 10**400}, "evaluations"),
    "a time below zero": ({"wall_s": -1.0}, "wall_s"),
    "a case that is a list": ({"case": ["beam"]}, "case"),
    "a split of another name": ({"splits": {"# a": SPLIT}}, "splits.# a"),
    "a key of a megabyte": ({"splits": {"a" * 1_000_000: SPLIT}}, "splits.a"),
    "a split that is a number": ({"splits": {"fit": 1}}, "splits.fit"),
    "an error that is no number": ({"splits": {"fit": {**SPLIT, "all_points": {**ERROR, "rms": "NaN"}}}}, "rms"),
    "an error without end": ({"splits": {"fit": {**SPLIT, "all_points": {**ERROR, "rms": 1e999}}}}, "Infinity|number"),
    "a channel that the case lacks": ({"splits": {"fit": {**SPLIT, "channels": {"nobody": ERROR}}}}, "nobody"),
}


def score_case(what: str) -> Case:
    content, says = SCORES[what]
    text = content if isinstance(content, str) else json.dumps({**SCORE, **content})
    page = ("bench", "page", ".", "--out", "page.md")
    return Case("score", what, page, files=lambda f: (f / "score.json").write_text(text), says=rf"(?s){SHORT}.*{says}")


@pytest.mark.parametrize("case", parts([score_case(what) for what in SCORES], every=3))
def test_a_hostile_score(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)


# Predictions of a benchmark: what stands for text in the measured values, and the options; what is said of them.
TABLES: Mapping[str, tuple[tuple[str, str], tuple[str, ...], str]] = {
    "a method of bytes": (("", ""), ("--method", "a\udcff"), "method"),
    "a method that steers the terminal": (("", "# method: \x1b]0;a\x07\n"), (), "method"),
    "a method of many characters": (("", f"# method: {'m' * 150_000}\n"), (), "150000 characters"),
    "a time of many characters": (("", f"# wall: {'s' * 150_000}\n"), (), "no wall time"),
    "a time below zero": (("", "# wall: -3 s\n"), (), "no wall time"),
    "a count of many characters": (("", f"# evaluations: {'x' * 150_000}\n"), (), "no count"),
    "a parameter of many characters": (("", f"# E = {'9' * 150_000}\n"), (), "150000 characters"),
    "a parameter's name of many characters": (("", f"# {'E' * 150_000} = 1\n"), (), "150000 characters"),
    "a parameter with many blanks": (("", f"# E = 1{' ' * 900_000}2\n"), (), "900002 characters"),
    "a column of many characters": (("M1.x", "M" * 100_000), (), "no such channel"),
    "a unit of many characters": (("M1.x [m]", f"M1.x [{'m' * 100_000}]"), (), "unit"),
    "a first column of many characters": (("sample,", f"{'s' * 100_000},"), (), "name the samples"),
}


def table_case(what: str) -> Case:
    change, options, says = TABLES[what]

    def files(folder: Path) -> None:
        (folder / "own.csv").write_text(measured("tentacle").replace(*change, 1), encoding="utf-8")

    score = ("bench", "score", "tentacle", "own.csv", "--out", "out", *options)
    return Case("table of predictions", what, score, files=files, says=rf"(?s){SHORT}.*{says}")


def measured(name: str, factor: float = 1.0) -> str:
    """The measured values of a case, times a factor, as a table of predictions."""
    from softcal.plugins.bench.case import CASES
    from softcal.plugins.bench.predictions import Predictions

    record = CASES[name].record()
    return Predictions(record.samples, {key: factor * held for key, held in record.channels.items()}).text(record.units)


def zeros(name: str) -> Case:
    def files(folder: Path) -> None:
        (folder / "own.csv").write_text(measured(name, 0.0))

    score = ("bench", "score", name, "own.csv", "--out", "out")
    return Case("table of predictions", f"zeros for {name}", score, files=files, says="positions are all at the origin")


TABLE_CASES = [
    *(table_case(what) for what in TABLES),
    *(zeros(name) for name in ("beam", "manipulator", "sorosim-steel", "sorosim-tpu", "tentacle")),
]


@pytest.mark.parametrize("case", parts(TABLE_CASES, every=3))
def test_a_hostile_table_of_predictions(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)
