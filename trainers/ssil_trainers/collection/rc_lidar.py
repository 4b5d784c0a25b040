"""The paper's RC demonstrations: ten expert laps, half of them labeled, and unlabeled negatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.scoring import Progress
from ssil_trainers.collection.policy_selection import DriverTrainer, drives_within
from ssil_trainers.collection.ppo import PPOSettings
from ssil_trainers.collection.pure_pursuit import Pursuit
from ssil_trainers.collection.quality_tiers import EXPERT, Band, select_policies
from ssil_trainers.collection.recording import (
    EvaluationCourse,
    RecordedEpisode,
    Selection,
    first_pairs,
)
from ssil_trainers.envs.counts import count
from ssil_trainers.envs.rc_lidar.car import RCCar
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.rc_lidar.tracks import COLLECTION_TRACK

RC_BANDS = (
    Band("0-20", 0.0, 0.2),
    Band("20-40", 0.2, 0.4),
    Band("40-60", 0.4, 0.6),
    Band("60-80", 0.6, 0.8),
)
"""The four qualities of negatives; 1 is a whole lap."""

_SEEDS_APART = 1_000_000
"""Episodes of one collection are numbered from its seed times this, so no two share a start."""
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
        Where all drive: a name, `seed-N`, or a CSV file.
    laps:
        Expert laps; the first half is labeled.
    lap_steps:
        Pairs of a lap.
    negatives:
        Unlabeled negative pairs, shared evenly by the four qualities.
    segment:
        Of one negative drive at most so many pairs are kept, its last, which lead to the wall.
    ahead:
        How far ahead the expert aims [m].
    action_noise:
        Deviation of the normal noise on every action, the same for every driver.
    runs:
        Under-trained PPO runs that the negatives come from.
    policies:
        Most policies that stand for one quality.
    measure:
        Episodes that measure one policy.
    under_trained_steps:
        Steps of such a run.
    under_trained_learning_rate:
        Step size of such a run.
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
        """A run of the negatives' drivers, who change with every rollout."""
        return PPOSettings(self.under_trained_steps, self.under_trained_learning_rate, rollout=64)

    def __post_init__(self) -> None:
        """Refuse what cannot be collected, before anything is trained."""
        for name in _COUNTS:
            count(name, getattr(self, name))
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


@dataclass(frozen=True, eq=False)
class RCCollected:
    """What was collected, labeled first; expert_return is the return that scores 1."""

    settings: RCSettings
    car: RCCar
    seed: int
    expert_return: float
    taken: Sequence[Selection]

    def episodes(self) -> list[Episode]:
        """Return the demonstrations."""
        return [taken.episode() for taken in self.taken]


def collect_rc(
    *, seed: int, settings: RCSettings, progress: Progress = lambda what, done, of: None
) -> RCCollected:
    """Let the expert drive, train the others and let them drive; same seed, same demonstrations.

    Raises NotFoundError if the expert does not manage its laps or no driver of a quality turned up.
    """
    car = RCCar()

    def make_env() -> RCLidarEnv:
        return RCLidarEnv(settings.track, car=car, episode_steps=settings.lap_steps)

    env = make_env()
    course = EvaluationCourse(
        env, first_seed=seed * _SEEDS_APART, action_noise=settings.action_noise
    )
    laps = _laps(course, Pursuit(env, ahead=settings.ahead), settings)
    progress("drive expert", settings.laps, settings.laps)
    expert_return = float(np.mean([lap.total for lap in laps]))
    taken = [
        Selection(
            lap, len(lap), lap.total / expert_return, EXPERT, labeled=row < settings.laps // 2
        )
        for row, lap in enumerate(laps)
    ]
    taken += _negatives(DriverTrainer(make_env, course, seed, progress), settings, expert_return)
    return RCCollected(settings, car, seed, expert_return, taken)


def _laps(course: EvaluationCourse, expert: Pursuit, settings: RCSettings) -> list[RecordedEpisode]:
    laps = [course.drive(expert) for _ in range(settings.laps)]
    for row, lap in enumerate(laps):
        if lap.ending != "truncated":
            raise NotFoundError(
                f"lap {row} by {expert}: expected {settings.lap_steps} steps without a collision, "
                f"found one after {len(lap)}; give it less action_noise or another target distance"
            )
    return laps


def _negatives(
    school: DriverTrainer, settings: RCSettings, expert_return: float
) -> list[Selection]:
    checkpoints, scores = school.train_under_trained(
        settings.under_trained,
        runs=settings.runs,
        measure=settings.measure,
        expert_return=expert_return,
    )
    bounds = np.linspace(0, settings.negatives, len(RC_BANDS) + 1).astype(int)
    taken = []
    for band, wanted in zip(RC_BANDS, np.diff(bounds).tolist(), strict=True):
        drivers = [
            checkpoints[row] for row in select_policies(scores, band, at_most=settings.policies)
        ]
        drives = drives_within(
            band,
            drivers,
            school.course,
            expert_return=expert_return,
            patience=200 * settings.lap_steps,
        )
        taken += [
            Selection(
                drive, pairs, drive.total / expert_return, band.tier, first=len(drive) - pairs
            )
            for drive, pairs in first_pairs(drives, wanted, at_most=settings.segment)
        ]
        school.progress(f"drive quality {band.tier}", wanted, wanted)
    return taken
