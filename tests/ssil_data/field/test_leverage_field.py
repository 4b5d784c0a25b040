"""LCoR and CoR are what their formulas say, however the store is cut."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field import LeverageField
from ssil_data.kernels import Moments, chunked, cor, lcor_sums, log_kernel

ALPHAS = (0.3, 1.0, 3.0, 100.0, 1e4)


def made(seed: int, count: int, width: int = 5, *, alpha: float = 1.0) -> LeverageField:
    rng = np.random.default_rng(seed)
    states = (rng.normal(size=(count, width)) * [3.0] * width + 7).astype(np.float32)
    labeled = np.arange(count) < max(1, count // 3)
    leverage = rng.random(count).astype(np.float32)
    return LeverageField(states, leverage, labeled, Standardizer.of(states), alpha)


def kernel(distance: float, alpha: float) -> float:
    return (1 + distance / alpha) ** (-(alpha + 1) / 2)


def lcor_by_double_loop(field: LeverageField, queries: np.ndarray) -> tuple[list, list]:
    shift, scale = (getattr(field.standardizer, n).astype(np.float64) for n in ("shift", "scale"))
    states = (field.states.astype(np.float64) - shift) / scale
    asked = (queries - shift) / scale
    values = []
    sizes = []
    for query in asked:
        numerator = denominator = squares = 0.0
        for state, leverage in zip(states, field.leverage, strict=True):
            weight = kernel(float(np.abs(query - state).sum()), field.alpha)
            numerator += weight * float(leverage)
            denominator += weight
            squares += weight**2
        values.append(numerator / denominator)
        sizes.append(denominator**2 / squares)
    return values, sizes


@pytest.mark.parametrize("alpha", ALPHAS)
def test_lcor_is_the_double_loop(alpha: float):
    field = made(0, 400, alpha=alpha)
    queries = made(1, 30).states
    values, sizes = lcor_by_double_loop(field, queries.astype(np.float64))
    answer = field.lcor(queries)
    np.testing.assert_allclose(answer.values, values, atol=1e-6, rtol=0)
    np.testing.assert_allclose(answer.effective_sample_size, sizes, rtol=1e-4)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_cor_in_closed_form_is_the_double_loop(alpha: float):
    field = made(2, 200, alpha=alpha)
    queries = made(3, 20).states
    states = field.standardizer(field.states)
    asked = field.standardizer(queries)
    expected = []
    for query in asked.astype(np.float64):
        weights = []
        for part in (states[field.labeled], states[~field.labeled]):
            squares = [float(((query - state) ** 2).sum()) for state in part]
            weights.append(kernel(np.sqrt(sum(squares) / len(squares)), alpha))
        expected.append(weights[0] / sum(weights))
    np.testing.assert_allclose(field.cor(queries), expected, atol=1e-6, rtol=0)


@given(st.integers(0, 2**31), st.sampled_from(ALPHAS))
def test_cor_of_exchanged_sides_adds_up_to_one(seed: int, alpha: float):
    field = made(seed, 30)
    expert = Moments.of(field.states[:10])
    negative = Moments.of(field.states[10:])
    total = cor(field.states, expert, negative, alpha) + cor(field.states, negative, expert, alpha)
    np.testing.assert_allclose(total, 1, atol=1e-12)


@given(st.integers(0, 2**31), st.integers(1, 60), st.sampled_from(ALPHAS), st.floats(0.1, 1e30))
def test_lcor_lies_within_the_leverages_however_far_the_query(
    seed: int, count: int, alpha: float, far: float
):
    field = made(seed, count, alpha=alpha)
    queries = np.full((1, 5), far, np.float32)
    answer = field.lcor(queries)
    assert field.leverage.min() - 1e-6 <= answer.values[0] <= field.leverage.max() + 1e-6
    assert 1 - 1e-6 <= answer.effective_sample_size[0] <= count * (1 + 1e-6)


@given(st.integers(0, 2**31), st.sampled_from(ALPHAS), st.floats(0, 1, width=32))
def test_lcor_of_constant_leverage_is_that_constant(seed: int, alpha: float, constant: float):
    made_field = made(seed, 50, alpha=alpha)
    field = LeverageField(
        made_field.states,
        np.full(50, constant, np.float32),
        made_field.labeled,
        made_field.standardizer,
        alpha,
    )
    np.testing.assert_allclose(field.lcor(made(seed + 1, 5).states).values, constant, atol=1e-7)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_lcor_does_not_depend_on_the_order_or_the_blocks_of_the_store(alpha: float):
    field = made(4, 20_000, alpha=alpha)
    queries = made(5, 130).states
    order = np.random.default_rng(6).permutation(20_000)
    shuffled = LeverageField(
        field.states[order], field.leverage[order], field.labeled[order], field.standardizer, alpha
    )
    answer = field.lcor(queries)
    np.testing.assert_allclose(shuffled.lcor(queries).values, answer.values, atol=1e-7)
    alone = np.concatenate([field.lcor(queries[i : i + 1]).values for i in range(len(queries))])
    np.testing.assert_array_equal(alone, answer.values)


@pytest.mark.parametrize(
    ("lcor_sums", "absolute", "relative"),
    [(lcor_sums, 1e-6, 1e-5), (chunked.lcor_sums, 1e-9, 1e-9)],
    ids=["float32 engine", "plain"],
)
def test_sums_over_shards_add_up_to_the_store(lcor_sums, absolute: float, relative: float):
    field = made(7, 500)
    queries = made(8, 9).states
    states = field.standardizer(field.states)
    asked = field.standardizer(queries)
    for alpha in ALPHAS:
        whole = lcor_sums(asked, states, field.leverage, alpha=alpha, contributors=3)
        left = lcor_sums(asked, states[:123], field.leverage[:123], alpha=alpha, contributors=3)
        right = lcor_sums(asked, states[123:], field.leverage[123:], alpha=alpha, contributors=3)
        joined = left + right
        np.testing.assert_allclose(joined.values, whole.values, atol=absolute)
        np.testing.assert_allclose(
            joined.effective_sample_size, whole.effective_sample_size, rtol=relative
        )
        np.testing.assert_allclose(joined.nearest_weight, whole.nearest_weight, rtol=relative)


def test_contributors_are_the_nearest_states_and_their_share_of_the_weight():
    field = made(9, 300, alpha=3.0)
    queries = made(10, 7).states
    states = field.standardizer(field.states)
    asked = field.standardizer(queries)
    top = field.lcor(queries, contributors=5).contributors
    for query, rows, shares in zip(asked, top.row, top.share, strict=True):
        distance = np.abs(states - query).sum(axis=1)
        assert rows.tolist() == np.argsort(distance, kind="stable")[:5].tolist()
        weights = np.exp(log_kernel(distance, 3.0))
        np.testing.assert_allclose(shares, weights[rows] / weights.sum(), rtol=1e-4)


def test_more_contributors_than_states_are_all_states():
    assert made(11, 4).lcor(made(12, 2).states, contributors=10).contributors.row.shape == (2, 4)


@pytest.mark.parametrize(("wanted", "columns"), [(12_000, 12_000), (30_000, 20_000)])
def test_contributors_may_be_more_than_a_block_of_states(wanted: int, columns: int):
    field = made(11, 20_000)
    states = field.standardizer(field.states)
    query = field.standardizer(made(12, 1).states)
    sums = lcor_sums(query, states, field.leverage, alpha=1.0, contributors=wanted)
    assert sums.nearest.shape == sums.nearest_weight.shape == (1, columns)
    assert len(set(sums.nearest[0].tolist())) == columns
    distance = np.abs(states.astype(np.float64) - query).sum(axis=1)
    weights = np.exp(log_kernel(distance, 1.0) - log_kernel(distance.min(), 1.0))
    heaviest = np.sort(weights)[::-1][:columns]
    np.testing.assert_allclose(sums.nearest_weight[0], heaviest, rtol=1e-4)


def test_a_negative_number_of_contributors_is_refused():
    field = made(0, 5)
    with pytest.raises(InvalidInputError, match="contributors: expected at least 0, found -1"):
        field.lcor(field.states, contributors=-1)


def test_units_do_not_matter():
    field = made(13, 100)
    queries = made(14, 6).states
    unit = np.array([1e-3, 1, 1e3, 7, 50], np.float32)
    scaled = LeverageField(
        field.states * unit,
        field.leverage,
        field.labeled,
        Standardizer.of(field.states * unit),
        field.alpha,
    )
    np.testing.assert_allclose(
        scaled.lcor(queries * unit).values, field.lcor(queries).values, atol=1e-5
    )


@pytest.mark.parametrize("alpha", [0.0, -0.5, np.nan, np.inf])
def test_alpha_must_be_positive_and_finite(alpha: float):
    with pytest.raises(
        InvalidInputError, match=f"alpha: expected a finite number > 0, found {alpha}"
    ):
        made(0, 5, alpha=alpha)


@pytest.mark.parametrize("alpha", [5e-324, 1e-320, 9e-7, 1.1e8, 1e300])
def test_alpha_at_which_the_kernel_cannot_be_computed_is_refused(alpha: float):
    message = f"alpha: expected a number from 1e-06 to 1e+08, found {alpha}"
    with pytest.raises(InvalidInputError, match=re.escape(message)):
        made(0, 5, alpha=alpha)


@pytest.mark.parametrize("alpha", [1e-6, 1e8])
@pytest.mark.parametrize("far", [0.0, 1.0, 1e30])
def test_answers_are_finite_at_the_ends_of_alpha(alpha: float, far: float):
    field = made(0, 50, alpha=alpha)
    queries = np.concatenate([field.states[:3], np.full((1, 5), far, np.float32)])
    values = field.lcor(queries).values
    assert (values >= field.leverage.min() - 1e-6).all()
    assert (values <= field.leverage.max() + 1e-6).all()
    assert np.isfinite(field.cor(queries)).all()


def test_a_query_of_another_width_or_not_finite_is_refused():
    field = made(0, 5)
    with pytest.raises(InvalidInputError, match="expected width 5, found 4"):
        field.lcor(np.zeros((2, 4), np.float32))
    with pytest.raises(InvalidInputError, match="found nan at row 1, column 2"):
        field.lcor([[0] * 5, [0, 0, np.nan, 0, 0]])


def test_cor_needs_both_sides():
    field = made(0, 5)
    everything = LeverageField(
        field.states, field.leverage, np.ones(5, bool), field.standardizer, field.alpha
    )
    with pytest.raises(InvalidInputError, match="found 5 labeled of 5"):
        everything.cor(field.states)


def test_one_leverage_per_state():
    field = made(0, 5)
    with pytest.raises(
        InvalidInputError,
        match=r"leverage: expected one per state, found shape \(4,\) for 5 states",
    ):
        LeverageField(field.states, field.leverage[:4], field.labeled, field.standardizer, 1.0)
