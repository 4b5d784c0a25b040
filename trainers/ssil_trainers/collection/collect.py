"""Collecting demonstrations: one procedure for every world.

An expert drives, under-trained policies drive, and every episode is kept for the tier that its
score lies in. What differs between worlds is a `World`: the environment, how the expert comes
about, the tiers, which pairs of a worse episode are kept, and what the card says.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

import gymnasium
import numpy as np

from ssil_data.demonstrations import Episode
from ssil_data.scoring import Progress
from ssil_trainers.collection.driver_training import DriverTrainer
from ssil_trainers.collection.policy_selection import episodes_within, select_policies
from ssil_trainers.collection.ppo import PPOSettings
from ssil_trainers.collection.quality_tiers import EXPERT, Band
from ssil_trainers.collection.recording import (
    EvaluationCourse,
    RecordedEpisode,
    Selection,
    take_pairs,
)

_SEEDS_APART = 1_000_000
"""Episodes of one collection are numbered from its seed times this, so no two share a start."""


class Settings(Protocol):
    """What the settings of every world have in common; each world adds its own."""

    @property
    def action_noise(self) -> float:
        """Deviation of the normal noise on every action."""
        ...

    @property
    def runs(self) -> int:
        """Under-trained PPO runs that the negatives come from."""
        ...

    @property
    def policies(self) -> int:
        """Most policies that stand for one tier."""
        ...

    @property
    def measure(self) -> int:
        """Episodes that measure one policy."""
        ...

    @property
    def under_trained(self) -> PPOSettings:
        """How a run is trained whose checkpoints drive the negatives."""
        ...


SettingsT = TypeVar("SettingsT", bound=Settings)
EnvT = TypeVar("EnvT", bound=gymnasium.Env[Any, Any])


class ExpertPairs(NamedTuple):
    """How many pairs of an expert's episode are kept, its first, and whether they are labeled."""

    recorded: RecordedEpisode
    pairs: int
    labeled: bool


@dataclass(frozen=True)
class Negatives:
    """How much is kept of worse episodes.

    Parameters
    ----------
    pairs:
        Pairs in all, shared evenly by the tiers.
    patience:
        Steps without an episode of a tier before the collection fails.
    per_episode:
        Most pairs that are kept of one episode; None keeps whole episodes.
    keep:
        Which pairs of an episode are kept.
    """

    pairs: int
    patience: int
    per_episode: int | None = None
    keep: Literal["first", "last"] = "first"


@dataclass(frozen=True)
class World(Generic[SettingsT, EnvT]):
    """All that the collection needs to know of a simulated world.

    Parameters
    ----------
    name:
        Name of the command, and of the dataset unless another is given.
    state_names, action_names:
        Names of the dimensions.
    bands:
        Score bands of the negatives' tiers, from the worst to the best.
    make_env:
        Makes the environment of some settings.
    record_expert:
        Records the expert in that environment, or in others that the trainer makes.
    negatives:
        How much of worse episodes some settings keep.
    card:
        File name of the card's template in this folder.
    card_values:
        What this template needs beside the values that all of them get.

    Examples
    --------
    >>> from ssil_trainers.collection.racetrack import RACETRACK
    >>> from ssil_trainers.collection.rc_lidar import RC_LIDAR
    >>> [(world.name, len(world.state_names)) for world in (RACETRACK, RC_LIDAR)]
    [('racetrack', 29), ('rc-lidar', 20)]
    """

    name: str
    state_names: Sequence[str]
    action_names: Sequence[str]
    bands: Sequence[Band]
    make_env: Callable[[SettingsT], EnvT]
    record_expert: Callable[[SettingsT, EnvT, DriverTrainer], Sequence[ExpertPairs]]
    negatives: Callable[[SettingsT], Negatives]
    card: str
    card_values: Callable[[SettingsT], Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Collection(Generic[SettingsT]):
    """What was collected.

    Parameters
    ----------
    world:
        Where it was collected.
    settings:
        With which settings.
    expert_return:
        Mean return of the expert, which scores 1.
    selections:
        What is kept: labeled expert, unlabeled expert, then tier by tier.
    """

    world: World[SettingsT, Any]
    settings: SettingsT
    expert_return: float
    selections: Sequence[Selection]

    def episodes(self) -> list[Episode]:
        """Return the demonstrations, ready for `Store.create`."""
        return [selection.to_episode() for selection in self.selections]


def collect(
    world: World[SettingsT, EnvT],
    settings: SettingsT,
    *,
    seed: int,
    progress: Progress = lambda what, done, of: None,
) -> Collection[SettingsT]:
    """Train the drivers, let them drive, and keep what the settings say.

    Parameters
    ----------
    world:
        `RACETRACK` or `RC_LIDAR`.
    settings:
        The world's settings.
    seed:
        The same seed gives the same demonstrations on the same machine with the same libraries.
    progress:
        Called with what is done, how much of it, and how much there is.

    Returns
    -------
    Collection
        The demonstrations, and how they were made.

    Raises
    ------
    NotFoundError
        If the expert fails, or no policy of a tier was found.

    Examples
    --------
    A collection too small for real use, whose only tier takes every score:

    >>> from dataclasses import replace
    >>> from ssil_trainers.collection.collect import collect
    >>> from ssil_trainers.collection.quality_tiers import Band
    >>> from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings
    >>> world = replace(RC_LIDAR, bands=(Band("any", -9.0, 9.0),))
    >>> settings = RCSettings(laps=2, lap_steps=9, negatives=9, runs=1, under_trained_steps=64)
    >>> collection = collect(world, settings, seed=0)
    >>> [(one.tier, one.labeled, one.pairs) for one in collection.selections[:2]]
    [('expert', True, 9), ('expert', False, 9)]
    """
    make_env = partial(world.make_env, settings)
    env = make_env()
    course = EvaluationCourse(
        env, first_seed=seed * _SEEDS_APART, action_noise=settings.action_noise
    )
    trainer = DriverTrainer(make_env, course, seed, progress)
    expert = world.record_expert(settings, env, trainer)
    expert_return = float(np.mean([kept.recorded.total_reward for kept in expert]))
    selections = [
        Selection(
            kept.recorded,
            kept.pairs,
            score=kept.recorded.total_reward / expert_return,
            tier=EXPERT,
            labeled=kept.labeled,
        )
        for kept in expert
    ]
    selections += _collect_negatives(world, settings, trainer, expert_return)
    return Collection(world, settings, expert_return, selections)


def _collect_negatives(
    world: World[SettingsT, Any],
    settings: SettingsT,
    trainer: DriverTrainer,
    expert_return: float,
) -> list[Selection]:
    """Train the worse drivers and record every tier."""
    checkpoints, scores = trainer.train_under_trained(
        settings.under_trained,
        runs=settings.runs,
        measure=settings.measure,
        expert_return=expert_return,
    )
    negatives = world.negatives(settings)
    selections = []
    for band, pairs in zip(world.bands, share(negatives.pairs, len(world.bands)), strict=True):
        rows = select_policies(scores, band, at_most=settings.policies)
        episodes = episodes_within(
            band,
            [checkpoints[row] for row in rows],
            trainer.course,
            expert_return=expert_return,
            patience=negatives.patience,
        )
        for recorded, kept in take_pairs(episodes, pairs, per_episode=negatives.per_episode):
            selections.append(
                Selection(
                    recorded,
                    kept,
                    score=recorded.total_reward / expert_return,
                    tier=band.tier,
                    first=len(recorded) - kept if negatives.keep == "last" else 0,
                )
            )
        trainer.progress(f"drive tier {band.tier}", pairs, pairs)
    return selections


def share(pairs: int, tiers: int) -> list[int]:
    """Return how many pairs each tier gets, as evenly as whole numbers allow.

    Parameters
    ----------
    pairs:
        Pairs in all.
    tiers:
        Number of tiers.

    Examples
    --------
    >>> from ssil_trainers.collection.collect import share
    >>> share(43, 4)
    [10, 11, 11, 11]
    """
    bounds = np.linspace(0, pairs, tiers + 1).astype(int)
    return np.diff(bounds).tolist()
