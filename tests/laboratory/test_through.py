"""A model behind something: every image is changed, whether it is searched for or tracked."""

import numpy as np
import pytest

from panoloc_mcl.laboratory.through import SeenThrough
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation.tracking import Expected, TrackingModel
from panoloc_mcl.tools.datasets import Dataset, read_image


class Darker(SeenThrough):
    count = 0

    def seen(self, panorama: Panorama) -> Panorama:
        self.count += 1
        return Panorama(np.float32(0.5) * panorama.pixels, panorama.valid)


@pytest.mark.slow
def test_tracked_images_are_changed_like_searched_ones(small_room: Dataset, panorama_map: PanoramaMap) -> None:
    model = panorama_map.observation_model()
    through = Darker(model)
    assert isinstance(model, TrackingModel)
    assert isinstance(through, TrackingModel)
    assert through.places is model.places
    drive = small_room.sequences["noon_00"]
    panorama = panorama_map.unwrapper(drive.camera, drive.image_size)(read_image(drive.files[3]))
    assert drive.groundtruth is not None
    expected = Expected.of(drive.groundtruth.at(drive.times[3:4])[0], 0.02, 0.2)
    assert expected is not None
    dark = Panorama(np.float32(0.5) * panorama.pixels, panorama.valid)
    np.testing.assert_array_equal(through.observe(panorama).votes, model.observe(dark).votes)
    tracked, directly = through.observe_near(panorama, expected), model.observe_near(dark, expected)
    assert tracked.measurement is not None
    assert directly.measurement is not None
    np.testing.assert_array_equal(tracked.measurement.pose, directly.measurement.pose)
    assert through.count == 2
    with pytest.raises(AttributeError):
        _ = through.nothing_of_that_name
