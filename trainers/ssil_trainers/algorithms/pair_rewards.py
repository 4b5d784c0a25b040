"""Rewards that see the action: how expert-like the pairs are that the policy visits.

A state reward cannot tell a good action from a bad one in the same state. The log-odds of the
leverage of the pair (s, a) can. They are added to LCoR with weight `pair_reward`, so that 0 is SSIL
as it is, and they give way with η as LCoR does. Adding keeps LCoR, which holds the policy near
demonstrations also where a fitted model extrapolates.

Such a reward has a trap. If it is positive everywhere, staying alive pays, and the policy idles; if
it is negative everywhere, ending early pays, and the policy crashes. Two things together take its
level out:

- It is centered over the rollout: what counts is to be more expert-like than the policy is on
  average. A constant is no reward at all from the first iteration on.
- A real end is to V_C as a time limit: the future is worth V_C(s_{t+1}) and not 0. Centering alone
  would make 0, the average, the worth of every end: ending would pay wherever the pairs ahead are
  below average, whatever is done there, and be punished wherever they are above. With V_C(s_{t+1})
  ending in a state is worth what going on from it is, and only the pairs themselves decide.

The second part is as good as the critic: where the policy never went, V_C is a guess, and while the
critic learns, ending can pay in front of a long bad stretch. It is also for LCoR, as both have one
critic. Whether an end is good or bad in itself is left to −log D, which keeps its worth of 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.surface import ModelLike
from ssil_trainers.algorithms.odds import log_odds
from ssil_trainers.algorithms.policy import ActionBox
from ssil_trainers.algorithms.rollout import Rollout

PairReward = Callable[[Pairs], NDArray[np.float64]]
"""Maps pairs of n steps in raw units, in the order of their episodes, to rewards (n,)."""


def log_odds_reward(model: ModelLike, odds_limit: float) -> PairReward:
    """Return the log-odds of a pair's leverage as a reward; higher is more expert-like.

    Parameters
    ----------
    model:
        The fitted model of a scoring run, in this process or behind a service.
    odds_limit:
        The largest odds, above 1; the smallest are one over it.

    Examples
    --------
    >>> reward = log_odds_reward(dataset.model("vae"), odds_limit=20)
    >>> rewards = reward(dataset.pairs())
    >>> labeled = dataset.per_pair("labeled").astype(bool)
    >>> bool(rewards[labeled].mean() > rewards[~labeled].mean())
    True
    """
    return lambda pairs: log_odds(model(pairs).leverage, odds_limit)


def list_pairs(rollout: Rollout, box: ActionBox) -> Pairs:
    """Return the pairs of a rollout as demonstrations: one environment's steps after another's.

    Each stretch of an episode within the rollout is an episode of the pairs, whole and in order, so
    that models which look at neighbors see them. Its steps keep their numbers: a stretch that began
    in the rollout before does not begin with step 0.

    Parameters
    ----------
    rollout:
        T steps of N environments.
    box:
        Range of the environment's actions.

    Returns
    -------
    :
        N·T pairs in raw units, with the actions as they were taken.
    """
    horizon, count = rollout.steps.shape
    rows = horizon * count
    steps = rollout.steps.T
    first = steps == 0
    first[:, 0] = True
    return Pairs(
        states=rollout.states.swapaxes(0, 1).reshape(rows, -1),
        actions=box.from_unit(rollout.actions.swapaxes(0, 1).reshape(rows, -1)),
        episode=np.cumsum(first.ravel()) - 1,
        step=steps.ravel(),
    )


def reward_pairs(rollout: Rollout, box: ActionBox, reward: PairReward) -> NDArray[np.float64]:
    """Return the reward of every pair of a rollout, step by step as its states are flattened.

    Parameters
    ----------
    rollout:
        T steps of N environments.
    box:
        Range of the environment's actions.
    reward:
        Maps pairs to rewards.

    Returns
    -------
    :
        Rewards, (T·N,): first those of the first step of every environment.
    """
    rewards = reward(list_pairs(rollout, box))
    horizon, count = rollout.steps.shape
    return rewards.reshape(count, horizon).T.ravel()
