"""The robot in its own images: what stays the same in the camera's frame while the robot moves and turns is not the world.

Looked at are gradients of log grey levels, which no gain changes. Over many images those of the robot keep their value, those of the
world do not: their median is large against their median deviation from it. A part of the robot without texture has small gradients
that hardly deviate, on a scale where noise averages out, and edges around it that keep their direction; where the world beside it is as
plain, nothing tells them apart, and nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera.directions import pixels_of
from panoloc_mcl.robot.camera.extent import geometry_of
from panoloc_mcl.robot.camera.spec import AnyCamera

Float32 = NDArray[np.float32]
Bool = NDArray[np.bool_]

#: Images needed to tell anything, and as many as are looked at.
FEWEST_IMAGES, MOST_IMAGES = 8, 120
# Set on renderings of a hall and an office with textured bodies and without: the world's ratios end at 0.4, the robot's begin at 1.6.
_CERTAIN, _LIKELY = 2.0, 1.0
# Of the usual deviation in the image, on the scale of plain parts; the world's smallest are above 0.3.
_PLAIN = 0.12
# A part without texture counts where the edges around it keep their direction; those of the world do by 0.1 to 0.3.
_EDGE = 0.5
_SIGMA_PX, _PLAIN_SIGMA_PX = 1.0, 3.0
_DARK = 4.0  # grey levels added before the logarithm, about the noise of a camera
_LEAST_PART = 1e-3  # of the pixels; smaller parts are chance
_GAP_PX = 2
_RIM_PX, _RIM_ROWS = 4.0, 3
# Where a camera's sight ends higher, what is at its end need not be near.
_HIGHEST_RIM_DEG = -15.0
# Of a part of the robot that nobody looks at, at least so much hardly deviates: of textured bodies 0.7, of what is far 0.2.
_TEXTURED = 0.4
# A world of which less varies than this was hardly moved through.
_LEAST_VARYING = 0.3


@dataclass(frozen=True, eq=False)
class FoundBody:
    """The robot as found.

    Parameters
    ----------
    world : bool (height, width)
        Pixels that show the world.
    images : int
        Looked at.
    agreement : float
        Share of the robot's pixels, found in either half of the images, that are found in both: 1 when both say the same.
    varying : float
        Share of the pixels that clearly vary: a robot that stands still cannot tell itself from the world.
    constant : bool (height, width)
        Pixels whose gradients hardly deviate: the robot's, where it has a texture.
    """

    world: Bool
    images: int
    agreement: float
    varying: float
    constant: Bool

    @property
    def hidden(self) -> float:
        """Share of the pixels that the robot hides."""
        return float(1.0 - self.world.mean())

    @property
    def sure(self) -> bool:
        """Whether the mask is to be used without being looked at."""
        return self.varying >= _LEAST_VARYING and self.agreement >= 0.8

    def without_doubt(self, rim: Bool) -> Bool:
        """The world (height, width), with nothing left out but what can only be the robot; all of it where nobody is sure.

        What is far away stays the same as well, while all look the same way, and so does a plain floor between the walls of a
        corridor. A robot stands below its camera, and has a texture.

        Parameters
        ----------
        rim : bool (height, width)
            The lower end of what the camera sees.
        """
        if not self.sure:
            return np.ones_like(self.world)
        count, labels = cv2.connectedComponents((~self.world).astype(np.uint8), connectivity=8)
        sizes, told = np.bincount(labels.ravel(), minlength=count), np.bincount(labels[self.constant], minlength=count)
        kept = told >= _TEXTURED * sizes
        kept &= np.bincount(labels[rim], minlength=count) > 0
        kept[0] = False
        return np.asarray(~kept[labels])

    @property
    def verdict(self) -> str:
        """One line: what was found, and how sure that is."""
        if self.varying < _LEAST_VARYING:
            return (
                f"mask: not observable, only {100.0 * self.varying:.0f} % of the pixels vary over {self.images} images; "
                "drive and turn more"
            )
        if self.world.all():
            return f"mask: nothing of the robot in {self.images} images"
        how = "sure" if self.sure else "not sure, look at the picture"
        return (
            f"mask: {100.0 * self.hidden:.1f} % of the pixels are the robot's, {how} (both halves of {self.images} images agree on "
            f"{100.0 * self.agreement:.0f} % of it)"
        )


def find_body(images: Sequence[Float32], seen: Bool | None = None) -> FoundBody:
    """Find what the images of one camera always show.

    Parameters
    ----------
    images : sequence of float32 (height, width)
        Grey levels 0..255, taken at different places and headings.
    seen : bool (height, width), optional
        Pixels that the camera uses at all; others are left alone.

    Raises
    ------
    ValueError
        Fewer than `FEWEST_IMAGES` images.
    """
    if len(images) < FEWEST_IMAGES:
        raise ValueError(f"{len(images)} images cannot tell the robot from the world; {FEWEST_IMAGES} are needed")
    used = np.ones(images[0].shape, dtype=np.bool_) if seen is None else seen
    logs = [np.log(image + np.float32(_DARK)) for image in images]
    fine, coarse = (np.stack([_gradients(log, sigma) for log in logs]) for sigma in (_SIGMA_PX, _PLAIN_SIGMA_PX))
    body, ratio = _constant(fine, coarse, used)
    first, second = (_constant(fine[half::2], coarse[half::2], used)[0] for half in (0, 1))
    body = _confirmed(body, first & second)
    either = int(((first | second) & body).sum())
    agreement = float((first & second & body).sum() / either) if either else 1.0
    varying = float((ratio[used] < 0.5 * _LIKELY).mean())
    return FoundBody(~body, len(images), agreement, varying, np.asarray((ratio > _CERTAIN) & used))


def _confirmed(body: Bool, both: Bool) -> Bool:
    """The parts of which both halves of the images show most; the rest is chance."""
    count, labels = cv2.connectedComponents(body.astype(np.uint8), connectivity=8)
    sizes, shown = np.bincount(labels.ravel(), minlength=count), np.bincount(labels[both], minlength=count)
    kept = shown >= 0.5 * sizes
    kept[0] = False
    return np.asarray(kept[labels])


def _gradients(log: Float32, sigma: float) -> Float32:
    """Central differences of a smoothed image across its seam, float32 (2, height, width)."""
    margin = int(np.ceil(3.0 * sigma)) + 1
    padded = cv2.copyMakeBorder(log, 0, 0, margin, margin, cv2.BORDER_WRAP)
    smooth = cv2.GaussianBlur(padded, (0, 0), sigma)
    across = 0.5 * (smooth[:, margin + 1 : margin + 1 + log.shape[1]] - smooth[:, margin - 1 : margin - 1 + log.shape[1]])
    inner = smooth[:, margin : margin + log.shape[1]]
    return np.stack([across, np.gradient(inner, axis=0)]).astype(np.float32)


def _constant(fine: Float32, coarse: Float32, used: Bool) -> tuple[Bool, Float32]:
    """Pixels of the robot, and how large the usual gradient is against its deviations."""
    strength, deviation = _median_and_deviation(fine)
    # A camera's digits and noise alone make a deviation of this size.
    ratio = strength / (deviation + np.float32(0.1) * np.median(deviation[used]))
    _, plain_deviation = _median_and_deviation(coarse)
    plain = _outlined(used & (plain_deviation < _PLAIN * np.median(plain_deviation[used])), _edge_coherence(fine))
    certain, likely = (ratio > _CERTAIN) | plain, (ratio > _LIKELY) | plain
    body = _grown(certain & used, likely & used)
    return _tidied(body) & used, np.asarray(ratio, dtype=np.float32)


def _median_and_deviation(gradients: Float32) -> tuple[Float32, Float32]:
    median = np.median(gradients, axis=0)
    deviation = np.median(np.hypot(*np.moveaxis(gradients - median, 1, 0)), axis=0)
    return np.hypot(*median), deviation


def _edge_coherence(gradients: Float32) -> Float32:
    """How far the direction of a pixel's edge stays the same, whichever side is the brighter one: 0 to 1 (height, width)."""
    z = gradients[:, 0] + 1j * gradients[:, 1]
    doubled = z * z
    size = np.abs(doubled)
    return np.asarray(np.abs(np.mean(doubled / (size + 1e-2 * size.mean()), axis=0)), dtype=np.float32)


def _outlined(plain: Bool, coherence: Float32) -> Bool:
    """Plain parts that end in edges of their own; a plain floor ends anywhere."""
    count, labels = cv2.connectedComponents(plain.astype(np.uint8), connectivity=8)
    # Plain parts begin inside their edges, as far as these are smoothed.
    reach = round(_PLAIN_SIGMA_PX)
    inside, around = (np.ones((2 * n + 1, 2 * n + 1), np.uint8) for n in (reach, reach + 3))
    found = np.zeros(plain.shape, dtype=np.bool_)
    for part in range(1, count):
        mask = (labels == part).astype(np.uint8)
        if mask.sum() < _LEAST_PART * mask.size:
            continue
        rim = (cv2.dilate(mask, around) > 0) & (mask == 0)
        if rim.any() and float(np.quantile(coherence[rim], 0.75)) > _EDGE:
            found |= cv2.dilate(mask, inside) > 0
    return found


def _grown(certain: Bool, likely: Bool) -> Bool:
    """Likely pixels that hang together with certain ones."""
    count, labels = cv2.connectedComponents((likely | certain).astype(np.uint8), connectivity=8)
    kept = np.zeros(count, dtype=np.bool_)
    kept[np.unique(labels[certain])] = True
    kept[0] = False
    return np.asarray(kept[labels])


def _tidied(body: Bool) -> Bool:
    """Without specks and holes, and with the rim that the smoothing blurs."""
    gap = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _GAP_PX + 1, 2 * _GAP_PX + 1))
    margin = 4 * _GAP_PX
    padded = cv2.copyMakeBorder(body.astype(np.uint8), 0, 0, margin, margin, cv2.BORDER_WRAP)
    padded = cv2.copyMakeBorder(padded, margin, margin, 0, 0, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, gap)
    least = _LEAST_PART * body.size
    for value in (1, 0):
        count, labels, stats, _ = cv2.connectedComponentsWithStats((closed == value).astype(np.uint8), connectivity=8)
        for part in range(1, count):
            if stats[part, cv2.CC_STAT_AREA] < least:
                closed[labels == part] = 1 - value
    wide = cv2.dilate(closed, np.ones((3, 3), np.uint8))
    return np.asarray(wide[margin:-margin, margin:-margin] > 0)


def grey_levels(image: NDArray[Any]) -> Float32:
    """Grey levels 0..255, float32 (height, width), of an image as cameras deliver it."""
    grey = image if image.ndim == 2 else image[:, :, :3] @ np.array([0.114, 0.587, 0.299])
    return np.asarray(grey * (255.0 / 65535.0 if image.dtype == np.uint16 else 1.0), dtype=np.float32)


def ring_of(camera: AnyCamera, size: tuple[int, int]) -> Bool | None:
    """Pixels of raw images that lie in the ring which the camera uses, bool (height, width); None where it uses no ring."""
    radii = getattr(camera, "valid_radius_px", None)
    if radii is None:
        return None
    v, u = np.mgrid[: size[1], : size[0]]
    center = camera.center_px  # type: ignore[union-attr]
    radius = np.hypot(u - center[0], v - center[1])
    # The rim itself is an edge that never moves.
    return np.asarray((radius >= radii[0] + _RIM_PX) & (radius <= radii[1] - _RIM_PX))


def lower_rim(camera: AnyCamera, size: tuple[int, int], seen: Bool | None) -> Bool:
    """Pixels of raw images at the lower end of what the camera sees, bool (height, width); none where that is not below it.

    Parameters
    ----------
    camera : AnyCamera
    size : (int, int)
        Width and height of its images.
    seen : bool (height, width), optional
        Pixels that are used.
    """
    rim = np.zeros((size[1], size[0]), dtype=np.uint8)
    geometry = geometry_of(camera, size)
    azimuth = geometry.azimuth_of_column(np.arange(geometry.width, dtype=np.float64))
    elevation = geometry.elevation_of_row(np.arange(geometry.height, dtype=np.float64))[::-1]
    below = elevation[elevation < np.radians(_HIGHEST_RIM_DEG)]
    if not len(below):
        return np.zeros(rim.shape, dtype=np.bool_)
    pixels = pixels_of(camera, size, azimuth[None, :], below[:, None])
    u, v, used = (np.array(part) for part in np.broadcast_arrays(*pixels))
    columns, rows = (np.clip(np.nan_to_num(part).round().astype(int), 0, n - 1) for part, n in zip((u, v), size, strict=True))
    used &= True if seen is None else seen[rows, columns]
    lowest = used & (np.cumsum(used, axis=0) <= _RIM_ROWS)
    rim[rows[lowest], columns[lowest]] = 1
    # Images have more pixels than the panoramas that are made of them.
    reach = 1 + 2 * int(np.ceil(max(size[0] / geometry.width, size[1] / geometry.height)))
    return np.asarray(cv2.dilate(rim, np.ones((reach, reach), np.uint8)) > 0)
