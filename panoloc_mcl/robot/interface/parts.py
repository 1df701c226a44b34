"""What a localizer consists of, and who may touch it when: shared by the pages that its class is written on."""

from __future__ import annotations

from panoloc_mcl.robot.camera import Camera, Mount, Unwrapper
from panoloc_mcl.robot.filters import PoseFilter, Sightings, Start, Status, telling_way
from panoloc_mcl.robot.interface.contradictions import Contradictions
from panoloc_mcl.robot.interface.frozen_camera import FrozenCamera
from panoloc_mcl.robot.interface.mounting_tilt import MountingTilt
from panoloc_mcl.robot.locks import Lock
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.motion import Anchor, ImageClock, OdometryBuffer
from panoloc_mcl.robot.motion.pace import Pace
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.robot.reasons import Finding
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import LocalizerSettings


class Parts:
    """The parts of a localizer; made by `Localizer`."""

    config: LocalizerConfig
    settings: LocalizerSettings
    images_skipped: int
    _map: PanoramaMap
    _revision: str
    _camera: Camera | None
    _image_size: tuple[int, int] | None
    _unwrap: Unwrapper
    _mount: Mount
    _stamp_offset_s: float
    _observation: ObservationModel
    _odometry: OdometryBuffer
    _clock: ImageClock
    _sightings: Sightings
    _filter: PoseFilter
    _frozen_camera: FrozenCamera
    _mounting_tilt: MountingTilt
    _contradictions: Contradictions
    _seed: int | tuple[int, ...]
    # How often the pose was given or forgotten: random numbers go on from there.
    _begun_anew: int
    # The camera's pose at the last answer: where the pose between images begins.
    _anchor: tuple[Anchor, Status] | None
    _has_fix: bool
    # The next image counts whatever the motion gate says.
    _forced: bool
    _images: int
    _gated: int
    _pace: Pace | None
    _reported: dict[str, int]
    # Images are processed one at a time; neither odometry nor `pose_at` waits for them.
    _lock: Lock

    def _new_sightings(self, start: Start | None) -> Sightings:
        """Of a belief that begins; where its position is given, the map need not tell it."""
        given = start is not None and start.position is not None
        return Sightings(self.settings.status, 0.0 if given else telling_way(self._map.references.positions))

    def _look_back(self, votes: VoteField, found: Finding, way_m: float) -> None:
        """What an image has come to: taken into the belief, after so many metres, or left out."""
        if votes.informative:
            belief = self._filter.state()
            self._sightings.counted(way_m, belief.backing, belief.vouches)
        else:
            self.images_skipped += 1
            self._sightings.left_out(found.reason)
