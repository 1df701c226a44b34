"""Cameras that write a file for each of their two lenses are read as if they had joined them."""

import cv2
import numpy as np
import pytest
import yaml

from panoloc_mcl.robot.camera import Unwrapper, geometry_of
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.datasets import read_dataset
from panoloc_mcl.tools.datasets.pairs import ImagePair

_LENS = {"kind": "kannala_brandt", "fx": 20.0, "fy": 20.0, "cx": 31.5, "cy": 31.5}
_CAMERA = {"kind": "fisheye_pair", "front": {"lens": _LENS}, "back": {"lens": _LENS, "offset_px": [64, 0]}}


def written(folder, camera, halves):
    """Two references, their halves in folders of their own or joined."""
    for name, images in halves.items():
        for index, image in enumerate(images):
            file = folder / "references" / name.format(index)
            file.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(file), image)
    first = next(iter(halves))
    rows = [f"{first.format(index)},{index},0,0" for index in range(2)]
    (folder / "references" / "poses.csv").write_text("\n".join(["file,x,y,theta", *rows]) + "\n")
    (folder / "dataset.yaml").write_text(yaml.safe_dump({"format": "panoloc-dataset/1", "name": "a", "camera": camera}))
    return read_dataset(folder).references


def test_two_files_are_the_same_as_one(tmp_path):
    rng = np.random.default_rng(3)
    fronts, backs = rng.integers(0, 255, (2, 2, 64, 64), dtype=np.uint8)
    apart = written(tmp_path / "apart", {**_CAMERA, "files": ["front", "back"]}, {"front/{}.png": fronts, "back/{}.png": backs})
    joint = written(tmp_path / "joint", _CAMERA, {"{}.png": [np.hstack(pair) for pair in zip(fronts, backs, strict=True)]})
    assert apart.image_size == joint.image_size == (128, 64)
    assert apart.camera == joint.camera
    unwrap = Unwrapper(apart.camera, apart.image_size, geometry_of(apart.camera, apart.image_size))
    for one, other in zip(apart.files, joint.files, strict=True):
        np.testing.assert_array_equal(unwrap(read_image(one)).pixels, unwrap(read_image(other)).pixels)


def test_halves_that_do_not_go_together_are_named(tmp_path):
    cv2.imwrite(str(tmp_path / "f.png"), np.zeros((64, 64), dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((32, 64), dtype=np.uint8))
    pair = ImagePair(tmp_path / "f.png", tmp_path / "b.png")
    for look in (pair.read, lambda: pair.size):
        with pytest.raises(ImageError, match=r"b\.png"):
            look()
