"""The file that holds a map: a header and arrays.

It is a safetensors container: raw arrays behind a JSON header, read without executing anything, checked for truncation at load, mapped
into memory as it is, and readable from other languages. (HDF5 is a bigger dependency for the same arrays; npz has no place for settings
but pickled objects or arrays of text.)
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.files import known_errors, write_atomically

FORMAT = "panoloc-map/1"
# A larger file is not read but mapped: what is never looked at, such as references of other buildings, takes no memory.
_MAPPED_FROM = 200_000_000
_KINDS = {
    **{"F64": np.float64, "F32": np.float32, "F16": np.float16, "C64": np.complex64},
    **{"I64": np.int64, "I32": np.int32, "I16": np.int16, "I8": np.int8, "BOOL": np.bool_},
    **{"U64": np.uint64, "U32": np.uint32, "U16": np.uint16, "U8": np.uint8},
}

Tensors = dict[str, NDArray[Any]]


def write(path: Path, header: dict[str, Any], tensors: Tensors) -> None:
    """Write a map, whole or not at all.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    metadata = {"map": json.dumps({"format": FORMAT, **header}, sort_keys=True)}
    write_atomically(path, _container(metadata, tensors))


def _container(metadata: dict[str, str], tensors: Tensors) -> Iterator[bytes | memoryview]:
    """The parts of a safetensors file, one after the other: the library's own writer copies all arrays twice in memory.

    Larger items come first, so that each array lies where its items are aligned.
    """
    entries: dict[str, Any] = {"__metadata__": metadata}
    names = sorted(tensors, key=lambda name: (-tensors[name].itemsize, name))
    end = 0
    for name in names:
        array = tensors[name]
        begin, end = end, end + array.nbytes
        kind = next(kind for kind, known in _KINDS.items() if array.dtype == known)
        entries[name] = {"dtype": kind, "shape": array.shape, "data_offsets": (begin, end)}
    header = json.dumps(entries, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    yield len(header).to_bytes(8, "little") + header
    for name in names:
        yield np.ascontiguousarray(tensors[name]).reshape(-1).view(np.uint8).data


def read(path: Path) -> tuple[dict[str, Any], Tensors]:
    """Header and arrays of a map.

    Raises
    ------
    MapError
        Missing, truncated, not a map, or of a newer format.
    """
    with known_errors(MapError, path):
        found = path.is_file()
    if not found:
        raise MapError(f"{path}: no such map file; build one with: panoloc build-map DATASET -o {path}")
    try:
        with safe_open(path, framework="numpy") as container:
            header = _header_of(container.metadata() or {}, path)
            if path.stat().st_size > _MAPPED_FROM:
                return header, _mapped(path)
            return header, {name: container.get_tensor(name) for name in container.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, TypeError, LookupError) as error:
        raise MapError(
            f"{path}: not a map file, or cut short ({error}); check the path, or build it again with panoloc build-map"
        ) from error


def _mapped(path: Path) -> Tensors:
    """The arrays of a file, in memory as far as they are looked at; what is written to them is this process's own."""
    with path.open("rb") as file:
        begin = 8 + int.from_bytes(file.read(8), "little")
        entries = json.loads(file.read(begin - 8))
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    entries.pop("__metadata__", None)
    tensors: Tensors = {}
    for name, entry in entries.items():
        kind = np.dtype(_KINDS[entry["dtype"]])
        count = (entry["data_offsets"][1] - entry["data_offsets"][0]) // kind.itemsize
        tensors[name] = np.frombuffer(memory, kind, count, begin + entry["data_offsets"][0]).reshape(entry["shape"])
    return tensors


def part(tensors: Tensors, name: str) -> Tensors:
    """The arrays whose names begin with a part's, without it."""
    return {key.removeprefix(f"{name}."): array for key, array in tensors.items() if key.startswith(f"{name}.")}


def kept_masks(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Masks of the references as the file keeps them: one (rows, columns) where all are the same."""
    return valid[0] if valid.strides[0] == 0 or bool((valid == valid[0]).all()) else valid


def masks(kept: NDArray[np.bool_] | None, count: int) -> NDArray[np.bool_] | None:
    """Masks of so many references, (count, rows, columns), from what `kept_masks` gave."""
    if kept is None or kept.ndim == 3:
        return kept
    return np.broadcast_to(kept, (count, *kept.shape))


def _header_of(metadata: dict[str, str], path: Path) -> dict[str, Any]:
    try:
        header = json.loads(metadata.get("map", "{}"))
    except ValueError as error:
        raise MapError(f"{path}: the map's header is damaged ({error}); build it again with panoloc build-map") from error
    found = header.get("format") if isinstance(header, dict) else None
    if not isinstance(header, dict) or found != FORMAT:
        raise MapError(f"{path}: format is '{found}', this version reads '{FORMAT}'; build the map again")
    return header
