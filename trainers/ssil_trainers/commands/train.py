"""The command `ssil-data train`: from demonstrations and an environment to a policy file."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ssil_data.client import ServiceError
from ssil_data.commands.output import AsJson, StoreLocation, StoreOption, print_json, print_table
from ssil_trainers.algorithms.config import PAPER, TrainSettings
from ssil_trainers.algorithms.expert_weights import SURE, has_sure_pair
from ssil_trainers.algorithms.methods import METHODS, MethodName
from ssil_trainers.algorithms.unused_settings import check_used
from ssil_trainers.envs.registry import find_spec, make_vectorized
from ssil_trainers.training.checkpoint import CHECKPOINT
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.data_source import DataSource, load_training_data
from ssil_trainers.training.progress import progress_display, tensorboard
from ssil_trainers.training.run import POLICY, Callback, TrainResult, TrainRun


def train(
    method: MethodName,
    /,
    *,
    env: str,
    source: Annotated[DataSource, Parameter(name="*")],
    preset: Literal["default", "paper"] = "default",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    resume: bool = False,
    settings: Annotated[TrainSettings, Parameter(name="*")] = TrainSettings(),  # noqa: B008
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Train a policy on demonstrations; no method reads the environment's reward.

    An option that the method does not use is refused, but for those that say what a run may cost.

    Parameters
    ----------
    method:
        gail imitates the labeled pairs; mixgail adds CoR to its reward, ssil LCoR. gail-mixed
        imitates all pairs; gail-leverage and ssil-leverage take half of every batch from labeled
        pairs and half from unlabeled ones of high leverage. clone, clone-mixed and clone-leverage
        clone the labeled pairs, all, or half and half. Controls are gail-shuffled and
        clone-shuffled (by leverage, each unlabeled pair by that of another), shuffled (LCoR of
        shuffled leverage) and constant (the same reward everywhere).
    env:
        racetrack, rc-lidar or the id of any gymnasium environment with Box spaces; settings of the
        environment follow as in racetrack?policy_hz=5&track=large.
    preset:
        `paper` turns off what goes beyond the paper: one-step advantages, no centering, no
        gradient penalty, no spectral norm, no pair reward.
    output:
        Folder of the policy file, checkpoint, curve and TensorBoard events; without it, a folder in
        `training/` named after what is trained.
    resume:
        Go on from the folder's checkpoint, to the same result as without the interruption; without
        a checkpoint, start from the beginning and say so.
    """
    find_spec(env)
    check_used(method, settings)
    settings = replace(settings, **PAPER) if preset == "paper" else settings
    folder = output or _default_folder(method, env, source, settings.seed)
    if resume and not (folder / CHECKPOINT).exists():
        print(f"No checkpoint in {folder}: training starts from the beginning.", file=sys.stderr)
    try:
        with load_training_data(source, method, location) as data:
            _say_if_none_is_sure(method, settings, data)
            run = TrainRun(
                method,
                replace(data, identity={"env": env, **data.identity}),
                lambda count: make_vectorized(env, count),
                settings=settings,
                folder=folder,
            )
            with (
                progress_display(f"{method} {env}", run.settings.iterations) as show,
                tensorboard(folder, show) as callback,
            ):
                result = _train(run, folder, resume=resume, callback=callback)
    except KeyboardInterrupt:
        print(f"Stopped. {_how_to_resume(folder)}", file=sys.stderr)
        raise SystemExit(130) from None
    summary = {"policy": str(folder / POLICY), **result.policy.metadata["evaluated"]}
    if json:
        print_json(summary)
    else:
        print_table(f"{method} on {env}", [summary])


def _say_if_none_is_sure(method: MethodName, settings: TrainSettings, data: TrainingData) -> None:
    """Say that labeled pairs alone are imitated, where no other is surely the expert's."""
    takes_sure = METHODS[method].half_labeled and settings.expert_weighting == "sure"
    if takes_sure and not has_sure_pair(data.demonstrations):
        print(
            f"No unlabeled pair has a leverage of {SURE} or more, so {method} imitates labeled "
            "pairs alone; --expert-weighting posterior weights all by their leverage.",
            file=sys.stderr,
        )


def _train(run: TrainRun, folder: Path, *, resume: bool, callback: Callback) -> TrainResult:
    """Train; if the service does not come back, say how to go on later."""
    try:
        return run.train(resume=resume, callback=callback)
    except ServiceError as error:
        raise ServiceError(f"{error}. {_how_to_resume(folder)}") from None


def _how_to_resume(folder: Path) -> str:
    """Say how an interrupted run goes on."""
    if not (folder / CHECKPOINT).exists():
        return "Nothing was written."
    return f"The same command with --resume goes on from the checkpoint in {folder}."


def _default_folder(method: str, env: str, source: DataSource, seed: int) -> Path:
    """Name a folder after everything that is commonly varied."""
    parts = [
        source.dataset,
        source.run,
        source.labels,
        env.partition("?")[0],
        method,
        seed,
    ]
    return Path("training") / "-".join(str(part) for part in parts if part is not None)
