"""A store with one run, local and behind a service."""

from collections.abc import Iterator

import pytest

import ssil_data as sd
from ssil_data.client import RemoteDataset, RemoteStore
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drives


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> sd.Store:
    store = sd.Store(tmp_path_factory.mktemp("client") / "store")
    dataset = store.create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES, card="# Drives"
    )
    sd.score(dataset, sd.MDN(steps=20), run="mdn")
    return store


@pytest.fixture(scope="module")
def remote(local: sd.Store) -> Iterator[RemoteStore]:
    with embed(local.folder.uri, jobs=1) as store:
        yield store


@pytest.fixture(scope="module")
def dataset(remote: RemoteStore) -> RemoteDataset:
    return remote["drives"]
