"""Which environment a name means, and how to make one of it, or many side by side."""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv

import ssil_trainers.envs  # noqa: F401  registers the ids
from ssil_data.errors import NotFoundError

TASKS = {"racetrack": "SSILRacetrack-v0", "rc-lidar": "RCLidar-v0"}
"""Short names; any other registered gymnasium id is meant as it stands."""


def spec_of(name: str) -> EnvSpec:
    """Look a task up; raises NotFoundError."""
    try:
        return gymnasium.spec(TASKS.get(name, name))
    except gymnasium.error.Error as error:
        raise NotFoundError(
            f"environment: expected {' or '.join(TASKS)} or a gymnasium id, found {name!r}: {error}"
        ) from None


def single(name: str, *, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """Make one environment, the real one; raises NotFoundError."""
    return gymnasium.make(spec_of(name), render_mode=render_mode)


def side_by_side(name: str, count: int) -> VectorEnv[Any, Any, Any]:
    """Make `count` environments that are stepped together; raises NotFoundError.

    The project's own tasks have a vectorised twin, any other is stepped one by one. An ended
    episode starts anew in the same step.
    """
    spec, mode = spec_of(name), AutoresetMode.SAME_STEP
    if spec.id in TASKS.values():
        return gymnasium.make_vec(spec, num_envs=count, autoreset_mode=mode)
    return gymnasium.make_vec(
        spec,
        num_envs=count,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
    )
