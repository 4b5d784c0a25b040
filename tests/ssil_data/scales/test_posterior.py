"""The posterior scale: a chance, with the share of the expert's pairs and how sure that is."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.special import ndtri

from ssil_data.errors import InvalidInputError
from ssil_data.scales import Chance, Posterior, from_json, settings_from_json, to_json

numbers = st.floats(-1e6, 1e6, width=32)
pools = arrays(np.float32, st.integers(1, 60), elements=numbers)


def draw(
    seed: int, share: float, *, apart: float, count: int = 4000, labels: int = 200
) -> tuple[NDArray, NDArray[np.bool_], NDArray]:
    """Return a pool of two normal groups, whose pairs are the expert's, and held-out labels."""
    rng = np.random.default_rng(seed)
    is_expert = rng.random(count) < share
    pool = rng.normal(size=count) + np.where(is_expert, 0, apart)
    return pool, is_expert, rng.normal(size=labels)


@given(pool=pools, held_out=st.none() | pools, queries=pools, stretch=st.integers(1, 101))
@settings(deadline=None)
def test_leverage_never_rises_with_uncertainty_and_survives_json(
    pool: NDArray, held_out: NDArray | None, queries: NDArray, stretch: int
):
    scale = Posterior().fit(pool, held_out, stretch=stretch)
    leverage = scale(np.sort(queries))
    assert (np.diff(leverage) <= 0).all()
    assert (leverage >= 0).all() and (leverage <= 1).all()
    assert 0 <= scale.interval[0] <= scale.expert_share <= scale.interval[1] <= 1
    again = from_json(json.loads(json.dumps(to_json(scale))))
    assert again == scale
    np.testing.assert_array_equal(again(queries), scale(queries))


@pytest.mark.parametrize("share", [0.5, 0.1, 0.04])
@pytest.mark.parametrize("seed", [400, 401, 402])
def test_the_share_of_two_groups_apart_is_found(share: float, seed: int):
    pool, is_expert, held_out = draw(seed, share, apart=5)
    scale = Posterior().fit(pool, held_out)
    assert is_expert.mean() / 1.25 < scale.expert_share < 1.25 * is_expert.mean()
    assert scale(pool)[is_expert].mean() > 0.9
    assert scale(pool)[~is_expert].mean() < 0.05


@pytest.mark.parametrize("apart", [2.5, 3, 4])
def test_the_interval_holds_the_true_share_in_nine_of_ten_draws(apart: float):
    held = 0
    for seed in range(400, 440):
        share = (0.5, 0.25, 0.1, 0.04)[seed % 4]
        pool, is_expert, held_out = draw(seed, share, apart=apart)
        low, high = Posterior().fit(pool, held_out).interval
        held += low <= is_expert.mean() <= high
    assert held >= 36


@pytest.mark.parametrize("share", [0.9, 0.95, 0.98])
@pytest.mark.parametrize("apart", [2, 3, 4, 5, 7])
@pytest.mark.parametrize("stretch", [1, 3])
def test_a_pile_of_nearly_all_experts_is_believed_where_labels_are_plenty(
    share: float, apart: float, stretch: int
):
    """A gap amid the experts leaves others of nearly every share, and no prior may choose it."""
    held = 0
    for seed in range(400, 420):
        pool, is_expert, held_out = draw(seed, share, apart=apart, count=3000, labels=400)
        scale = Posterior().fit(pool, held_out, stretch=stretch)
        assert scale.expert_share == pytest.approx(is_expert.mean(), rel=0.2)
        held += scale.interval[0] <= is_expert.mean() <= scale.interval[1]
    assert held >= 18


@pytest.mark.parametrize("share", [0.35, 0.5, 0.7])
@pytest.mark.parametrize(("factor", "offset"), [(0.7, 0), (1, -0.5), (1, 1)])
def test_an_empty_valley_is_believed_whatever_labels_are_like(
    share: float, factor: float, offset: float
):
    """Labels of one drive are more alike than experts are; some look stranger than experts do."""
    held = 0
    for seed in range(400, 410):
        pool, is_expert, held_out = draw(seed, share, apart=7, count=3000, labels=400)
        scale = Posterior().fit(pool, factor * held_out + offset)
        assert scale.expert_share == pytest.approx(is_expert.mean(), rel=0.02)
        held += scale.interval[0] <= is_expert.mean() <= scale.interval[1]
    assert held >= 8


@pytest.mark.parametrize("share", [0.5, 0.1])
@pytest.mark.parametrize("apart", [2.5, 4])
def test_leverage_is_the_share_of_experts_among_pairs_that_have_it(share: float, apart: float):
    pool, is_expert, held_out = draw(400, share, apart=apart)
    leverage = Posterior().fit(pool, held_out)(pool)
    order = np.argsort(leverage, kind="stable")
    bins = np.array_split(order, 10)
    error = np.mean([abs(leverage[rows].mean() - is_expert[rows].mean()) for rows in bins])
    assert error <= 0.1


@pytest.mark.parametrize("stated", [0.02, 0.3, 0.9])
def test_a_stated_share_is_respected(stated: float):
    pool, _, held_out = draw(400, 0.3, apart=3)
    scale = Posterior(stated).fit(pool, held_out)
    assert scale.expert_share == pytest.approx(stated, abs=0.03)
    assert scale(pool).mean() == pytest.approx(stated, abs=0.03)
    assert scale.interval[0] <= stated <= scale.interval[1]


@pytest.mark.parametrize("stated", [None, 0.2])
def test_a_pool_of_one_value_tells_nothing_and_says_so(stated: float | None):
    scale = Posterior(stated).fit(np.full(50, 3.0), np.full(5, 3.0))
    expected = stated or 0.5
    assert scale([2.0, 3.0, 4.0]).tolist() == pytest.approx([expected] * 3)
    assert scale.interval == ((0.0, 1.0) if stated is None else (stated, stated))


def test_without_held_out_pairs_and_without_a_valley_nothing_is_known():
    scale = Posterior().fit(ndtri((np.arange(500) + 0.5) / 500))
    assert set(scale([-9.0, 0.0, 9.0]).tolist()) == {0.5}
    assert scale.interval == (0.0, 1.0)


def test_without_held_out_pairs_a_valley_decides():
    pool, is_expert, _ = draw(400, 0.3, apart=8)
    scale = Posterior().fit(pool)
    assert scale.expert_share == pytest.approx(is_expert.mean(), abs=0.03)


@pytest.mark.parametrize("pool", [[1.0], [0.0, 1.0], [0.0, 1e-45], [-3e38, 3e38], [0, 0, 1]])
@pytest.mark.parametrize("held_out", [None, [0.0], [5.0, -5.0], [1e30]])
@pytest.mark.parametrize("stretch", [1, 51])
def test_tiny_pools_have_a_finite_chance(pool: list, held_out: list | None, stretch: int):
    scale = Posterior().fit(np.array(pool), held_out, stretch=stretch)
    leverage = scale([-np.inf, *pool, np.inf])
    assert np.isfinite(leverage).all() and (np.diff(leverage) <= 0).all()


def test_held_out_pairs_beyond_the_pool_say_that_hardly_any_expert_is_in_it():
    pool = np.random.default_rng(0).normal(size=1000) + 50
    scale = Posterior().fit(pool, np.random.default_rng(1).normal(size=100))
    assert scale.expert_share < 0.01
    assert scale(pool).mean() < 0.01


SOUND = {
    "kind": "chance",
    "uncertainty": [0.0, 1.0, 2.0],
    "chance": [1.0, 0.5, 0.0],
    "expert_share": 0.5,
    "interval": [0.2, 0.8],
}


@pytest.mark.parametrize(
    "change",
    [
        {"uncertainty": [0.0, 1.0]},
        {"uncertainty": [0.0, 1.0, 1.0]},
        {"uncertainty": [0.0, 1.0, float("nan")]},
        {"chance": [1.0, 0.5, 0.6]},
        {"chance": [1.1, 0.5, 0.0]},
        {"chance": [1.0, 0.5, -0.1]},
        {"chance": "abc"},
        {"uncertainty": [0.0], "chance": [1.0]},
        {"expert_share": 0.9},
        {"expert_share": float("nan")},
        {"expert_share": None},
        {"interval": [0.8, 0.2]},
        {"interval": [0.2, 1.2]},
        {"interval": [0.2]},
        {"more": 1},
    ],
)
def test_a_tampered_record_is_refused(change: dict):
    assert isinstance(from_json(SOUND), Chance)
    with pytest.raises(InvalidInputError):
        from_json({**SOUND, **change})


@pytest.mark.parametrize(
    ("share", "expected"),
    [
        (0, "0 < share < 1"),
        (1, "0 < share < 1"),
        (-0.1, "0 < share < 1"),
        (float("nan"), "a finite number"),
        ("half", "a finite number"),
        (True, "a finite number"),
    ],
)
def test_a_number_that_is_no_share_is_refused(share: object, expected: str):
    with pytest.raises(InvalidInputError, match=f"expert_share: expected {expected}, found"):
        settings_from_json({"kind": "posterior", "expert_share": share})
    with pytest.raises(InvalidInputError, match="expert_share: expected 0 < share < 1, found"):
        Posterior(share)  # pyright: ignore[reportArgumentType]


def test_an_outlier_does_not_ruin_the_scale():
    rng = np.random.default_rng(400)
    pool = np.concatenate([rng.normal(size=300), 6 + rng.normal(size=700)])
    held_out = rng.normal(size=200)
    plain = Posterior().fit(pool, held_out)
    ruined = Posterior().fit(np.append(pool, 1e9), held_out)
    assert ruined.expert_share == pytest.approx(plain.expert_share, abs=0.01)
    np.testing.assert_allclose(ruined([0.0, 6.0, 1e9]), plain([0.0, 6.0, 1e9]), atol=0.05)


def test_a_pool_of_nothing_is_refused_with_what_to_do():
    with pytest.raises(InvalidInputError, match=r"needs unlabeled pairs.* such as conformal"):
        Posterior().fit([], [1.0])
