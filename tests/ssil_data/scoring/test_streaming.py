"""A stream of batches gives what one array would."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_data.demonstrations import Pairs, join_pairs
from ssil_data.estimators import (
    GPR,
    MDN,
    VAE,
    Contrast,
    Ensemble,
    Estimator,
    UnlabeledSample,
    WindowVAE,
)
from ssil_data.features import Standardizer
from ssil_data.scoring.streaming import add_margins, stream
from ssil_data.store.dataset import Dataset

EVERY = [
    VAE(),
    WindowVAE(),
    MDN(),
    GPR(),
    Contrast(steps=40),
    Ensemble((WindowVAE(steps=40), Contrast(steps=40))),
]


@given(st.integers(1, 50), st.integers(1, 7), st.integers(0, 2))
def test_margins_are_the_neighboring_rows(count: int, size: int, margin: int):
    rows = np.arange(count)
    pairs = Pairs(rows[:, None], rows[:, None], rows // 5, rows % 5)
    batches = [pairs[i : i + size] for i in range(0, count, size)]
    inner = []
    for (batch, own), plain in zip(add_margins(batches, margin), batches, strict=True):
        np.testing.assert_array_equal(batch[own].states, plain.states)
        assert own.start == min(margin, int(plain.states[0, 0]), size)
        inner.append(batch[own])
    np.testing.assert_array_equal(join_pairs(inner).states, pairs.states)


@pytest.mark.parametrize("estimator", EVERY, ids=[each.kind for each in EVERY])
def test_the_stream_does_not_depend_on_its_batches(dataset: Dataset, estimator: Estimator):
    unlabeled = UnlabeledSample.of(dataset.pairs()[120:])
    fitted = estimator.fit(dataset.labeled(), seed=0, unlabeled=unlabeled)
    pairs = dataset.pairs()
    expected = Standardizer.of(pairs.states)
    for rows in (1, 13, 10_000):
        done: list[int] = []
        answer = stream(dataset.batches(rows=rows), fitted, count=len(pairs), progress=done.append)
        # a Gaussian process takes small variances from large ones, in float32
        tolerance = 5e-3 if estimator.kind == "gpr" else 2e-4
        expected_total = fitted.uncertainty(pairs).total
        np.testing.assert_allclose(answer.uncertainty, expected_total, rtol=tolerance, atol=1e-5)
        found = Standardizer.of_moments(answer.mean, answer.variance)
        np.testing.assert_allclose(found.scale, expected.scale, rtol=1e-6)
        np.testing.assert_array_equal(answer.sample, pairs.states)
        assert done[-1] == len(pairs)
