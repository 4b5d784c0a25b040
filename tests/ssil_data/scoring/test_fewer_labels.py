"""A run may rest on the first labeled pairs alone; of the others nothing is learned."""

from dataclasses import replace

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.estimators import GPR, VAE
from ssil_data.scales import MinMax, Posterior
from ssil_data.scoring import Recipe, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

QUICK = VAE(steps=20)


def test_a_run_says_how_many_labels_it_rests_on(dataset: Dataset):
    run = score(dataset, QUICK, labels=50)
    assert (run.labeled, run.labeled_episodes, run.pairs) == (50, 1, len(dataset))
    every = score(dataset, QUICK)
    assert (every.labeled, every.labeled_episodes) == (120, 2)
    assert run.model != every.model


def test_all_labels_are_the_same_as_none_said(dataset: Dataset):
    plain = score(dataset, QUICK, run="plain")
    counted = score(dataset, QUICK, labels=120, run="counted")
    assert plain.model == counted.model
    np.testing.assert_array_equal(dataset.leverage("plain"), dataset.leverage("counted"))


@pytest.mark.parametrize("scale", [MinMax(), Posterior()])
def test_nothing_is_learned_from_the_labeled_pairs_that_are_left_out(store: Store, scale):
    """Whatever these are like: the model, and the leverage of all other pairs, stay the same."""
    recipe = Recipe(GPR(surprisal=True), scale, scale_floor=0.3, cross_fit=True)
    leverages = []
    for number, spread in enumerate((1, 50)):
        other = drive(77, 60, labeled=True, spread=spread)
        dataset = store.create(
            f"d{number}",
            [drives()[0], other, *drives()[2:]],
            state_names=STATE_NAMES,
            action_names=ACTION_NAMES,
        )
        score(dataset, recipe, labels=60, run="run")
        leverages.append(np.delete(dataset.leverage("run"), np.arange(60, 120)))
    np.testing.assert_array_equal(*leverages)


def test_only_labels_that_count_have_leverage_one_by_definition(dataset: Dataset):
    paper = Recipe(QUICK, MinMax(), labeled_is_one=True)
    score(dataset, paper, labels=60, run="paper")
    score(dataset, replace(paper, labeled_is_one=False), labels=60, run="measured")
    given = dataset.leverage("paper")
    assert (given[:60] == 1).all()
    np.testing.assert_array_equal(given[60:], dataset.leverage("measured")[60:])


@pytest.mark.parametrize("labels", [-1, 0, 1, 121, 2.5, True])
def test_too_few_labels_or_more_than_there_are_are_refused(dataset: Dataset, labels):
    with pytest.raises(InvalidInputError, match="labels: expected a whole number from 2 to 120"):
        score(dataset, QUICK, labels=labels)
    assert not list(dataset.runs)
