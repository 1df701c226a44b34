"""What every reader of recordings gives, and the drive that it becomes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera.mount import Mount
from panoloc_mcl.robot.camera.spec import AnyCamera
from panoloc_mcl.robot.errors import DatasetError, ImageError
from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.tools.datasets.dataset import Sequence
from panoloc_mcl.tools.datasets.recordings.images import ImageReel, RecordedImage
from panoloc_mcl.tools.datasets.trajectory import Trajectory

# So many images are tried for their size before a recording is called unreadable.
_TRIED = 20


@dataclass(eq=False)
class Recording:
    """A drive as it was recorded.

    Parameters
    ----------
    name : str
    path : Path
    stamps : int64 (n,)
        Of the images, nanoseconds, in the order that they are stored in.
    images : ImageReel, or tuple of Path
        Where they are.
    odometry, truth : Trajectory or None
    notes : list of str
        What the user should know.
    camera : AnyCamera or None
        That the recording itself describes; ``camera_note`` says how, if it is used.
    mount : Mount or None
        Where the recording has the camera on the robot.
    """

    name: str
    path: Path
    stamps: NDArray[np.int64]
    images: ImageReel | tuple[Path, ...]
    odometry: Trajectory | None = None
    truth: Trajectory | None = None
    notes: list[str] = field(default_factory=list)
    camera: AnyCamera | None = None
    camera_note: str = ""
    mount: Mount | None = None

    def sequence(self, camera: AnyCamera) -> Sequence:
        """The drive, its images in order of time, the first of those with one stamp.

        Raises
        ------
        DatasetError
            No image can be read.
        """
        if self.mount is not None and camera.mount is None:
            m = self.mount
            camera = camera.model_copy(update={"mount": m})
            self.notes.append(
                f"{self.path.name}: camera at x {m.x_m:.3f} m, y {m.y_m:.3f} m, yaw {m.yaw_deg:.1f} degrees, by tf"
            )
        stamps, first = np.unique(self.stamps, return_index=True)
        doubled = len(self.stamps) - len(stamps)
        if doubled:
            self.notes.append(f"{self.path.name}: {doubled} images have the stamp of another one; left out")
        files, size = self._files(first)
        # By the clock of odometry from here on, so the camera that goes with it has no offset any more.
        times = np.array([int(stamp) / 10**9 for stamp in stamps]) + camera.stamp_offset_s
        if camera.time_offset_s is not None:
            camera = camera.model_copy(update={"time_offset_s": None})
        return Sequence(
            name=self.name,
            path=self.path,
            times=times,
            files=files,
            camera=camera,
            image_size=size,
            odometry=self.odometry,
            groundtruth=self.truth,
            notes=tuple(dict.fromkeys(self.notes)),
        )

    def _files(self, order: NDArray[np.intp]) -> tuple[tuple[ImageSource, ...], tuple[int, int]]:
        problem = "holds no images"
        for index in order[:_TRIED].tolist():
            source: ImageSource
            source = self.images[index] if isinstance(self.images, tuple) else RecordedImage(self.images, index, (0, 0))
            try:
                height, width = read_image(source).shape[:2]
            except ImageError as error:
                problem = str(error)
                continue
            if isinstance(self.images, tuple):
                return tuple(self.images[i] for i in order.tolist()), (width, height)
            return tuple(RecordedImage(self.images, i, (width, height)) for i in order.tolist()), (width, height)
        raise DatasetError(f"{self.path}: no image can be read: {problem}")
