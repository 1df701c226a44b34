"""Gauss-Newton equations that align a synthesised view with an image, in position, heading and tilt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel, vector_kernel

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]


@vector_kernel
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
    float64 (24, columns)
        With a and b the derivatives along row and column, e the difference, d the distance, t the tangent of the elevation and l half
        the sine of twice the elevation, over the pixels that both show: aa/d^2, aa/d, aa, abl/d^2, abl/d, ab/d, ab, bbll/d^2, bbl/d,
        bb, ae/d, ae, bel/d, be, aat/d, aat, aatt, abtl/d, abt, aet, number of pixels, inner product of query and view, and both
        squared norms.
    """
    rows, columns = view.shape
    # A few hundred rows at most are summed, so single precision is enough, and twice as many are worked out at once.
    sums = np.zeros((24, columns), dtype=np.float32)
    wall = (1.0 / profile).astype(np.float32)
    row = np.empty((8, columns), dtype=np.float32)
    nearness, a_re, a_im, aa, ab, bb, ae, be = row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]
    quarter, one = np.float32(0.25), np.float32(1.0)
    for r in range(1, rows - 1, every):
        # Half the sine of twice the elevation: what a step towards a point changes in its elevation, times its distance.
        tangent, ground = np.float32(tangents[r]), np.float32(1.0 / floor[r])
        lift = tangent / (one + tangent * tangent)
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
        s20, s21, s22, s23 = sums[20], sums[21], sums[22], sums[23]
        for c in range(columns):
            both = np.float32(vu[c] & qu[c])
            down = v_below[c] - v_above[c] + q_below[c] - q_above[c]
            b_re, b_im = quarter * down.real, quarter * down.imag
            error = q[c] - v[c]
            across_re, across_im, down_re, down_im = both * a_re[c], both * a_im[c], both * b_re, both * b_im
            aa[c] = across_re * a_re[c] + across_im * a_im[c]
            ab[c] = across_re * b_re + across_im * b_im
            bb[c] = down_re * b_re + down_im * b_im
            ae[c] = across_re * error.real + across_im * error.imag
            be[c] = down_re * error.real + down_im * error.imag
            nearness[c] = max(wall[c], ground)
            s20[c] += both
        for c in range(columns):
            both = np.float32(vu[c] & qu[c])
            s21[c] += both * (q[c].real * v[c].real + q[c].imag * v[c].imag)
            s22[c] += both * (q[c].real * q[c].real + q[c].imag * q[c].imag)
            s23[c] += both * (v[c].real * v[c].real + v[c].imag * v[c].imag)
        s0, s1, s2, s14, s15, s16 = sums[0], sums[1], sums[2], sums[14], sums[15], sums[16]
        for c in range(columns):
            near, leaning = nearness[c] * aa[c], tangent * aa[c]
            s0[c] += near * nearness[c]
            s1[c] += near
            s2[c] += aa[c]
            s14[c] += nearness[c] * leaning
            s15[c] += leaning
            s16[c] += tangent * leaning
        s3, s4, s5, s6, s17, s18 = sums[3], sums[4], sums[5], sums[6], sums[17], sums[18]
        for c in range(columns):
            near, leaning = nearness[c] * ab[c], tangent * ab[c]
            s3[c] += lift * near * nearness[c]
            s4[c] += lift * near
            s5[c] += near
            s6[c] += ab[c]
            s17[c] += lift * nearness[c] * leaning
            s18[c] += leaning
        s7, s8, s9 = sums[7], sums[8], sums[9]
        for c in range(columns):
            near = lift * nearness[c] * bb[c]
            s7[c] += lift * nearness[c] * near
            s8[c] += near
            s9[c] += bb[c]
        s10, s11, s12, s13, s19 = sums[10], sums[11], sums[12], sums[13], sums[19]
        for c in range(columns):
            s10[c] += nearness[c] * ae[c]
            s11[c] += ae[c]
            s12[c] += lift * nearness[c] * be[c]
            s13[c] += be[c]
            s19[c] += tangent * ae[c]
    return sums.astype(np.float64)


@vector_kernel
def inner_products(view: Complex64, view_usable: Bool, query: Complex64, query_usable: Bool, every: int) -> Float64:
    """Inner product of query and view and both squared norms, over the pixels that `column_products` is of (parameters as there).

    Returns
    -------
    float64 (3,)
    """
    rows, columns = view.shape
    sums = np.zeros((3, columns), dtype=np.float32)
    common, of_query, of_view = sums[0], sums[1], sums[2]
    for r in range(1, rows - 1, every):
        v, q, vu, qu = view[r], query[r], view_usable[r], query_usable[r]
        for c in range(columns):
            both = np.float32(vu[c] & qu[c])
            common[c] += both * (q[c].real * v[c].real + q[c].imag * v[c].imag)
            of_query[c] += both * (q[c].real * q[c].real + q[c].imag * q[c].imag)
            of_view[c] += both * (v[c].real * v[c].real + v[c].imag * v[c].imag)
    out = np.zeros(3)
    for i in range(3):
        for c in range(columns):
            out[i] += np.float64(sums[i, c])
    return out


@kernel
def normal_equations(products: Float64, chosen: Bool, row_step: float) -> tuple[Float64, Float64, float, float]:
    """Gauss-Newton equations of the pose and the tilt that bring a view into agreement with an image.

    The unknowns are the steps of the view's position (x, y, metres), of the image's heading (radians), and of the camera's rotation
    about the level axes that point left and forward at azimuth 0 (radians; positive: nose down, right side down). Derivatives are
    those of the mean of both (efficient second-order minimisation, Malis 2004).

    Parameters
    ----------
    products : float64 (24, columns)
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
        aa2, aa1, aa0, ab2, abl, ab1, ab0, bb2, bb1, bb0, ae1, ae0, be1, be0 = products[:14, c]
        aat1, aat0, aatt, abtl, abt, aet, n, qv, qq, vv = products[14:, c]
        # A step in x moves the features by sin m / d along the row and by cos k l / d along the column; and so on.
        normal[0, 0] += sin * sin * m * m * aa2 + 2.0 * sin * cos * m * k * ab2 + cos * cos * k * k * bb2
        normal[1, 0] += sin * cos * (k * k * bb2 - m * m * aa2) + (sin * sin - cos * cos) * m * k * ab2
        normal[1, 1] += cos * cos * m * m * aa2 - 2.0 * sin * cos * m * k * ab2 + sin * sin * k * k * bb2
        normal[2, 0] -= m * (sin * m * aa1 + cos * k * abl)
        normal[2, 1] -= m * (sin * k * abl - cos * m * aa1)
        normal[2, 2] += m * m * aa0
        # Pitch moves them by sin m t along the row and by cos k along the column, roll by cos m t and by -sin k.
        x_across, x_down = m * (sin * m * aat1 + cos * k * abtl), k * (sin * m * ab1 + cos * k * bb1)
        y_across, y_down = m * (sin * k * abtl - cos * m * aat1), k * (sin * k * bb1 - cos * m * ab1)
        normal[3, 0] += sin * x_across + cos * x_down
        normal[4, 0] += cos * x_across - sin * x_down
        normal[3, 1] += sin * y_across + cos * y_down
        normal[4, 1] += cos * y_across - sin * y_down
        normal[3, 2] -= m * (sin * m * aat0 + cos * k * ab0)
        normal[4, 2] -= m * (cos * m * aat0 - sin * k * ab0)
        normal[3, 3] += sin * sin * m * m * aatt + 2.0 * sin * cos * m * k * abt + cos * cos * k * k * bb0
        normal[4, 3] += sin * cos * (m * m * aatt - k * k * bb0) + (cos * cos - sin * sin) * m * k * abt
        normal[4, 4] += cos * cos * m * m * aatt - 2.0 * sin * cos * m * k * abt + sin * sin * k * k * bb0
        right[0] += sin * m * ae1 + cos * k * be1
        right[1] += sin * k * be1 - cos * m * ae1
        right[2] -= m * ae0
        right[3] += sin * m * aet + cos * k * be0
        right[4] += cos * m * aet - sin * k * be0
        residual += qq + vv - 2.0 * qv
        count += n
    for i in range(5):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return normal, right, max(residual, 0.0), count


@kernel
def sector_pulls(products: Float64, chosen: Bool, row_step: float, sectors: int) -> Float64:
    """The right-hand side of `normal_equations`, sector by sector of the circle: what each pulls the pose towards.

    Parameters
    ----------
    products : float64 (24, columns)
        Of view and image (see `column_products`).
    chosen : bool (columns,)
        Columns that count.
    row_step : float
        Elevation of a row, radians.
    sectors : int
        So many over the circle.

    Returns
    -------
    float64 (sectors, 5)
    """
    columns = products.shape[1]
    m, k = columns / (2.0 * np.pi), 1.0 / row_step
    pulls = np.zeros((sectors, 5))
    for c in range(columns):
        if not chosen[c]:
            continue
        azimuth = -2.0 * np.pi * c / columns
        cos, sin = np.cos(azimuth), np.sin(azimuth)
        ae1, ae0, be1, be0, aet = products[10, c], products[11, c], products[12, c], products[13, c], products[19, c]
        pull = pulls[c * sectors // columns]
        pull[0] += sin * m * ae1 + cos * k * be1
        pull[1] += sin * k * be1 - cos * m * ae1
        pull[2] -= m * ae0
        pull[3] += sin * m * aet + cos * k * be0
        pull[4] += cos * m * aet - sin * k * be0
    return pulls


@kernel
def agreeing_columns(sums: Float64, reach: int, share: float) -> Bool:
    """Columns around which view and image agree at least by a share of the upper quartile of all.

    Parameters
    ----------
    sums : float64 (3, columns)
        Inner products of view and image, and both squared norms.
    reach : int
        Columns to either side that are looked at together.
    share : float

    Returns
    -------
    bool (columns,)
    """
    columns = sums.shape[1]
    agreement = np.empty(columns)
    around = np.zeros(3)
    for c in range(-reach, reach + 1):
        for i in range(3):
            around[i] += sums[i, c % columns]
    for c in range(columns):
        agreement[c] = around[0] / np.sqrt(max(around[1] * around[2], 1e-12))
        for i in range(3):
            around[i] += sums[i, (c + reach + 1) % columns] - sums[i, (c - reach) % columns]
    upper_quartile = np.partition(agreement, 3 * columns // 4)[3 * columns // 4]
    found: Bool = agreement >= share * upper_quartile
    return found
