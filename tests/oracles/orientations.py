"""Plain NumPy and SciPy version of the normalised gradients, circular by construction."""

import numpy as np
from scipy import ndimage

MODE = ("mirror", "wrap")  # rows, columns


def gaussian_kernel(sigma: float) -> np.ndarray:
    reach = int(np.ceil(3.0 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return kernel / kernel.sum()


def orientations(image, valid, settings):
    grey = image.astype(np.float64)
    if settings.median:
        # cv2.medianBlur repeats the upper and lower row.
        padded = np.pad(np.pad(grey, ((1, 1), (0, 0)), mode="edge"), ((0, 0), (1, 1)), mode="wrap")
        grey = np.median(np.lib.stride_tricks.sliding_window_view(padded, (3, 3)), axis=(2, 3))
    bad = (grey <= settings.mask_dark) | (grey >= settings.mask_bright)
    if valid is not None:
        bad |= ~valid
    if settings.smoothing_px > 0.0:
        kernel = gaussian_kernel(settings.smoothing_px)
        grey = ndimage.correlate1d(grey, kernel, axis=0, mode="mirror")
        grey = ndimage.correlate1d(grey, kernel, axis=1, mode="wrap")
    gx = 0.5 * (np.roll(grey, -1, axis=1) - np.roll(grey, 1, axis=1))
    gy = np.zeros_like(grey)
    gy[1:-1] = 0.5 * (grey[2:] - grey[:-2])
    z = gx + 1j * gy
    if settings.gradient == "doubled_angle":
        z = z * z / (np.abs(z) ** 2 + settings.contrast_floor**2)
    elif settings.gradient == "signed":
        z = z / (np.abs(z) + settings.contrast_floor)
    reach = 1 + round(settings.smoothing_px)
    rows, columns = bad.shape
    usable = np.ones_like(bad)
    for r, c in np.argwhere(bad):
        near_rows = slice(max(0, r - reach), r + reach + 1)
        usable[near_rows, np.arange(c - reach, c + reach + 1) % columns] = False
    usable[0] = usable[rows - 1] = False
    z[~usable] = 0.0
    if settings.gradient == "linear":
        z /= np.sqrt(np.mean(np.abs(z[usable]) ** 2)) + settings.contrast_floor
    return z, usable
