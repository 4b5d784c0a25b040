"""What a run says of itself, and the parts that it is made of: laps, cross-fit, self-training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ssil_data as sd
from ssil_data.demonstrations import Episode, Pairs
from ssil_data.estimators import VAE, Contrast, Ensemble, UnlabeledSample, WindowVAE
from ssil_data.pooling import NoPooling, Window
from ssil_data.scales import Chance, Posterior
from ssil_data.scoring.cross_fit import halve, rank_labeled
from ssil_data.scoring.health import examine
from ssil_data.scoring.laps import count_laps
from ssil_data.scoring.poor_labels import count_distinct, find_poor_labels
from ssil_data.scoring.recipes import Recipe, preset
from ssil_data.scoring.self_training import choose_purest, collect_pairs, join_labeled
from ssil_data.store import Store
from support.demonstrations import ACTION_NAMES, DATASETS, STATE_NAMES, drive


def some_pairs(seed: int, count: int, *, at: float = 0.0, episodes: int = 2) -> Pairs:
    rng = np.random.default_rng(seed)
    states = (rng.normal(size=(count, 3)) + at).astype(np.float32)
    actions = rng.normal(size=(count, 2)).astype(np.float32)
    episode = np.arange(count) * episodes // count
    step = np.arange(count) - np.searchsorted(episode, episode)
    return Pairs(states, actions, episode, step)


CHANCES = Chance((0.0, 1.0), (1.0, 0.0), 0.25, (0.2, 0.3))


def test_the_numbers_of_a_run_are_what_they_say():
    leverage = np.array([1.0, 0.5, 0.5, 0.0], np.float32)
    health = examine(
        leverage,
        CHANCES,
        labeled=some_pairs(0, 60, episodes=3),
        held_out=np.array([1.0, 0.5, 0.2], np.float32),
        unlabeled=UnlabeledSample.of(some_pairs(1, 100)),
    )
    assert health.labeled_episodes == 3
    assert (health.expert_share, health.expert_share_interval) == (0.25, (0.2, 0.3))
    assert health.effective_pairs == pytest.approx(2.0**2 / 1.5)
    assert health.weight_on_experts == pytest.approx(1.5 / 2)
    # by hand: 1.0 beats three and ties one; 0.5 beats one and ties two; 0.2 beats one
    assert health.held_out_auroc == pytest.approx((3.5 + 2 + 1) / 12)
    assert health.calibration_error is not None and 0 <= health.calibration_error <= 1


def test_a_scale_without_chances_has_no_share_and_no_calibration():
    leverage = np.linspace(0, 1, 100, dtype=np.float32)
    scale = sd.Quantile().fit(np.linspace(0, 1, 100))
    health = examine(leverage, scale, labeled=some_pairs(0, 60), held_out=None, unlabeled=None)
    assert health.weak == ()
    assert health.effective_pairs == pytest.approx(75, rel=0.02)
    for name in ("expert_share", "expert_share_interval", "weight_on_experts"):
        assert getattr(health, name) is None
    assert health.calibration_error is None and health.held_out_auroc is None


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_calibration_of_a_true_posterior_is_good_and_of_a_wrong_one_is_not(share: float):
    rng = np.random.default_rng(400)
    is_expert = rng.random(20_000) < share
    r = rng.normal(size=20_000) + np.where(is_expert, 0, 3)
    odds = share / (1 - share) * np.exp(-3 * r + 4.5)
    true = (odds / (1 + odds)).astype(np.float32)
    held = rng.normal(size=5000)
    held_odds = share / (1 - share) * np.exp(-3 * held + 4.5)
    of_held = (held_odds / (1 + held_odds)).astype(np.float32)
    errors = [
        examine(
            change(true),
            replace(CHANCES, expert_share=share, interval=(0.0, 1.0)),
            labeled=some_pairs(0, 60),
            held_out=change(of_held),
            unlabeled=None,
        ).calibration_error
        for change in (lambda w: w, lambda w: 0.5 * w + 0.5)
    ]
    good, bad = errors
    assert good is not None and bad is not None
    assert good < 0.02
    assert bad > 0.2


def test_a_dimension_that_decides_alone_is_named():
    labeled = some_pairs(0, 60)
    states = np.array(some_pairs(1, 200).states)
    states[:, 1] = 50
    far = Pairs(states, some_pairs(1, 200).actions, np.zeros(200, np.int64), np.arange(200))
    health = examine(
        np.linspace(0, 1, 200, dtype=np.float32),
        CHANCES,
        labeled=labeled,
        held_out=np.ones(60, np.float32),
        unlabeled=UnlabeledSample.of(far, scale_floor=0.3),
    )
    assert [text for text in health.weak if "state dimension 1 decides alone" in text]


def test_labels_that_share_a_value_with_the_pool_are_not_poor():
    labeled, others = some_pairs(0, 60), some_pairs(1, 200)
    both = [np.array(each.actions) for each in (labeled, others)]
    both[0][:, 0] = 1.0
    both[1][:50, 0] = 1.0
    ours, theirs = (
        Pairs(each.states, actions, each.episode, each.step)
        for each, actions in zip((labeled, others), both, strict=True)
    )
    assert find_poor_labels(ours, UnlabeledSample.of(theirs)) == []
    (reason,) = find_poor_labels(ours, UnlabeledSample.of(others))
    assert reason.startswith("action 0 is 1 in all labeled pairs and hardly ever elsewhere")


@pytest.mark.parametrize("noise", [0.0, 1e-7])
@pytest.mark.parametrize("shift", [0.0, 0.0005, 0.001])
def test_pairs_that_are_alike_count_once_wherever_the_grid_lies(noise: float, shift: float):
    rng = np.random.default_rng(0)
    rows = np.tile(np.arange(4.0)[:, None] + shift, (15, 3)) + noise * rng.normal(size=(60, 3))
    assert count_distinct(rows.astype(np.float32), np.ones(3)) == 4


def test_1200_labels_of_the_racetrack_are_6_3_laps():
    dataset = sd.Store(DATASETS)["racetrack"]
    labeled = dataset.per_pair("labeled").astype(bool)
    known = labeled & (np.cumsum(labeled) <= 1200)
    laps = count_laps(dataset.read_recorded("position"), dataset.per_pair("episode"), known)
    assert laps == pytest.approx(6.34, abs=0.01)
    half = labeled & (np.cumsum(labeled) <= 94)
    laps = count_laps(dataset.read_recorded("position"), dataset.per_pair("episode"), half)
    assert laps == pytest.approx(0.44, abs=0.01)  # it starts from rest


def test_all_2005_labels_of_the_rc_car_are_5_laps_and_401_of_them_are_1():
    dataset = sd.Store(DATASETS)["rc-lidar"]
    labeled = dataset.per_pair("labeled").astype(bool)
    position = dataset.read_recorded("position")
    episode = dataset.per_pair("episode")
    assert labeled.sum() == 2005
    assert count_laps(position, episode, labeled) == pytest.approx(5, abs=0.01)
    first = labeled & (np.cumsum(labeled) <= 401)
    assert count_laps(position, episode, first) == pytest.approx(1, abs=0.01)


def test_laps_of_a_circle_are_counted_and_of_a_line_are_unknown():
    angle = np.linspace(0, 6 * np.pi, 601)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    episode = np.zeros(601, np.int64)
    everything = np.ones(601, bool)
    assert count_laps(circle, episode, everything) == pytest.approx(3, abs=0.02)
    assert count_laps(circle, episode, np.arange(601) <= 100) == pytest.approx(0.5, abs=0.02)
    line = np.stack([angle, 0 * angle], axis=1).astype(np.float32)
    assert count_laps(line, episode, everything) is None
    assert count_laps(None, episode, everything) is None
    still = np.zeros((601, 2), np.float32)
    assert count_laps(still, episode, everything) is None
    assert count_laps(circle[:0], episode[:0], everything[:0]) is None


def test_halves_are_whole_episodes_or_the_two_ends_of_the_only_one():
    several = some_pairs(0, 60, episodes=3)
    first = halve(several)
    assert [set(first[several.episode == number]) for number in range(3)] == [{1}, {0}, {1}]
    alone = halve(some_pairs(0, 9, episodes=1))
    assert alone.tolist() == [True] * 4 + [False] * 5


def test_labels_of_an_expert_far_from_the_pool_rank_below_it_and_those_of_the_pool_inside():
    pool = UnlabeledSample.of(some_pairs(1, 400))
    apart = some_pairs(2, 60, at=30, episodes=4)
    estimator = VAE(steps=60)
    ranks = rank_labeled(estimator, NoPooling(), apart, unlabeled=pool, seed=400)
    assert ranks is not None and ranks.shape == (60,)
    assert ranks.max() < 0.05
    within = rank_labeled(
        estimator, NoPooling(), some_pairs(3, 60, episodes=4), unlabeled=pool, seed=400
    )
    assert within is not None
    assert 0.3 < within.mean() < 0.8


def test_three_labels_have_no_halves_and_four_have():
    pool = UnlabeledSample.of(some_pairs(1, 100))
    estimator = Contrast(steps=5)
    few = rank_labeled(estimator, Window(), some_pairs(0, 3), unlabeled=pool, seed=0)
    assert few is None
    four = rank_labeled(estimator, Window(), some_pairs(0, 4), unlabeled=pool, seed=0)
    assert four is not None and ((four >= 0) & (four <= 1)).all()


def test_pairs_that_joined_are_learned_from_and_not_judged():
    labeled, pool = some_pairs(3, 20, episodes=4), UnlabeledSample.of(some_pairs(1, 400, at=2))
    estimator = Contrast(steps=100)
    alone = rank_labeled(estimator, NoPooling(), labeled, unlabeled=pool, seed=400)
    joined = rank_labeled(
        estimator,
        NoPooling(),
        labeled,
        unlabeled=pool,
        seed=400,
        joined=some_pairs(4, 300),
    )
    assert alone is not None and joined is not None
    assert joined.shape == alone.shape == (20,)
    assert joined.mean() < alone.mean()


def test_the_purest_join_where_they_are_pure_and_none_where_they_are_not():
    labeled = np.arange(1000) < 100
    pure = np.where(np.arange(1000) < 300, 0.99, 0.01).astype(np.float32)
    chosen = choose_purest(pure, labeled)
    assert chosen is not None
    assert not (chosen & labeled).any()
    assert chosen.sum() == int(0.3 * pure[~labeled].sum(dtype=np.float64))
    assert pure[chosen].min() == np.float32(0.99)
    assert choose_purest(np.full(1000, 0.9, np.float32), labeled) is None
    assert choose_purest(np.zeros(1000, np.float32), labeled) is None
    assert choose_purest(np.ones(100, np.float32), np.ones(100, bool)) is None


@pytest.mark.parametrize("size", [1, 7, 100])
def test_chosen_pairs_are_read_from_a_stream_and_join_as_episodes_of_their_own(size: int):
    pairs = some_pairs(0, 50, episodes=2)
    chosen = np.isin(np.arange(50), [3, 4, 5, 9, 24, 25, 40])
    batches = [pairs[first : first + size] for first in range(0, 50, size)]
    found = collect_pairs(batches, chosen)
    np.testing.assert_array_equal(found.states, pairs.states[chosen])
    assert found.episode.tolist() == [0, 0, 0, 1, 2, 3, 4]
    assert found.step.tolist() == [0, 1, 2, 0, 0, 0, 0]
    both = join_labeled(pairs, found)
    assert len(both) == 57
    assert both.episode[50:].tolist() == [2, 2, 2, 3, 4, 5, 6]


GATE = Recipe(
    Ensemble((WindowVAE(steps=60), Contrast(steps=60, expert_share=0.5))),
    Posterior(),
    pooling=Window(),
    scale_floor=0.3,
    cross_fit=True,
    self_training=True,
)


def test_a_run_joins_the_purest_pairs_where_they_are_pure_and_not_where_it_is_weak(store: Store):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}

    def shifted(seed: int, far: float, **known: object) -> Episode:
        plain = drive(seed, 60, spread=0.3, **known)
        return replace(plain, states=plain.states + np.float32(far))

    labeled = [shifted(seed, 0, labeled=True) for seed in range(4)]
    pool = [*(shifted(10 + s, 0) for s in range(6)), *(shifted(30 + s, 9) for s in range(6))]
    pure = store.create("pure", [*labeled, *pool], **names)
    run = sd.score(pure, GATE, seed=400)
    assert run.weak == ()
    assert run.self_training and run.self_trained > 50
    assert run.labeled == 240
    first = labeled[0]
    three = replace(first, states=first.states[:3], actions=first.actions[:3])
    few = store.create("few", [three, *pool], **names)
    run = sd.score(few, GATE, seed=400)
    assert run.weak
    assert run.self_training and run.self_trained == 0


def test_the_default_presets_record_tells_everything(store: Store):
    dataset = store.create(
        "drives",
        [*(drive(s, 60, labeled=True) for s in range(2)), *(drive(9 + s, 60) for s in range(4))],
        state_names=STATE_NAMES,
        action_names=ACTION_NAMES,
    )
    small = replace(
        preset("default"), estimator=Ensemble((WindowVAE(steps=40), Contrast(steps=40)))
    )
    run = sd.score(dataset, small, seed=400)
    assert (run.labeled, run.labeled_episodes, run.laps) == (120, 2, None)
    assert run.pooling == {"kind": "window", "half_width": 25}
    assert (run.scale_floor, run.cross_fit, run.self_training) == (0.3, True, False)
    assert run.effective_pairs is not None and 1 <= run.effective_pairs <= 240
    for value in (run.weight_on_experts, run.calibration_error, run.held_out_auroc):
        assert value is not None and 0 <= value <= 1
    assert dataset.runs[run.name] == run
