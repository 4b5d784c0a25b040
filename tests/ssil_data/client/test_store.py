"""The store of a service lists, opens, writes and deletes datasets as the local one does."""

import threading
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteStore, connect
from ssil_data.client.connection import Connection
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive


def test_the_store_lists_and_opens_its_datasets(remote: RemoteStore, local: sd.Store):
    assert remote.names() == local.names()
    assert [dataset.name for dataset in remote] == [dataset.name for dataset in local]
    assert "drives" in remote and "nope" not in remote
    with pytest.raises(sd.NotFoundError):
        remote["nope"]
    with pytest.raises(sd.InvalidInputError):
        remote["../etc"]


def test_a_dataset_written_over_rest_is_the_one_written_locally(
    remote: RemoteStore, tmp_path: Path
):
    walk = np.random.default_rng(0).normal(size=(9, 3))
    full = sd.Episode(
        walk, walk[:, :2], True, "lap 1", walk[:, 0], walk[:, :2], 0.5, "expert", "terminated"
    )
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    there = remote.create("written", [full, drive(3, 5)], card="# Here", **names)
    here = sd.Store(tmp_path).create("written", [full, drive(3, 5)], card="# Here", **names)
    assert there.version == here.version
    assert there.card == here.card
    assert there.episodes.equals(here.episodes)
    assert_array_equal(there.episode(0).states, here.episode(0).states)
    longer = there.append([drive(4, 6)])
    expected = here.append([drive(4, 6)])
    assert (longer.version, len(there)) == (expected.version, 14)
    with pytest.raises(sd.ConflictError):
        remote.create("written", [full], **names)
    remote.delete("written")


def test_many_short_episodes_are_written_at_once(remote: RemoteStore):
    pair = np.zeros((2, 3)), np.zeros((2, 2))
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    many = [sd.Episode(*pair, labeled=number == 0) for number in range(5_000)]
    written = remote.create("short", many, **names)
    assert (len(written.episodes), len(written)) == (5_000, 10_000)
    assert len(written.append(many).episodes) == 10_000
    remote.delete("short")


def test_threads_may_share_a_store(remote: RemoteStore, local: sd.Store):
    states = local["drives"].pairs().states
    field = remote["drives"].field("mdn")
    expected = [local["drives"].field("mdn").lcor(states[i : i + 5]).values for i in range(8)]
    found: dict[int, np.ndarray] = {}

    def ask(number: int) -> None:
        found[number] = field.lcor(states[number : number + 5]).values

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number, values in enumerate(expected):
        assert_array_equal(found[number], values)


def test_nothing_is_sent_before_it_is_needed():
    def refuse(request: httpx.Request) -> httpx.Response:
        raise AssertionError("asked")

    asked: Callable[[httpx.Request], httpx.Response] = refuse
    store = connect("http://service", transport=httpx.MockTransport(asked))
    assert isinstance(store.connection, Connection)
    assert "http://service" in repr(store)
    store.close()
