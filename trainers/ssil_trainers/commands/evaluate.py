"""The command `ssil-data evaluate`: what a policy file does on the real environment."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.commands.output import AsJson, print_json, print_table, progress
from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.envs.registry import make_single

Picture = Callable[[NDArray[np.uint8]], None]


def evaluate(
    policy: Path,
    /,
    *,
    env: str | None = None,
    episodes: int = 5,
    seed: int = 0,
    video: Path | None = None,
    json: AsJson = False,
) -> None:
    """Drive the real environment by a policy's mean action, and say how well it did.

    Parameters
    ----------
    policy:
        The policy file that `train` wrote.
    env:
        racetrack, rc-lidar or a gymnasium id, instead of the one it was trained on.
    episodes:
        How many to drive.
    seed:
        Seed of the first; the others count on.
    video:
        Also write the first as an mp4 film.
    """
    if episodes < 1:
        raise InvalidInputError(f"episodes: expected at least 1, found {episodes}")
    if video is not None and video.suffix != ".mp4":
        raise InvalidInputError(f"video: expected a file name ending in .mp4, found {video}")
    driver = Policy.load(policy)
    task = env or driver.described["origin"]["env"]
    world = make_single(task)
    refuse_unfit(driver, world)
    with progress() as report:
        driven = []
        for number in range(episodes):
            driven.append(drive(driver, world, seed=seed + number))
            report(f"drive {task}", number + 1, episodes)
        if video is not None:
            _, frames = driven[0]
            film(driver, task, video, seed=seed, tell=lambda n: report("film", n, frames))
    world.close()
    result = _summary(task, np.array(driven), driver.described.get("expert_return"))
    if json:
        print_json({**result, "returns": [total for total, _ in driven], "seed": seed})
    else:
        print_table(f"{policy} on {task}", [result])


def drive(
    policy: Policy, env: Any, *, seed: int, picture: Picture | None = None
) -> tuple[float, int]:
    """Drive one episode by the mean action; return the sum of its rewards and its length."""
    state, _ = env.reset(seed=seed)
    total, length, ended = 0.0, 0, False
    while not ended:
        state, reward, terminated, truncated, _ = env.step(
            policy(np.asarray(state, np.float32)[None])[0]
        )
        total, length, ended = total + float(reward), length + 1, terminated or truncated
        if picture is not None:
            picture(env.render())
    return total, length


def film(
    policy: Policy,
    task: str,
    path: Path,
    *,
    seed: int,
    tell: Callable[[int], None] = lambda frames: None,
) -> None:
    """Write one episode as an mp4 film, telling how many frames it has so far."""
    import imageio.v2 as imageio

    env = make_single(task, render_mode="rgb_array")
    rate = env.metadata.get("render_fps", 30)
    path.parent.mkdir(parents=True, exist_ok=True)
    with imageio.get_writer(path, fps=rate, macro_block_size=2) as frames:
        numbers = count(1)

        def picture(shown: NDArray[np.uint8]) -> None:
            frames.append_data(shown)  # pyright: ignore[reportAttributeAccessIssue]
            tell(next(numbers))

        drive(policy, env, seed=seed, picture=picture)
    env.close()


def refuse_unfit(policy: Policy, env: Any) -> None:
    """Raise InvalidInputError if the policy was made for other states or actions."""
    found = env.observation_space.shape, env.action_space.shape
    expected = (policy.standardiser.width,), policy.log_sigma.shape
    if found != expected:
        raise InvalidInputError(
            f"policy: expected state and action shapes {found} of the environment, found {expected}"
        )


def _summary(task: str, driven: NDArray[np.float64], expert_return: float | None) -> dict[str, Any]:
    total, length = driven.T
    return {
        "env": task,
        "episodes": len(total),
        "score": None if expert_return is None else float(total.mean() / expert_return),
        "return": float(total.mean()),
        "deviation": float(total.std()),
        "least": float(total.min()),
        "length": float(length.mean()),
    }
