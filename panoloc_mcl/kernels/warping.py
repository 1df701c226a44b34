"""Inner loops of view synthesis: where a point seen from one place appears from another.

The world around a place is a profile: in every column a vertical wall at some distance, and the floor up to it. Azimuth of column c is
-2 pi c / columns (clockwise); elevation of row r is ``top - (r + 0.5) * row_step``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.kernels.jit import kernel

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


@kernel
def normal_equations(
    view: Complex64,
    view_usable: Bool,
    query: Complex64,
    query_usable: Bool,
    profile: Float64,
    floor: Float64,
    tangents: Float64,
    row_step: float,
    every: int,
) -> tuple[Float64, Float64, float, float, float, float, float]:
    """Gauss-Newton equations of the pose and the tilt that bring a view into agreement with an image.

    The unknowns are the steps of the view's position (x, y, metres), of the image's heading (radians), and of the camera's pitch and
    roll (radians). Derivatives are those of the mean of both (efficient second-order minimisation, Malis 2004).

    Parameters
    ----------
    view, query : complex64 (rows, columns)
        Features of the synthesised view, and of the image turned back by its heading.
    view_usable, query_usable : bool (rows, columns)
    profile : float64 (columns,)
        Distance of the wall as seen from the view, metres.
    floor : float64 (rows,)
        Distance at which a row meets the floor, metres.
    tangents : float64 (rows,)
        Tangent of the row's elevation.
    row_step : float
        Elevation of a row, radians.
    every : int
        Only every so many rows are used; neighbouring rows say nearly the same.

    Returns
    -------
    normal : float64 (5, 5)
    right : float64 (5,)
    residual : float
        Sum of squared differences.
    count : float
        Number of pixels used.
    common, query_energy, view_energy : float
        Real part of their inner product, and both squared norms, over those pixels.
    """
    rows, columns = view.shape
    per_radian = columns / (2.0 * np.pi)
    normal = np.zeros((5, 5))
    right = np.zeros(5)
    residual, count = 0.0, 0.0
    common, query_energy, view_energy = 0.0, 0.0, 0.0
    jacobian_re, jacobian_im = np.empty(5), np.empty(5)
    azimuths = -2.0 * np.pi * np.arange(columns) / columns
    cosines, sines = np.cos(azimuths), np.sin(azimuths)
    for r in range(1, rows - 1, every):
        # Half the sine of twice the elevation: what a step towards a point changes in its elevation, times its distance.
        lift = tangents[r] / (1.0 + tangents[r] * tangents[r])
        for c in range(columns):
            if not (view_usable[r, c] and query_usable[r, c]):
                continue
            left, here_right = (c - 1) % columns, (c + 1) % columns
            across = 0.25 * (view[r, here_right] - view[r, left] + query[r, here_right] - query[r, left])
            down = 0.25 * (view[r + 1, c] - view[r - 1, c] + query[r + 1, c] - query[r - 1, c])
            cos_c, sin_c = cosines[c], sines[c]
            distance = min(profile[c], floor[r])
            sideways = per_radian / distance
            upward = lift / (distance * row_step)
            x_step = across * (sin_c * sideways) + down * (cos_c * upward)
            y_step = -across * (cos_c * sideways) + down * (sin_c * upward)
            turn = -across * per_radian
            pitch = -down * (cos_c / row_step)
            roll = -down * (sin_c / row_step)
            jacobian_re[0], jacobian_im[0] = x_step.real, x_step.imag
            jacobian_re[1], jacobian_im[1] = y_step.real, y_step.imag
            jacobian_re[2], jacobian_im[2] = turn.real, turn.imag
            jacobian_re[3], jacobian_im[3] = pitch.real, pitch.imag
            jacobian_re[4], jacobian_im[4] = roll.real, roll.imag
            error = query[r, c] - view[r, c]
            for i in range(5):
                right[i] += jacobian_re[i] * error.real + jacobian_im[i] * error.imag
                for j in range(i + 1):
                    normal[i, j] += jacobian_re[i] * jacobian_re[j] + jacobian_im[i] * jacobian_im[j]
            residual += error.real * error.real + error.imag * error.imag
            count += 1.0
            q, v = query[r, c], view[r, c]
            common += q.real * v.real + q.imag * v.imag
            query_energy += q.real * q.real + q.imag * q.imag
            view_energy += v.real * v.real + v.imag * v.imag
    for i in range(5):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return normal, right, residual, count, common, query_energy, view_energy
