"""Environments by name and settings, one or many side by side."""

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
"""Short names; any other name is a registered gymnasium id."""


def find_spec(task: str) -> EnvSpec:
    """Look up a task by name and settings.

    Parameters
    ----------
    task:
        `racetrack`, `rc-lidar` or a gymnasium id, with settings as in a URL:
        `racetrack?policy_hz=5&track=large`.

    Returns
    -------
    gymnasium.envs.registration.EnvSpec
        A copy of the registered specification with these settings.

    Raises
    ------
    NotFoundError
        For an unknown name.
    InvalidInputError
        For settings of another form.

    Examples
    --------
    >>> from ssil_trainers.envs.registry import find_spec
    >>> find_spec("racetrack?policy_hz=5&track=large").kwargs
    {'policy_hz': 5, 'track': 'large'}
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
    """Make one environment, the one in which scores are measured.

    Parameters
    ----------
    task:
        As for `find_spec`.
    render_mode:
        None or one of the environment's.

    Raises
    ------
    NotFoundError, InvalidInputError
        As `find_spec`; InvalidInputError also for settings that the environment does not have.

    Examples
    --------
    >>> from ssil_trainers.envs.registry import make_single
    >>> make_single("rc-lidar?track=yard").observation_space.shape
    (20,)
    """
    try:
        return gymnasium.make(find_spec(task), render_mode=render_mode)
    except TypeError as error:
        raise InvalidInputError(f"{task}: expected the environment's settings: {error}") from None


def make_vectorized(task: str, count: int) -> VectorEnv[Any, Any, Any]:
    """Make environments that are stepped together; an ended episode starts anew in the same step.

    The project's own tasks have a vectorized twin; any other task, and the racetrack with
    highway-env's traffic, is stepped one by one.

    Parameters
    ----------
    task:
        As for `find_spec`.
    count:
        Number of environments.

    Raises
    ------
    NotFoundError, InvalidInputError
        As `make_single`.

    Examples
    --------
    >>> from ssil_trainers.envs.registry import make_vectorized
    >>> make_vectorized("rc-lidar", 4).reset(seed=0)[0].shape
    (4, 20)
    """
    spec = find_spec(task)
    mode = AutoresetMode.SAME_STEP
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
    """Return the number that a text spells, else the text; 1_0 is none, though Python reads 10."""
    for kind in (int, float) if "_" not in text else ():
        try:
            return kind(text)
        except ValueError:
            continue
    return text
