"""Inner loops of view synthesis: where a point seen from one place appears from another.

The world around a place is a profile: in every column a vertical wall at some distance, and the floor up to it. Azimuth of column c is
-2 pi c / columns (clockwise); elevation of row r is ``top - (r + 0.5) * row_step``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]


# Coefficients of arctan(t) = t P(t^2) on [0, 1], by iteratively reweighted least squares.
ARCTAN = (
    0.9999999966727658,
    -0.33333302091086764,
    0.1999912982173639,
    -0.14274432314959162,
    0.11028651957399649,
    -0.08713862955357884,
    0.0654138350487966,
    -0.04208817279717219,
    0.02046789119610041,
    -0.006394794269840109,
    0.0009375635095654235,
)


@kernel
def arctan2(y: float, x: float) -> float:
    """Angle of a vector within 2e-10 radians, without branches or calls, so that loops over it are vectorised.

    The library's arctan2 takes most of a synthesised view. Odd minimax polynomial on [0, 1] and the octants' symmetries.
    """
    ax, ay = abs(x), abs(y)
    ratio = min(ax, ay) / max(max(ax, ay), 1e-300)
    q = ratio * ratio
    angle = ARCTAN[10]
    for k in range(9, -1, -1):
        angle = angle * q + ARCTAN[k]
    angle *= ratio
    angle = 0.5 * np.pi - angle if ay > ax else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@kernel
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
    per_radian = source_columns / (2.0 * np.pi)
    azimuths = -2.0 * np.pi * np.arange(columns) / columns
    cosines, sines = np.cos(azimuths), np.sin(azimuths)
    # Where a row sees the wall in every column, only its elevation is its own: the rest is worked out once.
    farthest = np.max(profile)
    wall_column, wall_range = np.empty(columns, dtype=np.float32), np.empty(columns)
    for c in range(columns):
        px, py = profile[c] * cosines[c] + dx, profile[c] * sines[c] + dy
        column = -arctan2(py, px) * per_radian
        wall_column[c] = column + margin + (source_columns if column < 0.0 else 0)
        wall_range[c] = np.sqrt(px * px + py * py)
    for r in range(rows):
        ground, tangent = floor[r], tangents[r]
        if ground >= farthest:
            for c in range(columns):
                map_x[r, c] = wall_column[c]
                map_y[r, c] = (top - arctan2(tangent * profile[c], wall_range[c])) / row_step - 0.5
            continue
        for c in range(columns):
            distance = min(ground, profile[c])
            px, py = distance * cosines[c] + dx, distance * sines[c] + dy
            column = -arctan2(py, px) * per_radian
            elevation = arctan2(tangent * distance, np.sqrt(px * px + py * py))
            map_x[r, c] = column + margin + (source_columns if column < 0.0 else 0)
            map_y[r, c] = (top - elevation) / row_step - 0.5
    return map_x, map_y


@kernel
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
    per_radian, per_row = source_columns / (2.0 * np.pi), 1.0 / row_step
    # A ray is (cos, sin, tangent): of its three turned components all but the tangent's part is the column's.
    cosines, sines = np.cos(azimuths - heading), np.sin(azimuths - heading)
    level_x = rotation[0, 0] * cosines + rotation[1, 0] * sines
    level_y = rotation[0, 1] * cosines + rotation[1, 1] * sines
    level_z = rotation[0, 2] * cosines + rotation[1, 2] * sines
    for r in range(rows):
        x_up, y_up, z_up = tangents[r] * rotation[2, 0], tangents[r] * rotation[2, 1], tangents[r] * rotation[2, 2]
        for c in range(columns):
            x, y = level_x[c] + x_up, level_y[c] + y_up
            column = -arctan2(y, x) * per_radian
            elevation = arctan2(level_z[c] + z_up, np.sqrt(x * x + y * y))
            map_x[r, c] = column + margin + (source_columns if column < 0.0 else 0)
            map_y[r, c] = (top - elevation) * per_row - 0.5
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
