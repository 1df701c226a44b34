"""Errors that relative poses measured by images have in common.

All views made from one keyframe share its depths. Where these are wrong on one side, every image seen from there seems turned, the more
the farther ahead it was taken; where they are wrong all around, every way seems too long. Some of both is the same for all keyframes of
a drive, as depths are swept between neighbours along the way whose headings carry the turn (see `drift`), and as the height of the
camera gives all lengths. And a keyframe may seem turned by a little from wherever it is seen. A loop contradicts a turn that grows with
the way; nothing in the images contradicts the others, but a survey does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Edges
from panoloc_mcl.robot.map.pose_graph import CommonErrors

# Standard deviations, set on six maps of four drives through the hall and the office whose camera's height was exact: turns in radians
# for each metre ahead and lengths as a share, of all keyframes of a drive and of each by itself; and how far a keyframe seems turned.
_TURN_OF_DRIVE, _LENGTH_OF_ALL = np.radians(0.1), 0.003
_TURN_OF_KEYFRAME, _LENGTH_OF_KEYFRAME = np.radians(0.08), 0.002
_TURN_OF_IMAGE = np.radians(0.05)


def common_errors(edges: Edges, poses: NDArray[np.float64], owner: NDArray[np.int64]) -> CommonErrors:
    """Of measurements between images.

    Parameters
    ----------
    edges : Edges
        Those of odometry have none.
    poses : float64 (n, 3)
        Of keyframes, as far as they are known. Effects are worked out from these: worked out from measurements they would carry their
        noise, and a map that shrinks would fit better.
    owner : int64 (n,)
        The drive of every keyframe.
    """
    count, drives = len(owner), int(owner.max()) + 1
    rows = np.flatnonzero(edges.kinds != ODOMETRY)
    first, second = edges.first[rows], edges.second[rows]
    ahead, left, _ = between(poses[first], poses[second]).T
    x, y, heading = 3 * rows, 3 * rows + 1, 3 * rows + 2
    all_of_them = np.zeros(len(rows), dtype=np.int64)
    # Which of its kind errs, what it adds to which value of the edges, and how far it may err.
    kinds = (
        (count, _TURN_OF_KEYFRAME, ((first, heading, ahead),)),
        (drives, _TURN_OF_DRIVE, ((owner[first], heading, ahead),)),
        (count, _LENGTH_OF_KEYFRAME, ((first, x, ahead), (first, y, left))),
        (1, _LENGTH_OF_ALL, ((all_of_them, x, ahead), (all_of_them, y, left))),
        (count, _TURN_OF_IMAGE, ((second, heading, np.ones(len(rows))), (first, heading, -np.ones(len(rows))))),
    )
    columns = []
    for size, _, parts in kinds:
        which, where, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        columns.append(sparse.csc_matrix((values, (where, which)), shape=(3 * len(edges), size)))
    sds = np.concatenate([np.full(size, sd) for size, sd, _ in kinds])
    return CommonErrors(sparse.hstack(columns, format="csc"), sds)
