"""A field and a model of a service have the bits of the local ones."""

import httpx
import numpy as np
import pyarrow as pa
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteDataset, RemoteModel
from ssil_data.client.wire import encode
from ssil_service import embed
from support.scripted_service import scripted_store


def test_a_field_answers_bit_for_bit_like_the_local_one(dataset: RemoteDataset, local: sd.Store):
    remote = dataset.field("mdn")
    here = local["drives"].field("mdn")
    states = local["drives"].pairs().states[::7]
    assert remote.alpha == here.alpha
    for options in ({}, {"contributors": 4}, {"tolerance": 0.05}, {"tolerance": 1.0, "seed": 3}):
        found = remote.lcor(states, **options)
        expected = here.lcor(states, **options)
        for name in ("values", "effective_sample_size", "half_width"):
            assert_array_equal(getattr(found, name), getattr(expected, name))
        assert_array_equal(found.contributors.row, expected.contributors.row)
        assert_array_equal(found.contributors.share, expected.contributors.share)
    assert_array_equal(remote.cor(states), here.cor(states))
    sums = remote.sums(states, contributors=2)
    expected = here.sums(states, contributors=2)
    for name in ("numerator", "denominator", "squares", "log_scale", "nearest", "nearest_weight"):
        assert_array_equal(getattr(sums, name), getattr(expected, name))


def test_another_alpha_is_that_of_the_local_field(dataset: RemoteDataset, local: sd.Store):
    states = local["drives"].pairs().states[:5]
    found = dataset.field("mdn", alpha=0.1 + 0.2).lcor(states).values
    assert_array_equal(found, local["drives"].field("mdn", alpha=0.1 + 0.2).lcor(states).values)


def test_no_states_get_no_answers(dataset: RemoteDataset):
    assert len(dataset.field("mdn").lcor(np.empty((0, 3))).values) == 0


def test_more_states_than_one_request_takes_are_sent_in_several(local: sd.Store):
    states = local["drives"].pairs().states[:50]
    with embed(local.folder.uri, query_rows=16) as store:
        found = store["drives"].field("mdn").cor(states)
    assert_array_equal(found, local["drives"].field("mdn").cor(states))


def test_states_are_refused_as_they_are_locally(dataset: RemoteDataset, local: sd.Store):
    for states in (np.ones((2, 4)), np.full((1, 3), np.nan), np.full((1, 3), 1e300), np.ones(3)):
        with pytest.raises(sd.InvalidInputError) as here:
            local["drives"].field("mdn").lcor(states)
        with pytest.raises(sd.InvalidInputError) as there:
            dataset.field("mdn").lcor(states)
        assert str(there.value) == str(here.value)


def test_a_model_scores_pairs_like_the_local_one(dataset: RemoteDataset, local: sd.Store):
    pairs = local["drives"].episode(4)
    found = dataset.model("mdn")(pairs)
    expected = local["drives"].model("mdn")(pairs)
    assert_array_equal(found.uncertainty, expected.uncertainty)
    assert_array_equal(found.leverage, expected.leverage)
    assert_array_equal(found.pooled, expected.pooled)
    assert set(found.parts) == set(expected.parts)
    assert_array_equal(found.parts["epistemic"], expected.parts["epistemic"])


def test_an_earlier_service_pools_nothing(local: sd.Store):
    pairs = local["drives"].episode(4)
    scored = local["drives"].model("mdn")(pairs)
    columns = {"uncertainty": scored.uncertainty, **scored.parts, "leverage": scored.leverage}
    answer = httpx.Response(200, content=encode(pa.table(columns)).to_pybytes())
    store, _ = scripted_store(answer)
    model = RemoteModel(store.connection, "runs/mdn", local["drives"].runs["mdn"], 1000)
    found = model(pairs)
    assert_array_equal(found.pooled, scored.uncertainty)
    assert set(found.parts) == {"aleatoric", "epistemic"}


def test_no_pairs_get_no_answers(dataset: RemoteDataset):
    none = sd.Pairs(np.empty((0, 3)), np.empty((0, 2)), np.empty(0, int), np.empty(0, int))
    found = dataset.model("mdn")(none)
    assert (len(found.leverage), len(found.pooled)) == (0, 0)
