import pytest

from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import read_dataset


def test_a_data_set_is_corrupted_by_command(small_room, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["corrupt", str(small_room.path), "-o", str(out), "--recipe", "body:strong+told", "--seed", "2"]
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(out)
    written = read_dataset(out)
    assert written.camera.mask is not None
    assert len(written.references) == len(small_room.references)
    assert "body:strong+told, seed 2" in written.description


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--recipe", "bdy:strong"], "did you mean 'body'?"),
        (["--recipe", "body"], "level is missing"),
        (["--recipe", "body:mild", "--seed", "-1"], "--seed -1: must be 0 or more"),
        (["--recipe", "body:mild", "--sequences", "nooon_00"], "did you mean 'noon_00'?"),
    ],
)
def test_bad_input_is_one_line(small_room, tmp_path, capsys, words, said):
    assert main(["corrupt", str(small_room.path), "-o", str(tmp_path / "out"), *words]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_something_is_left_alone(small_room, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["corrupt", str(small_room.path), "-o", str(tmp_path), "--recipe", "jpeg:mild"]) == 2
    assert "not empty" in capsys.readouterr().err
