"""Random damage to the bytes of a file."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
#: What numbers and words are replaced by, and what is put in between.
_NASTY = tuple(
    word.encode()
    for word in (
        *("nan", "-inf", "1e400", "-1", "0", "1e-320", "99999999999999999999", "0x1F", "360", "2.5", "010", "1:30", "1_000", "٣", "½"),
        *("", " ", "\t", "\r", "\n", "\0", '"', "'", ",", ";", ":", "#", "{", "}", "[", "]", "*a", "<<: *a"),
        *("&a [*a, *a]", "!!python/object:os.system"),
        *("null", "true", "~", "../../../../etc/passwd", "/dev/zero", "%s%n", "\ufeff", "\ud7ff", "é", "a" * 5000),
    )
)  # fmt: skip


def mutated(data: bytes, rng: np.random.Generator, other: bytes = b"") -> bytes:
    """A file's bytes with one damage or a few, of random kinds; many at once would hide each other.

    Parameters
    ----------
    data : bytes
    rng : numpy.random.Generator
    other : bytes
        Of another file, a part of which may be put in.

    Returns
    -------
    bytes
    """
    for _ in range(int(rng.geometric(0.7))):
        data = _KINDS[int(rng.integers(len(_KINDS)))](data, rng, other)
    return data


def _span(data: bytes, rng: np.random.Generator, most: int = 200) -> slice:
    begin = int(rng.integers(len(data) + 1))
    return slice(begin, begin + int(rng.integers(1, most)))


def _flip(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    if not data:
        return data
    position = int(rng.integers(len(data)))
    return data[:position] + bytes([data[position] ^ (1 << int(rng.integers(8)))]) + data[position + 1 :]


def _overwrite(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    span = _span(data, rng, 16)
    return data[: span.start] + rng.bytes(span.stop - span.start) + data[span.stop :]


def _remove(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    span = _span(data, rng)
    return data[: span.start] + data[span.stop :]


def _double(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    span = _span(data, rng)
    return data[: span.stop] + data[span] + data[span.stop :]


def _cut(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _insert(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at = int(rng.integers(len(data) + 1))
    return data[:at] + _NASTY[int(rng.integers(len(_NASTY)))] + data[at:]


def _other_number(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    numbers = list(_NUMBER.finditer(data[:20_000]))
    if not numbers:
        return _flip(data, rng, b"")
    match = numbers[int(rng.integers(len(numbers)))]
    return data[: match.start()] + _NASTY[int(rng.integers(len(_NASTY)))] + data[match.end() :]


def _swap_lines(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    lines = data.splitlines(keepends=True)
    if len(lines) < 2:
        return _double(data, rng, b"")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return b"".join(lines)


def _splice(data: bytes, rng: np.random.Generator, other: bytes) -> bytes:
    at = int(rng.integers(len(data) + 1))
    return data[:at] + other[_span(other, rng)] + data[at:]


_KINDS: tuple[Callable[[bytes, np.random.Generator, bytes], bytes], ...] = (
    _flip,
    _overwrite,
    _remove,
    _double,
    _cut,
    _insert,
    _other_number,
    _swap_lines,
    _splice,
)
