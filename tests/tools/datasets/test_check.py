from pathlib import Path

from panoloc_mcl.tools.datasets import Trajectory, check_dataset, read_dataset, read_tum, write_tum

SEQUENCE = "sequences/noon_00"


def test_images_are_decoded(room: Path) -> None:
    file = room / SEQUENCE / "images" / "f001.png"
    file.write_bytes(file.read_bytes()[:-200])
    read_dataset(room)  # the header is whole
    (fault,) = check_dataset(room)
    assert fault.startswith(f"{file}: is cut off")


def test_trajectories_must_cover_the_frames(room: Path) -> None:
    path = room / SEQUENCE / "odometry.tum"
    odometry = read_tum(path)
    write_tum(path, Trajectory(odometry.times - 1000.0, odometry.poses))
    (fault,) = check_dataset(room)
    assert fault.startswith(f"{path}: covers 0.063 to")
    assert "3 of 3 frames" in fault
    assert "one clock" in fault


def test_two_references_at_one_pose_are_no_fault(room: Path) -> None:
    path = room / "references" / "poses.csv"
    path.write_text(path.read_text().replace("1.0,0.0,0.0", "0.0,0.0,0.0"))
    assert check_dataset(room) == []


def test_faults_beyond_a_broken_dataset_yaml_are_still_found(room: Path) -> None:
    (room / "dataset.yaml").write_text("format: [")
    (room / SEQUENCE / "odometry.tum").write_text("")
    assert len(check_dataset(room)) == 2
