"""The racetrack as a `World`: settings, a trained PPO expert, three tiers of negatives.

After the SSIL paper (Lee et al.), with highway-env's racetrack in the place of TORCS.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssil_data.errors import InvalidInputError
from ssil_trainers.collection.collect import ExpertPairs, Negatives, World
from ssil_trainers.collection.driver_training import DriverTrainer
from ssil_trainers.collection.ppo import PPOSettings
from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.recording import Selection, take_pairs
from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.racetrack.env import RacetrackEnv
from ssil_trainers.envs.racetrack.highway import (
    HIGHWAY_IDS,
    POLICY_HZ,
    SIMULATION_HZ,
    TrackName,
    check_task,
)
from ssil_trainers.envs.racetrack.starts import START_SPEEDS
from ssil_trainers.envs.racetrack.state import ACTION_NAMES, SPEED_SCALE, STATE_NAMES

BANDS = (Band("0-25", 0.0, 0.25), Band("25-50", 0.25, 0.50), Band("50-75", 0.50, 0.75))
"""The three tiers of negatives; 1 is the expert's mean return."""

_COUNTS = (
    "labeled",
    "unlabeled",
    "segment",
    "runs",
    "policies",
    "measure",
    "episode_steps",
    "expert_steps",
    "under_trained_steps",
)
_RATES = ("expert_learning_rate", "under_trained_learning_rate")


@dataclass(frozen=True)
class RacetrackSettings:
    """How much is collected, from whom, and how the drivers are trained.

    Parameters
    ----------
    track:
        highway-env's racetrack.
    policy_hz:
        Decisions a second, a divisor of 20 and at least 4; 5 is harder than 10.
    other_vehicles:
        Most other vehicles on the road, highway-env's own.
    labeled:
        Labeled expert pairs.
    unlabeled:
        Unlabeled expert pairs; as many again are negative, a third from each tier.
    segment:
        Labeled episodes are cut after this many pairs, so that there are several starts.
    action_noise:
        Deviation of the normal noise on every action, the same for every driver.
    runs:
        Under-trained PPO runs that the negatives come from.
    policies:
        Most policies that stand for one tier.
    measure:
        Episodes that measure one policy.
    episode_steps:
        Time limit of an episode.
    expert_steps:
        Steps of the PPO run whose best checkpoint is the expert.
    expert_learning_rate:
        Step size of that run.
    under_trained_steps:
        Steps of a run whose checkpoints drive the negatives.
    under_trained_learning_rate:
        Step size of such a run; small, so that there are policies between bad and good.

    Raises
    ------
    InvalidInputError
        For settings that cannot be collected, before anything is trained.

    Examples
    --------
    >>> from ssil_trainers.collection.racetrack import RacetrackSettings
    >>> RacetrackSettings(unlabeled=900).under_trained.steps
    24576
    """

    track: TrackName = "default"
    policy_hz: int = POLICY_HZ
    other_vehicles: int = 0
    labeled: int = 1_200
    unlabeled: int = 24_000
    segment: int = 200
    action_noise: float = 0.3
    runs: int = 6
    policies: int = 8
    measure: int = 5
    episode_steps: int = 1_000
    expert_steps: int = 300_000
    expert_learning_rate: float = 3e-4
    under_trained_steps: int = 24_576
    under_trained_learning_rate: float = 1e-4

    @property
    def expert(self) -> PPOSettings:
        """The expert's run; its checkpoints are far apart, as neighbors hardly differ."""
        return PPOSettings(self.expert_steps, self.expert_learning_rate, keep_every=20)

    @property
    def under_trained(self) -> PPOSettings:
        """A run of the negatives' drivers, which change with every rollout."""
        return PPOSettings(self.under_trained_steps, self.under_trained_learning_rate)

    def __post_init__(self) -> None:
        """Validate before anything is trained."""
        check_task(self.track, policy_hz=self.policy_hz, other_vehicles=self.other_vehicles)
        for name in _COUNTS:
            check_count(name, getattr(self, name))
        for name in _RATES:
            if not 0 < getattr(self, name) < np.inf:
                raise InvalidInputError(
                    f"{name}: expected a finite number above 0, found {getattr(self, name)}"
                )
        if not 0 <= self.action_noise < np.inf:
            raise InvalidInputError(
                f"action_noise: expected a finite number of at least 0, found {self.action_noise}"
            )
        if self.unlabeled % len(BANDS):
            raise InvalidInputError(
                f"unlabeled: expected a multiple of {len(BANDS)}, found {self.unlabeled}"
            )


def _make_env(settings: RacetrackSettings) -> RacetrackEnv:
    return RacetrackEnv(
        settings.track,
        policy_hz=settings.policy_hz,
        other_vehicles=settings.other_vehicles,
        episode_steps=settings.episode_steps,
    )


def _record_expert(
    settings: RacetrackSettings, env: RacetrackEnv, trainer: DriverTrainer
) -> list[ExpertPairs]:
    """Train the expert; record the labeled episodes, cut short, and then the unlabeled ones."""
    expert = trainer.train_expert(settings.expert, measure=settings.measure)
    episodes = iter(lambda: trainer.course.drive(expert), None)
    labeled = take_pairs(episodes, settings.labeled, per_episode=settings.segment)
    unlabeled = take_pairs(episodes, settings.unlabeled)
    return [
        *(ExpertPairs(recorded, pairs, labeled=True) for recorded, pairs in labeled),
        *(ExpertPairs(recorded, pairs, labeled=False) for recorded, pairs in unlabeled),
    ]


def _negatives(settings: RacetrackSettings) -> Negatives:
    return Negatives(settings.unlabeled, patience=settings.unlabeled)


def _card_values(settings: RacetrackSettings) -> Mapping[str, Any]:
    return {
        "highway_id": HIGHWAY_IDS[settings.track],
        "simulation_hz": SIMULATION_HZ,
        "start_speeds": START_SPEEDS,
        "is_usual_noise": settings.action_noise == RacetrackSettings().action_noise,
        "mean_steps": _mean_steps,
        "mean_speed": _mean_speed,
    }


def _mean_steps(selections: Sequence[Selection]) -> float:
    """Return the mean length of the whole episodes."""
    return float(np.mean([len(selection.recorded) for selection in selections]))


def _mean_speed(selections: Sequence[Selection]) -> float:
    """Return the mean forward speed over the kept pairs [m/s]."""
    forward = STATE_NAMES.index("forward speed")
    speeds = [one.recorded.states[: one.pairs, forward] for one in selections]
    return SPEED_SCALE * float(np.mean(np.concatenate(speeds)))


RACETRACK: World[RacetrackSettings, RacetrackEnv] = World(
    name="racetrack",
    state_names=STATE_NAMES,
    action_names=ACTION_NAMES,
    bands=BANDS,
    make_env=_make_env,
    record_expert=_record_expert,
    negatives=_negatives,
    card="racetrack_card.md.j2",
    card_values=_card_values,
)
"""The paper's racetrack demonstrations: labeled expert, unlabeled expert, unlabeled negatives."""
