"""How the camera leaned in all images that a map is made of, found where nobody said it.

Seen by a camera that leans by two degrees on its mount, a floor falls to one side. Views of one place from elsewhere contradict
each other then, and poses are off by millimetres that the map cannot tell from other errors. What the search finds is used where
images agree better with it than chance explains: a room of few images can seem to lean by half a degree, but they agree no
better with that.
"""

from __future__ import annotations

import math

from panoloc_mcl.robot.camera import AnyCamera
from panoloc_mcl.robot.map.camera_search.adjustment import adjust, search
from panoloc_mcl.robot.map.camera_search.features import COARSE_COLUMNS, FINE_COLUMNS
from panoloc_mcl.robot.map.camera_search.parameters import of_tilt
from panoloc_mcl.robot.map.camera_search.references_scene import ReferencesScene
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.observation import VotesSettings

# Images agree better with a camera that leans by so many standard errors. Where it is upright (27 sets: hall, office and a small
# room, their drives, a survey 10 cm off) it was 1.9 at the most, and once 2.8, by 0.02 degrees; in a hall where it leans by half a
# degree 5.
_BETTER = 3.0
# Less, in degrees, is not worth mending again: two degrees cost 2.7 mm.
_LEAST_DEG = 0.1
# Smoothing of the features, pixels, of steps that show whether there is a lean at all: from five degrees they come within two of it.
_GLANCE = (1.5, 1.0, 1.0)


def with_found_tilt(
    references: References, votes: VotesSettings, progress: Progress = no_progress
) -> tuple[AnyCamera, tuple[str, ...]]:
    """The camera as it leans on its mount, and a note of it; the camera itself where a tilt is given, or none is found.

    Parameters
    ----------
    references : References
        With poses that are as good as can be had, and a camera whose height is known.
    votes : VotesSettings
        How images are compared.
    progress : callable (done, total, what)

    Raises
    ------
    DatasetError, ImageError
        Fewer than three places; images that cannot be read.
    """
    camera = references.camera
    if not camera.mounting.is_upright:
        return camera, ()
    coarse = ReferencesScene(references, votes, camera, columns=COARSE_COLUMNS)
    angles = of_tilt(camera.mounting)
    if not _better(coarse, adjust(camera, angles, coarse, schedule=_GLANCE).camera, camera):
        return camera, ()
    found = search(camera, angles, coarse, progress)
    fine = ReferencesScene(references, votes, found.camera, columns=FINE_COLUMNS)
    found = search(camera, angles, fine, progress, found)
    if not _better(fine, found.camera, camera):
        return camera, ()
    mount = found.camera.mounting
    said = f"pitch_deg {mount.pitch_deg:.2f}, roll_deg {mount.roll_deg:.2f}"
    note = f"found that the camera leans on its mount: {said}; camera.mount in dataset.yaml overrules it"
    return found.camera, (note,)


def _better(scene: ReferencesScene, found: AnyCamera, described: AnyCamera) -> bool:
    if math.hypot(found.mounting.pitch_deg, found.mounting.roll_deg) < _LEAST_DEG:
        return False
    gain, error = scene.gain(found, described)
    return gain > _BETTER * error
