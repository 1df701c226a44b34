"""A large map's file is mapped into memory: the same arrays, read where they are looked at."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.map import map_file

ARRAYS: dict[str, NDArray[Any]] = {
    "references.pixels": np.arange(60, dtype=np.uint8).reshape(3, 4, 5),
    "references.positions": np.linspace(0.0, 1.0, 6).reshape(3, 2),
    "references.valid": np.array([[True, False], [False, True]]),
    "model.coefficients": (np.arange(12) + 1j * np.arange(12)[::-1]).astype(np.complex64).reshape(4, 3),
    "model.energy": np.linspace(0.0, 1.0, 7).astype(np.float16),
    "model.used": np.arange(3),
    "model.spectra_real": np.ones((2, 3), dtype=np.float32),
    "model.retrieved": np.array([300]),
    "model.none": np.zeros((0, 4), dtype=np.float32),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    map_file.write(tmp_path / "map", {"name": "some"}, ARRAYS)
    return tmp_path / "map"


@pytest.mark.parametrize("mapped", [True, False])
def test_what_was_written_is_read(mapped: bool, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_file, "_MAPPED_FROM", 0 if mapped else 10**9)
    header, arrays = map_file.read(path)
    assert header["name"] == "some"
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        assert arrays[name].shape == array.shape
        assert np.array_equal(arrays[name], array)
        # Kernels are compiled for arrays of this kind.
        assert arrays[name].flags.c_contiguous
        assert arrays[name].flags.aligned
        assert arrays[name].flags.writeable


def test_writing_into_mapped_arrays_leaves_the_file_alone(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_file, "_MAPPED_FROM", 0)
    before = path.read_bytes()
    _, arrays = map_file.read(path)
    arrays["references.pixels"][:] = 0
    assert path.read_bytes() == before


def test_a_mapped_file_that_is_written_anew_keeps_what_was_read(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_file, "_MAPPED_FROM", 0)
    _, arrays = map_file.read(path)
    map_file.write(path, {"name": "other"}, {"references.pixels": np.zeros((1, 1, 1), dtype=np.uint8)})
    assert np.array_equal(arrays["references.pixels"], ARRAYS["references.pixels"])


@pytest.mark.parametrize("left", [4, 100, -1])
def test_a_large_file_that_is_cut_short_is_told(left: int, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_file, "_MAPPED_FROM", 0)
    path.write_bytes(path.read_bytes()[:left])
    with pytest.raises(MapError, match="cut short"):
        map_file.read(path)
