"""Plain NumPy versions of the compiled kernels: slow, and written another way wherever there is one."""

import numpy as np

from panoloc_mcl.robot.geometry import compose


def propagate(particles, turns, ways, sd_turns, sd_ways, normals):
    """Three poses put together: turn, drive, turn."""
    moved = particles.T
    zero = np.zeros(particles.shape[1])
    moved = compose(moved, np.column_stack([zero, zero, turns[0] + sd_turns[0] * normals[0]]))
    moved = compose(moved, np.column_stack([ways[0] + sd_ways[0] * normals[1], ways[1] + sd_ways[1] * normals[2], zero]))
    return compose(moved, np.column_stack([zero, zero, turns[1] + sd_turns[1] * normals[3]])).T


def philox(counter, key):
    """Ten rounds in Python's whole numbers, as in the paper's figure."""
    c, k = list(counter), list(key)
    for _ in range(10):
        one, other = divmod(0xD2511F53 * c[0], 1 << 32), divmod(0xCD9E8D57 * c[2], 1 << 32)
        c = [other[0] ^ c[1] ^ k[0], other[1], one[0] ^ c[3] ^ k[1], one[1]]
        k = [(k[0] + 0x9E3779B9) % (1 << 32), (k[1] + 0xBB67AE85) % (1 << 32)]
    return tuple(c)


def normals(key, step, stream, first, count):
    out = []
    for index in range(first, first + count):
        words = philox((index % 2**32, index >> 32, step, stream), (key % 2**32, key >> 32))
        for one, other in (words[:2], words[2:]):
            drawn = np.sqrt(-2.0 * np.log((one + 0.5) / 2**32)) * np.exp(2j * np.pi * other / 2**32)
            out += [drawn.real, drawn.imag]
    return np.array(out).reshape(count, 4).T


def read_field(particles, scores, neighbours, weights, origin_x, origin_y, cell, cells_x, cells_y):
    """Periodic np.interp over the headings, one particle after the other."""
    headings = 2.0 * np.pi * np.arange(len(scores) + 1) / len(scores)
    closed = np.vstack([scores, scores[:1]]).astype(np.float64)
    out = np.zeros(particles.shape[1])
    for i, (x, y, theta) in enumerate(particles.T):
        column, row = int((x - origin_x) // cell), int((y - origin_y) // cell)
        if not (0 <= column < cells_x and 0 <= row < cells_y):
            continue
        index = row * cells_x + column
        for place, weight in zip(neighbours[index], weights[index], strict=True):
            out[i] += weight * np.interp(np.mod(theta, 2.0 * np.pi), headings, closed[:, place])
    return out


def pick(weights, targets):
    cumulative = np.cumsum(weights) / np.sum(weights)
    return np.minimum(np.searchsorted(cumulative, targets, side="right"), np.flatnonzero(weights)[-1])


def residual(weights, uniforms):
    shares = len(uniforms) * weights / weights.sum()
    certain = np.repeat(np.arange(len(weights)), np.floor(shares).astype(int))
    left = len(uniforms) - len(certain)
    return np.sort(np.r_[certain, pick(shares - np.floor(shares), np.sort(uniforms[:left]))]) if left else certain


def occupied_cells(poses, weights, cell, around):
    """Poses (n, 3) in double precision, one after the other; the corner of the grid is that of the cell before the lowest."""
    columns, rows = np.floor(poses[:, :2].T / cell).astype(np.int64)
    turns = np.floor(np.mod(poses[:, 2], 2.0 * np.pi) * around / (2.0 * np.pi)).astype(np.int64)
    first_column, first_row, high = columns.min() - 1, rows.min() - 1, rows.max() - rows.min() + 3
    keys = ((columns - first_column) * high + (rows - first_row)) * around + turns
    occupied = np.unique(keys)
    out = np.zeros((len(occupied), 10))
    for (x, y, theta), column, row, w, key in zip(poses, columns, rows, weights, keys, strict=True):
        x, y = x - (column + 0.5) * cell, y - (row + 0.5) * cell
        t = np.mod(theta, 2.0 * np.pi / around) - np.pi / around
        out[np.searchsorted(occupied, key)] += w * np.array([1.0, x, y, t, x * x, x * y, y * y, x * t, y * t, t * t])
    return occupied, out, first_column, first_row, high


def merge_cells(labels, count, origins, moments):
    """Each label's particles as their cells have them, in the heaviest cell's turn of the circle."""
    masses, means, covariances = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    for label in range(count):
        inside = moments[labels == label]
        cells = origins[labels == label] + inside[:, 1:4] / inside[:, :1]
        middle = cells[np.argmax(inside[:, 0]), 2]
        cells[:, 2] = middle + np.mod(cells[:, 2] - middle + np.pi, 2.0 * np.pi) - np.pi
        masses[label] = inside[:, 0].sum()
        shares = inside[:, 0] / masses[label]
        means[label] = shares @ cells
        for share, cell, row in zip(shares, cells, inside, strict=True):
            xx, xy, yy, xt, yt, tt = row[4:] / row[0]
            off = row[1:4] / row[0]
            within = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) - np.outer(off, off)
            covariances[label] += share * (within + np.outer(cell - means[label], cell - means[label]))
    means[:, 2] = np.mod(means[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return masses, means, covariances


def link_cells(occupied, heavy, rows, turns):
    """Flooding from heavy cell to heavy cell; a light cell takes a label of one of the heavy ones around it, or its own."""
    place, turn = np.divmod(occupied, turns)
    column, row = np.divmod(place, rows)
    off = (turn[:, None] - turn + turns // 2) % turns - turns // 2
    touch = (abs(column[:, None] - column) <= 1) & (abs(row[:, None] - row) <= 1) & (abs(off) <= 1)
    labels = np.arange(len(occupied))
    for _ in occupied:
        labels = np.array([labels[touch[i] & heavy].min() if heavy[i] else labels[i] for i in range(len(occupied))])
    return labels, touch


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
