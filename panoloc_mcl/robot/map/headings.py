"""Headings of references that nobody measured, or only coarsely, from their images.

The turn between two panoramas of neighbouring places is the shift around the circle at which their features correlate most. All turns
together give headings but for one common turn (angular synchronisation: Singer, "Angular synchronization by eigenvectors and
semidefinite programming", 2011), refined by least squares that outliers hardly move. What headings were given, however coarse, fix the
common turn; where none was, parallax does: only in the right frame do views warped from one place to the next agree better than the
images as they are. Mending then works on what is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.sparse import coo_matrix, csr_matrix, vstack
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh, lsqr
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import compose, wrap_angle
from panoloc_mcl.robot.map.pairs import neighbour_pairs
from panoloc_mcl.robot.observation.scale import references_at
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, References, read_references
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles
from panoloc_mcl.robot.synthesis.plausibility import agreements
from panoloc_mcl.robot.synthesis.spacing import usual_spacing

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# From this standard deviation on a heading is found anew, radians: mending follows smaller errors by itself.
_COARSE = np.radians(5.0)
# Of a heading that is given without one.
_GIVEN = np.radians(1.0)
# Turns are found between so many columns at most: fractions of a column are read off the peak.
_COLUMNS = 180
# Neighbours see things shifted by parallax: features are smoothed by as much, standard deviation. Set on the rendered hall: turns of
# references 1 m apart come out twice as good.
_PARALLAX_DEG = 5.0
# Neighbours beyond so many usual distances show other things.
_FAR_IN_SPACINGS = 2.5
# Standard deviations within which a turn is looked for; another turn than the best is farther from it than this, radians.
_LIKELY, _OTHER_TURN, _LEAST_WEIGHT = 3.0, np.radians(20.0), 0.01
_ROUNDS = 10
# Larger matrices are sparse ones.
_DENSE = 500
_LEAST_SD = np.radians(0.1)
# Common turns that are tried, and references that they are tried on: groups of neighbours from all over the map.
_TURNS, _GROUPS, _GROUP = 24, 3, 6


def with_headings(
    source: References, votes: VotesSettings, settings: MapSettings, progress: Progress = no_progress, threads: int = 1
) -> tuple[References, tuple[str, ...]]:
    """References whose headings are all known well enough to be mended, and what the user should know.

    Parameters
    ----------
    source : References
        A standard deviation of the heading without end says that it is not known.
    votes : VotesSettings
    settings : MapSettings
    progress : callable (done, total, what)
    threads : int

    Raises
    ------
    DatasetError, ImageError
        As `read_references`, of references with such headings.
    """
    sds = _sds(source, settings)
    coarse = sds >= _COARSE
    if not coarse.any() or len(source) < 2:
        return source, ()
    panoramas = _small(read_references(source, progress))
    pairs = neighbour_pairs(panoramas.positions, settings.neighbours, _FAR_IN_SPACINGS * usual_spacing(panoramas.positions))
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    turns, weights = pair_turns(panoramas, pairs, votes, sds)
    found, residual_sd = synchronised(pairs, turns, weights, sds)
    doubt, note = residual_sd, ""
    if np.isinf(sds).all():
        common, doubt, note = _common_turn(panoramas, found, votes, threads)
        found = found + common
    poses, all_sds = source.poses.copy(), np.full((len(source), 2), np.nan) if source.sds is None else source.sds.copy()
    poses[coarse, 2] = wrap_angle(poses[coarse, 2] + found[coarse])
    all_sds[coarse, 1] = max(residual_sd, doubt)
    told = (
        f"headings of {int(coarse.sum())} of {len(source)} references found from their images; turns between neighbours fit them to "
        f"{np.degrees(residual_sd):.1f} degrees{note}"
    )
    if residual_sd > _OTHER_TURN:
        told += "; their images are too unlike to tell: give theta in poses.csv, or take references nearer to each other"
    return replace(source, poses=poses, sds=all_sds), (told,)


def _sds(source: References, settings: MapSettings) -> Float64:
    """Standard deviations of the given headings, radians (n,)."""
    given = _GIVEN if settings.sd_theta_deg is None else np.radians(settings.sd_theta_deg)
    sds = np.full(len(source), given)
    if source.sds is not None:
        sds = np.where(np.isnan(source.sds[:, 1]), sds, source.sds[:, 1])
    return sds


def _small(panoramas: ReferencePanoramas) -> ReferencePanoramas:
    rows, columns = panoramas.geometry.shape
    width = min(columns, _COLUMNS)
    return references_at(panoramas, (max(1, round(rows * width / columns)), width))


def pair_turns(panoramas: ReferencePanoramas, pairs: Int64, votes: VotesSettings, sds: Float64) -> tuple[Float64, Float64]:
    """By how much the second of each pair is turned against the first, as their images have it, and how clearly.

    Parameters
    ----------
    panoramas : ReferencePanoramas
    pairs : int64 (m, 2)
    votes : VotesSettings
    sds : float64 (n,)
        Of the headings that panoramas were turned to 0 by: farther off, no turn is looked for.

    Returns
    -------
    turns, weights : float64 (m,)
        Radians; and the lead of the best turn over the best one elsewhere, as a share of its score.
    """
    spectra = [_spectra(orientations(panoramas.panorama(index), votes)[0]) for index in range(len(panoramas))]
    count = panoramas.geometry.width
    every = wrap_angle(2.0 * np.pi * np.arange(count) / count)
    turns, weights = np.empty(len(pairs)), np.empty(len(pairs))
    for row, (first, second) in enumerate(pairs):
        # Content moves to larger columns when the heading grows.
        scores = fft.ifft(np.sum(spectra[second] * spectra[first].conj(), axis=0)).real
        likely = np.abs(every) <= _LIKELY * np.hypot(sds[first], sds[second])
        best = int(np.where(likely, scores, -np.inf).argmax())
        before, here, after = scores[[best - 1, best, (best + 1) % count]]
        bend = before - 2.0 * here + after
        turns[row] = every[best] + 2.0 * np.pi / count * (0.5 * (before - after) / bend if bend < 0.0 else 0.0)
        rival = scores[np.abs(wrap_angle(every - every[best])) > _OTHER_TURN].max()
        weights[row] = np.clip(1.0 - rival / max(here, 1e-12), _LEAST_WEIGHT, 1.0)
    return np.asarray(wrap_angle(turns)), weights


def _spectra(z: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Of rows that are smoothed around the circle."""
    columns = z.shape[1]
    frequencies = fft.fftfreq(columns) * columns
    return np.asarray(fft.fft(z, axis=1) * np.exp(-0.5 * np.square(np.radians(_PARALLAX_DEG) * frequencies)).astype(np.float32))


def synchronised(pairs: Int64, turns: Float64, weights: Float64, sds: Float64) -> tuple[Float64, float]:
    """Corrections of headings that meet the turns between pairs, and the standard deviation of what is left of these.

    Parameters
    ----------
    pairs : int64 (m, 2)
    turns, weights : float64 (m,)
        Correction of the second less that of the first, radians, by their images, and how far it is trusted, up to 1.
    sds : float64 (n,)
        Of the given headings, whose correction is 0 but for this; without end where none is given. References that no turn joins to a
        given one have no common turn but their own.
    """
    count = len(sds)
    relative = csr_matrix((weights * np.exp(1j * turns), (pairs[:, 1], pairs[:, 0])), shape=(count, count))
    _, parts = connected_components(abs(relative), directed=False)
    found = np.zeros(count)
    for part in range(parts.max() + 1):
        mine = np.flatnonzero(parts == part)
        block = relative[mine][:, mine]
        angles = np.angle(_leading(csr_matrix(block + block.conj().T)))
        given = np.where(np.isfinite(sds[mine]), 1.0 / np.square(sds[mine]), 0.0)
        found[mine] = angles - (np.angle(np.sum(given * np.exp(1j * angles))) if given.any() else angles[0])
    scale = _LEAST_SD
    rows = np.arange(len(pairs))
    differences = coo_matrix((np.tile([-1.0, 1.0], len(pairs)), (np.repeat(rows, 2), pairs.ravel())), shape=(len(pairs), count))
    known = np.flatnonzero(np.isfinite(sds))
    for _ in range(_ROUNDS):
        left = wrap_angle(turns - (found[pairs[:, 1]] - found[pairs[:, 0]]))
        scale = max(1.4826 * float(np.median(np.abs(left))) if len(left) else 0.0, _LEAST_SD)
        # Cauchy's weights: a turn that is far off has next to none.
        trusted = np.sqrt(weights) / (scale * np.sqrt(1.0 + np.square(left / (2.0 * scale))))
        held = coo_matrix((1.0 / sds[known], (np.arange(len(known)), known)), shape=(len(known), count))
        system = vstack([differences.multiply(trusted[:, None]), held]).tocsr()
        right = np.concatenate([trusted * left, -wrap_angle(found[known]) / sds[known]])
        found = found + np.asarray(lsqr(system, right, atol=1e-10, btol=1e-10, iter_lim=2000)[0])
    return np.asarray(wrap_angle(found)), scale


def _leading(matrix: csr_matrix) -> NDArray[np.complex128]:
    """Eigenvector of the largest eigenvalue of a Hermitian matrix."""
    count = matrix.shape[0]
    if count <= _DENSE:
        return np.asarray(np.linalg.eigh(matrix.toarray())[1][:, -1])
    return np.asarray(eigsh(matrix, 1, which="LA", v0=np.ones(count))[1][:, 0])


def _common_turn(
    panoramas: ReferencePanoramas, headings: Float64, votes: VotesSettings, threads: int
) -> tuple[float, float, str]:
    """The turn of all headings (n,) together at which warping gains most, its standard deviation, and what to say of it."""
    height = panoramas.camera_height_m
    if height is None:
        return 0.0, np.inf, "; all of them may be turned by one angle: give camera.height_m, or the heading of one reference"
    columns = panoramas.geometry.width
    shifts = np.rint(headings * columns / (2.0 * np.pi)).astype(int)
    chosen = _groups(panoramas.positions)
    level = panoramas.of(chosen)
    # At heading 0 all show what they would have shown in a frame that is turned by the common angle alone.
    level = replace(level, pixels=np.stack([np.roll(p, -s, axis=1) for p, s in zip(level.pixels, shifts[chosen], strict=True)]))
    if level.valid is not None:
        level = replace(
            level, valid=np.stack([np.roll(v, -s, axis=1) for v, s in zip(level.valid, shifts[chosen], strict=True)])
        )
    turns = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    gains = np.empty(_TURNS)
    for index, turn in enumerate(turns):
        turned = replace(
            level, positions=compose(np.array([0.0, 0.0, -turn]), np.pad(level.positions, ((0, 0), (0, 1))))[:, :2]
        )
        synthesizer = ViewSynthesizer(turned, sweep_profiles(turned, height, votes, threads=threads), height)
        gains[index] = float(np.nanmedian(agreements(synthesizer, votes, threads=threads).warped))
    best = int(gains.argmax())
    before, here, after = gains[[best - 1, best, (best + 1) % _TURNS]]
    bend = before - 2.0 * here + after
    step = 2.0 * np.pi / _TURNS
    turn = float(turns[best] + step * (0.5 * (before - after) / bend if bend < 0.0 else 0.0))
    return turn, 0.5 * step, ""


def _groups(positions: Float64) -> Int64:
    middles = np.linspace(0, len(positions) - 1, _GROUPS + 2).round().astype(int)[1:-1]
    _, nearest = cKDTree(positions).query(positions[middles], k=min(_GROUP, len(positions)))
    return np.unique(nearest).astype(np.int64)
