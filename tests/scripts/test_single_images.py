import re

import numpy as np
import pytest


@pytest.fixture(scope="module")
def script(load_script):
    return load_script("single_images")


@pytest.fixture
def single_images(script, small_room, own_cache, capsys):
    """Run it on the small room; exit code, what it printed, what it complained of."""

    def run(*words):
        code = script.main(["--dataset", str(small_room.path), "--every", "4", *words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def median_mm(table, row):
    return float(re.search(rf"^\| {row} \| \d+ \| ([\d.]+) /", table, re.MULTILINE)[1])


def test_errors_of_field_and_refined_pose(single_images):
    code, table, _ = single_images("--worst", "2")
    assert code == 0
    assert "12 of 12 references" in table
    assert median_mm(table, "noon, refined") < min(20.0, median_mm(table, "noon, vote field"))
    # The worst images come worst first.
    worst = [float(mm) for mm in re.findall(r"^\| \S+\.png \| [^|]+ \| ([\d.]+),", table, re.MULTILINE)]
    assert len(worst) == 2
    assert worst == sorted(worst, reverse=True)


def test_a_map_from_every_second_reference(single_images):
    code, table, _ = single_images("--references", "checkerboard")
    assert code == 0
    assert "6 of 12 references" in table
    assert median_mm(table, "noon, refined") < 50.0


def test_disturbed_poses_make_errors_of_their_own_size(single_images):
    _, exact, _ = single_images()
    code, table, _ = single_images("--disturb", "5", "2", "--seed", "1")
    assert code == 0
    assert "(seed 1)" in table
    assert median_mm(exact, "noon, refined") < median_mm(table, "noon, refined") < 200.0


def test_errors_are_those_that_were_asked_for(script, small_room):
    references, said = script.disturbed(small_room.references, 0.02, 1.0, 7)
    errors = references.poses - small_room.references.poses
    assert references.files == small_room.references.files
    np.testing.assert_allclose(
        errors, script.disturbed(small_room.references, 0.02, 1.0, 7)[0].poses - small_room.references.poses
    )
    assert np.any(errors != script.disturbed(small_room.references, 0.02, 1.0, 8)[0].poses - small_room.references.poses)
    asked = np.array([0.02, 0.02, np.radians(1.0)])
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert np.all((rms > 0.3 * asked) & (rms < 2.0 * asked))
    assert f"{100 * rms[0]:.1f} cm in x" in said
    assert f"{np.degrees(rms[2]):.2f} degrees" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--references", "chessboard"), "--references chessboard: no such part"),
        (("--every", "0"), "--every 0: must be at least 1"),
        (("--disturb", "-1", "1"), "--disturb -1 1"),
        (("--set", "observation.votes.median=perhaps"), "median"),
    ],
)
def test_faults_are_one_line(single_images, words, said):
    code, out, error = single_images(*words)
    assert code == 2
    assert out == ""
    assert said in error
    assert error.count("\n") == 1
