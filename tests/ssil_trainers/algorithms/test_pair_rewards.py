"""Rewards that see the action: neither staying alive nor ending early pays in itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_trainers.algorithms import learner as learner_module
from ssil_trainers.algorithms.advantage import compute_advantages
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.learner import Learner
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.networks import Discriminator
from ssil_trainers.algorithms.pair_rewards import list_pairs, log_odds_reward, reward_pairs
from ssil_trainers.algorithms.rewards import Shaping, zero_reward
from ssil_trainers.algorithms.rollout import RolloutCollector
from support.ending_environment import STEPS, EndingEnv, LogOddsModel
from support.toy_environment import demonstrations

SETTINGS = TrainSettings(
    environments=16,
    horizon=2 * STEPS,
    hidden=16,
    discount=0.95,
    kl=0.03,
    entropy=0.0,
    critic_rate=3e-3,
    discriminator_steps=0,
    eta_decay=1.0,
    pair_reward=1.0,
)
ALWAYS_ENDS = 1.0
NEVER_ENDS = 1 / STEPS
"""Ends per step, those by time limits included."""
LEVELS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "positive": lambda time: np.full_like(time, 1.5),
    "negative": lambda time: np.full_like(time, -1.5),
    "rising": lambda time: 2 * time - 1,
    "falling": lambda time: 1 - 2 * time,
}
"""Log-odds of whatever is done, by how much of the episode is over."""
Formula = Callable[[Pairs], np.ndarray]


def is_end(pairs: Pairs) -> np.ndarray:
    return pairs.actions[:, 0] > 0


def level_and_bonus(level: str, *, ending: float, going_on: float = 0.0) -> Formula:
    """Log-odds of a level, and more where an episode is ended, or where it goes on."""
    return lambda pairs: (
        LEVELS[level]((pairs.states[:, 0] + 1) / 2) + np.where(is_end(pairs), ending, going_on)
    )


def learner_of(
    formula: Formula | None, settings: TrainSettings = SETTINGS, shaping: Shaping = zero_reward
) -> Learner:
    collector = RolloutCollector(EndingEnv(settings.environments))
    ones = np.ones((2, 1), np.float32)
    learner = Learner(
        settings,
        collector=collector,
        experts=ExpertSampler(ones, ones, ones[:, 0]),
        shaping=shaping,
        standardizer=Standardizer(np.zeros(1, np.float32), np.ones(1, np.float32)),
        pair_reward=formula and log_odds_reward(LogOddsModel(formula), settings.odds_limit),
    )
    learner.reset_environments()
    return learner


def ends_per_step(learner: Learner, iterations: int = 40) -> float:
    """Train, and return how many episodes end in a step of the last rollout."""
    for _ in range(iterations - 1):
        learner.iterate()
    last = learner.iterate()
    return last.ended / (SETTINGS.environments * SETTINGS.horizon)


@pytest.fixture
def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """The discriminator's reward, which is positive and so pays for staying alive, is 0."""
    monkeypatch.setattr(Discriminator, "reward", lambda self, pairs: torch.zeros(len(pairs)))


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize(("reward", "ends"), [(1.5, NEVER_ENDS), (-1.5, ALWAYS_ENDS)])
def test_the_trap_is_there_a_reward_of_states_pays_for_living_or_for_ending(
    reward: float, ends: float
) -> None:
    """A reward without centering, the same for every pair: its sign alone decides."""
    learner = learner_of(None, replace(SETTINGS, centered=False))
    learner.shaping = lambda states: np.full(len(states), reward)
    assert ends_per_step(learner) == pytest.approx(ends, abs=0.01)


@pytest.mark.parametrize("level", [2.0, -2.0, 50.0, -50.0])
def test_log_odds_that_are_the_same_everywhere_change_nothing(level: float) -> None:
    """All positive they do not pay for idling, all negative not for ending the episode."""
    with_reward = learner_of(lambda pairs: np.full(len(pairs), level))
    without = learner_of(None)
    for _ in range(2):
        with_reward.iterate()
        without.iterate()
    figures = with_reward.iterate()
    without.iterate()
    assert figures.log_odds == pytest.approx(np.clip(level, -np.log(20), np.log(20)), rel=1e-5)
    for one, other in zip(with_reward.policy.layers(), without.policy.layers(), strict=True):
        np.testing.assert_allclose(one[0], other[0], atol=1e-4)


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize("level", ["positive", "negative", "rising"])
def test_the_more_expert_like_of_ending_and_going_on_wins_at_every_level(level: str) -> None:
    going_on = learner_of(level_and_bonus(level, ending=-0.5))
    ending = learner_of(level_and_bonus(level, ending=0.0, going_on=-0.5))
    assert ends_per_step(going_on) == pytest.approx(NEVER_ENDS, abs=0.01)
    assert ends_per_step(ending) == pytest.approx(ALWAYS_ENDS, abs=0.01)


@pytest.mark.usefixtures("blind")
def test_centering_alone_would_pay_for_ending_before_pairs_below_average(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where pairs get worse whatever is done, a worth of 0 at real ends makes it end for good."""
    formula = level_and_bonus("falling", ending=-1.0)
    settings = replace(SETTINGS, gae_lambda=0.5)  # advantages that lean on the critic
    learner = learner_of(formula, settings)
    assert ends_per_step(learner, iterations=60) == pytest.approx(NEVER_ENDS, abs=0.01)

    def with_worth_0(*arrays: Any, terminated: np.ndarray, **options: Any) -> np.ndarray:
        ends_of_d = terminated[:, :1]
        return compute_advantages(*arrays, terminated=ends_of_d, **options)

    monkeypatch.setattr(learner_module, "compute_advantages", with_worth_0)
    assert ends_per_step(learner_of(formula, settings), iterations=60) > 3 * NEVER_ENDS


def test_models_see_whole_stretches_of_episodes_with_the_actions_taken() -> None:
    """Each pair comes with the number of its step; a stretch goes on where the last rollout cut."""
    learner = learner_of(lambda pairs: pairs.states[:, 0] + pairs.actions[:, 0])
    model = LogOddsModel(lambda pairs: pairs.states[:, 0] + pairs.actions[:, 0])
    reward = log_odds_reward(model, odds_limit=1e6)
    rng = np.random.default_rng(0)
    box = learner.collector.action_box
    later = 0
    for _ in range(3):
        noise = rng.standard_normal((7, 16, 1)).astype(np.float32) - 1.5
        rollout = learner.collector.collect(learner.snapshot(), noise)
        rewards = reward_pairs(rollout, box, reward).reshape(7, 16)
        taken = box.from_unit(rollout.actions)
        expected = rollout.states[..., 0] + taken[..., 0]
        np.testing.assert_allclose(rewards, expected, atol=1e-4)
        pairs = model.asked[-1]
        np.testing.assert_array_equal(pairs.states[:, 0], rollout.states[..., 0].T.ravel())
        # The state says which step of the episode it is.
        np.testing.assert_array_equal(pairs.step, np.rint((pairs.states[:, 0] + 1) * STEPS / 2))
        starts = np.zeros((16, 7), bool)
        starts[:, 0] = True
        starts[:, 1:] |= rollout.ended.T[:, :-1]
        np.testing.assert_array_equal(pairs.episode, np.cumsum(starts.ravel()) - 1)
        later += (pairs.step.reshape(16, 7)[:, 0] > 0).sum()
    assert later > 0


def test_a_reset_starts_the_numbers_of_steps_anew() -> None:
    learner = learner_of(None)
    noise = np.full((3, 16, 1), -2, np.float32)
    learner.collector.collect(learner.snapshot(), noise)
    assert (learner.collector.collect(learner.snapshot(), noise).steps[0] == 3).all()
    learner.reset_environments()
    pairs = list_pairs(
        learner.collector.collect(learner.snapshot(), noise), learner.collector.action_box
    )
    assert pairs.step.tolist() == [0, 1, 2] * 16


def test_the_weight_multiplies_the_pair_reward_and_is_off_by_default() -> None:
    formula = level_and_bonus("rising", ending=-1.0)
    targets = []
    for weight in (1.0, 2.0):
        learner = learner_of(formula, replace(SETTINGS, pair_reward=weight))
        fit = learner._fit_critics
        learner._fit_critics = lambda states, goals, rng, fit=fit: (  # pyright: ignore
            targets.append(goals[1]),
            fit(states, goals, rng),
        )[1]
        learner.iterate()
    np.testing.assert_allclose(2 * targets[0], targets[1], rtol=1e-6)
    assert TrainSettings().pair_reward == 0


def test_eta_follows_the_third_critic_with_a_pair_reward_too() -> None:
    """It learns what V_C learns without centering: LCoR as it is, and centered log-odds.

    The policy stands still, so that both are given the same rollouts.
    """
    settings = replace(SETTINGS, eta=0.0, kl=1e-12, eta_decay=0.9, discriminator_steps=5)
    learners = []
    for centered in (True, False):
        learner = learner_of(
            level_and_bonus("rising", ending=-1.0),
            replace(settings, centered=centered),
            shaping=lambda states: 0.5 + 0.2 * states[:, 0],
        )
        learner.eta = 0.5
        learners.append(learner)
    assert [learner.critics.count for learner in learners] == [3, 2]
    eta = 0.5
    ended = 0
    for _ in range(6):
        before = values_at_starts(learners[0])
        figures = [learner.iterate() for learner in learners]
        ended += figures[0].ended
        after, plain = (values_at_starts(learner) for learner in learners)
        assert np.isfinite(after).all()
        assert after[2] == pytest.approx(plain[1], rel=1e-3)
        assert after[1] < 0.5 * after[2]  # of the centered reward: the rule would see another rise
        eta *= 0.9 if after[0] - before[0] > after[2] - before[2] else 1
        assert learners[0].eta == learners[1].eta == pytest.approx(eta)
    assert ended > 0


def values_at_starts(learner: Learner) -> list[float]:
    """Return each critic's mean value of the states in which the environments last started."""
    return learner.critics(learner.standardize(learner.initial)).mean(dim=1).tolist()


@pytest.mark.usefixtures("blind")
def test_the_more_expert_like_wins_with_a_third_critic_too() -> None:
    for ending, going_on, ends in ((-0.5, 0.0, NEVER_ENDS), (0.0, -0.5, ALWAYS_ENDS)):
        learner = learner_of(
            level_and_bonus("rising", ending=ending, going_on=going_on),
            shaping=lambda states: np.full(len(states), 0.7),
        )
        assert learner.critics.count == 3
        assert ends_per_step(learner, iterations=25) == pytest.approx(ends, abs=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_only_methods_with_lcor_have_a_pair_reward(method: str) -> None:
    model = LogOddsModel(is_end)
    of = replace(demonstrations(), open_model=lambda: model)
    on = replace(TrainSettings(), pair_reward=0.5)
    assert METHODS[method].pair_reward(of, TrainSettings()) is None
    assert (METHODS[method].pair_reward(of, on) is not None) == method.startswith("ssil")


def test_a_pair_reward_needs_the_model_of_a_run() -> None:
    with pytest.raises(InvalidInputError, match="needs the leverage of a scoring run"):
        METHODS["ssil"].pair_reward(demonstrations(), replace(TrainSettings(), pair_reward=1.0))
