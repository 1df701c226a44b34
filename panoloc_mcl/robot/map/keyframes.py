"""Keyframes: the images that a map is made of, where each was taken and how surely, and which of them see one another.

References of a survey are keyframes with given poses, images of a drive are keyframes whose poses odometry proposes. All else in a map
(depths, virtual places, the eigenspace, the calibration) is derived from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

#: What an edge rests on: two images refined against each other, odometry, or two images that met again after a while.
IMAGES, ODOMETRY, LOOP = 0, 1, 2
KINDS = ("images", "odometry", "loop")
# An edge with less weight than this is one that the others contradict.
BELIEVED = 0.1
# Nothing moves any more if this share of all keyframes does not.
_STILL_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class Edges:
    """Measured relative poses of pairs of keyframes.

    Parameters
    ----------
    first, second : int64 (m,)
        Indices of keyframes.
    measured : float64 (m, 3)
        Pose of the second in the frame of the first, metres and radians.
    covariances : float64 (m, 3, 3)
        Of that.
    kinds : int64 (m,)
        `IMAGES`, `ODOMETRY` or `LOOP`.
    weights : float64 (m,)
        How far the other edges bear it out, from 0 (contradicted) to 1.
    """

    first: Int64
    second: Int64
    measured: Float64
    covariances: Float64
    kinds: Int64
    weights: Float64

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def none(cls) -> Self:
        """No edges."""
        index = np.zeros(0, dtype=np.int64)
        return cls(index, index, np.zeros((0, 3)), np.zeros((0, 3, 3)), index, np.zeros(0))

    @classmethod
    def of(cls, pairs: NDArray[np.int64], measured: Float64, covariances: Float64, kind: int = IMAGES) -> Self:
        """Edges of one kind between pairs (m, 2), all believed."""
        pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        count = len(pairs)
        return cls(
            pairs[:, 0].copy(),
            pairs[:, 1].copy(),
            np.asarray(measured, dtype=np.float64).reshape(count, 3),
            np.asarray(covariances, dtype=np.float64).reshape(count, 3, 3),
            np.full(count, kind, dtype=np.int64),
            np.ones(count),
        )

    def chosen(self, which: NDArray[np.bool_] | Int64) -> Self:
        """Some of the edges."""
        return replace(self, **{name: getattr(self, name)[which] for name in EDGE_ARRAYS})

    def joined(self, other: Edges) -> Self:
        """These edges and others."""
        return replace(self, **{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in EDGE_ARRAYS})

    def among(self, kept: Int64) -> Self:
        """Edges between the keyframes that are kept (ascending indices), numbered anew."""
        inside = np.isin(self.first, kept) & np.isin(self.second, kept)
        some = self.chosen(inside)
        return replace(some, first=np.searchsorted(kept, some.first), second=np.searchsorted(kept, some.second))


#: What edges are made of.
EDGE_ARRAYS = ("first", "second", "measured", "covariances", "kinds", "weights")


@dataclass(frozen=True, eq=False)
class Keyframes:
    """What is known of every keyframe of a map but its pixels.

    Parameters
    ----------
    names : tuple of str
        Of the images.
    given : float64 (n, 3)
        Standpoints as they were given, by a survey or by odometry: where the camera stood and the heading of the base; metres and
        radians, map frame.
    poses : float64 (n, 3)
        The same as the map holds them.
    covariances : float64 (n, 3, 3)
        Of these; zero where they are taken as exact.
    times : float64 (n,)
        Seconds; NaN for references of a survey.
    drives : tuple of str
        The drive that each was taken on; empty for references of a survey.
    edges : Edges
        Which see which.
    left_out : mapping of str to str
        Images that are not in the map, and why.
    placed_anew : tuple of str
        Those whose given poses were far off, and that have another now.
    """

    names: tuple[str, ...]
    given: Float64
    poses: Float64
    covariances: Float64
    times: Float64
    drives: tuple[str, ...]
    edges: Edges = field(default_factory=Edges.none)
    left_out: Mapping[str, str] = field(default_factory=dict)
    placed_anew: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def surveyed(cls, names: tuple[str, ...], poses: Float64, sds: Float64 | None = None) -> Self:
        """Keyframes with given poses; ``sds`` (n, 2) of position and heading, metres and radians, if they are known."""
        count = len(names)
        # NaN: nobody says.
        known = np.zeros((count, 2)) if sds is None else np.nan_to_num(np.asarray(sds, dtype=np.float64), nan=0.0)
        variances = known[:, [0, 0, 1]] ** 2
        covariances = np.einsum("ni,ij->nij", variances, np.eye(3))
        poses = np.array(poses, dtype=np.float64).reshape(count, 3)
        return cls(names, poses, poses.copy(), covariances, np.full(count, np.nan), ("",) * count)

    @property
    def moved_m(self) -> Float64:
        """How far the map holds every keyframe from where it was given, metres (n,)."""
        return np.asarray(np.hypot(*(self.poses - self.given)[:, :2].T))

    @property
    def turned(self) -> Float64:
        """By how much the map holds every keyframe turned from what was given, radians (n,), with sign."""
        return angle_difference(self.poses[:, 2], self.given[:, 2])

    @property
    def sds(self) -> Float64:
        """Standard deviations of position (along its worse axis, metres) and heading (radians), (n, 2)."""
        worst = np.linalg.eigvalsh(self.covariances[:, :2, :2])[:, -1]
        return np.sqrt(np.maximum(np.column_stack([worst, self.covariances[:, 2, 2]]), 0.0))

    def of(self, kept: Int64) -> Self:
        """Some of the keyframes (ascending indices), with the edges between them."""
        return replace(
            self,
            names=tuple(self.names[index] for index in kept),
            given=self.given[kept],
            poses=self.poses[kept],
            covariances=self.covariances[kept],
            times=self.times[kept],
            drives=tuple(self.drives[index] for index in kept),
            edges=self.edges.among(kept),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that a map file keeps."""
        kept: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in ("given", "poses", "covariances", "times")}
        return kept | {f"edges.{name}": getattr(self.edges, name) for name in EDGE_ARRAYS}

    def header(self) -> dict[str, Any]:
        """The plain values that a map file keeps."""
        return {"drives": list(self.drives), "left_out": dict(self.left_out), "placed_anew": list(self.placed_anew)}

    @classmethod
    def restored(cls, names: tuple[str, ...], arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> Self:
        """What `arrays` and `header` gave.

        Raises
        ------
        KeyError, ValueError
            Arrays that are missing, or do not fit each other.
        """
        edges = Edges(**{name: arrays[f"edges.{name}"] for name in EDGE_ARRAYS})
        count = len(names)
        shapes = {"given": (count, 3), "poses": (count, 3), "covariances": (count, 3, 3), "times": (count,)}
        for name, shape in shapes.items():
            if arrays[name].shape != shape:
                raise ValueError(f"keyframes.{name} has shape {arrays[name].shape}, needs {shape}")
        if len(edges) and max(edges.first.max(), edges.second.max()) >= count:
            raise ValueError("edges name keyframes that the map does not have")
        return cls(
            names,
            arrays["given"],
            arrays["poses"],
            arrays["covariances"],
            arrays["times"],
            drives=tuple(header["drives"]),
            edges=edges,
            left_out=dict(header["left_out"]),
            placed_anew=tuple(header["placed_anew"]),
        )


def is_still(before: Float64, after: Float64, metres: float, radians: float) -> bool:
    """Whether nearly all poses (n, 3) moved by less than this."""
    moved = np.hypot(*(after - before)[:, :2].T)
    turned = np.abs(angle_difference(after[:, 2], before[:, 2]))
    return bool(np.mean((moved < metres) & (turned < radians)) >= _STILL_SHARE)
