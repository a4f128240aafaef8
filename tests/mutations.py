"""Files changed at random, as disks, editors and copies that are cut off change them: a hypothesis strategy."""

from __future__ import annotations

import re
from collections.abc import Callable

from hypothesis import strategies as st

_TOKENS = (
    b"", b"nan", b"NaN", b"-inf", b"Infinity", b"1e400", b"-1", b"0", b"null", b"true", b"[]", b"{}", b"'", b'"', b",",
    b";", b"\n", b"\r", b"\t", b"\0", b"..", b"/etc/passwd", b"9" * 5000, b"[" * 2000, b"\xff\xfe", b"&a [*a]",
    b"!!int x", b"1 MPa", b"5 mm", "ä€".encode(),
)  # fmt: skip
_WORD = re.compile(rb"[\w.+-]+")

Mutation = Callable[[bytes], bytes]


def _flipped(place: float, bit: int) -> Mutation:
    def change(raw: bytes) -> bytes:
        i = int(place * len(raw))
        return raw[:i] + bytes([raw[i] ^ (1 << bit)]) + raw[i + 1 :] if i < len(raw) else raw

    return change


def _replaced(place: float, length: int, by: bytes) -> Mutation:
    def change(raw: bytes) -> bytes:
        i = int(place * len(raw))
        return raw[:i] + by + raw[i + length :]

    return change


def _word_replaced(place: float, by: bytes) -> Mutation:
    def change(raw: bytes) -> bytes:
        words = list(_WORD.finditer(raw))
        if not words:
            return by
        word = words[min(int(place * len(words)), len(words) - 1)]
        return raw[: word.start()] + by + raw[word.end() :]

    return change


def _moved(start: float, end: float, place: float) -> Mutation:
    """A piece of the file once more, elsewhere in it."""

    def change(raw: bytes) -> bytes:
        low, high = sorted((int(start * len(raw)), int(end * len(raw))))
        i = int(place * len(raw))
        return raw[:i] + raw[low : min(high, low + 4096)] + raw[i:]

    return change


_PLACES = st.floats(0.0, 1.0)
_ONE = st.one_of(
    st.builds(_flipped, _PLACES, st.integers(0, 7)),
    st.builds(_replaced, _PLACES, st.integers(0, 64), st.binary(max_size=64)),
    st.builds(_replaced, _PLACES, st.just(1 << 40), st.just(b"")),  # cut off
    st.builds(_word_replaced, _PLACES, st.sampled_from(_TOKENS)),
    st.builds(_moved, _PLACES, _PLACES, _PLACES),
)


def mutations() -> st.SearchStrategy[list[Mutation]]:
    """One to four changes, one after the other."""
    return st.lists(_ONE, min_size=1, max_size=4)


def mutated(raw: bytes, changes: list[Mutation]) -> bytes:
    """The bytes with all of the changes."""
    for change in changes:
        raw = change(raw)
    return raw
