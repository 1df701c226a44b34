"""Small made-up worlds: smooth random textures as panoramas, and images turned in them."""

import cv2
import numpy as np

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.references import ReferencePanoramas

ROWS, COLUMNS = 20, 60


def texture(seed: int, rows: int = ROWS, columns: int = COLUMNS, blur: float = 1.2) -> np.ndarray:
    """Smooth noise with grey levels 20..235, seamless, uint8."""
    noise = np.random.default_rng(seed).standard_normal((rows, columns)).astype(np.float32)
    margin = 12
    wide = np.pad(noise, ((margin, margin), (margin, margin)), mode="wrap")
    smooth = cv2.GaussianBlur(wide, (0, 0), blur)[margin:-margin, margin:-margin]
    smooth -= smooth.min()
    return np.rint(20.0 + 215.0 * smooth / smooth.max()).astype(np.uint8)


def panorama(image: np.ndarray, valid: np.ndarray | None = None) -> Panorama:
    return Panorama(image.astype(np.float32), valid)


def turned(image: np.ndarray, columns: int) -> np.ndarray:
    """What the camera sees after the robot has turned left by so many columns: the world moves to the right in the image."""
    return np.roll(image, columns, axis=1)


def references(images: list[np.ndarray], positions, valid: np.ndarray | None = None) -> ReferencePanoramas:
    pixels = np.stack(images)
    return ReferencePanoramas(
        pixels=pixels,
        valid=None if valid is None else np.broadcast_to(valid, (len(images), *images[0].shape)),
        positions=np.asarray(positions, dtype=np.float64),
        names=tuple(f"ref_{index}.png" for index in range(len(pixels))),
        geometry=PanoramaGeometry(pixels.shape[2], pixels.shape[1], -50.0, 25.0),
        camera_height_m=None,
    )


def grid(columns: int, rows: int, spacing: float = 1.0) -> np.ndarray:
    return np.array([(x * spacing, y * spacing) for y in range(rows) for x in range(columns)])


def random_world(count: int = 6, seed: int = 0) -> ReferencePanoramas:
    """Places on a grid three wide, each with a texture of its own."""
    return references([texture(100 * seed + index) for index in range(count)], grid(3, -(-count // 3))[:count])
