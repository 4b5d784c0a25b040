"""The RC car as a `World`: settings, an expert that knows the track, four tiers of negatives.

After the SSIL paper (Lee et al.), in simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_trainers.collection.collect import ExpertPairs, Negatives, World
from ssil_trainers.collection.driver_training import DriverTrainer
from ssil_trainers.collection.ppo import PPOSettings
from ssil_trainers.collection.pure_pursuit import PurePursuit
from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.recording import Selection
from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.rc_lidar.car import ACTION_NAMES, STATE_NAMES, RCCar
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.rc_lidar.tracks import (
    COLLECTION_TRACK,
    TEST_TRACKS,
    TRAINING_TRACK,
    find_track,
)

CAR = RCCar()
"""The car that all of them drive."""

RC_BANDS = (
    Band("0-20", 0.0, 0.2),
    Band("20-40", 0.2, 0.4),
    Band("40-60", 0.4, 0.6),
    Band("60-80", 0.6, 0.8),
)
"""The four tiers of negatives; 1 is a whole lap."""

_PATIENCE_LAPS = 200
"""Laps that are driven without an episode of a tier before the collection fails."""
_WHOLE_LAP = 0.01
"""A time limit so near to one lap is called one: the usual 401 pairs are one step more."""
_COUNTS = (
    "laps",
    "lap_steps",
    "negatives",
    "segment",
    "runs",
    "policies",
    "measure",
    "under_trained_steps",
)


@dataclass(frozen=True)
class RCSettings:
    """How much is collected, from whom, and how the drivers are trained.

    Parameters
    ----------
    track:
        Where the drivers drive: a name, `seed-N`, or a CSV file.
    laps:
        Expert laps; the first half is labeled.
    lap_steps:
        Pairs of a lap.
    negatives:
        Unlabeled negative pairs, shared evenly by the four tiers.
    segment:
        Most pairs that are kept of one negative episode: its last, which lead to the wall.
    ahead:
        How far ahead the expert aims [m].
    action_noise:
        Deviation of the normal noise on every action, the same for every driver.
    runs:
        Under-trained PPO runs that the negatives come from.
    policies:
        Most policies that stand for one tier.
    measure:
        Episodes that measure one policy.
    under_trained_steps:
        Steps of such a run.
    under_trained_learning_rate:
        Step size of such a run.

    Raises
    ------
    InvalidInputError
        For settings that cannot be collected, before anything is trained.

    Examples
    --------
    >>> from ssil_trainers.collection.rc_lidar import RCSettings
    >>> RCSettings(track="hall").under_trained.rollout
    64
    """

    track: str = COLLECTION_TRACK
    laps: int = 10
    lap_steps: int = 401
    negatives: int = 1_170
    segment: int = 75
    ahead: float = 1.4
    action_noise: float = 0.05
    runs: int = 12
    policies: int = 8
    measure: int = 8
    under_trained_steps: int = 8_192
    under_trained_learning_rate: float = 3e-4

    @property
    def under_trained(self) -> PPOSettings:
        """A run of the negatives' drivers, which change with every rollout."""
        return PPOSettings(self.under_trained_steps, self.under_trained_learning_rate, rollout=64)

    def __post_init__(self) -> None:
        """Validate before anything is trained."""
        for name in _COUNTS:
            check_count(name, getattr(self, name))
        if self.laps % 2:
            raise InvalidInputError(f"laps: expected an even number, found {self.laps}")
        if self.negatives < len(RC_BANDS):
            raise InvalidInputError(
                f"negatives: expected at least {len(RC_BANDS)}, found {self.negatives}"
            )
        if not 0 <= self.action_noise < np.inf:
            raise InvalidInputError(
                f"action_noise: expected a finite number of at least 0, found {self.action_noise}"
            )
        if not 0 < self.ahead < np.inf:
            raise InvalidInputError(f"ahead: expected a positive length, found {self.ahead}")
        if not 0 < self.under_trained_learning_rate < np.inf:
            raise InvalidInputError(
                "under_trained_learning_rate: expected a finite number above 0, "
                f"found {self.under_trained_learning_rate}"
            )


def _make_env(settings: RCSettings) -> RCLidarEnv:
    return RCLidarEnv(settings.track, car=CAR, episode_steps=settings.lap_steps)


def _record_expert(
    settings: RCSettings, env: RCLidarEnv, trainer: DriverTrainer
) -> list[ExpertPairs]:
    """Record the expert's laps, the first half of them labeled."""
    expert = PurePursuit(env, ahead=settings.ahead)
    laps = [trainer.course.drive(expert) for _ in range(settings.laps)]
    for row, lap in enumerate(laps):
        if lap.ending != "truncated":
            raise NotFoundError(
                f"lap {row} by {expert}: collision after {len(lap)} of {settings.lap_steps} steps; "
                "lower action_noise, or aim at another distance ahead"
            )
    trainer.progress("drive expert", settings.laps, settings.laps)
    return [
        ExpertPairs(lap, len(lap), labeled=row < settings.laps // 2) for row, lap in enumerate(laps)
    ]


def _negatives(settings: RCSettings) -> Negatives:
    return Negatives(
        settings.negatives,
        patience=_PATIENCE_LAPS * settings.lap_steps,
        per_episode=settings.segment,
        keep="last",
    )


def _card_values(settings: RCSettings) -> Mapping[str, Any]:
    laps = settings.lap_steps / CAR.lap_steps(find_track(settings.track))
    return {
        "car": CAR,
        "laps": laps,
        "is_lap": abs(laps - 1) < _WHOLE_LAP,
        "is_usual": settings == RCSettings(),
        "training_track": TRAINING_TRACK,
        "test_tracks": TEST_TRACKS,
        "count_collisions": _count_collisions,
    }


def _count_collisions(selections: Sequence[Selection]) -> int:
    """Count the episodes that are kept to their end at a wall."""
    return sum(selection.to_episode().ending == "terminated" for selection in selections)


RC_LIDAR: World[RCSettings, RCLidarEnv] = World(
    name="rc-lidar",
    state_names=STATE_NAMES,
    action_names=ACTION_NAMES,
    bands=RC_BANDS,
    make_env=_make_env,
    record_expert=_record_expert,
    negatives=_negatives,
    card="rc_lidar_card.md.j2",
    card_values=_card_values,
)
"""The paper's RC demonstrations: expert laps, half of them labeled, and unlabeled negatives."""
