"""The command `ssil-data train`: a method, an environment, demonstrations; a policy comes out."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ssil_data.client import ServiceError
from ssil_data.commands.output import AsJson, Place, StorePlace, print_json, print_table
from ssil_trainers.algorithms.config import PAPER, TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.envs.registry import find_spec, make_vectorized
from ssil_trainers.training.data_source import DataSource, load_training_data
from ssil_trainers.training.progress import progress_display, tensorboard
from ssil_trainers.training.run import CHECKPOINT, POLICY, Callback, TrainJob, TrainResult
from ssil_trainers.training.run import train as train_job

Name = Literal[
    "gail",
    "gail-mixed",
    "gail-leverage",
    "mixgail",
    "ssil",
    "ssil-leverage",
    "shuffled",
    "constant",
    "clone",
    "clone-mixed",
    "clone-leverage",
]


def train(
    method: Name,
    /,
    *,
    env: str,
    origin: Annotated[DataSource, Parameter(name="*")],
    preset: Literal["default", "paper"] = "default",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    resume: bool = False,
    settings: Annotated[TrainSettings, Parameter(name="*")] = TrainSettings(),  # noqa: B008
    place: StorePlace = Place(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Train a policy on demonstrations; no method reads the environment's reward.

    Parameters
    ----------
    method:
        gail, mixgail (CoR beside it), ssil (LCoR beside it); gail-mixed takes unlabeled pairs for
        expert ones, gail-leverage and ssil-leverage take them by their leverage; the controls
        shuffled (LCoR of mixed up leverage) and constant (a reward that says nothing); clone,
        clone-mixed and clone-leverage clone the labeled pairs, all, or all by their leverage.
    env:
        racetrack, rc-lidar or the id of any gymnasium environment with Box spaces; settings of the
        environment follow as in racetrack?policy_hz=5&track=large.
    preset:
        `paper` overrides what goes beyond the paper: one-step advantages, nothing centred, no
        penalty, no spectral norm.
    output:
        Folder of the policy file, checkpoint, curve and TensorBoard events; without it, named
        after what is trained, in `training/`.
    resume:
        Go on from the folder's checkpoint, to the same result as without the interruption; without
        one, begin, and say so.
    """
    find_spec(env)
    settings = replace(settings, **PAPER) if preset == "paper" else settings
    folder = output or _folder(method, env, origin, settings.seed)
    if resume and not (folder / CHECKPOINT).exists():
        print(f"No checkpoint in {folder}: training begins anew.", file=sys.stderr)
    iterations = METHODS[method].settings(settings).iterations
    try:
        with load_training_data(origin, method, place) as lessons:
            job = TrainJob(
                method=method,
                settings=settings,
                demonstrations=lessons.demonstrations,
                worlds=lambda count: make_vectorized(env, count),
                origin={"env": env, **lessons.identity},
                expert_return=lessons.expert_return,
                folder=folder,
            )
            with (
                progress_display(f"{method} {env}", iterations) as seen,
                tensorboard(folder, seen) as seen,
            ):
                trained = _train(job, resume, seen)
    except KeyboardInterrupt:
        print(f"Stopped. {_on_from(folder)}", file=sys.stderr)
        raise SystemExit(130) from None
    result = {"policy": str(folder / POLICY), **trained.policy.described["evaluated"]}
    if json:
        print_json(result)
    else:
        print_table(f"{method} on {env}", [result])


def _train(job: TrainJob, resume: bool, seen: Callback) -> TrainResult:
    """Train, and say of a service that stays away how to go on."""
    try:
        return train_job(job, resume=resume, seen=seen)
    except ServiceError as error:
        assert job.folder is not None
        raise ServiceError(f"{error}. {_on_from(job.folder)}") from None


def _on_from(folder: Path) -> str:
    if not (folder / CHECKPOINT).exists():
        return "Nothing was written."
    return f"The same command with --resume goes on from the checkpoint in {folder}."


def _folder(method: str, env: str, origin: DataSource, seed: int) -> Path:
    named = [origin.dataset, origin.run, origin.labels, env.partition("?")[0], method, seed]
    return Path("training") / "-".join(str(part) for part in named if part is not None)
