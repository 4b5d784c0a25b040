"""Imitation by weight: half of every batch is labeled, half are unlabeled pairs by their weight.

No unlabeled pair counts more than a labeled one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.expert_sampler import ExpertSampler, PairSampler
from ssil_trainers.algorithms.half_labeled_sampler import HalfLabeledSampler, share_of_unlabeled
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.odds import density_ratio, log_odds
from ssil_trainers.algorithms.policy import ActionBox
from support.toy_environment import demonstrations

LABELED = 3
LEVELS = [0.0, 0.25, 0.5, 0.75, 1.0]
LEVERAGE = np.array([0.3, 0.9, 0.0, *(4 * LEVELS)], np.float32)
"""Of three labeled pairs, then of unlabeled ones, four of each level."""
BY_WEIGHT = ["gail-leverage", "ssil-leverage", "clone-leverage", "gail-shuffled", "clone-shuffled"]
WIDTH = 999
BOX = ActionBox(np.full(1, -WIDTH, np.float32), np.full(1, WIDTH, np.float32))


def numbered(leverage: np.ndarray = LEVERAGE) -> Demonstrations:
    """Demonstrations whose state is their number, and whose action is minus that."""
    number = np.arange(len(leverage), dtype=np.float32)[:, None]
    return Demonstrations(number, -number, np.arange(len(leverage)) < LABELED, leverage)


def sampler(
    method: str = "gail-leverage", of: Demonstrations | None = None, **settings: Any
) -> PairSampler:
    of = of or numbered()
    row = METHODS[method]
    return row.expert_sampler(of, BOX, of.standardizer, settings=TrainSettings(**settings))


def draw(
    experts: PairSampler, count: int, seed: int = 0, of: Demonstrations | None = None
) -> np.ndarray:
    """Draw pairs; return their numbers, which states and actions agree on."""
    states, actions = experts.sample(count, np.random.default_rng(seed))
    assert len(states) == len(actions) == count
    found = np.rint(-WIDTH * actions.numpy().ravel()).astype(int)
    of = of or numbered()
    np.testing.assert_allclose(states.numpy(), of.standardizer(of.states)[found])
    return found


@pytest.mark.parametrize("method", BY_WEIGHT)
@pytest.mark.parametrize("count", [2, 64, 256])
def test_half_of_every_batch_is_labeled(method: str, count: int) -> None:
    experts = sampler(method)
    for seed in range(20):
        assert (draw(experts, count, seed) < LABELED).sum() == count / 2


def test_of_an_odd_batch_the_larger_part_is_labeled() -> None:
    assert (draw(sampler(), 7) < LABELED).sum() == 4
    assert (draw(sampler(), 1) < LABELED).all()


def test_labeled_pairs_are_drawn_alike_whatever_their_leverage() -> None:
    labeled = draw(sampler(), 24_000)[:12_000]
    np.testing.assert_allclose(np.bincount(labeled) / 12_000, np.full(3, 1 / 3), atol=0.015)


@pytest.mark.parametrize(
    ("settings", "weights"),
    [
        ({}, [0, 0, 0, 0, 1]),
        ({"expert_weighting": "posterior"}, [0, 0.25, 0.5, 0.75, 1]),
        ({"expert_weighting": "ratio"}, [0, 1 / 3, 1, 3, 20]),
        ({"expert_weighting": "ratio", "odds_limit": 2.0}, [0, 1 / 3, 1, 2, 2]),
    ],
    ids=["sure", "posterior", "ratio", "ratio below 2"],
)
def test_unlabeled_pairs_are_drawn_if_they_are_sure_or_by_leverage_or_by_its_odds(
    settings: dict[str, Any], weights: list[float]
) -> None:
    unlabeled = draw(sampler(**settings), 24_000)[12_000:] - LABELED
    shares = np.tile(weights, 4) / (4 * sum(weights))
    np.testing.assert_allclose(np.bincount(unlabeled, minlength=20) / 12_000, shares, atol=0.015)


def with_sure(labeled: int, sure: int) -> Demonstrations:
    """So many labeled pairs, then so many unlabeled ones that are sure, and two others."""
    leverage = np.array([0] * labeled + [1] * sure + [0.9, 0.0], np.float32)
    of = numbered(leverage)
    return replace(of, labeled=np.arange(len(leverage)) < labeled)


@pytest.mark.parametrize("method", BY_WEIGHT)
@pytest.mark.parametrize(("labeled", "sure"), [(3, 1), (3, 2), (50, 1), (50, 20), (50, 49)])
def test_a_few_sure_pairs_are_drawn_as_often_as_labeled_ones(
    method: str, labeled: int, sure: int
) -> None:
    of = with_sure(labeled, sure)
    found = draw(sampler(method, of), 200_000, of=of)
    drawn = np.bincount(found, minlength=len(of.states)) / 200_000
    chosen = np.flatnonzero(drawn)
    assert len(chosen) == labeled + sure
    np.testing.assert_allclose(drawn[chosen], 1 / (labeled + sure), atol=0.003)
    assert (chosen < labeled).sum() == labeled


@pytest.mark.parametrize("method", BY_WEIGHT)
@pytest.mark.parametrize("sure", [3, 4, 30])
def test_with_as_many_sure_pairs_as_labeled_ones_they_fill_half_of_every_batch(
    method: str, sure: int
) -> None:
    of = with_sure(3, sure)
    for seed in range(20):
        assert (draw(sampler(method, of), 64, seed, of) < LABELED).sum() == 32


@given(
    st.integers(1, 8),
    st.lists(st.floats(0, 1, width=32), min_size=1, max_size=12),
    st.sampled_from(["sure", "posterior", "ratio"]),
    st.sampled_from(BY_WEIGHT),
)
def test_no_unlabeled_pair_counts_more_than_a_labeled_one(
    labeled: int, leverage: list[float], weighting: str, method: str
) -> None:
    of = numbered(np.array([1.0] * labeled + leverage, np.float32))
    of = replace(of, labeled=np.arange(len(of.states)) < labeled)
    experts = sampler(method, of, expert_weighting=weighting)
    weights = METHODS[method].expert_weights(of, TrainSettings(expert_weighting=weighting))
    unlabeled = weights[labeled:].astype(np.float64)
    share = share_of_unlabeled(labeled, unlabeled)
    if isinstance(experts, HalfLabeledSampler):
        assert share == 0.5
        heaviest = experts.unlabeled.weights.max() / experts.unlabeled.weights.sum(dtype=float) / 2
        assert heaviest <= 1 / (2 * labeled) * (1 + 1e-6)
        return
    assert isinstance(experts, ExpertSampler)
    drawn = experts.weights / experts.weights.sum(dtype=float)
    assert np.ptp(drawn[:labeled]) == 0
    assert drawn.max() == drawn[0]
    assert share < 0.5
    assert drawn[labeled:].sum() == pytest.approx(share, abs=1e-6)
    kept = unlabeled[unlabeled > 0]
    np.testing.assert_allclose(drawn[labeled:] * kept.sum(), kept * share, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("method", BY_WEIGHT)
@pytest.mark.parametrize("weighting", ["sure", "posterior", "ratio"])
@pytest.mark.parametrize("rows", [slice(None), slice(LABELED)], ids=["leverage 0", "all labeled"])
def test_without_an_unlabeled_pair_of_positive_weight_batches_are_labeled(
    method: str, weighting: str, rows: slice
) -> None:
    leverage = np.where(np.arange(8) < LABELED, 1, 0).astype(np.float32)[rows]
    experts = sampler(method, numbered(leverage), expert_weighting=weighting)
    assert isinstance(experts, ExpertSampler)
    np.testing.assert_array_equal(experts.weights, np.ones(LABELED))
    assert (draw_states(experts, 50) < LABELED).all()


def draw_states(experts: ExpertSampler, count: int) -> np.ndarray:
    _, actions = experts.sample(count, np.random.default_rng(0))
    return np.rint(-WIDTH * actions.numpy().ravel())


@pytest.mark.parametrize("weighting", ["posterior", "ratio"])
@pytest.mark.parametrize("everywhere", [1.0, 0.5, 1e-30])
def test_leverage_that_is_the_same_everywhere_draws_all_unlabeled_pairs_alike(
    weighting: str, everywhere: float
) -> None:
    leverage = np.full(len(LEVERAGE), everywhere, np.float32)
    experts = sampler(of=numbered(leverage), expert_weighting=weighting)
    assert isinstance(experts, HalfLabeledSampler)
    assert np.isfinite(experts.unlabeled.weights).all()
    assert np.ptp(experts.unlabeled.weights) == 0
    assert set(draw(experts, 2_000)[1_000:]) == set(range(LABELED, len(LEVERAGE)))


@given(st.lists(st.floats(0, 1, width=32), min_size=1, max_size=9), st.floats(1.001, 1e6))
def test_odds_keep_the_order_and_their_limits(leverage: list[float], limit: float) -> None:
    w = np.array(leverage, np.float32)
    ratio = density_ratio(w, limit)
    logarithm = log_odds(w, limit)
    order = np.argsort(w)
    for odds in (ratio, logarithm):
        assert np.isfinite(odds).all()
        assert (np.diff(odds[order]) >= 0).all()
    assert (ratio >= 0).all() and (ratio <= limit * (1 + 1e-12)).all()
    assert (np.abs(logarithm) <= np.log(limit) * (1 + 1e-9) + 1e-9).all()
    inside = (ratio > 1.01 / limit) & (ratio < 0.99 * limit)
    np.testing.assert_allclose(np.exp(logarithm[inside]), ratio[inside], rtol=1e-6)


@pytest.mark.parametrize("method", ["gail-shuffled", "clone-shuffled"])
@pytest.mark.parametrize("weighting", ["sure", "posterior", "ratio"])
def test_shuffled_twins_have_the_same_weights_at_other_pairs(method: str, weighting: str) -> None:
    toy = demonstrations()
    leverage = np.random.default_rng(0).random(len(toy.states), np.float32) ** np.float32(0.1)
    of = Demonstrations(toy.states, toy.actions, toy.labeled, leverage.copy())
    twin = method.replace("shuffled", "leverage")

    def unlabeled(name: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        experts = sampler(name, of, expert_weighting=weighting, seed=seed)
        assert isinstance(experts, HalfLabeledSampler)
        assert len(experts.labeled.weights) == 300
        return experts.unlabeled.weights, experts.unlabeled.states

    def differ(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> bool:
        return any((mine != theirs).any() for mine, theirs in zip(one, other, strict=True))

    shuffled = unlabeled(method)
    np.testing.assert_array_equal(np.sort(shuffled[0]), np.sort(unlabeled(twin)[0]))
    assert differ(shuffled, unlabeled(twin))
    assert not differ(shuffled, unlabeled(method))
    assert differ(shuffled, unlabeled(method, seed=1))
    assert of.leverage is not None
    np.testing.assert_array_equal(of.leverage, leverage)


def test_the_same_seed_draws_the_same_batches() -> None:
    for one, other in zip(
        sampler().sample(64, np.random.default_rng(3)),
        sampler().sample(64, np.random.default_rng(3)),
        strict=True,
    ):
        assert torch.equal(one, other)
    assert (draw(sampler(), 64, seed=3) != draw(sampler(), 64, seed=4)).any()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"expert_weighting": "all"},
            "expert_weighting: expected one of sure, posterior, ratio, found",
        ),
        ({"odds_limit": 1.0}, "odds_limit: expected a number above 1, found 1.0"),
        ({"odds_limit": float("inf")}, "odds_limit: expected a number above 1"),
        ({"pair_reward": -1.0}, "pair_reward: expected a number of at least 0"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        replace(TrainSettings(), **wrong)
