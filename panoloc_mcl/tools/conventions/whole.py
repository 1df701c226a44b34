"""Conventions of a whole data set: references and drives together tell what either alone cannot."""

from __future__ import annotations

from dataclasses import replace

from panoloc_mcl.robot.settings.localizer import MotionSettings
from panoloc_mcl.tools.conventions.drives import drive_findings, trajectory_fit
from panoloc_mcl.tools.conventions.readings import MIRRORED, MIRRORED_Y, Fit
from panoloc_mcl.tools.conventions.references import height_findings, reference_fit
from panoloc_mcl.tools.conventions.stamps import stamp_findings
from panoloc_mcl.tools.datasets import Dataset

_LEFT_HANDED = replace(
    MIRRORED,
    kind="left-handed",
    said="the poses fit mirrored, as in a left-handed frame",
    remedy="change the signs of y and theta",
)
_IMAGES_MIRRORED = replace(MIRRORED, remedy="write the other sense for camera.columns (or azimuth), or mirror them back")


def convention_findings(dataset: Dataset, most_drives: int = 3, motion: MotionSettings | None = None) -> list[str]:
    """One line for each convention that fits the images far better than what is written; empty for a good data set.

    Parameters
    ----------
    dataset : Dataset
    most_drives : int
        So many of its drives are looked at.
    motion : MotionSettings, optional
        Of the run; the usual ones if left out.
    """
    drives = list(dataset.sequences.values())[:most_drives]
    lines = [line for drive in dataset.sequences.values() for line in stamp_findings(drive, motion)]
    fit = reference_fit(dataset.references)
    images_mirrored = False
    if fit is None:
        lines += height_findings(dataset.references)
    else:
        fit, images_mirrored = _told_by_drives(fit, dataset, most_drives)
        lines.append(fit.line(str(dataset.references.path / "poses.csv")))
    if not lines or not images_mirrored:
        for drive in drives:
            if not stamp_findings(drive, motion):
                lines += drive_findings(drive)
    return lines


def _told_by_drives(fit: Fit, dataset: Dataset, most_drives: int) -> tuple[Fit, bool]:
    """Mirrored images and mirrored poses look alike in the references; drives of the same camera turn with their odometry, or not."""
    if fit.reading.kind not in (MIRRORED.kind, MIRRORED_Y.kind):
        return fit, False
    for drive in list(dataset.sequences.values())[:most_drives]:
        if drive.odometry is None or drive.camera != dataset.references.camera:
            continue
        of_drive = trajectory_fit(drive, drive.odometry)[0]
        if of_drive is not None and of_drive.reading.kind == MIRRORED.kind:
            return replace(fit, reading=_IMAGES_MIRRORED), True
        if of_drive is None:
            return (fit if fit.reading.kind == MIRRORED_Y.kind else replace(fit, reading=_LEFT_HANDED)), False
    return fit, False
