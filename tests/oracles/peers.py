"""The cited peers by brute force: the image is rolled for every heading, subspaces come from np.linalg.svd, spectra from sums."""

import numpy as np

from panoloc_mcl.laboratory.peers.linear_filters import filter_bank


def turned_back(image):
    """The image turned back by every whole column, (columns, rows, columns)."""
    return np.stack([np.roll(image, -heading, axis=1) for heading in range(image.shape[1])])


def scaled(images, unit_energy):
    images = np.asarray(images, dtype=np.float64)
    return images / np.linalg.norm(images, axis=(-2, -1), keepdims=True) if unit_energy else images


def subspace(images, components):
    """Mean, basis (p, pixels) and coefficients (n, p) of the images."""
    flat = images.reshape(len(images), -1)
    mean = flat.mean(axis=0)
    basis = np.linalg.svd(flat - mean, full_matrices=False)[2][:components]
    return mean, basis, (flat - mean) @ basis.T


def by_distance(mine, theirs, width):
    """Votes of coefficients (h, p) for references (k, p)."""
    squared = ((mine[:, None, :] - theirs[None]) ** 2).sum(axis=2)
    return 1.0 / (1.0 + squared / (width**2 * (theirs**2).sum(axis=1).mean()))


def eigenspace(images, image, settings):
    mean, basis, theirs = subspace(scaled(images, settings.unit_energy), settings.components)
    mine = (turned_back(scaled(image, settings.unit_energy)).reshape(image.shape[1], -1) - mean) @ basis.T
    return by_distance(mine, theirs, settings.vote_width)


def least_squares(images, image, settings):
    shape = image.shape
    mean, basis, theirs = subspace(np.asarray(images, dtype=np.float64), settings.components)
    filtered_mean = filter_bank(mean.reshape(shape).astype(np.float32)).ravel()
    design = np.stack([filter_bank(e.reshape(shape).astype(np.float32)).ravel() for e in basis], axis=1).astype(np.float64)
    if settings.mean_column:
        design = np.column_stack([design, filtered_mean])
    votes = []
    for turned in turned_back(image):
        observed = filter_bank(turned.astype(np.float32)).ravel() - (0.0 if settings.mean_column else filtered_mean)
        found = np.linalg.lstsq(design, observed, rcond=None)[0][: settings.components]
        cosines = theirs @ found / np.linalg.norm(theirs, axis=1) / np.linalg.norm(found)
        votes.append(np.exp(-(np.arccos(cosines) ** 2) / (2.0 * settings.vote_width**2)))
    return np.stack(votes)


def spinning(images, image, settings, dimensions):
    """All turned copies of all references in one big SVD; ``dimensions`` real ones are kept."""
    copies = np.concatenate([turned_back(one) for one in scaled(images, settings.unit_energy)])
    mean, basis, _ = subspace(copies, dimensions)
    theirs = (scaled(images, settings.unit_energy).reshape(len(images), -1) - mean) @ basis.T
    mine = (turned_back(scaled(image, settings.unit_energy)).reshape(image.shape[1], -1) - mean) @ basis.T
    return by_distance(mine, theirs, settings.vote_width)


def first_phase(image):
    columns = image.shape[1]
    angles = 2.0 * np.pi * np.arange(columns) / columns
    means = image.mean(axis=0)
    return np.arctan2(-(means * np.sin(angles)).sum(), (means * np.cos(angles)).sum())


def at_zero_phase(image):
    """The trigonometric polynomial through each row, read at shifted columns."""
    columns = image.shape[1]
    frequencies = np.fft.fftfreq(columns, 1.0 / columns)
    at = np.arange(columns) - first_phase(image) * columns / (2.0 * np.pi)
    waves = np.exp(2j * np.pi * np.outer(frequencies, at) / columns)
    return (np.fft.fft(image, axis=1) @ waves).real / columns


def zero_phase(images, image, settings):
    columns = image.shape[1]
    mean, basis, theirs = subspace(
        scaled([at_zero_phase(np.asarray(one, dtype=np.float64)) for one in images], settings.unit_energy), settings.components
    )
    mine = (scaled(at_zero_phase(image), settings.unit_energy).ravel() - mean) @ basis.T
    of_places = by_distance(mine[None], theirs, settings.vote_width)[0]
    width = max(np.radians(settings.heading_width_deg), 2.0 * np.pi / columns)
    votes = np.empty((columns, len(images)))
    for k, one in enumerate(images):
        off = 2.0 * np.pi * np.arange(columns) / columns - (first_phase(np.asarray(one, dtype=np.float64)) - first_phase(image))
        off = np.arctan2(np.sin(off), np.cos(off))
        bell = np.exp(-(off**2) / (2.0 * width**2))
        votes[:, k] = of_places[k] * bell / bell.max()
    return votes


def orientation_signs(image):
    rows, columns = image.shape
    signs = np.zeros(image.shape, dtype=np.complex128)
    for r in range(1, rows - 1):
        for c in range(columns):
            z = complex(image[r, (c + 1) % columns] - image[r, c - 1], image[r + 1, c] - image[r - 1, c])
            signs[r, c] = z / abs(z) if z else 0.0
    return signs


def orientation_correlation(images, image):
    places = [orientation_signs(np.asarray(one, dtype=np.float64)) for one in images]
    votes = [
        [np.vdot(place, turned).real / np.linalg.norm(place) / np.linalg.norm(turned) for place in places]
        for turned in turned_back(orientation_signs(image))
    ]
    return np.maximum(votes, 0.0)


def fourier_signature(images, image, frequencies):
    """Similarities (k,) of the magnitudes, and agreement (columns, k) of the phases weighted by both magnitudes."""
    columns = image.shape[1]
    waves = np.exp(-2j * np.pi * np.outer(np.arange(columns), np.arange(frequencies)) / columns)
    theirs = np.asarray(images, dtype=np.float64) @ waves
    distances = np.abs(np.abs(theirs) - np.abs(image @ waves)).sum(axis=(1, 2))
    similarity = 1.0 - (distances - distances.min()) / np.ptp(distances)
    agreement = np.empty((columns, len(images)))
    for heading, turned in enumerate(turned_back(image)):
        mine = (turned @ waves)[None, :, 1:]
        difference = np.angle(mine) - np.angle(theirs[:, :, 1:])
        agreement[heading] = (np.abs(mine) * np.abs(theirs[:, :, 1:]) * np.cos(difference)).sum(axis=(1, 2))
    return similarity, agreement


def nearest_reference(images, image, floor):
    """Cosines of normalised gradients, every turn by hand."""

    def gradients(grey):
        z = np.zeros(grey.shape, dtype=complex)
        for row in range(1, grey.shape[0] - 1):
            for column in range(grey.shape[1]):
                across = grey[row, (column + 1) % grey.shape[1]] - grey[row, column - 1]
                z[row, column] = 0.5 * (across + 1j * (grey[row + 1, column] - grey[row - 1, column]))
        return z / (np.abs(z) + floor)

    places = [gradients(one.astype(float)) for one in images]
    votes = np.zeros((image.shape[1], len(images)))
    for heading, turned in enumerate(turned_back(image)):
        mine = gradients(turned)
        for place, theirs in enumerate(places):
            cosine = (mine.conj() * theirs).sum().real / (np.linalg.norm(mine) * np.linalg.norm(theirs))
            votes[heading, place] = max(0.0, cosine)
    return votes


def template_matching(images, image):
    """Pearson's correlation of grey levels, every turn by hand."""
    votes = [
        [np.corrcoef(turned.ravel(), np.asarray(one, dtype=np.float64).ravel())[0, 1] for one in images]
        for turned in turned_back(image)
    ]
    return np.maximum(votes, 0.0)
