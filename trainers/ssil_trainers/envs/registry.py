"""Which environment a text means, and how to make one of it, or many side by side."""

from __future__ import annotations

from copy import deepcopy
from typing import Any
from urllib.parse import parse_qsl

import gymnasium
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv

import ssil_trainers.envs  # noqa: F401  registers the ids
from ssil_data.errors import InvalidInputError, NotFoundError

TASKS = {"racetrack": "SSILRacetrack-v0", "rc-lidar": "RCLidar-v0"}
"""Short names; any other registered gymnasium id is meant as it stands."""


def find_spec(task: str) -> EnvSpec:
    """Look up a task such as `racetrack` or, with settings, `racetrack?policy_hz=5&track=large`.

    Raises NotFoundError for an unknown name, InvalidInputError for settings of another form.
    """
    name, _, query = task.partition("?")
    try:
        spec = deepcopy(gymnasium.spec(TASKS.get(name, name)))
        settings = parse_qsl(query, strict_parsing=bool(query))
    except gymnasium.error.Error as error:
        raise NotFoundError(
            f"environment: expected {' or '.join(TASKS)} or a gymnasium id, found {name!r}: {error}"
        ) from None
    except ValueError:
        raise InvalidInputError(f"{name}: expected key=value&key=value, found {query!r}") from None
    spec.kwargs = {**spec.kwargs, **{key: _number(value) for key, value in settings}}
    return spec


def make_single(task: str, *, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """Make one environment, the real one; errors as in `spec_of`."""
    try:
        return gymnasium.make(find_spec(task), render_mode=render_mode)
    except TypeError as error:
        raise InvalidInputError(f"{task}: expected the environment's settings: {error}") from None


def make_vectorized(task: str, count: int) -> VectorEnv[Any, Any, Any]:
    """Make `count` environments that are stepped together; errors as in `spec_of`.

    The project's own tasks have a vectorised twin, any other is stepped one by one, and so is the
    racetrack with highway-env's traffic. An ended episode starts anew in the same step.
    """
    spec, mode = find_spec(task), AutoresetMode.SAME_STEP
    try:
        if spec.id in TASKS.values() and not spec.kwargs.get("other_vehicles"):
            return gymnasium.make_vec(spec, num_envs=count, autoreset_mode=mode)
        return gymnasium.make_vec(
            spec,
            num_envs=count,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": mode},
        )
    except TypeError as error:
        raise InvalidInputError(f"{task}: expected the environment's settings: {error}") from None


def _number(text: str) -> int | float | str:
    """Return the number that a text means; 1_0 is none, though Python reads it as 10."""
    for kind in (int, float) if "_" not in text else ():
        try:
            return kind(text)
        except ValueError:
            continue
    return text
