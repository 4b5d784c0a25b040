"""A dataset of a service reads as the local one does."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteDataset, RemoteStore
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives


@pytest.mark.parametrize("what", ["name", "version", "card", "state_names", "action_names"])
def test_a_dataset_describes_itself_as_the_local_one_does(
    what: str, dataset: RemoteDataset, local: sd.Store
):
    assert getattr(dataset, what) == getattr(local["drives"], what)


def test_a_dataset_reads_like_the_local_one(dataset: RemoteDataset, local: sd.Store):
    here = local["drives"]
    assert len(dataset) == len(here)
    assert dataset.versions == here.versions
    assert dataset.at(here.version).version == here.version
    assert dataset.episodes.equals(here.episodes)
    assert_array_equal(dataset.per_pair("labeled"), here.per_pair("labeled"))
    assert dataset.read_recorded("reward") is None
    for found, expected in (
        (dataset.pairs(), here.pairs()),
        (dataset.episode(3), here.episode(3)),
        (dataset.labeled(), here.labeled()),
    ):
        for name in ("states", "actions", "episode", "step"):
            assert_array_equal(getattr(found, name), getattr(expected, name))
            assert getattr(found, name).dtype == getattr(expected, name).dtype


@pytest.mark.parametrize("number", [-1, 11, 99, 2**70])
def test_an_episode_that_is_none_is_refused_as_locally(
    number: int, dataset: RemoteDataset, local: sd.Store
):
    with pytest.raises(sd.NotFoundError) as here:
        local["drives"].episode(number)
    with pytest.raises(sd.NotFoundError) as there:
        dataset.episode(number)
    assert str(there.value) == str(here.value)


def test_numbers_of_numpy_are_taken_as_locally(remote: RemoteStore):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    dataset = remote.create("numbers", drives(), **names)
    labels: Any = np.int64(20)
    seed: Any = np.uint8(3)
    assert dataset.score(sd.VAE(steps=5), labels=labels, seed=seed).seed == 3


def test_long_answers_come_in_pages(local: sd.Store):
    with embed(local.folder.uri, page_rows=100) as store:
        assert_array_equal(store["drives"].leverage("mdn"), local["drives"].leverage("mdn"))
        assert_array_equal(store["drives"].pairs().states, local["drives"].pairs().states)


def test_an_opened_dataset_stays_what_it_was(remote: RemoteStore):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    before = remote.create("growing", drives(), **names)
    run = before.score(sd.VAE(steps=10)).name
    states = before.pairs().states[:4]
    value = before.field(run).lcor(states).values
    before.append([drive(4, 6)])
    assert len(before.pairs()) == 420
    assert_array_equal(before.field(run).lcor(states).values, value)
    with pytest.raises(sd.ConflictError):
        remote["growing"].field(run)
    remote.delete("growing")
