"""From uncertainty to leverage."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ssil_data.errors import InvalidInputError
from ssil_data.scales import (
    SCALES,
    Conformal,
    FittedScale,
    MinMax,
    Quantile,
    Ramp,
    Rank,
    Scale,
    from_json,
    settings_from_json,
    to_json,
)

numbers = st.floats(-1e6, 1e6, width=32)
pools = arrays(np.float32, st.integers(1, 40), elements=numbers)
every_scale = pytest.mark.parametrize("kind", sorted(SCALES))


def fitted(kind: str, pool: np.ndarray) -> FittedScale:
    return SCALES[kind]().fit(pool, pool)


@every_scale
@given(pool=pools, queries=pools)
def test_leverage_lies_between_zero_and_one(kind: str, pool: np.ndarray, queries: np.ndarray):
    leverage = fitted(kind, pool)(queries)
    assert leverage.dtype == np.float32 and leverage.shape == queries.shape
    assert (leverage >= 0).all() and (leverage <= 1).all()


@every_scale
@given(pool=pools, queries=pools)
def test_larger_uncertainty_never_gets_larger_leverage(
    kind: str, pool: np.ndarray, queries: np.ndarray
):
    assert (np.diff(fitted(kind, pool)(np.sort(queries))) <= 0).all()


@every_scale
@given(pool=pools, queries=pools)
def test_a_fitted_scale_survives_json(kind: str, pool: np.ndarray, queries: np.ndarray):
    scale = fitted(kind, pool)
    again = from_json(json.loads(json.dumps(to_json(scale))))
    assert again == scale
    np.testing.assert_array_equal(again(queries), scale(queries))


@pytest.mark.parametrize("scale", [MinMax(), Quantile(0.1, 0.8), Conformal(0.3)])
def test_settings_survive_json(scale: Scale):
    assert settings_from_json(json.loads(json.dumps(to_json(scale)))) == scale


def test_the_smallest_uncertainty_gets_leverage_one_as_in_algorithm_1():
    scale = MinMax().fit(np.array([1.0, 2.0, 5.0]))
    assert scale(np.array([1.0, 2.0, 5.0])).tolist() == [1.0, 0.75, 0.0]


def test_pairs_that_arrive_later_are_clipped():
    scale = MinMax().fit(np.array([1.0, 5.0]))
    assert scale(np.array([-9.0, 99.0, np.inf])).tolist() == [1.0, 0.0, 0.0]


def test_quantile_is_not_at_the_mercy_of_one_outlier():
    pool = np.append(np.linspace(0, 1, 100), 1e6)
    assert MinMax().fit(pool)(np.array([0.9])) > 0.99
    assert Quantile().fit(pool)(np.array([0.9])) < 0.1


@pytest.mark.parametrize("scale", [MinMax(), Quantile()])
def test_a_pool_of_one_value_gets_leverage_one_and_zero_beyond(scale: Scale):
    ramp = scale.fit(np.full(10, 3.0))
    assert ramp(np.array([2.0, 3.0, 3.1])).tolist() == [1.0, 1.0, 0.0]


def test_conformal_leverage_is_the_share_of_residuals_at_least_as_large():
    scale = Conformal().fit(np.empty(0), np.array([4.0, 1.0, 2.0, 3.0]))
    assert scale(np.array([0.0, 2.0, 2.5, 4.0, 5.0])).tolist() == [1.0, 0.75, 0.5, 0.25, 0.0]


def test_conformal_leverage_of_expert_pairs_is_uniform():
    r = np.random.default_rng(0).normal(size=20_000)
    leverage = Conformal().fit(r, r[:10_000])(r[10_000:])
    np.testing.assert_allclose(np.quantile(leverage, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.02)


def test_conformal_without_held_out_pairs_is_refused():
    with pytest.raises(InvalidInputError, match="held-out"):
        Conformal().fit(np.ones(3))


@every_scale
@pytest.mark.parametrize("pool", [[], [np.nan], [1.0, np.inf], [[1.0]]])
def test_a_pool_of_nothing_or_not_finite_is_refused(kind: str, pool: list):
    with pytest.raises(InvalidInputError, match=r"expected one finite number|needs unlabeled"):
        fitted(kind, np.array(pool))


@every_scale
def test_nan_gets_no_leverage(kind: str):
    with pytest.raises(InvalidInputError, match="NaN"):
        fitted(kind, np.arange(3.0))(np.array([np.nan]))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Quantile(0.5, 0.5),
        lambda: Quantile(-0.1, 0.5),
        lambda: Quantile(0.1, 1.5),
        lambda: Quantile(float("nan"), 0.5),
        lambda: Conformal(0),
        lambda: Conformal(1),
        lambda: Ramp(2.0, 1.0),
        lambda: Ramp(0.0, float("inf")),
        lambda: Ramp(-1e308, 1e308),
        lambda: Rank(()),
        lambda: Rank((float("nan"),)),
    ],
)
def test_impossible_settings_are_refused(make):
    with pytest.raises(InvalidInputError):
        make()


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"kind": "minmax"},
        {"kind": ["ramp"]},
        {"kind": "ramp", "low": 0},
        {"kind": "ramp", "low": 0, "high": 1, "more": 2},
        {"kind": "ramp", "low": "0", "high": 1},
        {"kind": "rank", "residuals": "abc"},
        {"kind": "rank", "residuals": None},
    ],
)
def test_malformed_json_of_a_fitted_scale_is_refused(values: dict):
    with pytest.raises(InvalidInputError):
        from_json(values)


@pytest.mark.parametrize("values", [{"kind": "ramp"}, {"kind": "quantile", "low": "a"}])
def test_malformed_json_of_settings_is_refused(values: dict):
    with pytest.raises(InvalidInputError):
        settings_from_json(values)
