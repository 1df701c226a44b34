from pathlib import Path

import cv2
import numpy as np
import pytest

from panoloc_mcl.robot.errors import ImageError, OutputError
from panoloc_mcl.tools.datasets import image_size, read_image, write_image

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("shape", [(7, 5), (7, 5, 3), (7, 5, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_is_kept_as_it_is(tmp_path: Path, shape: tuple[int, ...], dtype: type) -> None:
    image: np.ndarray = RNG.integers(0, np.iinfo(dtype).max, shape, dtype=dtype)
    write_image(tmp_path / "a.png", image)
    back = read_image(tmp_path / "a.png")
    assert back.dtype == dtype
    assert np.array_equal(back, image)
    assert image_size(tmp_path / "a.png") == (5, 7)


@pytest.mark.parametrize("shape", [(64, 48), (64, 48, 3)])
def test_jpeg(tmp_path: Path, shape: tuple[int, ...]) -> None:
    write_image(tmp_path / "a.jpg", np.full(shape, 100, dtype=np.uint8))
    assert read_image(tmp_path / "a.jpg").shape == shape
    assert image_size(tmp_path / "a.jpg") == (48, 64)


def png(tmp_path: Path) -> bytes:
    write_image(tmp_path / "whole.png", RNG.integers(0, 255, (40, 40), dtype=np.uint8))
    return (tmp_path / "whole.png").read_bytes()


def test_cut_off_damaged_and_foreign_files_are_refused(tmp_path: Path) -> None:
    whole = png(tmp_path)
    middle = len(whole) // 2
    cases = [
        ("cut off", whole[:middle]),
        ("neither a PNG nor a JPEG", b"GIF89a" + whole),
        ("cannot be decoded", whole[:20] + whole[-12:]),
        ("cannot be decoded", whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]),
    ]
    for words, data in cases:
        path = tmp_path / "bad.png"
        path.write_bytes(data)
        with pytest.raises(ImageError) as caught:
            read_image(path)
        (fault,) = caught.value.faults
        assert fault.startswith(f"{path}: ")
        assert words in fault


def test_a_cut_off_jpeg_is_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "a.jpg", RNG.integers(0, 255, (64, 64), dtype=np.uint8))
    data = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "a.jpg").write_bytes(data[: len(data) // 2])
    with pytest.raises(ImageError, match="cut off"):
        read_image(tmp_path / "a.jpg")


def test_missing_file(tmp_path: Path) -> None:
    for read in (read_image, image_size):
        with pytest.raises(ImageError, match="no such file; add it"):
            read(tmp_path / "none.png")


def test_headers_that_are_no_images(tmp_path: Path) -> None:
    for data in (b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0\x00\x04ab", b"hello, this is not an image at all"):
        (tmp_path / "x.jpg").write_bytes(data)
        with pytest.raises(ImageError, match="not a whole PNG or JPEG"):
            image_size(tmp_path / "x.jpg")


def test_what_a_format_cannot_hold_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"unknown ending '\.bmp'"):
        write_image(tmp_path / "a.bmp", np.zeros((4, 4), dtype=np.uint8))
    with pytest.raises(ImageError, match=r"do not fit \.jpg"):
        write_image(tmp_path / "a.jpg", np.zeros((4, 4), dtype=np.uint16))
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_image(tmp_path / "file" / "a.png", np.zeros((4, 4), dtype=np.uint8))


def test_palettes_are_read_as_colour(tmp_path: Path) -> None:
    done, data = cv2.imencode(".png", np.zeros((4, 4), dtype=np.uint8), [cv2.IMWRITE_PNG_BILEVEL, 1])
    assert done
    (tmp_path / "bilevel.png").write_bytes(data.tobytes())
    assert read_image(tmp_path / "bilevel.png").dtype == np.uint8
