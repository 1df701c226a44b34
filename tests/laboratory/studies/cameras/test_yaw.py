"""The study of the mount's yaw by references that are mirrored and turned."""

import numpy as np

from panoloc_mcl.laboratory.studies.cameras import yaw
from panoloc_mcl.robot.images import read_image


def test_a_mirror_turns_left_into_right_and_two_of_them_change_nothing(small_room, tmp_path):
    references = small_room.references
    once = yaw.changed(references, tmp_path, mirrored=True, turned=False)
    np.testing.assert_array_equal(once.poses, references.poses * [1.0, -1.0, -1.0])
    image, mirrored = read_image(references.files[0]), read_image(once.files[0])
    # What stood at 90 degrees to the left stands as far to the right; the heading stays.
    quarter = image.shape[1] // 4
    np.testing.assert_array_equal(mirrored[:, [0, quarter]], image[:, [0, -quarter]])
    twice = yaw.changed(once, tmp_path / "twice", mirrored=True, turned=False)
    np.testing.assert_array_equal(twice.poses, references.poses)
    np.testing.assert_array_equal(read_image(twice.files[0]), image)


def test_a_turned_robot_sees_the_same_elsewhere(small_room, tmp_path):
    references = small_room.references
    turned = yaw.changed(references, tmp_path, mirrored=False, turned=True)
    for index in range(len(references)):
        columns = (turned.poses[index, 2] - references.poses[index, 2]) * references.image_size[0] / (2.0 * np.pi)
        image = read_image(references.files[index])
        np.testing.assert_array_equal(read_image(turned.files[index]), np.roll(image, round(columns), axis=1))


def test_the_command_has_a_row_for_each_change(ask, small_room, monkeypatch):
    monkeypatch.setattr(yaw, "CHANGES", {name: yaw.CHANGES[name] for name in ("as they are", "mirrored")})
    answer = ask("study", "yaw", "--dataset", small_room.path, "--references", "3")
    assert answer.code == 0
    for row in answer.rows():
        assert row["looked at"] == 3
        # As described: panoramas of 90 columns tell it to a quarter of one.
        assert abs(row["yaw, °"]) < 1.0


def test_columns_that_run_the_other_way_are_one_line(ask, room):
    file = room / "dataset.yaml"
    file.write_text(file.read_text().replace("columns: clockwise", "columns: counterclockwise"))
    answer = ask("study", "yaw", "--dataset", room)
    assert answer.code == 2
    assert "must be panoramas, with columns: clockwise and heading_column: 0" in answer.err
