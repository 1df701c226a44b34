"""Locally normalised gradients: local orientation, whatever the light.

A linear gradient filter removes a global gain and offset only. Dividing every gradient by its own length (plus a contrast floor)
removes gain that varies over the room; doubling its angle removes the sign of the contrast, so that a window that is bright by day
and dark by night keeps its edge. The eigenspace of such images is that of image gradient orientations (Tzimiropoulos, Zafeiriou &
Pantic, "Subspace learning from image gradient orientations", TPAMI 2012). For comparison there are linear gradients, too, which
only the whole image's length divides.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.kernels.gradients import normalised_gradients, plain_gradients
from panoloc_mcl.robot.settings.observation import VotesSettings

Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# More noise than world. Rendered rooms by day and by night have a share of noise of .02 to .2, photographs of a wood .2.
_MOST_NOISE, _QUIETED_PX = 0.5, 1.0
_ROWS_APART = 2


def pad_circular(image: NDArray[Any], margin: int) -> NDArray[Any]:
    """Add ``margin`` columns on both sides that continue the image across its seam; ``margin`` may exceed the width."""
    if not 0 < margin <= image.shape[1]:
        return np.pad(image, ((0, 0), (margin, margin)), mode="wrap")
    # As np.pad, in a fifth of its time.
    return np.concatenate([image[:, -margin:], image, image[:, :margin]], axis=1)


def check_filter_size(shape: tuple[int, int], settings: VotesSettings) -> None:
    """Refuse filters that are larger than the panoramas, where there is nothing but rims and seams.

    Parameters
    ----------
    shape : (rows, columns)
        Of the panoramas.
    settings : VotesSettings

    Raises
    ------
    MapError
        The Gaussian, cut at 3 sigma, and the difference after it reach over the whole image.
    """
    # The difference needs a pixel more on both sides.
    size = 2 * int(np.ceil(3.0 * settings.smoothing_px)) + 3
    if size <= min(shape):
        return
    found = f"filters of {size} x {size} pixels are larger than the panoramas of {shape[0]} rows x {shape[1]} columns"
    largest = ((min(shape) - 1) // 2 - 1) / 3.0
    remedy = f"set at most {np.floor(100 * largest) / 100:g}" if largest >= 0.0 else "use larger panoramas"
    raise MapError(f"observation.votes.smoothing_px = {settings.smoothing_px:g}: {found}; {remedy}")


def orientations(panorama: Panorama, settings: VotesSettings) -> tuple[Complex64, Bool]:
    """Gradients of a panorama, locally normalised or not.

    Parameters
    ----------
    panorama : Panorama
        Canonical, grey levels 0..255.
    settings : VotesSettings

    Returns
    -------
    z : complex64 (rows, columns)
        z / (|z| + c) for ``signed``, z^2 / (|z|^2 + c^2) for ``doubled_angle``, z / (r + c) for ``linear``, where z = g_x + i g_y in
        grey levels per pixel and r the root mean square of |z| over the usable pixels; 0 where masked. Cosines do not see that
        one factor, but texture can be judged and views be subtracted from images with it.
    usable : bool (rows, columns)
        False where a dark, saturated or unseen pixel, or the upper or lower rim, reaches into the gradient.
    """
    columns = panorama.pixels.shape[1]
    # The Gaussian is cut at 3 sigma; the median and the difference reach one pixel further each.
    reach = int(np.ceil(3.0 * settings.smoothing_px))
    margin = reach + 2
    grey = pad_circular(panorama.pixels, margin)
    if settings.median:
        grey = cv2.medianBlur(grey, 3)
    # After the median a single black or white pixel is gone and needs no mask.
    bad = ((grey <= settings.mask_dark) | (grey >= settings.mask_bright)).astype(np.uint8)
    if panorama.valid is not None:
        bad |= pad_circular(~panorama.valid, margin).astype(np.uint8)
    if settings.smoothing_px > 0.0:
        size = 2 * reach + 1
        grey = cv2.GaussianBlur(grey, (size, size), settings.smoothing_px)
    # What a bad pixel reaches with noticeable weight: two pixels for the usual Gaussian of one pixel.
    spread = 1 + round(settings.smoothing_px)
    bad = cv2.dilate(bad, np.ones((2 * spread + 1, 2 * spread + 1), np.uint8))
    usable = bad[:, margin : margin + columns] == 0
    usable[0] = usable[-1] = False
    if settings.gradient == "linear":
        z = plain_gradients(grey, bad, margin)
        energy = np.sum(np.square(z.real) + np.square(z.imag), dtype=np.float64)
        length = np.sqrt(energy / max(int(usable.sum()), 1))
        return z * np.float32(1.0 / (length + settings.contrast_floor)), usable
    return normalised_gradients(grey, bad, margin, settings.contrast_floor, settings.gradient == "doubled_angle"), usable


def quiet(panorama: Panorama) -> Panorama:
    """A panorama as it is, or smoothed by a pixel where noise makes more than half of the energy of its gradients: in near darkness.

    Noise is what second differences both ways show (Immerkær, "Fast noise variance estimation", CVIU 1996), by their median, which
    leaves texture out; smoothing takes 12 thirteenths of its gradients' energy, and much less of what the world shows.
    """
    if noise_share(panorama) <= _MOST_NOISE:
        return panorama
    margin = int(np.ceil(3.0 * _QUIETED_PX))
    size = (2 * margin + 1, 2 * margin + 1)

    def smoothed(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(pad_circular(pixels, margin), size, _QUIETED_PX)[:, margin:-margin])

    if panorama.valid is None:
        return Panorama(smoothed(panorama.pixels))
    # Only what is seen counts.
    seen = panorama.valid.astype(np.float32)
    mean = smoothed(panorama.pixels * seen) / np.maximum(smoothed(seen), np.float32(1e-6))
    return Panorama((mean * seen).astype(np.float32), panorama.valid)


def noise_share(panorama: Panorama) -> float:
    """Of the energy of a panorama's gradients, what noise makes that differs from pixel to pixel; 0 where nothing is seen."""
    # Every other row says as much.
    above, here, below = panorama.pixels[:-2:_ROWS_APART], panorama.pixels[1:-1:_ROWS_APART], panorama.pixels[2::_ROWS_APART]
    across = 0.5 * (below - above)
    along = 0.5 * (here[:, 2:] - here[:, :-2])
    down = above + below - 2.0 * here
    second = np.abs(down[:, 2:] + down[:, :-2] - 2.0 * down[:, 1:-1])
    energy = np.square(along) + np.square(across[:, 1:-1])
    if panorama.valid is not None:
        seen = cv2.erode(panorama.valid.astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1:_ROWS_APART, 1:-1] > 0
        second, energy = second[seen], energy[seen]
    if not second.size:
        return 0.0
    # Of normal noise, the median deviation is 0.6745; the mask's weights have a norm of 6, and central differences halve the variance.
    variance = (float(np.median(second)) / (6.0 * 0.6745)) ** 2
    return variance / max(float(energy.mean()), 1e-12)


def useless(panorama: Panorama, z: Complex64, usable: Bool, settings: VotesSettings) -> str:
    """Why a panorama, with its gradients and where they are usable, says nothing; empty where it does."""
    visible = float(usable.mean())
    if visible < settings.min_visible:
        brightness = float(np.median(panorama.pixels))
        if brightness <= settings.mask_dark:
            what = "image is black"
        elif brightness >= settings.mask_bright:
            what = "image is saturated"
        else:
            what = "image is mostly masked"
        return f"{what}: {100.0 * visible:.0f} % of its pixels are usable"
    return "" if float(np.mean(z.real * z.real + z.imag * z.imag)) >= 1e-3 else "image has no texture"
