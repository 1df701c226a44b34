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


def test_a_trajectory_of_another_name_is_not_passed_over(room: Path) -> None:
    path = room / SEQUENCE / "odometry.tum"
    path.rename(path.with_name("Odometry.csv"))
    (fault,) = check_dataset(room)
    assert fault.startswith(f"{path.with_name('Odometry.csv')}: is not read; write it as odometry.tum")
    path.with_name("Odometry.csv").rename(path)
    path.with_name("odometry.csv").write_text("the same, for a spreadsheet")
    assert check_dataset(room) == []


def test_references_all_at_one_place_are_no_map(room: Path) -> None:
    path = room / "references" / "poses.csv"
    header, *rows = path.read_text().split()
    again = [f"{row.split(',')[0]},2.0,1.0,{0.1 * number}" for number, row in enumerate(rows)]
    path.write_text("\n".join([header, *again]))
    (fault,) = check_dataset(room)
    assert fault == f"{path}: all {len(rows)} images have one place; write where each was taken"


def test_frames_in_milliseconds_are_one_fault_of_the_frames(room: Path) -> None:
    path = room / SEQUENCE / "frames.csv"
    head, *rows = path.read_text().splitlines()
    in_seconds = [row.split(",") for row in rows]
    path.write_text("\n".join([head, *(f"{1000.0 * float(time):.3f},{file}" for time, file in in_seconds)]))
    (fault,) = check_dataset(room)
    assert fault.startswith(f"{path}: time stamps")
    assert "look like milliseconds" in fault
    assert "write seconds" in fault
