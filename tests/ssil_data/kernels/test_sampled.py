"""Answers from a part of the references: as exact as asked for, honest about it, and repeatable."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import cache

import numpy as np
import pytest

from ssil_data.kernels import Estimate, References, Sampled
from ssil_data.kernels import sampled as module
from ssil_data.kernels.native import Target
from ssil_data.kernels.sample import FIRST_PART
from support.kernel_references import draw_references

STORE = 120_000


@cache
def world(width: int = 9) -> tuple[np.ndarray, np.ndarray, References, np.ndarray]:
    """Return states, a leverage that depends on them, all of them as references, and queries."""
    states, noise = draw_references(0, STORE, width)
    leverage = (1 / (1 + np.exp(-3 * states[:, 0])) + 0.2 * noise).clip(0, 1)
    return states, leverage, References(states, leverage), draw_references(1, 300, width)[0]


def sampled(*, width: int = 9, **options) -> Sampled:
    states, leverage, references, _ = world(width)
    return Sampled(states, leverage, lambda: references, **options)


def exact(alpha: float, queries: np.ndarray | None = None) -> np.ndarray:
    _, _, references, usual = world()
    return references.sums(usual if queries is None else queries, alpha=alpha).values


@pytest.mark.parametrize("alpha", [0.1, 1.0, 3.0, 12.0])
def test_999_of_1000_answers_lie_within_their_half_width(alpha: float):
    queries, known, missed, source = world()[3], exact(alpha), 0, sampled()
    for seed in range(10):
        found = source.estimate_of_size(queries, alpha=alpha, size=16_384, seed=seed)
        assert found.is_trusted.all()
        missed += (np.abs(found.values - known) > found.half_width).sum()
    assert missed <= 15  # of 3,000, where 3 are expected


@pytest.mark.parametrize("alpha", [1.0, 12.0])
def test_the_half_width_is_no_wider_than_it_must_be(alpha: float):
    found = sampled().estimate_of_size(world()[3], alpha=alpha, size=16_384)
    error = np.abs(found.values - exact(alpha))
    assert np.median(error / found.half_width) > 0.1  # 0.205 of a normal distribution's


def test_995_of_1000_answers_to_a_tolerance_lie_within_it():
    queries, known, missed, source = world()[3], exact(3.0), 0, sampled()
    for seed in range(10):
        found = source.estimate_within(queries, alpha=3.0, tolerance=4e-3, seed=seed)
        assert ((found.half_width > 0) & (found.half_width <= 4e-3)).all()
        missed += (np.abs(found.values - known) > found.half_width).sum()
    assert missed <= 15


@pytest.mark.parametrize("rare", [1, 20, 400])
@pytest.mark.parametrize("other", [0.0, 1.0])
def test_leverages_that_few_states_have_are_asked_of_all(rare: int, other: float):
    states, _, _, queries = world()
    leverage = np.full(STORE, 0.5, np.float32)
    leverage[:rare] = other
    references = References(states, leverage)
    source = Sampled(states, leverage, lambda: references)
    own = np.concatenate([queries[:50], states[:50] + np.float32(0.1)])
    known = references.sums(own, alpha=12.0)
    for seed in range(3):
        part = source.estimate_of_size(own, alpha=12.0, size=8192, seed=seed)
        assert not part.is_trusted.any()
        assert np.isfinite(part.half_width).all()
        assert (part.effective_sample_size <= STORE).all()
        whole = source.estimate_within(own, alpha=12.0, tolerance=0.01, seed=seed)
        np.testing.assert_allclose(whole.values, known.values, atol=1e-6)


def test_the_order_of_the_references_is_nothing_but_chance():
    states, leverage, references, queries = world()
    order = np.random.default_rng(2).permutation(STORE)
    mixed = Sampled(states[order], leverage[order], lambda: references)
    one = sampled().estimate_of_size(queries, alpha=1.0, size=16_384)
    other = mixed.estimate_of_size(queries, alpha=1.0, size=16_384)
    assert (one.values != other.values).any()
    assert (np.abs(one.values - other.values) <= one.half_width + other.half_width).all()


def test_what_distance_and_leverage_explain_costs_no_width():
    states, leverage, _, queries = world()
    found = sampled().estimate_of_size(queries, alpha=1.0, size=16_384)
    chosen = np.random.default_rng(0).choice(STORE, 16_384, replace=False)
    for i in range(0, 300, 60):
        weights = 1 / (1 + np.abs(states[chosen] - queries[i]).sum(axis=1))
        spread = (weights * (leverage[chosen] - found.values[i])).std() / weights.mean()
        assert found.half_width[i] < 0.6 * 3.29 * spread / np.sqrt(16_384)


@pytest.mark.parametrize("alpha", [1.0, 12.0, 100.0])
@pytest.mark.parametrize("tolerance", [1e-2, 2e-3, 1e-9])
def test_a_tolerance_is_kept_by_every_answer(alpha: float, tolerance: float):
    found = sampled().estimate_within(world()[3], alpha=alpha, tolerance=tolerance)
    assert (found.half_width <= tolerance).all()
    error = np.abs(found.values - exact(alpha))
    assert (error <= np.maximum(found.half_width, 1e-6)).mean() > 0.98


def test_a_tolerance_that_no_sample_reaches_is_answered_exactly():
    found = sampled().estimate_within(world()[3], alpha=1.0, tolerance=1e-9)
    assert (found.half_width == 0).all()
    np.testing.assert_allclose(found.values, exact(1.0), atol=1e-7)


def test_far_queries_that_few_references_decide_are_answered_exactly():
    _, _, references, queries = world(29)
    found = sampled(width=29).estimate_within(queries * 2, alpha=1e4, tolerance=0.5)
    assert (found.half_width == 0).all()
    known = references.sums(queries * 2, alpha=1e4).values
    np.testing.assert_allclose(found.values, known, atol=1e-6)


def test_a_lone_neighbour_that_was_not_drawn_is_within_the_half_width():
    states, _, references, _ = world(29)
    own = states[:200] + np.float32(0.01)
    known = references.sums(own, alpha=20.0).values
    found = sampled(width=29).estimate_of_size(own, alpha=20.0, size=8192)
    error = np.abs(found.values - known)
    assert (error > 3.29 * found.deviation).mean() > 0.05
    assert (error <= found.half_width).all()


def test_every_path_has_the_same_moments(target: Target | None):
    queries = np.concatenate([world()[3][:30], world()[3][:3] * 300])
    for alpha in (1.0, 2.0, 3.0, 7.5):
        found = sampled(target=target).estimate_of_size(queries, alpha=alpha, size=8192)
        plain = sampled(target=None).estimate_of_size(queries, alpha=alpha, size=8192)
        np.testing.assert_allclose(found.values, plain.values, atol=2e-6)
        np.testing.assert_allclose(found.half_width, plain.half_width, rtol=1e-2, atol=1e-6)
        np.testing.assert_allclose(found.support, plain.support, rtol=1e-3)


def assert_equal(one: Estimate, other: Estimate) -> None:
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_equal_seeds_give_equal_answers_and_others_do_not():
    queries = world()[3]
    one, same, other = (
        sampled().estimate_within(queries, alpha=1.0, tolerance=3e-3, seed=seed)
        for seed in (5, 5, 6)
    )
    assert_equal(one, same)
    assert (one.values != other.values).any()


def test_one_sample_answers_many_threads_at_once():
    queries, source = world()[3], sampled()
    expected = sampled().estimate_within(queries, alpha=1.0, tolerance=2e-3)
    with ThreadPoolExecutor(4) as pool:
        answers = pool.map(
            lambda _: source.estimate_within(queries, alpha=1.0, tolerance=2e-3), range(8)
        )
    for answer in answers:
        assert_equal(answer, expected)


@pytest.mark.parametrize("alpha", [0.3, 1.0, 2.0, 3.0, 12.0, 99.0])
@pytest.mark.parametrize("width", [9, 29])
def test_no_bit_of_an_answer_depends_on_the_batch_or_the_threads(width: int, alpha: float):
    queries, source = world(width)[3][:150].copy(), sampled(width=width)
    queries[::7] *= 40

    def of_size(rows: slice | list[int], threads: int | None = None) -> Estimate:
        return source.estimate_of_size(queries[rows], alpha=alpha, size=20_000, threads=threads)

    def within(rows: slice | list[int], threads: int | None = None) -> Estimate:
        return source.estimate_within(queries[rows], alpha=alpha, tolerance=0.02, threads=threads)

    for ask in (of_size, within):
        whole = ask(slice(None), 1)
        for threads in (2, 3):
            assert_equal(ask(slice(None), threads), whole)
        for rows in ([0], [1], [149], [7, 3], list(range(149, 0, -1)), list(range(1, 98))):
            chosen = np.isin(np.arange(150), rows)
            asked = ask(sorted(rows))
            assert_equal(asked, whole.take(chosen))
            assert_equal(ask(sorted(rows, reverse=True)), _reversed(asked))


def _reversed(answers: Estimate) -> Estimate:
    return Estimate(*(getattr(answers, field.name)[::-1] for field in fields(answers)))


def test_constant_leverage_returns_itself_with_no_width():
    states = world()[0]
    leverage = np.full(STORE, 0.3, np.float32)
    source = Sampled(states, leverage, lambda: References(states, leverage))
    found = source.estimate_within(world()[3], alpha=1.0, tolerance=1e-6)
    np.testing.assert_allclose(found.values, 0.3, atol=1e-7)
    assert (found.half_width < 1e-7).all()


def test_values_stay_within_the_leverages():
    found = sampled().estimate_of_size(world()[3] * np.float32(3), alpha=50.0, size=8192)
    leverage = world()[1]
    assert (found.values >= leverage.min()).all()
    assert (found.values <= leverage.max()).all()


@pytest.mark.parametrize("seconds", [1e-6, 60.0])
def test_time_buys_a_larger_sample_and_in_the_end_all(seconds: float):
    found = sampled().estimate_in_time(world()[3], alpha=1.0, seconds=seconds)
    error = np.abs(found.values - exact(1.0))
    if seconds > 1:
        assert (found.half_width == 0).all()
    else:
        assert (found.half_width > 0).all()
        smallest = sampled().estimate_of_size(world()[3], alpha=1.0, size=FIRST_PART)
        np.testing.assert_allclose(found.half_width, smallest.half_width)
    assert (error <= np.maximum(found.half_width, 1e-6)).mean() > 0.98


def test_an_answer_without_support_says_that_it_knows_nothing():
    _, leverage, _, queries = world(29)
    found = sampled(width=29).estimate_in_time(queries[:20] * 2, alpha=1e4, seconds=1e-6)
    assert not found.is_trusted.any()
    room = np.maximum(found.values - leverage.min(), leverage.max() - found.values)
    np.testing.assert_allclose(found.half_width, room)


def test_weights_beyond_float32_leave_nothing_known():
    queries = world()[3][:20] * np.float32(1e4)
    found = sampled().estimate_in_time(queries, alpha=200.0, seconds=1e-6)
    assert np.isfinite(found.values).all()
    assert (found.half_width >= 0.5).all()
    exactly = sampled().estimate_within(queries, alpha=200.0, tolerance=0.1)
    np.testing.assert_allclose(exactly.values, exact(200.0, queries), atol=1e-6)


def test_few_references_are_all_asked():
    states, leverage, _, queries = world()
    few = Sampled(states[:500], leverage[:500], lambda: References(states[:500], leverage[:500]))
    found = few.estimate_within(queries, alpha=1.0, tolerance=0.5)
    assert (found.half_width == 0).all()
    assert few.estimate_in_time(queries, alpha=1.0, seconds=1e-9).half_width.max() == 0
    assert sampled().estimate_within(queries[:0], alpha=1.0, tolerance=0.1).values.shape == (0,)


def test_a_mapped_file_is_read_in_parts(tmp_path):
    states, leverage, references, queries = world()
    np.save(tmp_path / "states.npy", states)
    mapped = np.load(tmp_path / "states.npy", mmap_mode="r")
    found = Sampled(mapped, leverage, lambda: references).estimate_within(
        queries, alpha=1.0, tolerance=2e-3
    )
    assert_equal(found, sampled().estimate_within(queries, alpha=1.0, tolerance=2e-3))


def test_what_is_known_of_all_states_is_read_once(monkeypatch: pytest.MonkeyPatch):
    made_from, real = [], module.Totals
    monkeypatch.setattr(module, "Totals", lambda *a: made_from.append(1) or real(*a))
    source = sampled()
    with ThreadPoolExecutor(4) as pool:
        list(
            pool.map(
                lambda _: source.estimate_of_size(world()[3], alpha=1.0, size=FIRST_PART), range(4)
            )
        )
    assert len(made_from) == 1
