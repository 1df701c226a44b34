import numpy as np
import pytest
from oracles import kernels as naive

from panoloc_mcl.kernels import voting


def gram_of(design: np.ndarray) -> np.ndarray:
    return np.einsum("...ntj,...ntk->...jk", design, design)


def hypothesis_problem(seed: int, pixels: int = 60, filters: int = 3, p: int = 5, bad: float = 0.3) -> tuple:
    """A design, responses of known coefficients with a little noise, and gross errors at some pixels."""
    rng = np.random.default_rng(seed)
    design = rng.standard_normal((pixels, filters, p))
    truth = rng.standard_normal(p)
    observed = design @ truth + 1e-3 * rng.standard_normal((pixels, filters))
    outliers = rng.random(pixels) < bad
    observed[outliers] += 20.0 * rng.standard_normal((int(outliers.sum()), filters))
    return design, observed, truth


@pytest.mark.parametrize("p", [1, 2, 7])
def test_solving_agrees_with_lapack(variant, p: int) -> None:
    rng = np.random.default_rng(p)
    for _ in range(10):
        rows = rng.standard_normal((p + 4, p))
        gram, right = rows.T @ rows, rng.standard_normal(p)
        expected = np.linalg.solve(gram, right)
        error = np.abs(variant(voting.solve_positive)(gram, right) - expected).max()
        assert error < 1e-12 * np.linalg.cond(gram) * max(np.abs(expected).max(), 1.0)


@pytest.mark.parametrize("dependent", [0, 2, 4])
def test_a_direction_without_support_gets_zero_and_leaves_the_others_right(variant, dependent: int) -> None:
    rng = np.random.default_rng(dependent)
    rows = rng.standard_normal((30, 5))
    rows[:, dependent] = 0.0
    observed = rng.standard_normal(30)
    a = variant(voting.solve_positive)(rows.T @ rows, rows.T @ observed)
    assert a[dependent] == 0.0
    # lstsq's solution of least length has the zero there, too.
    assert a == pytest.approx(np.linalg.lstsq(rows, observed, rcond=None)[0], abs=1e-10)


def test_equal_columns_still_give_a_least_squares_solution(variant) -> None:
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((30, 4))
    rows[:, 3] = rows[:, 1]
    observed = rng.standard_normal(30)
    a = variant(voting.solve_positive)(rows.T @ rows, rows.T @ observed)
    best = rows @ np.linalg.lstsq(rows, observed, rcond=None)[0]
    assert rows @ a == pytest.approx(best, abs=1e-8)


def test_an_empty_system_gives_zeros(variant) -> None:
    assert not variant(voting.solve_positive)(np.zeros((3, 3)), np.zeros(3)).any()


@pytest.mark.parametrize(("keep", "trim_to"), [(0.8, 20), (0.5, 10), (0.95, 40), (0.8, 60), (0.8, 1000), (0.3, 2)])
def test_downdating_agrees_with_solving_anew_at_every_step(variant, keep: float, trim_to: int) -> None:
    for seed in range(6):
        design, observed, _ = hypothesis_problem(seed)
        a = variant(voting.trimmed_coefficients)(design, gram_of(design), observed, keep, trim_to)
        # Downdated normal equations lose some digits; 1e-8 is far below any noise of an image.
        assert a == pytest.approx(naive.trimmed_coefficients(design, observed, keep, trim_to), abs=1e-8)


def test_trimming_finds_the_truth_among_gross_errors(variant) -> None:
    for seed in range(5):
        design, observed, truth = hypothesis_problem(seed, pixels=120)
        trim = variant(voting.trimmed_coefficients)
        plain = trim(design, gram_of(design), observed, 0.8, 120)
        trimmed = trim(design, gram_of(design), observed, 0.8, 40)
        assert np.abs(trimmed - truth).max() < 0.01 < np.abs(plain - truth).max()


def test_ties_do_not_change_how_many_pixels_are_left(variant) -> None:
    # All residuals equal: the first pixels stay, and their solution is the same.
    design = np.ones((40, 1, 1))
    observed = np.full((40, 1), 3.0)
    assert variant(voting.trimmed_coefficients)(design, gram_of(design), observed, 0.5, 5) == pytest.approx(3.0, abs=1e-12)


def voting_problem(seed: int, shifts: np.ndarray) -> dict:
    rng = np.random.default_rng(seed)
    t, height, width, m, n, p, k = 2, 9, 16, 4, 30, 3, 5
    design = rng.standard_normal((m, n, t, p))
    references = rng.standard_normal((k, p))
    return {
        "responses": rng.standard_normal((t, height, width)).astype(np.float32),
        "rows": rng.integers(0, height, (m, n)).astype(np.int32),
        "columns": rng.integers(0, width, (m, n)).astype(np.int32),
        "design": design,
        "grams": gram_of(design),
        "mean_responses": rng.standard_normal((m, n, t)),
        "references": references / np.linalg.norm(references, axis=1, keepdims=True),
        "shifts": shifts,
        "keep": 0.8,
        "trim_to": 10,
        "width": 0.6,
    }


def test_votes_agree_with_numpy(variant) -> None:
    problem = voting_problem(0, np.array([0.0, 1.0, 2.5, -0.25, 15.9, -40.0, 33.3]))
    votes = variant(voting.vote)(*problem.values())
    expected = naive.vote(**{key: value for key, value in problem.items() if key != "grams"})
    # Responses are float32, read between columns in float32 by one and in float64 by the other.
    assert votes == pytest.approx(expected, abs=1e-5)


def test_no_more_votes_than_hypotheses(variant) -> None:
    votes = variant(voting.vote)(*voting_problem(1, np.arange(16.0)).values())
    assert votes.min() >= 0.0
    assert votes.sum(axis=1).max() <= 1.0 + 1e-12
    assert votes.max() > 0.0


def test_whole_turns_of_the_image_give_the_same_votes(variant) -> None:
    there, back, again = (
        variant(voting.vote)(*voting_problem(2, np.arange(4.0) + turn).values()) for turn in (0.0, -16.0, 160.0)
    )
    assert np.array_equal(there, back)
    assert np.array_equal(there, again)


def test_an_image_equal_to_the_mean_gives_no_votes(variant) -> None:
    problem = voting_problem(3, np.zeros(1))
    # What the kernel reads at shift 0, taken for the mean: nothing is left, and nothing must become NaN.
    seen = problem["responses"][:, problem["rows"], problem["columns"]]
    problem["mean_responses"] = np.moveaxis(seen, 0, -1).astype(np.float64)
    assert not variant(voting.vote)(*problem.values()).any()
