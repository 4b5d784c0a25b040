"""A question that is asked in parts, as the service's limits want it, has the whole's bits."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteField
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES

ROWS = [97, 512, 1200]
SUMS = ("numerator", "denominator", "squares", "log_scale", "nearest", "nearest_weight")


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> sd.Dataset:
    """A run over enough states that a kernel has several blocks, and rest rows in the last."""
    rng = np.random.default_rng(3)
    walks = [
        sd.Episode(rng.normal((10, 100, 0), size=(2_909, 3)), rng.normal(size=(2_909, 2)), each < 2)
        for each in range(7)
    ]
    store = sd.Store(tmp_path_factory.mktemp("split") / "store")
    dataset = store.create("walks", walks, state_names=STATE_NAMES, action_names=ACTION_NAMES)
    sd.score(dataset, sd.VAE(steps=10), run="vae")
    return dataset


@pytest.fixture(scope="module")
def states() -> np.ndarray:
    return np.random.default_rng(0).normal((10, 100, 0), size=(1_501, 3)).astype(np.float32)


@pytest.fixture(scope="module", params=ROWS)
def parted(request: pytest.FixtureRequest, local: sd.Dataset) -> Iterator[Callable[..., Any]]:
    """Fields of a service that takes few rows in one question."""
    folder = Path(local.folder.uri).parent
    with embed(folder, jobs=1, query_rows=request.param) as store:
        assert store.limits["query_rows"] == request.param
        yield lambda alpha: store["walks"].field("vae", alpha=alpha)


@pytest.mark.parametrize("alpha", [0.5, 1.0, 2.0, 3.0, 37.5])
def test_lcor_and_contributors_in_parts_are_the_wholes(
    alpha: float, parted: Callable[[float], RemoteField], local: sd.Dataset, states: np.ndarray
):
    found = parted(alpha).lcor(states, contributors=3)
    whole = local.field("vae", alpha=alpha).lcor(states, contributors=3)
    for name in ("values", "effective_sample_size", "half_width"):
        assert_array_equal(getattr(found, name), getattr(whole, name), name)
    assert_array_equal(found.contributors.row, whole.contributors.row)
    assert_array_equal(found.contributors.share, whole.contributors.share)


@pytest.mark.parametrize("alpha", [1.0, 2.0, 37.5])
def test_sums_in_parts_are_the_wholes(
    alpha: float, parted: Callable[[float], RemoteField], local: sd.Dataset, states: np.ndarray
):
    found = parted(alpha).sums(states, contributors=2)
    whole = local.field("vae", alpha=alpha).sums(states, contributors=2)
    for name in SUMS:
        assert_array_equal(getattr(found, name), getattr(whole, name), name)


def test_cor_in_parts_is_the_wholes(
    parted: Callable[[float], RemoteField], local: sd.Dataset, states: np.ndarray
):
    assert_array_equal(parted(1.0).cor(states), local.field("vae", alpha=1.0).cor(states))
