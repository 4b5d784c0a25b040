"""The engine's sums are those of the slow reference, on every path, however the work is cut."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import cache, reduce
from operator import add

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssil_data.kernels import References, Sums
from ssil_data.kernels.native import Target
from support.kernel_references import ALPHAS, draw_references, slow_lcor

ALPHAS_OF_ALL_POWERS = (0.3, 1.0, 2.0, 3.0, 7.5, 11.0, 99.0, 198.0, 199.0, 1e4)


def assert_same(sums: Sums, other: Sums) -> None:
    np.testing.assert_allclose(sums.values, other.values, atol=1e-6, rtol=0)
    np.testing.assert_allclose(sums.effective_sample_size, other.effective_sample_size, rtol=1e-4)
    np.testing.assert_allclose(sums.log_scale, other.log_scale, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_every_path_is_the_slow_sum(target: Target | None, alpha: float):
    (states, leverage), (queries, _) = draw_references(0, 700, 29), draw_references(1, 40, 29)
    queries[:3], queries[3:6] = states[:3], queries[3:6] * 40
    sums = References(states, leverage, target=target).sums(queries, alpha=alpha)
    values, sizes = slow_lcor(queries, states, leverage, alpha)
    far = [3, 4, 5]  # distances near 1,000 have a last bit of 6e-5
    np.testing.assert_allclose(sums.values[far], values[far], atol=1e-5, rtol=0)
    np.testing.assert_allclose(
        np.delete(sums.values, far), np.delete(values, far), atol=1e-6, rtol=0
    )
    np.testing.assert_allclose(sums.effective_sample_size, sizes, rtol=1e-4)


@pytest.mark.parametrize("alpha", [1e-3, 0.01, 0.1, 0.5, 1.0])
def test_queries_on_a_reference_are_the_slow_sum_at_flat_kernels(
    target: Target | None, alpha: float
):
    states, leverage = draw_references(15, 400, 64)
    states[0, 5] = 1e4
    queries = states[:20] + np.float32(1e-4)
    sums = References(states, leverage, target=target).sums(queries, alpha=alpha)
    values, _ = slow_lcor(queries, states, leverage, alpha)
    np.testing.assert_allclose(sums.values, values, atol=1e-6, rtol=0)


@pytest.mark.parametrize("power", [*range(1, 12), 15, 16, 31, 63, 64, 95, 99, 100, 101])
def test_every_whole_power_weighs_two_states_as_float64_does(power: int):
    states, alpha = np.array([[0], [50]], np.float32), 2.0 * power - 1
    queries = np.linspace(-30, 80, 400, dtype=np.float32)[:, None]
    values = References(states, states[:, 0] / 50).sums(queries, alpha=alpha).values
    known, _ = slow_lcor(queries, states, states[:, 0] / 50, alpha)
    np.testing.assert_allclose(values, known, atol=1e-6, rtol=0)


@pytest.mark.parametrize("width", range(1, 65))
def test_every_width_is_the_slow_sum(width: int):
    (states, leverage), (queries, _) = (
        draw_references(width, 150, width),
        draw_references(width + 1, 7, width),
    )
    for alpha in (1.0, 20.0):
        sums = References(states, leverage).sums(queries, alpha=alpha)
        values, _ = slow_lcor(queries, states, leverage, alpha)
        np.testing.assert_allclose(sums.values, values, atol=1e-6, rtol=0)


@pytest.mark.parametrize("count", [1, 2, 63, 64, 65, 127, 129, 1023, 1024, 1025, 2049])
@pytest.mark.parametrize("asked", [1, 2, 5, 6, 7, 95, 96, 97])
def test_every_tail_of_the_tiles_is_the_slow_sum(count: int, asked: int):
    (states, leverage), (queries, _) = (
        draw_references(count, count, 3),
        draw_references(asked, asked, 3),
    )
    sums = References(states, leverage).sums(queries, alpha=1.0, contributors=2)
    values, sizes = slow_lcor(queries, states, leverage, 1.0)
    np.testing.assert_allclose(sums.values, values, atol=1e-6, rtol=0)
    np.testing.assert_allclose(sums.effective_sample_size, sizes, rtol=1e-4)
    assert sums.nearest.shape == (asked, min(count, 2))
    assert (sums.nearest < count).all()


def test_no_queries_have_no_sums(target: Target | None):
    states, leverage = draw_references(0, 10, 4)
    sums = References(states, leverage, target=target).sums(states[:0], alpha=1.0, contributors=3)
    assert sums.values.shape == (0,)
    assert sums.nearest.shape == (0, 3)


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("far", [10.0, 1e3, 1e6])
def test_far_queries_never_become_nothing_over_nothing(
    target: Target | None, alpha: float, far: float
):
    (states, leverage), (queries, _) = draw_references(2, 300, 29), draw_references(3, 10, 29)
    states[:10] += np.float32(far)
    for asked in (queries + np.float32(far), queries * np.float32(far), -np.abs(queries) * far):
        asked = asked.astype(np.float32)
        sums = References(states, leverage, target=target).sums(asked, alpha=alpha)
        assert (sums.values >= leverage.min() - 1e-6).all()
        assert (sums.values <= leverage.max() + 1e-6).all()
        assert (sums.effective_sample_size >= 1 - 1e-6).all()
        assert (sums.effective_sample_size <= 300 * (1 + 1e-6)).all()


@pytest.mark.parametrize("alpha", [1.0, 3.0, 11.0, 99.0, 100.0, 1e4])
def test_neighbours_far_from_the_centre_are_told_apart(target: Target | None, alpha: float):
    (states, leverage), (queries, _) = draw_references(4, 500, 29), draw_references(5, 12, 29)
    states[:50] += 1024
    sums = References(states, leverage, target=target).sums(queries + 1024, alpha=alpha)
    values, sizes = slow_lcor(queries + np.float32(1024), states, leverage, alpha)
    np.testing.assert_allclose(sums.values, values, atol=3e-6, rtol=0)
    np.testing.assert_allclose(sums.effective_sample_size, sizes, rtol=1e-3)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 200), st.sampled_from(ALPHAS), st.floats(0, 1))
def test_constant_leverage_returns_itself(seed: int, count: int, alpha: float, constant: float):
    (states, _), (queries, _) = draw_references(seed, count, 6), draw_references(seed + 1, 5, 6)
    leverage = np.full(count, constant, np.float32)
    values = References(states, leverage).sums(queries, alpha=alpha).values
    np.testing.assert_allclose(values, leverage[0], atol=1e-7, rtol=0)


@pytest.mark.parametrize("alpha", [1.0, 50.0, 1e4])
def test_threads_permutation_and_shards_do_not_matter(alpha: float):
    (states, leverage), (queries, _) = draw_references(6, 12_000, 9), draw_references(7, 200, 9)
    queries[::7] *= 30
    whole = References(states, leverage).sums(queries, alpha=alpha, threads=1)
    for threads in (2, 3, 8):
        cut = References(states, leverage).sums(queries, alpha=alpha, threads=threads)
        assert_same(cut, whole)
    order = np.random.default_rng(8).permutation(len(states))
    assert_same(References(states[order], leverage[order]).sums(queries, alpha=alpha), whole)
    parts = [slice(0, 5000), slice(5000, 5001), slice(5001, None)]
    shards = [References(states[p], leverage[p]).sums(queries, alpha=alpha) for p in parts]
    assert_same(reduce(add, shards), whole)


def assert_equal(sums: Sums, other: Sums) -> None:
    for field in fields(sums):
        np.testing.assert_array_equal(getattr(sums, field.name), getattr(other, field.name))


@cache
def near_and_far(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states and leverage, and queries of which some lie far away and one on a state.

    Later states lie farther out, so that blocks differ in weight, and their sums round.
    """
    (states, leverage), (queries, _) = draw_references(16, count, 29), draw_references(17, 230, 29)
    states *= np.linspace(0.2, 3, count, dtype=np.float32)[:, None]
    queries[::7] *= 40
    queries[5:7] *= np.float32(1e5)
    queries[3] = states[3]
    return states, leverage, queries


@pytest.mark.parametrize("alpha", ALPHAS_OF_ALL_POWERS)
@pytest.mark.parametrize("count", [50, 2500])
def test_no_bit_of_an_answer_depends_on_the_batch_or_the_threads(
    compiled_target: Target, count: int, alpha: float
):
    states, leverage, queries = near_and_far(count)
    references = References(states, leverage, target=compiled_target)

    def ask(rows: np.ndarray | slice, threads: int | None = None) -> Sums:
        return references.sums(queries[rows], alpha=alpha, contributors=3, threads=threads)

    whole, everyone = ask(slice(None), 1), np.arange(len(queries))
    for threads in (2, 3):
        assert_equal(ask(slice(None), threads), whole)
        assert_equal(ask(everyone[::-1], threads), whole.take(everyone[::-1]))
    for row in everyone[:40]:
        assert_equal(ask(everyone[row : row + 1]), whole.take(everyone[row : row + 1]))
    columns = np.asfortranarray(queries[:9])
    found = references.sums(columns, alpha=alpha, contributors=3)
    assert_equal(found, whole.take(everyone[:9]))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from(ALPHAS_OF_ALL_POWERS), st.integers(1, 3))
def test_any_cut_of_a_batch_gives_the_same_bits(seed: int, alpha: float, threads: int):
    states, leverage, queries = near_and_far(20_000)
    references, rng = References(states, leverage), np.random.default_rng(seed)
    order = rng.permutation(len(queries))
    bounds = rng.choice(np.arange(1, len(queries)), 4, replace=False)
    parts = [
        references.sums(queries[rows], alpha=alpha, contributors=2, threads=threads)
        for rows in np.split(order, np.sort(bounds))
    ]
    whole = references.sums(queries, alpha=alpha, contributors=2)
    assert_equal(Sums.join(parts), whole.take(order))


@pytest.mark.parametrize("contributors", [1, 10, 65])
def test_contributors_are_the_nearest(target: Target | None, contributors: int):
    (states, leverage), (queries, _) = draw_references(9, 12_000, 4), draw_references(10, 90, 4)
    references = References(states, leverage, target=target)
    for threads in (1, 5):
        sums = references.sums(queries, alpha=3.0, contributors=contributors, threads=threads)
        assert sums.nearest.shape == (90, contributors)
        for query, rows in list(zip(queries, sums.nearest, strict=True))[::9]:
            distance = np.abs(states - query).sum(axis=1)
            nearest = np.argsort(distance)[:contributors]
            np.testing.assert_allclose(distance[rows], distance[nearest], rtol=1e-5)
            assert len(set(rows.tolist())) == contributors


def test_one_object_answers_many_threads_at_once():
    (states, leverage), (queries, _) = draw_references(11, 20_000, 12), draw_references(12, 150, 12)
    references = References(states, leverage)
    expected = [references.sums(queries, alpha=alpha).values for alpha in ALPHAS]
    with ThreadPoolExecutor(8) as pool:
        answers = list(
            pool.map(lambda alpha: references.sums(queries, alpha=alpha).values, ALPHAS * 4)
        )
    for answer, wanted in zip(answers, expected * 4, strict=True):
        np.testing.assert_array_equal(answer, wanted)


def test_reading_changes_neither_queries_nor_states(target: Target | None):
    (states, leverage), (queries, _) = draw_references(13, 100, 4), draw_references(14, 9, 4)
    copies = states.copy(), leverage.copy(), queries.copy()
    References(states, leverage, target=target).sums(queries, alpha=5.0, contributors=3)
    for array, copy in zip((states, leverage, queries), copies, strict=True):
        np.testing.assert_array_equal(array, copy)
