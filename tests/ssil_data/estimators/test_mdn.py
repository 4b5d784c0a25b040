"""The mixture density network."""

import numpy as np
import pytest
from scipy.stats import norm

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import MDN, dump, from_json, load, to_json
from ssil_data.estimators.learning.mixture import MixtureLearner
from ssil_data.estimators.mdn import FittedMDN, Mixture


@pytest.fixture
def mixture() -> Mixture:
    """Two states, three components, two action dimensions."""
    rng = np.random.default_rng(0)
    weights = np.array([[0.2, 0.5, 0.3], [1.0, 0.0, 0.0]], np.float32)
    means, variances = rng.normal(size=(2, 3, 2)), rng.uniform(0.1, 2, (2, 3, 2))
    return Mixture(weights, means.astype(np.float32), variances.astype(np.float32))


def test_the_parts_are_the_variance_of_the_mixture(mixture: Mixture):
    rng = np.random.default_rng(1)
    for row in range(2):
        which = rng.choice(3, 400_000, p=mixture.weights[row])
        drawn = rng.normal(mixture.means[row, which], np.sqrt(mixture.variances[row, which]))
        variance = drawn.var(axis=0).sum()
        total = mixture.aleatoric()[row] + mixture.epistemic()[row]
        np.testing.assert_allclose(total, variance, rtol=0.01)


def test_the_parts_by_hand():
    mixture = Mixture(
        weights=np.array([[0.25, 0.75]], np.float32),
        means=np.array([[[0.0], [4.0]]], np.float32),
        variances=np.array([[[1.0], [2.0]]], np.float32),
    )
    assert mixture.aleatoric().tolist() == [0.25 * 1 + 0.75 * 2]
    assert mixture.epistemic().tolist() == [0.25 * 9 + 0.75 * 1]


def test_one_component_has_no_epistemic_part(mixture: Mixture):
    assert mixture.epistemic()[1] == pytest.approx(0, abs=1e-6)


def test_surprisal_is_the_negative_logarithm_of_the_density(mixture: Mixture):
    actions = np.array([[0.3, -1.0], [2.0, 0.5]], np.float32)
    for row in range(2):
        each = norm.pdf(actions[row], mixture.means[row], np.sqrt(mixture.variances[row]))
        density = mixture.weights[row] @ each.prod(axis=1)
        assert mixture.surprisal(actions)[row] == pytest.approx(-np.log(density), rel=1e-5)


def test_total_is_the_sum_of_the_parts_unless_surprisal_is_chosen(expert: Pairs):
    plain = MDN().fit(expert, seed=0).uncertainty(expert)
    np.testing.assert_allclose(plain.total, sum(plain.parts.values()), rtol=1e-6)
    judged = MDN(surprisal=True).fit(expert, seed=0).uncertainty(expert)
    np.testing.assert_array_equal(judged.parts["epistemic"], plain.parts["epistemic"])
    assert judged.total.min() < 0


def test_two_habits_of_the_expert_become_two_components():
    rng = np.random.default_rng(0)
    states, side = rng.uniform(-1, 1, (800, 1)), rng.choice([-1.0, 1.0], (800, 1))
    pairs = Pairs(
        states, side + 0.05 * rng.normal(size=(800, 1)), np.arange(800), np.zeros(800, int)
    )
    fitted = MDN(surprisal=True).fit(pairs, seed=0)
    assert isinstance(fitted, FittedMDN)
    parts = fitted.uncertainty(pairs).parts
    assert parts["epistemic"].mean() == pytest.approx(1, abs=0.1)
    assert parts["aleatoric"].mean() < 0.2
    undecided = Pairs(states, 0 * side, pairs.episode, pairs.step)
    assert fitted.uncertainty(undecided).total.min() > fitted.uncertainty(pairs).total.mean() + 2


def test_surprisal_judges_the_action_and_the_variances_do_not(expert: Pairs):
    swapped = Pairs(expert.states, -expert.actions, expert.episode, expert.step)
    plain, judging = (MDN(surprisal=on).fit(expert, seed=0) for on in (False, True))
    np.testing.assert_array_equal(plain.uncertainty(swapped).total, plain.uncertainty(expert).total)
    assert judging.uncertainty(swapped).total.mean() > judging.uncertainty(expert).total.mean() + 1


def test_learning_ends_where_held_out_actions_are_likeliest():
    """Of actions that are noise, the mean alone can be learned: soon, and then only noise is."""
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(1_000, 2))
    states = rng.normal(size=(1_000, 20))
    episode = np.repeat(np.arange(10), 100)
    pairs = Pairs(states, noise, episode, np.tile(np.arange(100), 10))
    fresh = Pairs(rng.normal(size=(1_000, 20)), rng.normal(size=(1_000, 2)), episode, pairs.step)
    whole, early = (
        MDN(surprisal=True, stop_early=on).fit(pairs[:200], seed=0) for on in (False, True)
    )
    assert whole.uncertainty(fresh).total.mean() > early.uncertainty(fresh).total.mean() + 0.5


def test_what_can_be_learned_to_the_end_is(expert: Pairs):
    learner = MixtureLearner(
        components=5, hidden=64, floor=0.1, steps=300, batch=256, rate=3e-3, seed=0
    )
    arrays = expert.states.copy(), expert.actions.copy()
    assert learner.find_best_step(*arrays, held_out=arrays) > 250


def test_two_labeled_pairs_are_enough_to_hold_one_out(expert: Pairs):
    fitted = MDN(stop_early=True).fit(expert[:2], seed=0)
    assert np.isfinite(fitted.uncertainty(expert).total).all()


def test_the_setting_is_stored_only_where_it_is_on(expert: Pairs):
    """So archives and runs without it keep the bytes that the first version gave them."""
    assert "stop_early" not in to_json(MDN())
    early = MDN(stop_early=True)
    assert to_json(early)["stop_early"] is True
    assert from_json(to_json(early)) == early
    assert load(dump(early.fit(expert, seed=0))).settings == early
