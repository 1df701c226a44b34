"""The pictures of docs/how-to/own-data.md: what a mirror, a full sphere and a fisheye deliver, and the panorama that becomes of each.

    python scripts/your_camera.py docs/how-to

Needs the extra simulate; takes a minute, the light of the hall a few more at the first time.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.settings import SimulationConfig
from panoloc_mcl.laboratory.simulation.simulate import Simulation
from panoloc_mcl.robot.camera import Unwrapper, geometry_of
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.settings.validation import validate
from panoloc_mcl.tools.datasets import read_dataset

HEIGHT, GAP = 200, 6
_UNIFIED = {"kind": "unified", "xi": 0.9, "focal_px": 122.2}
_PANORAMA = {"size": [360, 145], "elevation_deg": [-50, 25]}
_FISHEYE = {"kind": "kannala_brandt", "fx": 74.0, "fy": 74.0, "cx": 127.5, "cy": 127.5}
CAMERAS = {
    "mirror": (
        {"kind": "omni", "center_px": [239.5, 239.5], "valid_radius_px": [28, 237], "profile": _UNIFIED, "panorama": _PANORAMA},
        (480, 480),
    ),
    "sphere": ({"kind": "equirectangular"}, (720, 360)),
    "fisheye": ({"kind": "omni", "looks": "up", "lens": _FISHEYE, "valid_radius_px": [0, 127]}, (256, 256)),
}


def main(folder: Path) -> None:
    """Render one image with each camera, and put its panorama beside it."""
    drives = [
        {"name": name, "light": "noon", "frames": 1, "camera": {**camera, "height_m": 0.6}, "size": size}
        for name, (camera, size) in CAMERAS.items()
    ]
    said = {
        "name": "cameras",
        "scene": "hall",
        "seed": 3,
        "references_light": "noon",
        "sensor": {"samples": 2},
        "references_drive": {"frames": 2},
        "sequences": drives,
    }
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / "data"
        Simulation(validate(SimulationConfig, said, "cameras"), Path(made)).run(path, lambda *_: None, print)
        for drive in read_dataset(path).sequences.values():
            image = read_image(drive.files[0])
            panorama = Unwrapper(drive.camera, drive.image_size, geometry_of(drive.camera, drive.image_size))(image)
            name = folder / f"camera_{drive.name.partition('_')[0]}.png"
            cv2.imwrite(str(name), np.hstack([scaled(image), np.full((HEIGHT, GAP), 255, np.uint8), scaled(panorama.pixels)]))
            print(name)


def scaled(image: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.uint8]:
    """Of the pictures' height, as bright as the image may be."""
    stretched = np.clip(image.astype(np.float32) * (255.0 / max(float(np.quantile(image, 0.99)), 1.0)), 0.0, 255.0)
    width = round(image.shape[1] * HEIGHT / image.shape[0])
    resized = cv2.resize(stretched, (width, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.asarray(np.rint(resized), dtype=np.uint8)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
