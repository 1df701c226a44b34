import numpy as np
import pytest

from panoloc_mcl.laboratory.studies.images import disturbed

POSITION = "position mm: median / p95 / max"


@pytest.fixture
def images(ask, small_room):
    return lambda *words: ask("study", "images", "--dataset", small_room.path, "--every", "4", *words)


def median_mm(answer, label):
    (row,) = [row for row in answer.rows() if row["images of"] == label]
    return row[POSITION]["median"]


def test_errors_of_field_and_refined_pose(images):
    answer = images("--worst", "2")
    assert answer.code == 0
    assert "12 of 12 references" in answer.report["title"]
    assert "1 drives, 3 images" in answer.report["title"]
    assert median_mm(answer, "noon, refined") < min(20.0, median_mm(answer, "noon, vote field"))
    worst = [row["refined: mm"] for row in answer.rows(1)]
    assert len(worst) == 2
    assert worst == sorted(worst, reverse=True)


@pytest.mark.slow
def test_a_map_from_every_second_reference(images):
    answer = images("--references", "checkerboard")
    assert "6 of 12 references" in answer.report["title"]
    assert median_mm(answer, "noon, refined") < 50.0


@pytest.mark.slow
def test_disturbed_poses_make_errors_of_their_own_size(images):
    exact, answer = images(), images("--disturb", "5", "2", "--seed", "1")
    assert "(seed 1)" in answer.report["title"]
    assert median_mm(exact, "noon, refined") < median_mm(answer, "noon, refined") < 200.0


def test_errors_are_those_that_were_asked_for(small_room):
    references, said = disturbed(small_room.references, 0.02, 1.0, 7)
    errors = references.poses - small_room.references.poses
    assert references.files == small_room.references.files
    np.testing.assert_array_equal(references.poses, disturbed(small_room.references, 0.02, 1.0, 7)[0].poses)
    assert np.any(references.poses != disturbed(small_room.references, 0.02, 1.0, 8)[0].poses)
    asked = np.array([0.02, 0.02, np.radians(1.0)])
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert np.all((rms > 0.3 * asked) & (rms < 2.0 * asked))
    assert f"{100 * rms[0]:.1f} cm in x" in said
    assert f"{np.degrees(rms[2]):.2f} degrees" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--references", "chessboard"), "--references chessboard: no such part"),
        (("--every", "0"), "argument --every: 0: must be at least 1"),
        (("--disturb", "-1", "1"), "--disturb -1 1"),
        (("--set", "observation.votes.median=perhaps"), "median"),
    ],
)
def test_faults_are_one_line(images, words, said):
    answer = images(*words)
    assert (answer.code, answer.report) == (2, None)
    assert said in answer.err
    assert answer.err.count("\n") == 1
