from dataclasses import replace

import numpy as np

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.tools.datasets import Dataset, Trajectory
from panoloc_mcl.tools.streams import Image, Odometry, Truth, recorded


def drive(small_room: Dataset):
    some = small_room.sequences["noon_00"]
    times = np.array([1.0, 2.0, 3.0])
    odometry = Trajectory(np.array([0.5, 1.5, 2.0, 2.5, 3.5, 4.5]), np.zeros((6, 3)))
    return replace(some, times=times, files=some.files[:3], odometry=odometry, groundtruth=Trajectory(times, np.ones((3, 3))))


def order(messages) -> list[str]:
    short = {Odometry: "o", Image: "i", Truth: "t"}
    return [f"{short[type(message)]}{message.timestamp:g}" for message in messages]


def test_an_image_comes_after_the_first_odometry_that_is_not_older(small_room: Dataset) -> None:
    assert order(recorded(drive(small_room))) == ["o0.5", "o1.5", "t1", "i1", "o2", "t2", "i2", "o2.5", "o3.5", "t3", "i3"]


def test_images_may_arrive_late_out_of_order_or_not_at_all(small_room: Dataset) -> None:
    some = replace(drive(small_room), groundtruth=None)
    late = recorded(some, arrival=np.array([2.1, 2.0, 3.0]), kept=np.array([True, True, False]))
    assert order(late) == ["o0.5", "o1.5", "o2", "i2", "o2.5", "i1"]


def test_images_are_read_when_they_are_looked_at(small_room: Dataset) -> None:
    read: list[object] = []

    def reading(file: object) -> np.ndarray:
        read.append(file)
        return np.zeros((2, 2))

    stream = [m for m in recorded(drive(small_room), read=reading) if type(m) is Image]
    assert read == []
    assert stream[1].pixels().shape == (2, 2)
    assert read == [drive(small_room).files[1]]
    assert [message.index for message in stream] == [0, 1, 2]


def test_an_image_that_cannot_be_read_says_why(small_room: Dataset, tmp_path) -> None:
    broken = replace(drive(small_room), files=(tmp_path / "none.png",) * 3)
    found = next(m for m in recorded(broken) if isinstance(m, Image)).pixels()
    assert isinstance(found, ImageError)
    assert "no such file" in str(found)
