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
def column_products(
    view: Complex64,
    view_usable: Bool,
    query: Complex64,
    query_usable: Bool,
    profile: Float64,
    floor: Float64,
    tangents: Float64,
    every: int,
) -> Float64:
    """What Gauss-Newton equations of pose and tilt are made of, summed over the rows of every column (see `normal_equations`).

    A step of the pose moves the features of a pixel along the row and along the column, by amounts that are products of something of
    the column (its azimuth) and of powers of the inverse distance. So sums over the rows, column by column, hold all that is needed,
    and columns can be left out afterwards.

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
    every : int
        Only every so many rows are used; neighbouring rows say nearly the same.

    Returns
    -------
    float64 (18, columns)
        With a and b the derivatives along row and column, e the difference, d the distance and l half the sine of twice the
        elevation, over the pixels that both show: aa/d^2, aa/d, aa, abl/d^2, abl/d, ab/d, ab, bbll/d^2, bbl/d, bb, ae/d, ae, bel/d,
        be, number of pixels, inner product of query and view, and both squared norms.
    """
    rows, columns = view.shape
    sums = np.zeros((18, columns))
    nearness = np.empty(columns, dtype=np.float32)
    wall = 1.0 / profile
    a_re, a_im = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    aa, ab, bb = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    ae, be = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    quarter = np.float32(0.25)
    for r in range(1, rows - 1, every):
        # Half the sine of twice the elevation: what a step towards a point changes in its elevation, times its distance.
        lift = tangents[r] / (1.0 + tangents[r] * tangents[r])
        ground = 1.0 / floor[r]
        v, q, vu, qu = view[r], query[r], view_usable[r], query_usable[r]
        v_above, v_below, q_above, q_below = view[r - 1], view[r + 1], query[r - 1], query[r + 1]
        # Loops over few arrays each, without branches: only such ones are vectorised.
        for c in range(1, columns - 1):
            across = v[c + 1] - v[c - 1] + q[c + 1] - q[c - 1]
            a_re[c], a_im[c] = quarter * across.real, quarter * across.imag
        for c in (0, columns - 1):
            left, right = (c - 1) % columns, (c + 1) % columns
            across = v[right] - v[left] + q[right] - q[left]
            a_re[c], a_im[c] = quarter * across.real, quarter * across.imag
        for c in range(columns):
            both = np.float32(vu[c] and qu[c])
            down = v_below[c] - v_above[c] + q_below[c] - q_above[c]
            b_re, b_im = quarter * down.real, quarter * down.imag
            error = q[c] - v[c]
            aa[c] = both * (a_re[c] * a_re[c] + a_im[c] * a_im[c])
            ab[c] = both * (a_re[c] * b_re + a_im[c] * b_im)
            bb[c] = both * (b_re * b_re + b_im * b_im)
            ae[c] = both * (a_re[c] * error.real + a_im[c] * error.imag)
            be[c] = both * (b_re * error.real + b_im * error.imag)
        for c in range(columns):
            nearness[c] = max(wall[c], ground)
        s0, s1, s2 = sums[0], sums[1], sums[2]
        for c in range(columns):
            near = nearness[c] * aa[c]
            s0[c] += near * nearness[c]
            s1[c] += near
            s2[c] += aa[c]
        s3, s4, s5, s6 = sums[3], sums[4], sums[5], sums[6]
        for c in range(columns):
            near = nearness[c] * ab[c]
            s3[c] += lift * near * nearness[c]
            s4[c] += lift * near
            s5[c] += near
            s6[c] += ab[c]
        s7, s8, s9 = sums[7], sums[8], sums[9]
        for c in range(columns):
            near = lift * nearness[c] * bb[c]
            s7[c] += lift * nearness[c] * near
            s8[c] += near
            s9[c] += bb[c]
        s10, s11, s12, s13 = sums[10], sums[11], sums[12], sums[13]
        for c in range(columns):
            s10[c] += nearness[c] * ae[c]
            s11[c] += ae[c]
            s12[c] += lift * nearness[c] * be[c]
            s13[c] += be[c]
        s14, s15, s16, s17 = sums[14], sums[15], sums[16], sums[17]
        for c in range(columns):
            both = np.float32(vu[c] and qu[c])
            s14[c] += both
            s15[c] += both * (q[c].real * v[c].real + q[c].imag * v[c].imag)
            s16[c] += both * (q[c].real * q[c].real + q[c].imag * q[c].imag)
            s17[c] += both * (v[c].real * v[c].real + v[c].imag * v[c].imag)
    return sums


@kernel
def normal_equations(products: Float64, chosen: Bool, row_step: float) -> tuple[Float64, Float64, float, float]:
    """Gauss-Newton equations of the pose and the tilt that bring a view into agreement with an image.

    The unknowns are the steps of the view's position (x, y, metres), of the image's heading (radians), and of the camera's pitch and
    roll (radians). Derivatives are those of the mean of both (efficient second-order minimisation, Malis 2004).

    Parameters
    ----------
    products : float64 (18, columns)
        Of view and image (see `column_products`).
    chosen : bool (columns,)
        Columns that count.
    row_step : float
        Elevation of a row, radians.

    Returns
    -------
    normal : float64 (5, 5)
    right : float64 (5,)
    residual : float
        Sum of squared differences.
    count : float
        Number of pixels used.
    """
    columns = products.shape[1]
    # Columns and rows a radian.
    m, k = columns / (2.0 * np.pi), 1.0 / row_step
    normal = np.zeros((5, 5))
    right = np.zeros(5)
    residual, count = 0.0, 0.0
    for c in range(columns):
        if not chosen[c]:
            continue
        azimuth = -2.0 * np.pi * c / columns
        cos, sin = np.cos(azimuth), np.sin(azimuth)
        aa2, aa1, aa0, ab2, abl, ab1, ab0, bb2, bb1, bb0, ae1, ae0, be1, be0, n, qv, qq, vv = products[:, c]
        # A step in x moves the features by sin m / d along the row and by cos k l / d along the column; and so on.
        normal[0, 0] += sin * sin * m * m * aa2 + 2.0 * sin * cos * m * k * ab2 + cos * cos * k * k * bb2
        normal[1, 0] += sin * cos * (k * k * bb2 - m * m * aa2) + (sin * sin - cos * cos) * m * k * ab2
        normal[1, 1] += cos * cos * m * m * aa2 - 2.0 * sin * cos * m * k * ab2 + sin * sin * k * k * bb2
        normal[2, 0] -= m * (sin * m * aa1 + cos * k * abl)
        normal[2, 1] -= m * (sin * k * abl - cos * m * aa1)
        normal[2, 2] += m * m * aa0
        x_lift, y_lift = k * (sin * m * ab1 + cos * k * bb1), k * (sin * k * bb1 - cos * m * ab1)
        normal[3, 0] -= cos * x_lift
        normal[4, 0] -= sin * x_lift
        normal[3, 1] -= cos * y_lift
        normal[4, 1] -= sin * y_lift
        normal[3, 2] += cos * m * k * ab0
        normal[4, 2] += sin * m * k * ab0
        normal[3, 3] += cos * cos * k * k * bb0
        normal[4, 3] += sin * cos * k * k * bb0
        normal[4, 4] += sin * sin * k * k * bb0
        right[0] += sin * m * ae1 + cos * k * be1
        right[1] += sin * k * be1 - cos * m * ae1
        right[2] -= m * ae0
        right[3] -= cos * k * be0
        right[4] -= sin * k * be0
        residual += qq + vv - 2.0 * qv
        count += n
    for i in range(5):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return normal, right, max(residual, 0.0), count
