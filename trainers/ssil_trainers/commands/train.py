"""The command `ssil-data train`: from demonstrations and an environment to a policy file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ssil_data.client import ServiceError
from ssil_data.commands.output import AsJson, StoreLocation, StoreOption, print_json, print_table
from ssil_data.scales import Posterior
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.expert_weights import SURE
from ssil_trainers.algorithms.given_settings import GivenSettings, PresetName, apply_preset
from ssil_trainers.algorithms.half_labeled_sampler import share_of_unlabeled
from ssil_trainers.algorithms.methods import METHODS, MethodName
from ssil_trainers.algorithms.unused_settings import check_used, leave_out_replaced
from ssil_trainers.envs.registry import find_spec, make_vectorized
from ssil_trainers.training.checkpoint import CHECKPOINT, read_settings
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
    preset: PresetName = "default",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    resume: bool = False,
    settings: Annotated[GivenSettings, Parameter(name="*")] = GivenSettings(),  # noqa: B008
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Train a policy on demonstrations; no method reads the environment's reward.

    An option that the method does not use, or that the preset contradicts, is refused, but for
    those that say what a run may cost.

    Parameters
    ----------
    method:
        gail imitates the labeled pairs; mixgail adds CoR to its reward, ssil LCoR. gail-mixed
        imitates all pairs; gail-leverage and ssil-leverage take half of every batch from labeled
        pairs and half from unlabeled ones that are surely the expert's, less if those are few.
        clone, clone-mixed and clone-leverage clone the labeled pairs, all, or half and half.
        Controls are gail-shuffled and
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
    folder = output or _default_folder(method, env, source, settings.seed)
    goes_on = resume and (folder / CHECKPOINT).exists()
    stored = read_settings(folder) if goes_on else None
    given = settings if stored is None else leave_out_replaced(method, preset, settings, stored)
    check_used(method, given, stored=stored)
    chosen = apply_preset(preset, given)
    if resume and not goes_on:
        print(f"No checkpoint in {folder}: training starts from the beginning.", file=sys.stderr)
    try:
        with load_training_data(source, method, location) as data:
            for line in _describe_imitation(method, chosen, source, data):
                print(line, file=sys.stderr)
            run = TrainRun(
                method,
                replace(data, identity={"env": env, **data.identity}),
                lambda count: make_vectorized(env, count),
                settings=chosen,
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


def _describe_imitation(
    method: MethodName, settings: TrainSettings, source: DataSource, data: TrainingData
) -> Iterator[str]:
    """Yield a line for each thing about the pairs to imitate that differs from what one expects."""
    row = METHODS[method]
    if source.run is not None and not row.uses_run:
        yield f"{method} uses no scoring run, so --run {source.run} changes nothing."
    if not row.half_labeled:
        return
    sure = settings.expert_weighting == "sure"
    if sure and data.scale != Posterior.kind:
        yield (
            f"Leverage of {source.run} is by the scale {data.scale}, and a chance by the posterior "
            f"scale alone: pairs of leverage {SURE} or more need not be the expert's. Score with "
            "--scale posterior, or train with --expert-weighting ratio."
        )
    labeled = data.demonstrations.labeled
    if data.run_labeled is not None and data.run_labeled < labeled.sum():
        yield (
            f"{source.run} rests on {data.run_labeled:,} labeled pairs, and {method} imitates all "
            f"{labeled.sum():,}; --labels {data.run_labeled} takes as many."
        )
    weights = row.expert_weights(data.demonstrations, settings)[~labeled]
    share = share_of_unlabeled(int(labeled.sum()), weights)
    if share == 0:
        least = f"a leverage of {SURE} or more" if sure else "a leverage above 0"
        more = "; --expert-weighting posterior weights all by their leverage" if sure else ""
        yield f"No unlabeled pair has {least}, so {method} imitates labeled pairs alone{more}."
    elif round(100 * share) < 50:
        yield (
            f"Few unlabeled pairs for {labeled.sum():,} labeled ones: none of them counts more "
            f"than a labeled one, so {100 * share:.2g} % of what {method} imitates is unlabeled, "
            "not half."
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
