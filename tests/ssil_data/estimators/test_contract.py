"""What every estimator promises."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import torch
from sklearn.metrics import roc_auc_score

from ssil_data.demonstrations import Episode, Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import Estimator, Fitted, UnlabeledSample, dump, load
from ssil_data.store.arrow_schema import PARTS


def assert_same(one: Fitted, other: Fitted, pairs: Pairs) -> None:
    """Assert the same answer to the last bit."""
    mine, theirs = one.uncertainty(pairs), other.uncertainty(pairs)
    np.testing.assert_array_equal(mine.total, theirs.total)
    assert mine.parts.keys() == theirs.parts.keys()
    for name in mine.parts:
        np.testing.assert_array_equal(mine.parts[name], theirs.parts[name])


def test_same_seed_same_bytes(
    brief: Estimator, expert: Pairs, other_expert: Pairs, unlabeled: UnlabeledSample
):
    fitted = brief.fit(expert, seed=0, unlabeled=unlabeled)
    torch.rand(3)
    again = brief.fit(expert, seed=0, unlabeled=unlabeled)
    assert dump(again) == dump(fitted)
    assert_same(again, fitted, other_expert)


def test_fitting_leaves_torch_as_it_was(
    brief: Estimator, expert: Pairs, unlabeled: UnlabeledSample
):
    state, threads = torch.get_rng_state(), torch.get_num_threads()
    brief.fit(expert[:50], seed=3, unlabeled=unlabeled)
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.get_num_threads() == threads


def test_fits_in_several_threads_do_not_disturb_each_other(
    brief: Estimator, expert: Pairs, unlabeled: UnlabeledSample
):
    few = expert[:60]
    alone = dump(brief.fit(few, seed=0, unlabeled=unlabeled))
    with ThreadPoolExecutor() as threads:
        fits = [
            threads.submit(brief.fit, few, seed=seed, unlabeled=unlabeled) for seed in (0, 1, 0)
        ]
        first, _, third = (dump(fit.result()) for fit in fits)
    assert first == third == alone


def test_random_pairs_are_more_uncertain_than_expert_pairs(
    fitted: Fitted, other_expert: Pairs, random: Pairs
):
    uncertainty = [fitted.uncertainty(pairs).total for pairs in (other_expert, random)]
    is_random = np.repeat([0, 1], [len(other_expert), len(random)])
    assert roc_auc_score(is_random, np.concatenate(uncertainty)) > 0.85


def test_a_dumped_estimator_answers_identically_when_loaded(fitted: Fitted, random: Pairs):
    loaded = load(dump(fitted))
    assert loaded.settings == fitted.settings
    assert (loaded.margin, type(loaded)) == (fitted.margin, type(fitted))
    assert_same(loaded, fitted, random)


@pytest.mark.parametrize("count", [0, 1, 2, 300])
def test_rows_in_are_rows_out(fitted: Fitted, random: Pairs, count: int):
    uncertainty = fitted.uncertainty(random[:count])
    shares = fitted.shares(random[:count])
    for values in (uncertainty.total, *uncertainty.parts.values()):
        assert values.shape == (count,) and values.dtype == np.float32
        assert np.isfinite(values).all()
    assert shares is None or shares.shape == random[:count].states.shape
    assert set(uncertainty.parts) <= set(PARTS)


def test_the_input_is_untouched(fitted: Fitted, random: Pairs):
    before = random.states.copy(), random.actions.copy()
    fitted.uncertainty(random)
    fitted.shares(random)
    np.testing.assert_array_equal(before[0], random.states)
    np.testing.assert_array_equal(before[1], random.actions)


@pytest.mark.parametrize("cut", [slice(0, 30), slice(7, 55), slice(29, 31), slice(100, 300)])
def test_a_batch_with_its_margin_is_judged_as_in_the_whole(
    fitted: Fitted, random: Pairs, cut: slice
):
    start, stop = max(0, cut.start - fitted.margin), min(len(random), cut.stop + fitted.margin)
    part = fitted.uncertainty(random[start:stop]).total[cut.start - start :][: cut.stop - cut.start]
    whole = fitted.uncertainty(random).total[cut]
    np.testing.assert_allclose(part, whole, rtol=1e-3, atol=1e-4)


def test_values_far_away_are_judged_without_overflow(fitted: Fitted, random: Pairs):
    far = Pairs(random.states * 1e30, random.actions * 1e30, random.episode, random.step)
    uncertainty = fitted.uncertainty(far)
    assert np.isfinite(uncertainty.total).all()
    assert uncertainty.total.mean() > fitted.uncertainty(random).total.mean()


def test_another_width_is_refused_naming_both_sides(fitted: Fitted, random: Pairs):
    wide = Pairs(np.hstack([random.states] * 2), random.actions, random.episode, random.step)
    with pytest.raises(InvalidInputError, match="state width: expected 6, found 12"):
        fitted.uncertainty(wide)
    narrow = Pairs(random.states, random.actions[:, :1], random.episode, random.step)
    with pytest.raises(InvalidInputError, match="action width: expected 2, found 1"):
        fitted.uncertainty(narrow)


def test_what_is_no_pairs_is_refused_with_how_to_make_them(
    estimator: Estimator, fitted: Fitted, random: Pairs, unlabeled: UnlabeledSample
):
    wrong: list[Any] = [Episode(random.states, random.actions), random.states, None, "drives"]
    for value in wrong:
        found = type(value).__name__
        with pytest.raises(
            InvalidInputError, match=rf"^pairs: .*found {found}; make .*sd\.Pairs\("
        ):
            fitted.uncertainty(value)
        with pytest.raises(InvalidInputError, match=rf"^labeled: .*found {found}; make "):
            estimator.fit(value, seed=0, unlabeled=unlabeled)


def test_nan_is_refused(estimator: Estimator, expert: Pairs, unlabeled: UnlabeledSample):
    states = expert.states.copy()
    states[3, 2] = np.nan
    with pytest.raises(InvalidInputError, match="row 3, column 2"):
        estimator.fit(
            Pairs(states, expert.actions, expert.episode, expert.step), seed=0, unlabeled=unlabeled
        )


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_labeled_pairs_are_refused(
    estimator: Estimator, expert: Pairs, unlabeled: UnlabeledSample, count: int
):
    with pytest.raises(InvalidInputError, match=f"at least 2 pairs, found {count}"):
        estimator.fit(expert[:count], seed=0, unlabeled=unlabeled)


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_a_number_that_is_no_seed_is_refused(
    estimator: Estimator, expert: Pairs, unlabeled: UnlabeledSample, seed: int
):
    with pytest.raises(InvalidInputError, match=f"seed: expected .* found {seed}"):
        estimator.fit(expert, seed=seed, unlabeled=unlabeled)


@pytest.mark.parametrize("count", [2, 5])
def test_very_few_labeled_pairs_are_enough(
    estimator: Estimator, expert: Pairs, unlabeled: UnlabeledSample, count: int
):
    fitted = estimator.fit(expert[:count], seed=0, unlabeled=unlabeled)
    assert np.isfinite(fitted.uncertainty(expert).total).all()


def test_constant_dimensions_are_no_obstacle(
    estimator: Estimator, expert: Pairs, unlabeled: UnlabeledSample
):
    few = expert[:90]
    states, actions = few.states.copy(), few.actions.copy()
    states[:, 0], actions[:, 0] = 3.0, 0.0
    pairs = Pairs(states, actions, few.episode, few.step)
    fitted = estimator.fit(pairs, seed=0, unlabeled=unlabeled)
    assert np.isfinite(fitted.uncertainty(pairs).total).all()


def test_settings_and_scoring_do_not_wait_for_torch():
    code = "import sys, ssil_data.estimators, ssil_data.scales; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
