import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import kernels as naive

from panoloc_mcl.laboratory.benchmarks.plain_voting import vote_batched
from panoloc_mcl.laboratory.peers.paper import in_both_orders, whitened
from panoloc_mcl.robot.kernels import selection, voting


def solve(variant, gram: np.ndarray, right: np.ndarray, tolerance: float = 1e-12) -> np.ndarray:
    p = len(right)
    system = np.zeros((p + 1, p + 1))
    system[:p, :p], system[p, :p] = gram, right
    return variant(voting.solve_positive)(system, tolerance * max(gram.max(), 1e-300))


def by_filter(design: np.ndarray) -> np.ndarray:
    """(..., n, t, p) as equations filter by filter, (..., t n, p)."""
    swapped = np.swapaxes(design, -3, -2)
    return swapped.reshape(*swapped.shape[:-3], -1, swapped.shape[-1])


def trim(variant, design: np.ndarray, observed: np.ndarray, keep: float, trim_to: int) -> np.ndarray:
    """Coefficients of designs (n, t, p) and responses (n, t), or (s, n, t) of several headings."""
    equations, back = whitened(by_filter(design)[None])
    rows = np.swapaxes(observed, -2, -1).reshape(-1, equations.shape[1])
    transposed, by_pixel = in_both_orders(equations, len(design))
    found = variant(voting.trimmed_coefficients)(transposed[0], by_pixel[0], np.ascontiguousarray(rows), keep, trim_to)
    assert found.dtype == design.dtype
    assert not found[:, -1].any()
    return (found @ back[0]).reshape(*observed.shape[:-2], -1)


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
        error = np.abs(solve(variant, gram, right) - expected).max()
        assert error < 1e-12 * np.linalg.cond(gram) * max(np.abs(expected).max(), 1.0)


@pytest.mark.parametrize("dependent", [0, 2, 4])
def test_a_direction_without_support_gets_zero_and_leaves_the_others_right(variant, dependent: int) -> None:
    rng = np.random.default_rng(dependent)
    rows = rng.standard_normal((30, 5))
    rows[:, dependent] = 0.0
    observed = rng.standard_normal(30)
    a = solve(variant, rows.T @ rows, rows.T @ observed)
    assert a[dependent] == 0.0
    # lstsq's solution of least length has the zero there, too.
    assert a == pytest.approx(np.linalg.lstsq(rows, observed, rcond=None)[0], abs=1e-10)


def test_equal_columns_still_give_a_least_squares_solution(variant) -> None:
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((30, 4))
    rows[:, 3] = rows[:, 1]
    observed = rng.standard_normal(30)
    a = solve(variant, rows.T @ rows, rows.T @ observed)
    best = rows @ np.linalg.lstsq(rows, observed, rcond=None)[0]
    assert rows @ a == pytest.approx(best, abs=1e-8)


def test_an_empty_system_gives_zeros(variant) -> None:
    assert not solve(variant, np.zeros((3, 3)), np.zeros(3)).any()


@pytest.mark.parametrize(("keep", "trim_to"), [(0.8, 20), (0.5, 10), (0.95, 40), (0.8, 60), (0.8, 1000), (0.3, 2)])
def test_downdating_agrees_with_solving_anew_at_every_step(variant, keep: float, trim_to: int) -> None:
    for seed in range(6):
        design, observed, _ = hypothesis_problem(seed)
        a = trim(variant, design, observed, keep, trim_to)
        # Downdated normal equations lose some digits; 1e-8 is far below any noise of an image.
        assert a == pytest.approx(naive.trimmed_coefficients(design, observed, keep, trim_to), abs=1e-8)


@pytest.mark.parametrize(("keep", "trim_to"), [(0.8, 800), (0.8, 300), (0.3, 300), (0.5, 20)])
def test_single_precision_agrees_with_numpy(variant, keep: float, trim_to: int) -> None:
    """As the program calls it, and several headings at once, each with its own outliers."""
    design, first, _ = hypothesis_problem(0, pixels=1000, filters=2, p=15)
    # Columns as unlike in length as those of filtered eigenimages.
    design *= np.logspace(0.0, -2.0, 15)
    observed = np.stack([first, *(hypothesis_problem(seed, 1000, 2, 15)[1] for seed in (1, 2))])
    found = trim(variant, design.astype(np.float32), observed.astype(np.float32), keep, trim_to)
    for a, responses in zip(found, observed, strict=True):
        expected = naive.trimmed_coefficients(design, responses, keep, trim_to)
        # Angles count: 1e-3 of the length is 0.06 degrees, against a vote width of 17.
        assert np.linalg.norm(a - expected) < 1e-3 * np.linalg.norm(expected)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_the_limit_agrees_with_sorting(data: st.DataObject) -> None:
    number = st.one_of(st.floats(0.0, 2.0**100, width=32), st.sampled_from([0.0, 1.0, 2.0, float("inf")]))
    values = np.array(data.draw(st.lists(number, min_size=1, max_size=60)), dtype=np.float32)
    wanted = data.draw(st.integers(1, len(values)))
    bits = values.view(np.int32)
    limit, ties = selection.limit_of_smallest(bits, wanted, data.draw(st.integers(0, 0x7F800000)))
    stays = bits <= limit
    stays[np.flatnonzero(bits == limit + 1)[:ties]] = True
    assert stays.sum() == wanted
    assert np.array_equal(np.sort(values[stays]), np.sort(values)[:wanted])
    rows = np.empty(len(values) + 1, dtype=np.int32)
    number_gone = selection.leave_out(bits, limit, ties, rows)
    # What is infinite was left out before.
    assert np.array_equal(rows[:number_gone], np.flatnonzero(~stays & np.isfinite(values)))
    assert selection.remaining((~stays).astype(np.uint8), rows) == wanted
    assert np.array_equal(rows[:wanted], np.flatnonzero(stays))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_whitened_equations_say_the_same(dtype: type) -> None:
    design: np.ndarray = np.random.default_rng(4).standard_normal((3, 40, 5)).astype(dtype)
    design[1, :, 2] = 0.0
    observed: np.ndarray = np.random.default_rng(5).standard_normal((3, 40)).astype(dtype)
    equations, back = whitened(design)
    assert equations.dtype == back.dtype == dtype
    assert not equations[:, :, -1].any()
    digits = 1e-5 if dtype == np.float32 else 1e-12
    for h in range(3):
        known = 4 if h == 1 else 5
        values = np.linalg.eigvalsh(equations[h].T @ equations[h])
        assert values[-known:] == pytest.approx(1.0, abs=digits)
        assert values[:-known] == pytest.approx(0.0, abs=digits)
        expected = np.linalg.lstsq(design[h], observed[h], rcond=None)[0]
        assert observed[h] @ equations[h] @ back[h] == pytest.approx(expected, abs=10 * digits)


def test_trimming_finds_the_truth_among_gross_errors(variant) -> None:
    for seed in range(5):
        design, observed, truth = hypothesis_problem(seed, pixels=120)
        plain = trim(variant, design, observed, 0.8, 120)
        trimmed = trim(variant, design, observed, 0.8, 40)
        assert np.abs(trimmed - truth).max() < 0.01 < np.abs(plain - truth).max()


def test_ties_do_not_change_how_many_pixels_are_left(variant) -> None:
    # All residuals equal: the first pixels stay, and their solution is the same.
    design = np.ones((40, 1, 1))
    observed = np.full((40, 1), 3.0)
    assert trim(variant, design, observed, 0.5, 5) == pytest.approx(3.0, abs=1e-12)


def voting_problem(seed: int, shifts: np.ndarray) -> dict:
    """As the oracle takes it."""
    rng = np.random.default_rng(seed)
    t, height, width, m, n, p, k = 2, 9, 16, 4, 30, 3, 5
    references = rng.standard_normal((k, p))
    return {
        "responses": rng.standard_normal((t, height, width)).astype(np.float32),
        "rows": rng.integers(0, height, (m, n)).astype(np.int32),
        "columns": rng.integers(0, width, (m, n)).astype(np.int32),
        "design": rng.standard_normal((m, n, t, p)),
        "mean_responses": rng.standard_normal((m, n, t)),
        "references": references / np.linalg.norm(references, axis=1, keepdims=True),
        "shifts": shifts,
        "keep": 0.8,
        "trim_to": 10,
        "width": 0.6,
    }


def vote(variant, problem: dict, dtype: type = np.float64) -> np.ndarray:
    """The same problem as the kernel takes it."""
    equations, back = whitened(by_filter(problem["design"]).astype(dtype))
    mean: np.ndarray = by_filter(problem["mean_responses"][..., None])[..., 0].astype(dtype)
    return variant(voting.vote)(
        *(problem[key] for key in ("responses", "rows", "columns")),
        *in_both_orders(equations, problem["rows"].shape[1]),
        back,
        mean,
        *(problem[key] for key in ("references", "shifts", "keep", "trim_to", "width")),
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_votes_agree_with_numpy(variant, dtype: type) -> None:
    # More headings than go through one matrix product.
    problem = voting_problem(0, np.array([0.0, 1.0, 2.5, -0.25, 15.9, -40.0, 33.3, 7.0, 8.25, 3.0]))
    # Responses are float32, read between columns in float32 by one and in float64 by the other.
    assert vote(variant, problem, dtype) == pytest.approx(naive.vote(**problem), abs=1e-5)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_batched_numpy_agrees_with_the_loop(dtype: type) -> None:
    """The peer of the benchmark computes the same."""
    problem = voting_problem(5, np.array([0.0, 2.5, -0.25, 33.3]))
    batched = {
        key: value.astype(dtype) if isinstance(value, np.ndarray) and value.dtype.kind == "f" else value
        for key, value in problem.items()
    }
    expected = naive.vote(**problem)
    for downdate in (False, True):
        assert vote_batched(**batched, downdate=downdate) == pytest.approx(expected, abs=1e-5)


def test_no_more_votes_than_hypotheses(variant) -> None:
    votes = vote(variant, voting_problem(1, np.arange(16.0)))
    assert votes.min() >= 0.0
    assert votes.sum(axis=1).max() <= 1.0 + 1e-12
    assert votes.max() > 0.0


def test_whole_turns_of_the_image_give_the_same_votes(variant) -> None:
    there, back, again = (vote(variant, voting_problem(2, np.arange(4.0) + turn)) for turn in (0.0, -16.0, 160.0))
    assert np.array_equal(there, back)
    assert np.array_equal(there, again)


def test_an_image_equal_to_the_mean_gives_no_votes(variant) -> None:
    problem = voting_problem(3, np.zeros(1))
    # What the kernel reads at shift 0, taken for the mean: nothing is left, and nothing must become NaN.
    seen = problem["responses"][:, problem["rows"], problem["columns"]]
    problem["mean_responses"] = np.moveaxis(seen, 0, -1).astype(np.float64)
    assert not vote(variant, problem).any()
