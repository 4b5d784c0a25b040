"""Collections in miniature of both worlds: real environments, real PPO, a few hundred steps."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ssil_data.demonstrations import Episode
from ssil_trainers.collection.collect import Collection, World, collect
from ssil_trainers.collection.racetrack import RACETRACK, RacetrackSettings
from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings

SMALL_RACETRACK = RacetrackSettings(
    labeled=50,
    unlabeled=90,
    segment=20,
    runs=1,
    policies=2,
    measure=2,
    episode_steps=40,
    expert_steps=1_024,
    under_trained_steps=1_024,
)
SMALL_RC = RCSettings(
    laps=2,
    lap_steps=60,
    negatives=43,
    segment=9,
    runs=1,
    policies=2,
    measure=2,
    under_trained_steps=1_024,
)


def with_wide_bands(world: World[Any, Any]) -> World[Any, Any]:
    """Return the world with bands that hold every score: a thousand steps make no good driver."""
    return replace(world, bands=tuple(replace(band, low=-9.0, high=99.0) for band in world.bands))


SMALL_WORLDS: dict[str, tuple[World[Any, Any], Any]] = {
    "racetrack": (with_wide_bands(RACETRACK), SMALL_RACETRACK),
    "rc-lidar": (with_wide_bands(RC_LIDAR), SMALL_RC),
}


@cache
def collect_small(name: str, seed: int) -> Collection[Any]:
    """Collect once for all tests of a process."""
    world, settings = SMALL_WORLDS[name]
    return collect(world, settings, seed=seed)


def digest_episodes(episodes: Iterable[Episode]) -> str:
    """Return a SHA-256 over every bit of the arrays and everything that is said of an episode."""
    digest = hashlib.sha256()
    for episode in episodes:
        for values in (episode.states, episode.actions, episode.rewards, episode.positions):
            digest.update(np.ascontiguousarray(values).tobytes())
        assert episode.score is not None
        score = round(episode.score, 9)
        words = (episode.labeled, episode.source, score, episode.tier, episode.ending)
        digest.update(repr(words).encode())
    return digest.hexdigest()
