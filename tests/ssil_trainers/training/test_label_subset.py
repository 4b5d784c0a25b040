"""Datasets with fewer labels, and the scoring runs on them."""

from __future__ import annotations

import numpy as np
import pytest

from ssil_data.errors import ConflictError
from ssil_data.estimators import VAE
from ssil_data.scales import MinMax
from ssil_data.scoring import Recipe, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.training.label_subset import limit_labels, score_like
from support.demonstrations import drive


def test_fewer_labels_are_the_first_and_the_unlabeled_stay(store: Store, dataset: Dataset) -> None:
    fewer = limit_labels(store, "drives", 80)
    before = dataset.pairs()
    after = fewer.pairs()
    labeled = fewer.per_pair("labeled").astype(bool)
    assert labeled.sum() == 80
    np.testing.assert_array_equal(after.states[labeled], before.states[:80])
    np.testing.assert_array_equal(after.states[~labeled], before.states[120:])
    np.testing.assert_array_equal(after.actions[~labeled], before.actions[120:])
    assert fewer.episodes["length"].to_pylist()[:3] == [60, 20, 50]
    assert fewer.episodes["score"].to_pylist()[2:] == dataset.episodes["score"].to_pylist()[2:]
    assert limit_labels(store, "drives", 80).version == fewer.version
    assert limit_labels(store, "drives", 60).episodes["length"].to_pylist()[:2] == [60, 50]
    assert limit_labels(store, "drives", 120).name == "drives"


def test_fewer_labels_of_another_version_are_made_anew(store: Store, dataset: Dataset) -> None:
    before = limit_labels(store, "drives", 80)
    appended = dataset.append([drive(9, 30)])
    after = limit_labels(store, "drives", 80)
    assert after.name != before.name
    assert len(after.pairs().states) == len(before.pairs().states) + 30
    assert before.name.endswith(dataset.version) and after.name.endswith(appended.version)


def test_a_run_on_fewer_labels_that_was_made_otherwise_is_refused(
    store: Store, dataset: Dataset
) -> None:
    fewer = limit_labels(store, "drives", 80)
    score(dataset, VAE(steps=20), seed=3, run="vae")
    score(fewer, VAE(steps=20), seed=4, run="vae")
    with pytest.raises(ConflictError, match=r"run 'vae' of drives-80.*expected seed 3.*found 4"):
        score_like(fewer, dataset, "vae", lambda what, done, of: None)


def test_a_run_on_fewer_labels_is_made_as_the_one_on_all(store: Store, dataset: Dataset) -> None:
    score(dataset, Recipe(VAE(steps=20), MinMax(), labeled_is_one=True), seed=3, run="vae")
    fewer = limit_labels(store, "drives", 80)
    for _ in range(2):
        score_like(fewer, dataset, "vae", lambda what, done, of: None)
    one = dataset.runs["vae"]
    other = fewer.runs["vae"]
    assert (one.estimator, one.scale, one.seed) == (other.estimator, other.scale, other.seed)
    assert other.labeled_is_one and other.labeled == 80
