"""``frames.npz``: what a run looked like, frame by frame, small enough to be kept and to be put into a page.

Panoramas are JPEGs, votes one byte a place and a heading, particles a few hundred of all.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.geometry import FloatArray

FORMAT = "panoloc-frames/2"
#: The largest value of a vote in one byte.
FULL = 255


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames of one run over one sequence.

    Parameters
    ----------
    rows : int64 (m,)
        Of ``steps.csv``, increasing.
    panoramas : tuple of bytes, length m
        JPEG; empty where there was no usable image.
    places : float64 (k, 2)
        Positions that images vote for, metres.
    spacing : float
        Distance of neighbouring places, metres.
    votes : uint8 (m, k)
        Most votes over the headings, as a share of ``peaks``.
    heading_votes : uint8 (m, h)
        Most votes over the places for h headings, counter-clockwise from 0, as a share of ``peaks``.
    peaks : float64 (m,)
        Votes that 255 stands for; 0 where the image said nothing.
    prior : float32 (n, 3)
        Particles before the first image; n = 0 for filters without particles.
    particles : float32 (m, n, 3)
        A fair draw of them, metres and radians.
    references : dict of int to bytes
        JPEGs of the references that were best, by index.
    elevation_deg : (float, float)
        Of the bottom and the top of all panoramas.
    """

    rows: NDArray[np.int64]
    panoramas: tuple[bytes, ...]
    places: FloatArray
    spacing: float
    votes: NDArray[np.uint8]
    heading_votes: NDArray[np.uint8]
    peaks: FloatArray
    prior: NDArray[np.float32]
    particles: NDArray[np.float32]
    references: dict[int, bytes]
    elevation_deg: tuple[float, float]

    def __len__(self) -> int:
        return len(self.rows)

    def frame_of(self, row: int) -> int:
        """Index of the recorded frame of a row of ``steps.csv``.

        Raises
        ------
        ResultsError
            It was not recorded.
        """
        found = np.flatnonzero(self.rows == row)
        if not len(found):
            every = int(self.rows[1] - self.rows[0]) if len(self.rows) > 1 else 1
            shown = f"0 to {self.rows[-1]}" + (f" in steps of {every}" if every > 1 else "") if len(self.rows) else "none"
            raise ResultsError(f"frame {row}: was not recorded; there are {shown}")
        return int(found[0])

    def field(self, frame: int) -> FloatArray:
        """Votes of the places at one frame, float64 (k,)."""
        return np.asarray(self.votes[frame] * (self.peaks[frame] / FULL), dtype=np.float64)

    @property
    def vote_range(self) -> tuple[float, float]:
        """Votes that any place gets by chance, and those that the best place of an ordinary frame gets."""
        peaks = self.peaks[self.peaks > 0.0]
        if not len(peaks):
            return 0.0, 1.0
        most = float(np.median(peaks))
        chance = float(np.median(self.votes * self.peaks[:, None])) / FULL
        return min(chance, 0.5 * most), most

    def save(self, path: Path) -> None:
        """Write it.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        panoramas, panorama_ends = _joined(self.panoramas)
        references, reference_ends = _joined(list(self.references.values()))
        write_arrays(
            path,
            {"format": FORMAT, "spacing": self.spacing, "elevation_deg": list(self.elevation_deg)},
            {
                "rows": self.rows,
                "panoramas": panoramas,
                "panorama_ends": panorama_ends,
                "places": self.places,
                "votes": self.votes,
                "heading_votes": self.heading_votes,
                "peaks": self.peaks,
                "prior": self.prior,
                "particles": self.particles,
                "references": references,
                "reference_ends": reference_ends,
                "reference_indices": np.array(list(self.references), dtype=np.int64),
            },
        )

    @classmethod
    def load(cls, path: Path) -> Recording:
        """Read it.

        Raises
        ------
        ResultsError
            Missing, damaged, or of another version.
        """
        try:
            header, arrays = read_arrays(path)
        except FileNotFoundError:
            raise ResultsError(f"{path}: no such file; run again to record the frames") from None
        except (OSError, ValueError) as error:
            raise ResultsError(f"{path}: not recorded frames, or damaged ({error}); run again") from error
        if header.get("format") != FORMAT:
            raise ResultsError(f"{path}: format is '{header.get('format')}', this version reads '{FORMAT}'; run again")
        try:
            indices = [int(index) for index in np.atleast_1d(arrays["reference_indices"])]
            recording = cls(
                rows=np.asarray(arrays["rows"], dtype=np.int64),
                panoramas=_parted(arrays["panoramas"], arrays["panorama_ends"]),
                places=np.asarray(arrays["places"], dtype=np.float64),
                spacing=float(header["spacing"]),
                votes=np.asarray(arrays["votes"], dtype=np.uint8),
                heading_votes=np.asarray(arrays["heading_votes"], dtype=np.uint8),
                peaks=np.asarray(arrays["peaks"], dtype=np.float64),
                prior=np.asarray(arrays["prior"], dtype=np.float32),
                particles=np.asarray(arrays["particles"], dtype=np.float32),
                references=dict(zip(indices, _parted(arrays["references"], arrays["reference_ends"]), strict=True)),
                elevation_deg=(float(header["elevation_deg"][0]), float(header["elevation_deg"][1])),
            )
        except (LookupError, ValueError, TypeError) as error:
            raise ResultsError(f"{path}: the recorded frames are damaged ({error}); run again") from error
        frames = (recording.panoramas, recording.votes, recording.heading_votes, recording.peaks, recording.particles)
        shapes = tuple(len(part) for part in frames)
        if set(shapes) != {len(recording)} or recording.votes.shape[1:] != recording.places.shape[:1]:
            raise ResultsError(f"{path}: the recorded frames are damaged (lengths differ); run again")
        return recording


def thinned(particles: FloatArray, weights: FloatArray, count: int) -> NDArray[np.float32]:
    """A fair draw of so many particles, the same each time: float32 (count, 3); (0, 3) where there are none."""
    if len(particles) == 0:
        return np.zeros((0, 3), dtype=np.float32)
    cumulative = np.cumsum(weights)
    picks = np.searchsorted(cumulative, (np.arange(count) + 0.5) / count * cumulative[-1])
    return np.asarray(particles[np.minimum(picks, len(particles) - 1)], dtype=np.float32)


def _joined(parts: Sequence[bytes]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    return np.frombuffer(b"".join(parts), dtype=np.uint8), np.cumsum([len(part) for part in parts], dtype=np.int64)


def _parted(joined: NDArray[np.generic], ends: NDArray[np.generic]) -> tuple[bytes, ...]:
    data = joined.tobytes()
    limits = [0, *(int(end) for end in np.atleast_1d(np.asarray(ends, dtype=np.int64)))]
    if limits[-1] != len(data) or any(a > b for a, b in itertools.pairwise(limits)):
        raise ValueError("images are cut short")
    return tuple(data[a:b] for a, b in itertools.pairwise(limits))
