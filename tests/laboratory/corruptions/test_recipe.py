import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoloc_mcl.laboratory.corruptions import CORRUPTIONS, bars, drop_frames, parse_recipe, random_pixels, tilt
from panoloc_mcl.robot.errors import ConfigError

IMAGE = np.random.default_rng(0).integers(1, 255, (30, 72), dtype=np.uint8)
FIELD = (-50.0, 25.0)


def faults_of(text):
    with pytest.raises(ConfigError) as caught:
        parse_recipe(text)
    return caught.value.faults


def test_a_recipe_is_its_steps_in_order():
    both = parse_recipe("bars:0.5+random_pixels:0.25").image(IMAGE, np.random.default_rng(1), FIELD)
    rng = np.random.default_rng(1)
    np.testing.assert_array_equal(both, random_pixels(bars(IMAGE, rng, 0.5), rng, 0.25))


@pytest.mark.parametrize("text", ["bars:0.5,count=2", "bars:share=0.5,count=2", " bars : 0.5 , count = 2 ".replace(" :", ":")])
def test_severities_by_name_and_by_place(text):
    corrupted = parse_recipe(text).image(IMAGE, np.random.default_rng(1), FIELD)
    np.testing.assert_array_equal(corrupted, bars(IMAGE, np.random.default_rng(1), 0.5, 2))


def test_tilt_is_told_the_field():
    corrupted = parse_recipe("tilt:4").image(IMAGE, np.random.default_rng(1), (-40.0, 20.0))
    np.testing.assert_array_equal(corrupted, tilt(IMAGE, np.random.default_rng(1), 4.0, (-40.0, 20.0)))


def test_clean_changes_nothing():
    clean = parse_recipe("clean")
    assert not clean.changes_images
    np.testing.assert_array_equal(clean.image(IMAGE, np.random.default_rng(0), FIELD), IMAGE)
    assert not np.shares_memory(clean.image(IMAGE, np.random.default_rng(0), FIELD), IMAGE)
    np.testing.assert_array_equal(clean.frames(5, np.random.default_rng(0)), np.arange(5))


@given(count=st.integers(0, 500), share=st.floats(0.0, 1.0), seed=st.integers(0, 1000))
def test_frames_are_lost_as_asked_and_stay_in_order(count, share, seed):
    left = drop_frames(count, np.random.default_rng(seed), share)
    assert len(left) == count - round(share * count)
    assert (np.diff(left) > 0).all()
    assert set(left) <= set(range(count))
    np.testing.assert_array_equal(left, parse_recipe(f"drop_frames:{share!r}").frames(count, np.random.default_rng(seed)))


def test_frames_and_images_in_one_recipe():
    recipe = parse_recipe("drop_frames:0.5+noise:3+drop_frames:0.5")
    assert recipe.changes_images
    assert len(recipe.frames(40, np.random.default_rng(0))) == 10
    assert not np.array_equal(recipe.image(IMAGE, np.random.default_rng(0), FIELD), IMAGE)


def test_drop_frames_leaves_images_alone():
    recipe = parse_recipe("drop_frames:0.5")
    assert not recipe.changes_images
    np.testing.assert_array_equal(recipe.image(IMAGE, np.random.default_rng(0), FIELD), IMAGE)


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_every_name_says_which_severity_it_lacks_or_does_without(name):
    needs = any(field.is_required() for field in CORRUPTIONS[name].parameters.model_fields.values())
    if needs:
        (fault,) = faults_of(name)
        assert "is missing" in fault
    else:
        assert parse_recipe(name).changes_images


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bar:0.7", "unknown corruption 'bar'; did you mean 'bars'?"),
        ("random_pixel:0.7", "did you mean 'random_pixels'?"),
        ("cleen", "did you mean 'clean'?"),
        ("qqq", "unknown corruption 'qqq'; known: random_pixels, bars"),
        ("", "unknown corruption ''"),
        ("bars:0.7+", "unknown corruption ''"),
        ("bars:1.2", "share = 1.2: must be less than or equal to 1"),
        ("random_pixels:-0.1", "share = -0.1: must be greater than or equal to 0"),
        ("blobs:nan", "share = 'nan'"),
        ("noise:.inf", "sd = inf"),
        ("drop_frames:2", "share = 2"),
        ("bars:many", "must be a valid number"),
        ("bars:true", "share = true"),
        ("bars:0.5,cuont=2", "unknown key 'cuont'; did you mean 'count'?"),
        ("bars:0.5,2", "'2' in 'bars:0.5,2' has no name"),
        ("bars:0.5,share=0.2", "'share' is given twice"),
        ("bars:[", "not valid YAML"),
    ],
)
def test_faults_are_one_line_with_a_remedy(text, said):
    (fault,) = faults_of(text)
    assert fault.startswith(f"corruption '{text}': ")
    assert said in fault
    assert "\n" not in fault


def test_every_fault_is_named():
    assert len(faults_of("bars:2+fog+gain:-1")) == 3
