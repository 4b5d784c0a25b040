"""The command `ssil-data train`: a method, an environment, demonstrations; a policy comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from ssil_data.commands.output import AsJson, Place, StorePlace, print_json, print_table, progress
from ssil_data.errors import InvalidInputError
from ssil_trainers.labels import expert_return, scored_like, with_labels
from ssil_trainers.methods import METHODS, Demonstrations
from ssil_trainers.screen import events, screen
from ssil_trainers.settings import TrainSettings
from ssil_trainers.tasks import side_by_side, spec_of
from ssil_trainers.training import POLICY, Job
from ssil_trainers.training import train as train_job

Name = Literal[
    "gail", "gail-mixed", "mixgail", "ssil", "shuffled", "constant", "clone", "clone-leverage"
]


def train(
    method: Name,
    /,
    *,
    env: str,
    dataset: str,
    run: str | None = None,
    service: str | None = None,
    labels: int | None = None,
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
        gail, gail-mixed (unlabeled pairs pass for expert ones), mixgail, ssil; the controls
        shuffled and constant; cloning of the labeled pairs, or of all by their leverage.
    env:
        racetrack, rc-lidar or the id of any gymnasium environment with Box spaces.
    dataset:
        The demonstrations.
    run:
        The scoring run whose leverage is asked; gail, constant and clone ask none.
    service:
        URL of a service to ask instead of the store.
    labels:
        Take only the first labeled pairs, this many, as if the expert had given no more.
    output:
        Folder of the policy file, checkpoint, curve and TensorBoard events; without it, named
        after what is trained, in `training/`.
    resume:
        Go on from the folder's checkpoint, to the same result as without the interruption.
    """
    spec_of(env)
    folder = output or Path("training") / "-".join(
        [
            env,
            method,
            *([run] if run else []),
            *([str(labels)] if labels else []),
            str(settings.seed),
        ]
    )
    job = _job(method, env, dataset, run, service, labels, place, settings, folder)
    iterations = METHODS[method].settings(settings).iterations
    try:
        with screen(f"{method} {env}", iterations) as seen, events(folder, seen) as seen:
            trained = train_job(job, resume=resume, seen=seen)
    except KeyboardInterrupt:
        print(f"Stopped. The same command with --resume goes on from the checkpoint in {folder}.")
        raise SystemExit(130) from None
    last = trained.policy.described["evaluation"]
    result = {"policy": str(folder / POLICY), "steps": trained.curve[-1].steps, **last}
    if json:
        print_json(result)
    else:
        print_table(f"{method} on {env}", [result])


def _job(
    method: Name,
    env: str,
    dataset: str,
    run: str | None,
    service: str | None,
    labels: int | None,
    place: Place,
    settings: TrainSettings,
    folder: Path,
) -> Job:
    if METHODS[method].needs_run and run is None:
        raise InvalidInputError(f"{method}: expected --run, whose leverage it asks for, found none")
    source = _source(service, place)
    chosen = source[dataset]
    if labels is not None:
        if service is not None:
            raise InvalidInputError("--labels: expected a store, found --service")
        chosen = with_labels(source, dataset, labels)
        if run is not None:
            with progress() as report:
                scored_like(chosen, source[dataset], run, report)
    pairs = chosen.pairs()
    demonstrations = Demonstrations(
        states=pairs.states,
        actions=pairs.actions,
        labeled=chosen.per_pair("labeled").astype(bool),
        leverage=None if run is None else np.asarray(chosen.leverage(run)),
        field=None if run is None else chosen.field(run),
    )
    origin = {"env": env, "dataset": chosen.name, "version": chosen.version, "run": run}
    return Job(
        method=method,
        settings=settings,
        demonstrations=demonstrations,
        worlds=lambda count: side_by_side(env, count),
        origin=origin,
        expert_return=expert_return(chosen),
        folder=folder,
    )


def _source(service: str | None, place: Place) -> Any:
    if service is None:
        return place.open()
    from ssil_data import connect  # pyright: ignore[reportAttributeAccessIssue]

    return connect(service)
