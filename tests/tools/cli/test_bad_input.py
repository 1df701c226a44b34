"""What is wrong is said in one line with a remedy, code 2, and nothing half-written; what is survivable is survived."""

import csv
import json
import os
import re

import cv2
import numpy as np
import pytest

# A map that learns nothing of its own certainty, where another one is built that tells nothing of maps.
QUICK = ("--set", "observation.votes.calibration_references=0")


def replace_text(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def frame(drive, index):
    """The file of a frame."""
    with (drive / "frames.csv").open() as stream:
        return drive / list(csv.DictReader(stream))[index]["file"]


def steps(done):
    with (done.folder / "noon_00" / "run_0" / "steps.csv").open() as stream:
        return list(csv.DictReader(stream))


def refused(done, tmp_path, *words):
    """The one line that a command ended with."""
    assert done.code == 2
    assert done.out == ""
    (line,) = done.err.splitlines()
    for word in words:
        assert word in line
    assert re.search(r"; \w", line), f"no remedy: {line}"
    assert not (tmp_path / "out").exists()


class TestDataSets:
    def test_missing_image(self, run_small, drive, tmp_path):
        frame(drive, 3).unlink()
        refused(run_small(), tmp_path, f"{drive / 'frames.csv'}:5", "images/f003.png: no such file")

    def test_reference_that_is_no_image(self, run_small, small_room, tmp_path):
        image = next((small_room / "references").rglob("*.jpg"), None) or next((small_room / "references").rglob("*.png"))
        image.write_text("not an image")
        refused(run_small(), tmp_path, image.name, "not a whole PNG or JPEG")

    def test_missing_reference(self, run_small, small_room, tmp_path):
        image = next((small_room / "references").rglob("*.jpg"), None) or next((small_room / "references").rglob("*.png"))
        image.unlink()
        refused(run_small(), tmp_path, image.name, "no such file")

    def test_damaged_reference(self, run_small, small_room, tmp_path):
        image = next((small_room / "references").rglob("*.jpg"), None) or next((small_room / "references").rglob("*.png"))
        image.write_bytes(image.read_bytes()[:-200])
        done = run_small()
        assert done.code == 2
        assert "cut off" in done.err.splitlines()[-1]
        assert not (tmp_path / "out").exists()

    def test_image_of_another_size(self, run_small, drive, tmp_path):
        cv2.imwrite(str(frame(drive, 3)), np.full((40, 90), 99, dtype=np.uint8))
        refused(run_small(), tmp_path, frame(drive, 3).name, "90 x 40 pixels", "90 x 36")

    def test_row_with_nan(self, run_small, small_room, tmp_path):
        poses = small_room / "references" / "poses.csv"
        rows = poses.read_text().splitlines()
        poses.write_text("\n".join([*rows[:2], re.sub(r"[^,]+$", "nan", rows[2]), *rows[3:], ""]))
        refused(run_small(), tmp_path, f"{poses}:3", "theta", "nan")

    def test_unknown_column(self, run_small, drive, tmp_path):
        rows = (drive / "frames.csv").read_text().splitlines()
        (drive / "frames.csv").write_text("\n".join([f"{rows[0]},speed", *(f"{row},1" for row in rows[1:]), ""]))
        refused(run_small(), tmp_path, "frames.csv:1", "unknown column 'speed'")

    def test_time_stamps_that_do_not_increase(self, run_small, drive, tmp_path):
        rows = (drive / "frames.csv").read_text().splitlines()
        rows[3], rows[4] = rows[4], rows[3]
        (drive / "frames.csv").write_text("\n".join([*rows, ""]))
        refused(run_small(), tmp_path, "frames.csv:5", "timestamp")

    def test_damaged_odometry(self, run_small, drive, tmp_path):
        rows = (drive / "odometry.tum").read_text().splitlines()
        (drive / "odometry.tum").write_text("\n".join([*rows[:-1], rows[-1].replace(" ", " x", 1), ""]))
        refused(run_small(), tmp_path, f"odometry.tum:{len(rows)}")

    def test_several_faults_come_together(self, run_small, drive, small_room):
        frame(drive, 3).unlink()
        replace_text(small_room / "dataset.yaml", "name:", "nam:")
        done = run_small()
        assert done.code == 2
        assert len(done.err.splitlines()) == 3
        assert "did you mean 'name'?" in done.err

    def test_neither_a_folder_nor_a_name(self, run_small, tmp_path):
        refused(run_small("--set", "dataset=hal"), tmp_path, "dataset = 'hal'", "did you mean 'hall'?")

    def test_sequence_that_is_not_there(self, run_small, tmp_path):
        refused(run_small("--set", "sequences=[noon_01]"), tmp_path, "'noon_01' fits none", "did you mean 'noon_00'?")

    def test_data_set_without_sequences(self, run_small, small_room, tmp_path):
        (small_room / "sequences").rename(small_room / "aside")
        refused(run_small(), tmp_path, "has no sequences")


class TestConfigurations:
    def test_unknown_key(self, run_small, tmp_path):
        refused(run_small("--set", "sed=1"), tmp_path, "--set sed=1: unknown key 'sed'", "did you mean 'seed'?")

    def test_value_out_of_range(self, run_small, tmp_path):
        refused(run_small("--set", "runs=0"), tmp_path, "runs = 0: must be greater than or equal to 1")

    @pytest.mark.parametrize("value", [".nan", ".inf"])
    def test_value_that_is_not_finite(self, run_small, tmp_path, value):
        refused(run_small("--set", f"observation.votes.vote_width={value}"), tmp_path, "must be a finite number")

    def test_seed_below_zero(self, run_small, tmp_path):
        refused(run_small("--seed", "-1"), tmp_path, "--seed -1: seed = -1: must be greater than or equal to 0")

    def test_file_that_is_not_there(self, panoloc, tmp_path):
        refused(panoloc("run", tmp_path / "none.yaml"), tmp_path, "none.yaml: no such file")

    @pytest.mark.slow
    def test_start_from_ground_truth_that_is_not_there(self, run_small, drive, tmp_path):
        (drive / "groundtruth.tum").unlink()
        done = run_small(config="track")
        assert done.code == 2
        assert "sequence noon_00 has no ground truth" in done.err.splitlines()[-1]
        assert not (tmp_path / "out").exists()


class TestMaps:
    @pytest.mark.parametrize(
        ("key", "value", "what"),
        [
            ("elevation_deg", "[50, 80]", "does not fit the camera"),
            ("elevation_deg", "[10, 80]", "another camera"),
            ("height_m", "6.0", "above the floor"),
        ],
    )
    def test_map_for_another_camera(self, run_small, room_map, small_room, tmp_path, key, value, what):
        path = small_room / "dataset.yaml"
        text = re.sub(rf"  {key}:(.*\n)(  - .*\n)*", f"  {key}: {value}\n", path.read_text())
        assert value in text
        path.write_text(text)
        refused(run_small("--set", f"map={room_map}"), tmp_path, "map 'room'", what)

    def test_missing_and_damaged_map(self, run_small, room_map, tmp_path):
        refused(run_small("--set", "map=none.panomap"), tmp_path, "none.panomap: no such map file")
        room_map.write_bytes(room_map.read_bytes()[:-100])
        refused(run_small("--set", f"map={room_map}"), tmp_path, "room.panomap: not a map file, or cut short")

    def test_build_map_writes_the_whole_file_or_none(self, panoloc, small_room, tmp_path):
        (tmp_path / "taken").write_text("")
        done = panoloc("build-map", small_room, "-o", tmp_path / "taken" / "a.panomap", *QUICK)
        assert done.code == 2
        assert "a.panomap: cannot be written" in done.err.splitlines()[-1]
        done = panoloc("build-map", small_room, "-o", tmp_path / "a.panomap", "--set", "observation.votes.components=0")
        assert done.code == 2
        assert sorted(path.name for path in tmp_path.iterdir()) == ["room", "taken", "work"]

    def test_update_map_refuses_what_it_could_not_write_before_it_works(self, panoloc, room_map, small_room, tmp_path):
        (tmp_path / "folder").mkdir()
        done = panoloc("update-map", room_map, small_room, "--drives", "*", "-o", tmp_path / "folder")
        assert done.code == 2
        assert done.err.splitlines()[-1].endswith("folder: cannot be written (is a folder); check permissions and free space")
        assert not (tmp_path / "folder.parts").exists()

    def test_build_map_says_what_the_user_should_know_of_the_map(self, panoloc, small_room, tmp_path):
        file = small_room / "dataset.yaml"
        file.write_text("\n".join(line for line in file.read_text().splitlines() if "height_m" not in line))
        done = panoloc("build-map", small_room, "-o", tmp_path / "a.panomap")
        assert done.code == 0
        assert "map: no virtual places: the camera's height is not known" in done.err

    @pytest.mark.slow
    def test_one_gross_error_among_references_is_named_and_the_map_built(self, panoloc, small_room, tmp_path):
        file = small_room / "references" / "poses.csv"
        rows = file.read_text().splitlines()
        name, x, *others = rows[6].split(",")
        rows[6] = ",".join([name, f"{float(x) + 1.5:.6f}", *others])
        file.write_text("\n".join(rows) + "\n")
        done = panoloc("build-map", small_room, "-o", tmp_path / "a.panomap")
        assert done.code == 0, done.err
        assert name in done.err
        assert (tmp_path / "a.panomap").is_file()


class TestOutput:
    def test_file_where_the_folder_should_be(self, run_small, tmp_path):
        (tmp_path / "out").write_text("mine")
        done = run_small()
        assert done.code == 2
        assert "--out" in done.err.splitlines()[-1]
        assert (tmp_path / "out").read_text() == "mine"

    @pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unwritable for root")
    def test_folder_without_permission(self, run_small, tmp_path):
        (tmp_path / "locked").mkdir(mode=0o500)
        done = run_small("--out", tmp_path / "locked" / "out")
        assert done.code == 2
        assert "cannot be made" in done.err.splitlines()[-1]

    @pytest.mark.slow
    def test_cache_that_cannot_be_written_costs_a_line(self, run_small, tmp_path, monkeypatch):
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "file" / "cache"))
        done = run_small(*QUICK)
        assert done.code == 0
        (line,) = [line for line in done.err.splitlines() if "warning" in line]
        assert line.startswith("warning: map not kept for the next run: ")
        assert ".py" not in done.err


class TestSurvived:
    def survived(self, done, index):
        """The row of a frame that could not be used."""
        assert done.code == 0, done.err
        assert "note: sequence noon_00: 1 of 8 images skipped; steps.csv says why" in done.err.splitlines()
        rows = steps(done)
        assert len(rows) == 8
        assert [row["message"] != "" for row in rows] == [i == index for i in range(8)]
        assert all(np.isfinite(float(row["n_eff"])) for row in rows)
        metrics = json.loads((done.folder / "metrics.json").read_text())
        assert metrics["overall"]["frames"] == 8
        return rows[index]["message"]

    def test_corrupt_frame(self, run_small, drive):
        image = frame(drive, 4)
        image.write_bytes(image.read_bytes()[:-200])
        self.survived(run_small(), 4)

    @pytest.mark.parametrize("content", [b"", b"not an image"])
    def test_frame_that_is_no_image(self, run_small, drive, content):
        frame(drive, 4).write_bytes(content)
        self.survived(run_small(), 4)

    @pytest.mark.parametrize("level", [0, 255])
    def test_black_and_saturated_frames(self, run_small, drive, level):
        cv2.imwrite(str(frame(drive, 4)), np.full((36, 90), level, dtype=np.uint8))
        self.survived(run_small(), 4)

    def test_black_frame_at_the_very_start_with_the_kalman_filter(self, run_small, drive):
        cv2.imwrite(str(frame(drive, 0)), np.zeros((36, 90), dtype=np.uint8))
        self.survived(run_small(config="kalman"), 0)

    def test_no_odometry(self, run_small, drive):
        (drive / "odometry.tum").unlink()
        done = run_small()
        assert done.code == 0
        assert "note: sequence noon_00: has no odometry, runs on images only" in done.err.splitlines()
        assert len(steps(done)) == 8

    def test_no_ground_truth(self, run_small, drive):
        (drive / "groundtruth.tum").unlink()
        done = run_small()
        assert done.code == 0
        metrics = json.loads((done.folder / "metrics.json").read_text())
        assert metrics["overall"]["ape_rmse_m"] is None
        assert not (done.folder / "noon_00" / "run_0" / "groundtruth.tum").exists()
