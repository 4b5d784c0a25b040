"""Running a trained policy in a single environment, the real one, episode by episode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.policy import Policy

FrameSink = Callable[[NDArray[np.uint8]], None]
"""Takes each rendered frame, (height, width, 3)."""


def drive_episode(
    policy: Policy, env: Any, *, seed: int, frame_sink: FrameSink | None = None
) -> tuple[float, int]:
    """Run one episode with the policy's mean action.

    Parameters
    ----------
    policy:
        The policy that acts, without noise.
    env:
        A single gymnasium environment.
    seed:
        Seed of the episode.
    frame_sink:
        Called with the rendered frame after each step; None renders nothing.

    Returns
    -------
    :
        The return, which is the sum of the rewards (higher is better), and the number of steps.

    Examples
    --------
    >>> import gymnasium
    >>> from ssil_data.features import Standardizer
    >>> from ssil_trainers.algorithms.policy import ActionBox
    >>> policy = Policy(
    ...     standardizer=Standardizer(np.zeros(3, np.float32), np.ones(3, np.float32)),
    ...     layers=((np.zeros((3, 1), np.float32), np.zeros(1, np.float32)),),
    ...     log_sigma=np.zeros(1, np.float32),
    ...     box=ActionBox(np.array([-2], np.float32), np.array([2], np.float32)),
    ... )
    >>> total, steps = drive_episode(policy, gymnasium.make("Pendulum-v1"), seed=0)
    >>> total < 0, steps
    (True, 200)
    """
    state, _ = env.reset(seed=seed)
    total = 0.0
    length = 0
    ended = False
    while not ended:
        action = policy(np.asarray(state, np.float32)[None])[0]
        state, reward, terminated, truncated, _ = env.step(action)
        total += float(reward)
        length += 1
        ended = terminated or truncated
        if frame_sink is not None:
            frame_sink(env.render())
    return total, length


def check_policy_fits(policy: Policy, env: Any) -> None:
    """Raise InvalidInputError if the policy was trained for states or actions of another shape.

    Parameters
    ----------
    policy:
        The policy.
    env:
        A gymnasium environment.
    """
    expected = (env.observation_space.shape, env.action_space.shape)
    found = ((policy.standardizer.width,), policy.log_sigma.shape)
    if found != expected:
        raise InvalidInputError(
            f"policy: expected state and action shapes {expected} of the environment, found {found}"
        )
