"""Plain NumPy versions of the kernels of view synthesis: whole arrays at once, or one column after the other."""

import numpy as np


def azimuths(columns):
    return -2.0 * np.pi * np.arange(columns) / columns


def warp_table(profile, tangents, floor, dx, dy, top, row_step, source_columns, margin):
    """Every pixel as a point in space, which the source then looks at."""
    distance = np.minimum(floor[:, None], profile[None, :])
    directions = np.exp(1j * azimuths(len(profile)))
    points = distance * directions + complex(dx, dy)
    column = np.mod(-np.angle(points) * source_columns / (2.0 * np.pi), source_columns)
    elevation = np.arctan2(tangents[:, None] * distance, np.abs(points))
    return column + margin, (top - elevation) / row_step - 0.5


def move_profile(profile, dx, dy):
    """For every column of the other place, a search through all pieces of wall."""
    columns = len(profile)
    points = profile * np.exp(1j * azimuths(columns)) - complex(dx, dy)
    ranges, at = np.abs(points), np.mod(-np.angle(points) * columns / (2.0 * np.pi), columns)
    seen: list[list[tuple[float, float]]] = [[] for _ in range(columns)]
    for k in range(columns):
        first, second = ranges[k], ranges[(k + 1) % columns]
        step = (at[(k + 1) % columns] - at[k] + columns / 2) % columns - columns / 2
        if abs(second - first) > 0.3 * min(first, second) or abs(step) >= columns / 4:
            seen[round(at[(k + 1) % columns]) % columns].append(second)
            continue
        for i in range(columns):
            # How far column i lies from the piece's beginning, the short way round.
            away = (i - at[k] + columns / 2) % columns - columns / 2
            if min(step, 0.0) - 1e-9 <= away <= max(step, 0.0) + 1e-9:
                seen[i].append(first + (away / step if step else 0.0) * (second - first))
    moved = np.array([min(ranges_there, default=np.nan) for ranges_there in seen])
    known = np.flatnonzero(~np.isnan(moved))
    for hole in np.flatnonzero(np.isnan(moved)):
        before = known[np.argmin((hole - known) % columns)]
        after = known[np.argmin((known - hole) % columns)]
        moved[hole] = max(moved[before], moved[after])
    return moved


def moved_profile(profile, dx, dy):
    """As `move_profile`, all pieces of wall at once: for pictures of full size."""
    columns = len(profile)
    points = profile * np.exp(1j * azimuths(columns)) - complex(dx, dy)
    ranges, at = np.abs(points), np.mod(-np.angle(points) * columns / (2.0 * np.pi), columns)
    after, after_at = np.roll(ranges, -1), np.roll(at, -1)
    step = (after_at - at + columns / 2) % columns - columns / 2
    gap = (np.abs(after - ranges) > 0.3 * np.minimum(ranges, after)) | (np.abs(step) >= columns / 4)
    moved = np.full(columns, np.inf)
    np.minimum.at(moved, np.rint(after_at[gap]).astype(int) % columns, after[gap])
    first = np.ceil(np.minimum(at, at + step) - 1e-9)
    last = np.floor(np.maximum(at, at + step) + 1e-9)
    for more in range(int(np.max(np.where(gap, -1, last - first))) + 1):
        here = ~gap & (first + more <= last)
        fraction = np.divide(first + more - at, step, out=np.zeros(columns), where=step != 0.0)[here]
        there = ranges[here] + fraction * (after - ranges)[here]
        np.minimum.at(moved, (first[here] + more).astype(int) % columns, there)
    known = np.flatnonzero(np.isfinite(moved))
    holes = np.flatnonzero(np.isinf(moved))
    behind = np.searchsorted(known, holes)
    moved[holes] = np.maximum(moved[known[behind - 1]], moved[known[behind % len(known)]])
    return moved


def jacobian(view, query, profile, floor, tangents, row_step):
    """Change of the difference's other side with x, y, heading, pitch and roll: complex (5, rows, columns)."""
    columns = view.shape[1]
    mean = 0.5 * (view.astype(np.complex128) + query)
    along_azimuth = -(np.roll(mean, -1, axis=1) - np.roll(mean, 1, axis=1)) * 0.5 * columns / (2.0 * np.pi)
    along_elevation = np.zeros_like(mean)
    along_elevation[1:-1] = -(mean[2:] - mean[:-2]) * 0.5 / row_step
    a = azimuths(columns)[None, :]
    e = np.arctan(tangents)[:, None]
    distance = np.minimum(profile[None, :], floor[:, None])
    # Where a point that lies at azimuth a and elevation e goes when the camera moves; what is seen at (a, e) comes from the other side.
    azimuth_by_x, azimuth_by_y = np.sin(a) / distance, -np.cos(a) / distance
    elevation_by_x, elevation_by_y = (np.sin(e) * np.cos(e) * part / distance for part in (np.cos(a), np.sin(a)))
    return np.stack(
        [
            -(along_azimuth * azimuth_by_x + along_elevation * elevation_by_x),
            -(along_azimuth * azimuth_by_y + along_elevation * elevation_by_y),
            along_azimuth,
            -along_elevation * np.cos(a) - along_azimuth * np.sin(a) * np.tan(e),
            along_elevation * np.sin(a) - along_azimuth * np.cos(a) * np.tan(e),
        ]
    )


def column_agreement(first, first_usable, second, second_usable):
    a, b = (np.where(first_usable & second_usable, part.astype(np.complex128), 0.0) for part in (first, second))
    return np.real(a * b.conj()).sum(axis=0), (np.abs(a) ** 2).sum(axis=0), (np.abs(b) ** 2).sum(axis=0)


def normal_equations(view, view_usable, query, query_usable, profile, floor, tangents, row_step, every, columns=None):
    used = view_usable & query_usable
    chosen = np.zeros(len(used), dtype=bool)
    chosen[1:-1:every] = True
    used = used & chosen[:, None]
    if columns is not None:
        used = used & columns[None, :]
    j = jacobian(view, query, profile, floor, tangents, row_step)[:, used]
    v, q = (part[used].astype(np.complex128) for part in (view, query))
    normal = np.real(j @ j.conj().T)
    right = np.real(j.conj() @ (q - v))
    energies = (np.sum(np.abs(part) ** 2) for part in (q - v, q, v))
    residual, query_energy, view_energy = energies
    return normal, right, residual, used.sum(), np.real(np.vdot(v, q)), query_energy, view_energy


def normalised_gradients(grey, bad, margin, floor, doubled):
    g = grey.astype(np.float64)
    z = np.zeros(g.shape, dtype=np.complex128)
    z[1:-1, 1:-1] = 0.5 * (g[1:-1, 2:] - g[1:-1, :-2]) + 0.5j * (g[2:, 1:-1] - g[:-2, 1:-1])
    z = z**2 / (np.abs(z) ** 2 + floor**2) if doubled else z / (np.abs(z) + floor)
    z[bad != 0] = 0.0
    return z[:, margin:-margin]


def some_profile(rng: np.random.Generator, columns: int = 90) -> np.ndarray:
    """Walls with smooth parts, edges and single columns that stick out."""
    waves = np.cos(np.arange(1, 4)[:, None] * azimuths(columns) + rng.uniform(0.0, 6.0, (3, 1))).sum(axis=0)
    profile = np.exp(0.2 * waves) * 2.5
    start, width = rng.integers(columns), rng.integers(3, 20)
    profile[(start + np.arange(width)) % columns] *= rng.uniform(0.4, 2.0)
    profile[rng.integers(columns, size=2)] *= rng.uniform(0.5, 2.0, 2)
    return profile
