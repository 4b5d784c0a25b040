"""The command `ssil-data evaluate`: how well a policy file does in the real environment."""

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
from ssil_trainers.training.evaluation import check_policy_fits, drive_episode


def evaluate(
    policy_file: Path,
    /,
    *,
    env: str | None = None,
    episodes: int = 5,
    seed: int = 0,
    video: Path | None = None,
    json: AsJson = False,
) -> None:
    """Run a policy's mean action in the real environment, and report its returns.

    Parameters
    ----------
    policy_file:
        The policy file that `train` wrote.
    env:
        racetrack, rc-lidar or a gymnasium id, instead of the one it was trained in.
    episodes:
        Number of episodes.
    seed:
        Seed of the first episode; the next ones have the following seeds.
    video:
        Also write the first episode as an mp4 video.
    """
    if episodes < 1:
        raise InvalidInputError(f"episodes: expected at least 1, found {episodes}")
    if video is not None and video.suffix != ".mp4":
        raise InvalidInputError(f"video: expected a file name ending in .mp4, found {video}")
    policy = Policy.load(policy_file)
    task = env or policy.metadata["origin"]["env"]
    environment = make_single(task)
    check_policy_fits(policy, environment)
    with progress() as report:
        results = []
        for number in range(episodes):
            results.append(drive_episode(policy, environment, seed=seed + number))
            report(f"drive {task}", number + 1, episodes)
        if video is not None:
            _, frames = results[0]
            record_video(
                policy, task, video, seed=seed, report=lambda n: report("video", n, frames)
            )
    environment.close()
    summary = _summarize(task, np.array(results), policy.metadata.get("expert_return"))
    if json:
        print_json({**summary, "returns": [total for total, _ in results], "seed": seed})
    else:
        print_table(f"{policy_file} on {task}", [summary])


def record_video(
    policy: Policy,
    task: str,
    path: Path,
    *,
    seed: int,
    report: Callable[[int], None] = lambda frames: None,
) -> None:
    """Write one episode as an mp4 video.

    Parameters
    ----------
    policy:
        The policy that acts, without noise.
    task:
        The environment, as `make_single` takes it.
    path:
        The file; its folder is made if it is missing.
    seed:
        Seed of the episode.
    report:
        Called after each frame with the number of frames so far.
    """
    import imageio.v2 as imageio

    env = make_single(task, render_mode="rgb_array")
    rate = env.metadata.get("render_fps", 30)
    path.parent.mkdir(parents=True, exist_ok=True)
    with imageio.get_writer(path, fps=rate, macro_block_size=2) as video:
        numbers = count(1)

        def append(frame: NDArray[np.uint8]) -> None:
            video.append_data(frame)  # pyright: ignore[reportAttributeAccessIssue]
            report(next(numbers))

        drive_episode(policy, env, seed=seed, frame_sink=append)
    env.close()


def _summarize(
    task: str, results: NDArray[np.float64], expert_return: float | None
) -> dict[str, Any]:
    """Return the figures of episodes (n, 2): their returns and lengths."""
    total, length = results.T
    return {
        "env": task,
        "episodes": len(total),
        "score": None if expert_return is None else float(total.mean() / expert_return),
        "return": float(total.mean()),
        "deviation": float(total.std()),
        "least": float(total.min()),
        "length": float(length.mean()),
    }
