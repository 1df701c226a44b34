"""Inner loops of view synthesis: where a point seen from one place appears from another.

The world around a place is a profile: in every column a vertical wall at some distance, and the floor up to it. Azimuth of column c is
-2 pi c / columns (clockwise); elevation of row r is ``top - (r + 0.5) * row_step``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import arctan2
from panoloc_mcl.robot.kernels.jit import kernel, vector_kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]


# Tables are of single precision, and so is what they are made of: cv2.remap takes 1/32 of a pixel.
_ZERO = np.float32(0.0)


@vector_kernel
def warp_table(
    profile: Float64,
    tangents: Float64,
    floor: Float64,
    dx: float,
    dy: float,
    top: float,
    row_step: float,
    source_columns: int,
    margin: int,
) -> tuple[Float32, Float32]:
    """Where the pixels of a view lie in the image of a source camera (tables for ``cv2.remap``).

    Parameters
    ----------
    profile : float64 (columns,)
        Distance of the wall as seen from the view, metres.
    tangents : float64 (rows,)
        Tangent of every row's elevation.
    floor : float64 (rows,)
        Distance at which the row meets the floor, metres; infinity above the horizon.
    dx, dy : float
        From the source to the view, metres.
    top, row_step : float
        Elevation of the upper edge of the first row and of one row, radians.
    source_columns : int
        Columns of the source image; the view may have fewer.
    margin : int
        Columns by which the source image is continued on its left across the seam.

    Returns
    -------
    map_x, map_y : float32 (rows, columns)
        Column (with the margin) and row in the source.
    """
    columns, rows = profile.shape[0], tangents.shape[0]
    map_x = np.empty((rows, columns), dtype=np.float32)
    map_y = np.empty((rows, columns), dtype=np.float32)
    per_radian, per_row = np.float32(source_columns / (2.0 * np.pi)), np.float32(1.0 / row_step)
    above, left, around = np.float32(top / row_step - 0.5), np.float32(margin), np.float32(source_columns)
    wall = profile.astype(np.float32)
    azimuths = -2.0 * np.pi * np.arange(columns) / columns
    cosines, sines = np.cos(azimuths), np.sin(azimuths)
    # Where a row sees the wall in every column, only its elevation is its own: the rest is worked out once.
    farthest = np.max(profile)
    wall_column, wall_range = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    for c in range(columns):
        px, py = np.float32(profile[c] * cosines[c] + dx), np.float32(profile[c] * sines[c] + dy)
        column = -arctan2(py, px) * per_radian
        wall_column[c] = column + left + (around if column < _ZERO else _ZERO)
        wall_range[c] = np.sqrt(px * px + py * py)
    for r in range(rows):
        ground, tangent, row_x, row_y = floor[r], np.float32(tangents[r]), map_x[r], map_y[r]
        if ground >= farthest:
            row_x[:] = wall_column
            for c in range(columns):
                row_y[c] = above - arctan2(tangent * wall[c], wall_range[c]) * per_row
            continue
        for c in range(columns):
            # In double precision, as both parts may nearly cancel.
            distance = min(ground, profile[c])
            px, py = np.float32(distance * cosines[c] + dx), np.float32(distance * sines[c] + dy)
            column = -arctan2(py, px) * per_radian
            row_x[c] = column + left + (around if column < _ZERO else _ZERO)
            row_y[c] = above - arctan2(np.float32(tangent * distance), np.sqrt(px * px + py * py)) * per_row
    return map_x, map_y


@vector_kernel
def turned_table(
    tangents: Float64,
    azimuths: Float64,
    heading: float,
    rotation: Float64,
    top: float,
    row_step: float,
    source_columns: int,
    margin: int,
) -> tuple[Float32, Float32]:
    """Where an upright camera at heading 0 finds its pixels in the image of a camera that is turned (tables for ``cv2.remap``).

    Parameters
    ----------
    tangents : float64 (rows,)
        Tangent of the elevation of every row of the upright view.
    azimuths : float64 (columns,)
        Of its columns, radians.
    heading : float
        Of the turned camera, radians.
    rotation : float64 (3, 3)
        From the axes of the turned camera to those of an upright one at the same heading.
    top, row_step : float
        Elevation of the upper edge of the image's first row and of one row, radians.
    source_columns : int
        Columns of the image.
    margin : int
        Columns by which the image is continued on its left across the seam.

    Returns
    -------
    map_x, map_y : float32 (rows, columns)
        Column (with the margin) and row in the image.
    """
    rows, columns = tangents.shape[0], azimuths.shape[0]
    map_x = np.empty((rows, columns), dtype=np.float32)
    map_y = np.empty((rows, columns), dtype=np.float32)
    per_radian, per_row = np.float32(source_columns / (2.0 * np.pi)), np.float32(1.0 / row_step)
    above, left, around = np.float32(top / row_step - 0.5), np.float32(margin), np.float32(source_columns)
    # A ray is (cos, sin, tangent): of its three turned components all but the tangent's part is the column's.
    cosines, sines = np.cos(azimuths - heading), np.sin(azimuths - heading)
    level_x = (rotation[0, 0] * cosines + rotation[1, 0] * sines).astype(np.float32)
    level_y = (rotation[0, 1] * cosines + rotation[1, 1] * sines).astype(np.float32)
    level_z = (rotation[0, 2] * cosines + rotation[1, 2] * sines).astype(np.float32)
    for r in range(rows):
        tangent, row_x, row_y = tangents[r], map_x[r], map_y[r]
        x_up, y_up = np.float32(tangent * rotation[2, 0]), np.float32(tangent * rotation[2, 1])
        z_up = np.float32(tangent * rotation[2, 2])
        for c in range(columns):
            x, y = level_x[c] + x_up, level_y[c] + y_up
            column = -arctan2(y, x) * per_radian
            row_x[c] = column + left + (around if column < _ZERO else _ZERO)
            row_y[c] = above - arctan2(level_z[c] + z_up, np.sqrt(x * x + y * y)) * per_row
    return map_x, map_y


@kernel
def move_profile(profile: Float64, dx: float, dy: float) -> Float64:
    """A wall profile as seen from another place: nearest wall wins, holes are filled from their rims.

    Parameters
    ----------
    profile : float64 (columns,)
        Distances from the source, metres.
    dx, dy : float
        From the source to the other place, metres.

    Returns
    -------
    float64 (columns,)
    """
    columns = profile.shape[0]
    per_radian = columns / (2.0 * np.pi)
    moved = np.full(columns, np.inf)
    previous_column, previous_range = 0.0, 0.0
    for k in range(columns + 1):
        c = k % columns
        azimuth = -2.0 * np.pi * c / columns
        x, y = profile[c] * np.cos(azimuth) - dx, profile[c] * np.sin(azimuth) - dy
        distance = np.sqrt(x * x + y * y)
        column = -np.arctan2(y, x) * per_radian
        if k > 0:
            # The wall goes on between two neighbouring columns, unless the distance jumps: that is an edge, with a gap behind it.
            step = column - previous_column
            step -= columns * np.round(step / columns)
            gap = abs(distance - previous_range) > 0.3 * min(distance, previous_range)
            if not gap and abs(step) < columns / 4:
                # Rounding must not drop a column that an end of the piece falls on.
                first = np.ceil(min(previous_column, previous_column + step) - 1e-9)
                last = np.floor(max(previous_column, previous_column + step) + 1e-9)
                for i in range(int(first), int(last) + 1):
                    fraction = 0.0 if step == 0.0 else (i - previous_column) / step
                    there = previous_range + fraction * (distance - previous_range)
                    if there < moved[i % columns]:
                        moved[i % columns] = there
            else:
                i = int(np.round(column)) % columns
                if distance < moved[i]:
                    moved[i] = distance
        previous_column, previous_range = column, distance
    if np.all(np.isinf(moved)):
        # Seen from very far away all walls fit between two columns.
        moved[:] = previous_range
    # A hole lies behind an edge: what shows in it is the farther of its two rims.
    for c in range(columns):
        if not np.isinf(moved[c]):
            continue
        left, right = 1, 1
        while left < columns and np.isinf(moved[(c - left) % columns]):
            left += 1
        while right < columns and (np.isinf(moved[(c + right) % columns]) or moved[(c + right) % columns] < 0.0):
            right += 1
        # Filled values are kept negative until the end, so that a hole is filled from its rims and not from itself.
        moved[c] = -max(abs(moved[(c - left) % columns]), moved[(c + right) % columns])
    filled: Float64 = np.abs(moved)
    return filled


@kernel
def column_agreement(
    first: Complex64, first_usable: Bool, second: Complex64, second_usable: Bool
) -> tuple[Float64, Float64, Float64]:
    """Sums over the rows of two images of features, over the pixels that are usable in both.

    Parameters
    ----------
    first, second : complex64 (rows, columns)
    first_usable, second_usable : bool (rows, columns)

    Returns
    -------
    common : float64 (columns,)
        Real part of the inner product of every column.
    first_energy, second_energy : float64 (columns,)
        Squared norms.
    """
    rows, columns = first.shape
    common, first_energy, second_energy = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    for r in range(rows):
        for c in range(columns):
            # A factor instead of a branch, so that the loop is vectorised.
            both = np.float32(first_usable[r, c] and second_usable[r, c])
            a, b = first[r, c], second[r, c]
            common[c] += both * (a.real * b.real + a.imag * b.imag)
            first_energy[c] += both * (a.real * a.real + a.imag * a.imag)
            second_energy[c] += both * (b.real * b.real + b.imag * b.imag)
    return common, first_energy, second_energy


@vector_kernel
def features_of_planes(planes: Float32) -> tuple[Complex64, Bool]:
    """Features and usability that were interpolated together.

    Parameters
    ----------
    planes : float32 (rows, columns, 4)
        Real part, imaginary part, usability, and nothing: reading four planes takes half the time of three.

    Returns
    -------
    z : complex64 (rows, columns)
    usable : bool (rows, columns)
    """
    rows, columns, _ = planes.shape
    z, usable = np.empty((rows, columns), dtype=np.complex64), np.empty((rows, columns), dtype=np.bool_)
    nearly = np.float32(0.99)
    for r in range(rows):
        for c in range(columns):
            z[r, c] = complex(planes[r, c, 0], planes[r, c, 1])
            usable[r, c] = planes[r, c, 2] > nearly
    return z, usable
