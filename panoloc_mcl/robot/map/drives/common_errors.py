"""Errors that relative poses have in common.

All views made from one keyframe share its depths. Where these are wrong on one side, every image seen from there seems turned, the more
the farther ahead it was taken; where they are wrong all around, every way seems too long. Some of both is the same for all keyframes of
a drive, as depths are swept between neighbours along the way whose headings carry the turn (see `drift`), and as the height of the
camera gives all lengths. And a keyframe may seem turned by a little from wherever it is seen. A turn that grows with the way bends the
world: what lies ahead is shifted to the side, too, and relative poses along a straight way are those along an arc. Without the shift
they would contradict the arc, and their noise would choose a turn. A loop contradicts it; nothing in the images contradicts the others,
but a survey does.

Odometry creeps, too: it turns a little with every metre, and its metre is not quite one. Where images leave a turn or a length open,
odometry must not seem to know it better than it does: many steps that creep alike are no more exact than one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Edges
from panoloc_mcl.robot.map.pose_graph import CommonErrors

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Part = tuple[Int64, Int64, Float64]

# Standard deviations, set on maps of six drives through the hall and the office, one of them without a loop, whose camera's height was
# exact: turns in radians for each metre ahead and lengths as a share, of all keyframes of a drive and of each by itself; and how far a
# keyframe seems turned.
_TURN_OF_DRIVE, _LENGTH_OF_ALL = np.radians(0.05), 0.003
_TURN_OF_KEYFRAME, _LENGTH_OF_KEYFRAME = np.radians(0.08), 0.002
_TURN_OF_IMAGE = np.radians(0.05)
# Of odometry, all steps of a drive: wheels of unequal size, and a radius that is not quite known.
_TURN_OF_ODOMETRY, _LENGTH_OF_ODOMETRY = np.radians(1.0), 0.03


def common_errors(edges: Edges, poses: Float64, owner: Int64) -> CommonErrors:
    """Of measurements between images, and of odometry.

    Parameters
    ----------
    edges : Edges
    poses : float64 (n, 3)
        Of keyframes, as far as they are known. Effects are worked out from these: worked out from measurements they would carry their
        noise, and a map that shrinks would fit better.
    owner : int64 (n,)
        The drive of every keyframe.
    """
    count, drives = len(owner), int(owner.max()) + 1
    ahead, left, _ = between(poses[edges.first], poses[edges.second]).T
    images, odometry = (np.flatnonzero(found) for found in (edges.kinds != ODOMETRY, edges.kinds == ODOMETRY))
    first, second, of_drive = edges.first[images], edges.second[images], owner[edges.first]
    heading = 3 * images + 2
    # Which of its kind errs, what it adds to which value of the edges, and how far it may err.
    kinds = (
        (count, _TURN_OF_KEYFRAME, _bends(first, images, ahead, left)),
        (drives, _TURN_OF_DRIVE, _bends(of_drive[images], images, ahead, left)),
        (count, _LENGTH_OF_KEYFRAME, _lengths(first, images, ahead, left)),
        (1, _LENGTH_OF_ALL, _lengths(np.zeros(len(images), dtype=np.int64), images, ahead, left)),
        (count, _TURN_OF_IMAGE, ((second, heading, np.ones(len(images))), (first, heading, -np.ones(len(images))))),
        (drives, _TURN_OF_ODOMETRY, ((of_drive[odometry], 3 * odometry + 2, np.hypot(ahead, left)[odometry]),)),
        (drives, _LENGTH_OF_ODOMETRY, _lengths(of_drive[odometry], odometry, ahead, left)),
    )
    columns = []
    for size, _, parts in kinds:
        which, where, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        columns.append(sparse.csc_matrix((values, (where, which)), shape=(3 * len(edges), size)))
    sds = np.concatenate([np.full(size, sd) for size, sd, _ in kinds])
    return CommonErrors(sparse.hstack(columns, format="csc"), sds)


def _bends(which: Int64, rows: Int64, ahead: Float64, left: Float64) -> tuple[Part, ...]:
    """What turns more the farther ahead: as if the world were bent, so that what lies ahead is also shifted to the side."""
    ahead, left = ahead[rows], left[rows]
    return (which, 3 * rows + 2, ahead), (which, 3 * rows + 1, 0.5 * ahead**2), (which, 3 * rows, -ahead * left)


def _lengths(which: Int64, rows: Int64, ahead: Float64, left: Float64) -> tuple[Part, Part]:
    """What makes the ways of some edges longer by a share."""
    return (which, 3 * rows, ahead[rows]), (which, 3 * rows + 1, left[rows])
