"""The collection of both worlds in miniature."""

from __future__ import annotations

import llvmlite.binding
import numpy as np
import pytest
import torch

from ssil_trainers.collection.collect import collect, share
from support.small_collections import SMALL_WORLDS, collect_small, digest_episodes

PROCESSOR = "znver4"
"""Where the digests were taken; compilers round otherwise for another processor."""
TORCH = "2.13.0+cpu"
DIGESTS = {
    ("racetrack", 0): "2dc328d7ad0a15c01379ed04ffbefc8f9f87f38cb65c621f7df8355ea9f2f9b5",
    ("racetrack", 1): "044680cc73ac476d55cc0f02f3b46ed45364306d2f87cca906aff3fcbe06159e",
    ("rc-lidar", 0): "b3dafba3e3a815547969919e191f68f4d05f936512ffcd79de9a2aff5b0ca696",
    ("rc-lidar", 1): "e4e8e9bd65eae65b933bc382dec86073755fe6921f623f2759c65b836eef62ea",
}
"""Taken before the two worlds' collections became one procedure."""


@pytest.mark.parametrize(("name", "seed"), DIGESTS)
def test_demonstrations_are_the_same_to_the_last_bit_as_ever(name: str, seed: int) -> None:
    here = llvmlite.binding.get_host_cpu_name()
    if (here, torch.__version__) != (PROCESSOR, TORCH):
        pytest.skip(f"digests are of {PROCESSOR} and torch {TORCH}, this is {here}")
    assert digest_episodes(collect_small(name, seed).episodes()) == DIGESTS[name, seed]


@pytest.mark.parametrize("name", SMALL_WORLDS)
def test_same_seed_same_demonstrations_and_another_seed_others(name: str) -> None:
    world, settings = SMALL_WORLDS[name]
    first = collect_small(name, 0).episodes()
    again = collect(world, settings, seed=0).episodes()
    other = collect_small(name, 1).episodes()
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.states, two.states)
        np.testing.assert_array_equal(one.actions, two.actions)
    assert (first[0].states[0] != other[0].states[0]).any()


@pytest.mark.parametrize("name", SMALL_WORLDS)
def test_no_two_episodes_share_a_start(name: str) -> None:
    starts = [tuple(one.recorded.states[0]) for one in collect_small(name, 0).selections]
    assert len(set(starts)) == len(starts)


@pytest.mark.parametrize("name", SMALL_WORLDS)
def test_scores_are_returns_of_whole_episodes_over_the_experts_mean(name: str) -> None:
    collection = collect_small(name, 0)
    expert = [one.score for one in collection.selections if one.tier == "expert"]
    assert np.mean(expert) == pytest.approx(1.0)
    for selection, episode in zip(collection.selections, collection.episodes(), strict=True):
        total = selection.recorded.total_reward
        assert total == pytest.approx(selection.score * collection.expert_return)
        assert episode.score == pytest.approx(selection.score)
        assert episode.source == selection.recorded.driver


@pytest.mark.parametrize("name", SMALL_WORLDS)
def test_progress_reaches_the_end_of_every_piece_of_work(name: str) -> None:
    world, settings = SMALL_WORLDS[name]
    reported: dict[str, tuple[int, int]] = {}

    def progress(what: str, done: int, of: int) -> None:
        reported[what] = (done, of)

    collect(world, settings, seed=0, progress=progress)
    assert all(done == of for done, of in reported.values())
    assert {f"drive tier {band.tier}" for band in world.bands} < set(reported)


def test_tiers_share_the_negatives_as_evenly_as_possible() -> None:
    for pairs in (3, 43, 1_170, 24_000):
        for tiers in (1, 3, 4):
            shares = share(pairs, tiers)
            assert sum(shares) == pairs
            assert max(shares) - min(shares) <= 1
