"""A stored model gives pairs the leverage that its run has."""

from typing import Any

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import ESTIMATORS
from ssil_data.scoring import score
from ssil_data.store.dataset import Dataset

KINDS = sorted(ESTIMATORS)


@pytest.mark.parametrize("kind", KINDS)
def test_the_stored_model_gives_pairs_the_leverage_of_the_run(dataset: Dataset, kind: str):
    run = score(dataset, ESTIMATORS[kind]())
    scored = dataset.model(run.name)(dataset.pairs())
    np.testing.assert_array_equal(scored.leverage, dataset.leverage(run.name))
    values = dataset.runs.values(run.name)
    np.testing.assert_array_equal(scored.uncertainty, values["uncertainty"])
    for part in ("aleatoric", "epistemic"):
        assert (part in scored.parts) == (values[part].null_count == 0)


def test_an_episode_given_for_pairs_is_refused_with_what_to_do(dataset: Dataset):
    model = dataset.model(score(dataset, ESTIMATORS["vae"]()).name)
    pairs = dataset.episode(0)
    wrong: list[Any] = [Episode(pairs.states, pairs.actions), pairs.states, [pairs]]
    for value in wrong:
        with pytest.raises(InvalidInputError, match=r"pairs: expected sd\.Pairs, found .*; make"):
            model(value)
