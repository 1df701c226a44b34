"""Files that lie: refused before they cost memory, and what only looks damaged is read."""

import io
import os
import struct
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot import files
from panoloc_mcl.robot.errors import ConfigError, ImageError, OutputError
from panoloc_mcl.robot.files import CACHE_VARIABLE, cache_folder, read_arrays, write_arrays, write_atomically
from panoloc_mcl.robot.images import image_size, read_image, write_image


def picture(dtype=np.uint8, shape=(40, 60)):
    rng = np.random.default_rng(0)
    smooth = cv2.resize(rng.random((8, 12)), shape[::-1], interpolation=cv2.INTER_CUBIC)
    return (np.clip(smooth, 0.0, 1.0) * np.iinfo(dtype).max).astype(dtype)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
@pytest.mark.parametrize("behind", [0, 100, 5000, 300_000])
def test_what_stands_behind_the_end_of_an_image_does_not_matter(ending, behind, tmp_path):
    path = tmp_path / f"motion{ending}"
    write_image(path, picture())
    whole = read_image(path)
    path.write_bytes(path.read_bytes() + b"\x00\x00\x00\x18ftypmp42" + bytes(behind))
    assert np.array_equal(read_image(path), whole)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_cut_off_images_are_still_found(ending, share, tmp_path):
    path = tmp_path / f"cut{ending}"
    write_image(path, picture())
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ImageError, match="cut off"):
        read_image(path)


def test_a_thumbnail_does_not_stand_for_the_image(tmp_path):
    path = tmp_path / "a.jpg"
    write_image(path, picture())
    data = path.read_bytes()
    small = cv2.imencode(".jpg", picture(shape=(8, 12)))[1].tobytes()
    exif = b"\xff\xe1" + struct.pack(">H", len(small) + 2) + small
    path.write_bytes(data[:2] + exif + data[2:])
    assert image_size(path) == (60, 40)
    whole = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert whole is not None
    assert np.array_equal(read_image(path), whole)
    path.write_bytes((data[:2] + exif + data[2:])[:-200])
    with pytest.raises(ImageError, match="cut off"):
        read_image(path)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_images_of_fewer_bits_are_as_bright(bits, tmp_path):
    full = picture(np.uint16)
    full[0, 0] = 65535
    write_image(tmp_path / "a.png", full >> (16 - bits))
    assert np.abs(read_image(tmp_path / "a.png").astype(int) - full).max() <= 65535 // ((1 << bits) - 1) + 1


def test_an_image_that_says_it_is_huge_is_not_decoded(tmp_path):
    path = tmp_path / "huge.png"
    write_image(path, picture())
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 100_000, 100_000)
    path.write_bytes(bytes(data))
    with pytest.raises(ImageError, match="100000 x 100000 pixels"):
        read_image(path)


@given(st.binary(max_size=300), st.integers(0, 3))
@settings(max_examples=500, deadline=None)
def test_no_bytes_make_the_reader_of_images_fail(tmp_path_factory, data, kind):
    path = tmp_path_factory.getbasetemp() / "fuzz"
    path.write_bytes([b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0", b"\xff\xd8\xff\xda"][kind] + data)
    for read in (read_image, image_size):
        try:
            read(path)
        except ImageError as error:
            assert len(error.faults) == 1  # noqa: PT017 both are right answers


def damaged(path, change):
    """The archive with its arrays' part changed."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    parts["a.npy"] = change(parts["a.npy"])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)


def lying(content):
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    return out.getvalue() + content[-24:]


def with_objects(content):
    out = io.BytesIO()
    np.lib.format.write_array(out, np.array([{"a": 1}], dtype=object))
    return out.getvalue()


@pytest.mark.parametrize(
    "change", [lying, with_objects, lambda content: content[:40], lambda content: b"", lambda content: content[:-4]]
)
def test_arrays_that_lie_are_refused_before_they_take_memory(change, tmp_path):
    path = tmp_path / "state.npz"
    write_arrays(path, {"format": "x"}, {"a": np.arange(3.0)})
    assert read_arrays(path)[1]["a"].tolist() == [0.0, 1.0, 2.0]
    damaged(path, change)
    with pytest.raises(ValueError, match="not written by this program"):
        read_arrays(path)


def test_an_archive_that_unpacks_to_more_than_it_is_is_refused(tmp_path):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("header.npy", bytes(10_000_000))
    with pytest.raises(ValueError, match="in a file of"):
        read_arrays(path)


@pytest.mark.slow
@given(st.data())
@settings(max_examples=300, deadline=None)
def test_no_damage_to_a_state_is_more_than_a_known_error(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "fuzzed.npz"
    write_arrays(path, {"format": "x", "n": [1, 2]}, {"a": np.arange(30.0), "b": np.ones((2, 3), np.uint8)})
    content = bytearray(path.read_bytes())
    for position in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4)):
        content[position] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))]))
    try:
        read_arrays(path)
    except ValueError as error:
        assert "\n" not in str(error)  # noqa: PT017 both are right answers


def test_a_name_as_long_as_the_file_system_allows_can_be_written(tmp_path):
    path = tmp_path / ("n" * 250)
    write_atomically(path, "x")
    assert path.read_text() == "x"
    for name in ("n" * 300, "a\0b"):
        with pytest.raises(OutputError, match="cannot be written"):
            write_atomically(tmp_path / name, "x")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_the_old_file_stays_whole_when_writing_is_cut_short(error, tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    write_atomically(path, "old")

    def fail(handle):
        raise error

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises((KeyboardInterrupt, OutputError), match=r"No space left|^$"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]  # noqa: PTH208 hidden ones, too


def test_the_cache_of_a_user_without_a_home(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, "~nobody-of-that-name/x")
    with pytest.raises(ConfigError, match="PANOLOC_CACHE_DIR = ~nobody-of-that-name/x: there is no such home"):
        cache_folder()
    monkeypatch.delenv(CACHE_VARIABLE)
    monkeypatch.setattr(files, "user_cache_path", lambda *args, **kwargs: Path("~/.cache/panoloc_mcl"))
    assert cache_folder().is_absolute()
