import numpy as np
import pytest
from oracles import kernels as naive
from scipy import stats

from panoloc_mcl.robot.kernels import elementary
from panoloc_mcl.robot.kernels.filtering import random

# Random123 (Salmon et al. 2011), file tests/kat_vectors, lines "philox4x32 10": counter, key, answer.
KNOWN_ANSWERS = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_philox_gives_the_published_answers(variant, counter: str, key: str, answer: str) -> None:
    c, k, expected = (tuple(int(word, 16) for word in words.split()) for words in (counter, key, answer))
    words = variant(random.philox)(*(np.uint64(word) for word in (*c, *k)))
    assert tuple(int(word) for word in words) == expected
    assert naive.philox(c, k) == expected


@pytest.mark.parametrize("first", [0, 12, 2**32 - 5])
def test_normals_agree_with_numpy(variant, first: int) -> None:
    drawn = variant(random.normals)(2**63 - 5, 17, 3, first, 40)
    assert drawn == pytest.approx(naive.normals(2**63 - 5, 17, 3, first, 40), abs=3e-6)


def test_numbers_depend_on_key_step_stream_and_index_alone() -> None:
    whole = random.normals(5, 6, 7, 0, 1000)
    for first, count in ((0, 1), (1, 3), (2, 5), (17, 500), (999, 1)):
        assert np.array_equal(random.normals(5, 6, 7, first, count), whole[:, first : first + count])
    others = [random.normals(4, 6, 7, 0, 1000), random.normals(5, 5, 7, 0, 1000), random.normals(5, 6, 8, 0, 1000)]
    for other in others:
        # In single precision, a few of some thousand are equal by chance.
        assert np.isin(other, whole).mean() < 0.01
        assert abs(np.corrcoef(other.ravel(), whole.ravel())[0, 1]) < 6.0 / np.sqrt(whole.size)


def test_normals_are_standard_normal_and_independent() -> None:
    # Two steps, as the filter takes them.
    drawn = np.concatenate([random.normals(11, step, 0, 0, 100_000) for step in (1, 2)])
    for row in drawn:
        assert stats.kstest(row, "norm").pvalue > 1e-4
    n = drawn.shape[1]
    correlation = np.corrcoef(drawn)
    assert np.abs(correlation - np.eye(len(drawn))).max() < 6.0 / np.sqrt(n)
    # Neighbouring particles.
    assert np.abs(np.mean(drawn[:, 1:] * drawn[:, :-1], axis=1)).max() < 6.0 / np.sqrt(n)
    for power, moment in ((2, 1.0), (3, 0.0), (4, 3.0), (6, 15.0)):
        values = drawn.ravel() ** power
        assert values.mean() == pytest.approx(moment, abs=6.0 * values.std() / np.sqrt(drawn.size))


def test_the_ends_of_the_words_are_finite(variant) -> None:
    for one in (0, 1, 2**32 - 1):
        for other in (0, 2**31, 2**32 - 1):
            pair = variant(random.normal_pair)(np.uint64(one), np.uint64(other))
            assert np.hypot(*pair) < 6.7


def test_tails_are_those_of_the_normal_distribution() -> None:
    drawn = np.concatenate([random.normals(12, step, 0, 0, 500_000).ravel() for step in range(4)])
    for far in (3.0, 4.0, 4.5):
        expected = 2.0 * stats.norm.sf(far) * drawn.size
        assert abs(np.sum(np.abs(drawn) > far) - expected) < 6.0 * np.sqrt(expected)


def test_elementary_functions_agree_with_numpy(variant) -> None:
    rng = np.random.default_rng(0)
    eighths = [int(part) * 2**29 + step for part in range(8) for step in (0, 1, 2**29 - 1)]
    for turn in [*eighths, *rng.integers(0, 2**32, 500).tolist()]:
        s, c = variant(elementary.sine_cosine)(np.uint64(turn))
        angle = 2.0 * np.pi * turn / 2**32
        assert (s, c) == pytest.approx((np.sin(angle), np.cos(angle)), abs=2e-7)
    for x in [*np.geomspace(1e-37, 1e37, 300), *rng.uniform(0.5, 2.0, 300), 1.0, np.sqrt(2.0)]:
        x = np.float32(x)
        assert variant(elementary.logarithm)(x) == pytest.approx(np.log(float(x)), rel=2e-7, abs=1e-7)
