"""A gymnasium vector environment in stable-baselines3's form; it knows no particular one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from ssil_data.errors import InvalidInputError

Stepped = tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]


class StableBaselinesVecEnv(VecEnv):
    """The same states, rewards and infos as stable-baselines3's DummyVecEnv of single ones.

    Parameters
    ----------
    envs:
        Environments whose ended episodes start anew in the same step.

    Raises
    ------
    InvalidInputError
        For another autoreset mode.

    Examples
    --------
    >>> from ssil_trainers.envs.registry import make_vectorized
    >>> from ssil_trainers.envs.sb3_vec_env import StableBaselinesVecEnv
    >>> envs = StableBaselinesVecEnv(make_vectorized("rc-lidar", 4))
    >>> envs.reset().shape
    (4, 20)
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        """Check the autoreset mode."""
        mode = envs.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise InvalidInputError(
                f"environments: expected autoreset_mode SAME_STEP, found {mode}"
            )
        self.envs = envs
        self.render_mode = envs.render_mode
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._actions: NDArray[Any] = np.zeros(0)

    def reset(self) -> NDArray[Any]:
        """Start all of them anew, with the seeds that `seed` set."""
        if any(self._options):
            raise InvalidInputError("options: expected none for environments that share a reset")
        states, info = self.envs.reset(seed=self._seeds)  # pyright: ignore[reportArgumentType]
        self.reset_infos = list(self._each(info))
        self._reset_seeds()
        return states

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`.

        Parameters
        ----------
        actions:
            One for each environment (n, k).
        """
        self._actions = actions

    def step_wait(self) -> Stepped:
        """Step all of them; the infos of an ended episode are those of its last step."""
        states, rewards, terminated, truncated, info = self.envs.step(self._actions)
        ended = terminated | truncated
        final = info.pop("final_info", {})
        last_states = info.pop("final_obs", None)
        infos = list(self._each(info))
        if ended.any():
            finals = list(self._each(final))
            for number in np.flatnonzero(ended):
                self.reset_infos[number] = infos[number]
                infos[number] = {**finals[number], "terminal_observation": last_states[number]}
        for number, cut in enumerate(truncated & ~terminated):
            infos[number]["TimeLimit.truncated"] = bool(cut)
        return states, rewards.astype(np.float32), ended, infos

    def _each(self, info: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Yield the info of each environment."""
        masks = {key: info[f"_{key}"] for key in info if f"_{key}" in info}
        for number in range(self.num_envs):
            yield {key: info[key][number] for key, mask in masks.items() if mask[number]}

    def close(self) -> None:
        """Close all of them."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the attribute that the environments share, once for each.

        Parameters
        ----------
        attr_name:
            Name of the attribute.
        indices:
            Which environments; None is all.
        """
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refuse to set an attribute: the environments are one object.

        Parameters
        ----------
        attr_name, value, indices:
            Ignored.
        """
        raise NotImplementedError(f"{attr_name} cannot be set for some of {self.envs}")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **settings: Any) -> Any:
        """Refuse to call a method: the environments are one object.

        Parameters
        ----------
        method_name, args, indices, settings:
            Ignored.
        """
        raise NotImplementedError(f"{method_name} cannot be called for some of {self.envs}")

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each environment: none is wrapped on its own.

        Parameters
        ----------
        wrapper_class:
            Ignored.
        indices:
            Which environments; None is all.
        """
        return [False for _ in self._get_indices(indices)]
