"""Plain NumPy versions of the compiled kernels: slow, and written another way wherever there is one."""

import numpy as np

from panoloc_mcl.geometry import compose


def propagate(poses, dx, dy, turn, sd_position, sd_heading, normals):
    noise = sd_heading * normals[:, 2]
    start = poses + np.column_stack([np.zeros((len(poses), 2)), 0.5 * noise])
    step = np.column_stack([dx + sd_position * normals[:, 0], dy + sd_position * normals[:, 1], turn + 0.5 * noise])
    return compose(start, step)


def read_field(poses, scores, neighbours, weights, origin_x, origin_y, cell, cells_x, cells_y):
    """Periodic np.interp over the headings, one particle after the other."""
    headings = 2.0 * np.pi * np.arange(len(scores) + 1) / len(scores)
    closed = np.vstack([scores, scores[:1]]).astype(np.float64)
    out = np.zeros(len(poses))
    for i, (x, y, theta) in enumerate(poses):
        column, row = int((x - origin_x) // cell), int((y - origin_y) // cell)
        if not (0 <= column < cells_x and 0 <= row < cells_y):
            continue
        index = row * cells_x + column
        for place, weight in zip(neighbours[index], weights[index], strict=True):
            out[i] += weight * np.interp(np.mod(theta, 2.0 * np.pi), headings, closed[:, place])
    return out


def systematic_resample(weights, offset, count):
    targets = (np.arange(count) + offset) / count
    cumulative = np.cumsum(weights) / np.sum(weights)
    return np.minimum(np.searchsorted(cumulative, targets, side="right"), np.flatnonzero(weights)[-1])


def trimmed_coefficients(design, observed, keep, trim_to):
    """Every step solved anew by np.linalg.lstsq over the pixels that are left."""
    n, t, p = design.shape
    kept = np.arange(n)
    target = max(trim_to, -(-p // t))
    while True:
        a = np.linalg.lstsq(design[kept].reshape(-1, p), observed[kept].ravel(), rcond=None)[0]
        if len(kept) <= target:
            return a
        errors = ((observed[kept] - design[kept] @ a) ** 2).sum(axis=1)
        survivors = max(target, int(len(kept) * keep))
        kept = kept[np.sort(np.argsort(errors, kind="stable")[:survivors])]


def vote(responses, rows, columns, design, mean_responses, references, shifts, keep, trim_to, width):
    hypotheses = len(rows)
    image_columns = responses.shape[2]
    votes = np.zeros((len(shifts), len(references)))
    for s, shift in enumerate(shifts):
        whole = int(np.floor(shift))
        fraction = shift - whole
        turned = (1.0 - fraction) * np.roll(responses, -whole, axis=2) + fraction * np.roll(responses, -whole - 1, axis=2)
        assert turned.shape[2] == image_columns
        for h in range(hypotheses):
            observed = turned[:, rows[h], columns[h]].T - mean_responses[h]
            a = trimmed_coefficients(design[h], observed, keep, trim_to)
            cosines = references @ a / np.linalg.norm(a)
            best = np.argmax(cosines)
            votes[s, best] += np.exp(-(np.arccos(np.clip(cosines[best], -1.0, 1.0)) ** 2) / (2.0 * width**2)) / hypotheses
    return votes
