"""Pooling over time: what every kind promises, and slow references of window and hidden Markov."""

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import ssil_data.pooling.base
from ssil_data.errors import InvalidInputError
from ssil_data.pooling import POOLINGS, HiddenMarkov, NoPooling, Pooling, Window
from ssil_data.pooling.forward_backward import infer
from ssil_data.pooling.kinds import from_json, settings_from_json, to_json
from ssil_data.pooling.window import average_window
from ssil_data.ranks import normal_scores

EVERY = [NoPooling(), Window(), Window(3), HiddenMarkov(), HiddenMarkov(bins=4, start_share=0.5)]
every_pooling = pytest.mark.parametrize("pooling", EVERY, ids=str)


def rows_of(lengths: list[int]) -> NDArray[np.int64]:
    return np.repeat(np.arange(len(lengths)), lengths)


def slow_drive(seed: int, lengths: list[int]) -> NDArray[np.float32]:
    """Uncertainty that stays high or low for some 20 steps, with noise."""
    rng = np.random.default_rng(seed)
    count = sum(lengths)
    level = np.repeat(rng.normal(size=count // 20 + 1), 20)[:count]
    return (2 * level + 0.5 * rng.normal(size=count)).astype(np.float32)


episodes = st.lists(st.integers(1, 60), min_size=1, max_size=6)


@every_pooling
@given(lengths=episodes, seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_what_other_episodes_hold_changes_nothing(pooling: Pooling, lengths: list[int], seed: int):
    values = slow_drive(seed, lengths)
    episode = rows_of(lengths)
    fitted = pooling.fit(values, episode)
    whole = fitted(values, episode)
    assert whole.dtype == np.float32 and whole.shape == values.shape
    for number in range(len(lengths)):
        own = episode == number
        alone = fitted(values[own], episode[own])
        np.testing.assert_allclose(whole[own], alone, rtol=2e-5, atol=1e-6)
        others_changed = np.where(own, values, -9 * values).astype(np.float32)
        changed = fitted(others_changed, episode)
        np.testing.assert_allclose(changed[own], alone, rtol=2e-5, atol=1e-6)


@given(lengths=episodes, seed=st.integers(0, 99))
@settings(max_examples=30, deadline=None)
def test_an_episode_alone_gets_the_bits_that_it_has_in_the_whole(lengths: list[int], seed: int):
    values = slow_drive(seed, lengths)
    episode = rows_of(lengths)
    fitted = Window(3).fit(values, episode)
    whole = fitted(values, episode)
    alone = [fitted(values[episode == n], episode[episode == n]) for n in range(len(lengths))]
    np.testing.assert_array_equal(whole, np.concatenate(alone))


@every_pooling
@pytest.mark.parametrize("chunk", [1, 100, 101, 10_000])
def test_pooling_does_not_depend_on_its_chunks(
    pooling: Pooling, chunk: int, monkeypatch: pytest.MonkeyPatch
):
    lengths = [100, 1, 99, 1, 250, 50]
    values = slow_drive(1, lengths)
    episode = rows_of(lengths)
    fitted = pooling.fit(values, episode)
    whole = fitted(values, episode)
    monkeypatch.setattr(ssil_data.pooling.base, "CHUNK", chunk)
    np.testing.assert_allclose(fitted(values, episode), whole, rtol=2e-5, atol=1e-6)
    again = pooling.fit(values, episode)(values, episode)
    np.testing.assert_allclose(again, whole, rtol=1e-4, atol=1e-5)


@every_pooling
def test_a_single_pair_is_judged_alone_and_no_pair_gives_nothing(pooling: Pooling):
    lengths = [100, 80]
    values = slow_drive(2, lengths)
    fitted = pooling.fit(values, rows_of(lengths))
    low, high = (fitted([value], np.zeros(1, np.int64))[0] for value in (-9.0, 9.0))
    assert np.isfinite([low, high]).all() and low <= high
    assert fitted(np.zeros(0), np.zeros(0, np.int64)).shape == (0,)
    pairs = fitted([-9.0, 9.0], np.array([4, 9]))
    np.testing.assert_allclose(pairs, [low, high], rtol=1e-6)


@every_pooling
@pytest.mark.parametrize("values", [[3.0], [3.0] * 50, [0.0, 1.0], [-3e38, 3e38, 0.0], [1e-45, 0]])
def test_tiny_and_constant_pools_are_finite(pooling: Pooling, values: list[float]):
    episode = np.zeros(len(values), np.int64)
    fitted = pooling.fit(np.array(values, np.float32), episode)
    assert np.isfinite(fitted(values, episode)).all()


@every_pooling
def test_a_fitted_pooling_and_its_settings_survive_json(pooling: Pooling):
    lengths = [100, 80]
    values = slow_drive(3, lengths)
    fitted = pooling.fit(values, rows_of(lengths))
    again = from_json(json.loads(json.dumps(to_json(fitted))))
    assert again == fitted
    assert again.stretch == fitted.stretch
    np.testing.assert_array_equal(again(values, rows_of(lengths)), fitted(values, rows_of(lengths)))
    assert settings_from_json(json.loads(json.dumps(to_json(pooling)))) == pooling


@given(
    values=st.lists(st.floats(-4, 4, width=32), min_size=1, max_size=40),
    cuts=st.lists(st.booleans(), min_size=40, max_size=40),
    half_width=st.integers(0, 50),
)
def test_a_window_is_the_mean_of_a_double_loop(
    values: list[float], cuts: list[bool], half_width: int
):
    starts = np.array([True, *cuts[1 : len(values)]])[: len(values)]
    number = np.cumsum(starts)
    expected = []
    for row in range(len(values)):
        near = [
            values[other]
            for other in range(len(values))
            if abs(other - row) <= half_width and number[other] == number[row]
        ]
        expected.append(sum(near) / len(near))
    found = average_window(np.array(values, np.float32), starts, half_width)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_a_window_closes_where_rows_are_in_no_order_of_time(seed: int):
    values = slow_drive(seed, [2000])
    shuffled = np.random.default_rng(seed).permutation(values)
    episode = np.zeros(2000, np.int64)
    assert Window().fit(values, episode).half_width == 25
    closed = Window().fit(shuffled, episode)
    assert (closed.half_width, closed.stretch) == (0, 1)
    expected = normal_scores(shuffled, closed.knots)
    np.testing.assert_allclose(closed(shuffled, episode), expected, rtol=1e-6)


def test_a_window_closes_where_every_pair_is_an_episode_of_its_own():
    values = slow_drive(0, [500])
    assert Window().fit(values, np.arange(500)).half_width == 0


def by_enumeration(
    log_ratio: NDArray[np.float64], starts: NDArray[np.bool_], stay: float, share: float
) -> tuple[NDArray[np.float64], float]:
    """Sum over all sequences of states and of whether each step drew one."""
    count = len(log_ratio)
    chance = np.zeros(count)
    draws = whole = 0.0
    for states in itertools.product((0, 1), repeat=count):
        for drawn in itertools.product((0, 1), repeat=count):
            p = 1.0
            for t, state in enumerate(states):
                of_state = share if state == 0 else 1 - share
                if starts[t]:
                    p *= of_state if not drawn[t] else 0.0
                elif drawn[t]:
                    p *= (1 - stay) * of_state
                else:
                    p *= stay if state == states[t - 1] else 0.0
                p *= np.exp(log_ratio[t] / 2 * (1 if state == 0 else -1))
            whole += p
            draws += p * sum(drawn)
            chance += p * (np.array(states) == 0)
    inside = np.count_nonzero(~starts)
    return chance / whole, draws / whole / inside if inside else 0.0


@pytest.mark.parametrize(
    ("starts", "stay", "share"),
    [
        ([1, 0, 0, 0, 0, 0], 0.9, 0.2),
        ([1, 0, 0, 1, 0, 0], 0.98, 0.5),
        ([1, 1, 1, 1, 1, 1], 0.5, 0.05),
        ([1, 0, 1, 1, 0, 0], 0.5, 0.999),
        ([1], 0.9, 0.3),
    ],
)
def test_forward_backward_is_the_sum_over_all_sequences(
    starts: list[int], stay: float, share: float
):
    log_ratio = np.random.default_rng(len(starts)).normal(size=len(starts)) * 3
    marks = np.array(starts, bool)
    chance, draws = infer(log_ratio, marks, stay=stay, share=share)
    expected, expected_draws = by_enumeration(log_ratio, marks, stay, share)
    np.testing.assert_allclose(chance, expected, rtol=1e-10)
    assert draws == pytest.approx(expected_draws, rel=1e-10)


@given(
    log_ratio=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=300),
    stay=st.floats(0.5, 0.9999),
    share=st.floats(1e-4, 1 - 1e-4),
)
@settings(deadline=None)
def test_forward_backward_is_that_of_a_plain_loop(
    log_ratio: list[float], stay: float, share: float
):
    values = np.array(log_ratio)
    starts = np.arange(len(values)) % 37 == 0
    prior = np.array([share, 1 - share])
    inside = stay * np.eye(2) + (1 - stay) * prior
    half = np.clip(values, -60, 60) / 2
    likely = np.stack([np.exp(half), np.exp(-half)], axis=1)
    forward, backward = np.zeros((2, len(values), 2))
    for t in range(len(values)):
        forward[t] = likely[t] * (prior if starts[t] else forward[t - 1] @ inside)
        forward[t] /= forward[t].sum()
    for t in reversed(range(len(values))):
        ends = t + 1 == len(values) or starts[t + 1]
        backward[t] = 1 if ends else inside @ (likely[t + 1] * backward[t + 1])
        backward[t] /= backward[t].sum()
    joint = forward * backward
    chance, draws = infer(values, starts, stay=stay, share=share)
    np.testing.assert_allclose(chance, joint[:, 0] / joint.sum(axis=1), rtol=1e-8, atol=1e-12)
    assert 0 <= draws <= 1


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"kind": "median"},
        {"kind": "window", "half_width": 25, "knots": [1.0, 0.0]},
        {"kind": "window", "half_width": -1, "knots": [0.0] * 257},
        {"kind": "window", "half_width": 25, "knots": [0.0] * 256 + [float("inf")]},
        {"kind": "window", "half_width": 25, "knots": [1.0] * 256 + [0.0]},
        {"kind": "window", "half_width": "25", "knots": [0.0] * 257},
        {"kind": "window", "half_width": 2.5, "knots": [0.0] * 257},
        {"kind": "window", "half_width": 25, "knots": None},
        {"kind": "hmm", "edges": [0.0], "log_ratio": [0.0], "stay": 0.9, "share": 0.5},
        {"kind": "hmm", "edges": [1.0, 0.0], "log_ratio": [0.0] * 3, "stay": 0.9, "share": 0.5},
        {"kind": "hmm", "edges": [0.0], "log_ratio": [0.0, 1.0], "stay": 1.0, "share": 0.5},
        {"kind": "hmm", "edges": [0.0], "log_ratio": [0.0, 1.0], "stay": 0.9, "share": "half"},
        {"kind": "none", "more": 1},
    ],
)
def test_a_tampered_record_of_a_pooling_is_refused(values: dict):
    with pytest.raises(InvalidInputError):
        from_json(values)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Window(0),
        lambda: Window(2.5),  # pyright: ignore[reportArgumentType]
        lambda: Window(True),
        lambda: HiddenMarkov(bins=1),
        lambda: HiddenMarkov(bins=8.0),  # pyright: ignore[reportArgumentType]
        lambda: HiddenMarkov(start_share=0.0),
        lambda: HiddenMarkov(start_share=1.0),
        lambda: HiddenMarkov(start_share=float("nan")),
    ],
)
def test_impossible_settings_are_refused(make):
    with pytest.raises(InvalidInputError):
        make()


def test_there_are_three_kinds():
    assert sorted(POOLINGS) == ["hmm", "none", "window"]
