"""The paper's racetrack demonstrations: labeled expert, unlabeled expert, unlabeled negative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.scoring import Progress
from ssil_trainers.collection.policy_selection import DriverTrainer, drives_within
from ssil_trainers.collection.ppo import PPOSettings
from ssil_trainers.collection.quality_tiers import BANDS, EXPERT, select_policies
from ssil_trainers.collection.recording import EvaluationCourse, Selection, first_pairs
from ssil_trainers.envs.counts import count
from ssil_trainers.envs.racetrack.env import RacetrackEnv
from ssil_trainers.envs.racetrack.highway import POLICY_HZ, Track, check_task

_SEEDS_APART = 1_000_000
"""Episodes of one collection are numbered from its seed times this, so no two share a start."""

_COUNTS = ("labeled", "unlabeled", "segment", "runs", "policies", "measure", "episode_steps")
_COUNTS += ("expert_steps", "under_trained_steps")
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
    """

    track: Track = "default"
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
        """The run of the expert; only late checkpoints differ enough to be worth measuring."""
        return PPOSettings(self.expert_steps, self.expert_learning_rate, keep_every=20)

    @property
    def under_trained(self) -> PPOSettings:
        """A run of the negatives' drivers, who change with every rollout."""
        return PPOSettings(self.under_trained_steps, self.under_trained_learning_rate)

    def __post_init__(self) -> None:
        """Refuse what cannot be collected, before anything is trained."""
        check_task(self.track, policy_hz=self.policy_hz, other_vehicles=self.other_vehicles)
        for name in _COUNTS:
            count(name, getattr(self, name))
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


@dataclass(frozen=True, eq=False)
class Collected:
    """What was collected, labeled first; expert_return is the mean return that scores 1."""

    settings: RacetrackSettings
    seed: int
    expert_return: float
    taken: Sequence[Selection]

    def episodes(self) -> list[Episode]:
        """Return the demonstrations."""
        return [taken.episode() for taken in self.taken]


def collect_racetrack(
    *, seed: int, settings: RacetrackSettings, progress: Progress = lambda what, done, of: None
) -> Collected:
    """Train the drivers and let them drive; the same seed gives the same demonstrations.

    Raises NotFoundError if no driver of a tier turned up.
    """

    def make_env() -> RacetrackEnv:
        return RacetrackEnv(
            settings.track,
            policy_hz=settings.policy_hz,
            other_vehicles=settings.other_vehicles,
            episode_steps=settings.episode_steps,
        )

    course = EvaluationCourse(
        make_env(), first_seed=seed * _SEEDS_APART, action_noise=settings.action_noise
    )
    school = DriverTrainer(make_env, course, seed, progress)
    expert = school.train_expert(settings.expert, measure=settings.measure)
    expert_drives = iter(lambda: course.drive(expert), None)
    labeled = first_pairs(expert_drives, settings.labeled, at_most=settings.segment)
    unlabeled = first_pairs(expert_drives, settings.unlabeled)
    expert_return = float(np.mean([drive.total for drive, _ in labeled + unlabeled]))
    taken = [
        Selection(drive, pairs, drive.total / expert_return, EXPERT, is_labeled)
        for drives, is_labeled in ((labeled, True), (unlabeled, False))
        for drive, pairs in drives
    ]
    taken += _negatives(school, settings, expert_return)
    return Collected(settings, seed, expert_return, taken)


def _negatives(
    school: DriverTrainer, settings: RacetrackSettings, expert_return: float
) -> list[Selection]:
    checkpoints, scores = school.train_under_trained(
        settings.under_trained,
        runs=settings.runs,
        measure=settings.measure,
        expert_return=expert_return,
    )
    taken = []
    for band in BANDS:
        drivers = [
            checkpoints[row] for row in select_policies(scores, band, at_most=settings.policies)
        ]
        drives = drives_within(
            band,
            drivers,
            school.course,
            expert_return=expert_return,
            patience=settings.unlabeled,
        )
        wanted = settings.unlabeled // len(BANDS)
        taken += [
            Selection(drive, pairs, drive.total / expert_return, band.tier)
            for drive, pairs in first_pairs(drives, wanted)
        ]
        school.progress(f"drive tier {band.tier}", wanted, wanted)
    return taken
