"""The commands score and report: make leverage, write the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ssil_data.commands.health import describe_health, list_health
from ssil_data.commands.output import (
    AsJson,
    StoreLocation,
    StoreOption,
    print_json,
    print_table,
    progress,
)
from ssil_data.errors import InvalidInputError
from ssil_data.report import write_report
from ssil_data.scales import Posterior
from ssil_data.scoring import preset as recipe_of
from ssil_data.scoring import rescore
from ssil_data.scoring import score as score_dataset
from ssil_data.store.run_record import Run

Kind = Literal["vae", "windowvae", "mdn", "gpr", "contrast", "ensemble"]
"""The kinds in `ESTIMATORS`, for the types of the command line; a test compares the two."""
PresetName = Literal["default", "paper"]
"""The names in `PRESETS`; compared by the same test."""
PoolingKind = Literal["none", "window", "hmm"]
"""The kinds in `POOLINGS`; compared by the same test."""
ScaleKind = Literal["quantile", "minmax", "conformal", "posterior"]
"""The kinds in `SCALES`; compared by the same test."""


def score(
    name: str,
    /,
    *,
    estimator: Kind | None = None,
    preset: PresetName | None = None,
    pool: PoolingKind | None = None,
    scale: ScaleKind | None = None,
    expert_share: str | None = None,
    surprisal: bool | None = None,
    scale_floor: float | None = None,
    self_training: bool | None = None,
    labels: int | None = None,
    seed: int | None = None,
    run: str | None = None,
    fitted: str | None = None,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Give every pair a leverage in [0, 1]: the chance that it is the expert's.

    Leverage near 1 means that a pair is like the expert's. The values are stored as a run. Without
    any choice, what measured best: three estimators together, pooled over time. A run that should
    not be trusted is printed as weak, with the reasons.

    Parameters
    ----------
    name:
        The dataset.
    estimator:
        vae and windowvae judge states, mdn and gpr the actions expected in them, contrast tells
        labeled from unlabeled pairs, ensemble is several of them. [default: ensemble]
    preset:
        `default` has what measured best; `paper` the paper's choices, and needs --estimator vae,
        windowvae, mdn or gpr. [default: default]
    pool:
        How uncertainty is pooled over neighboring steps, instead of the preset's choice: window
        where a drive is good or bad as a whole, hmm where that changes inside an episode.
    scale:
        How uncertainty becomes leverage, instead of the preset's choice; only that of posterior
        is a chance.
    expert_share:
        Share of the expert's pairs among the unlabeled ones, a number between 0 and 1, if you know
        it; "auto" estimates it. [default: auto]
    surprisal:
        mdn and gpr: judge the action that was taken, instead of the preset's choice.
    scale_floor:
        Least scale of a state or action dimension, as a share of its deviation among the unlabeled
        pairs, instead of the preset's choice; 0 for none.
    self_training:
        Fit once more with the purest unlabeled pairs as labeled ones, if they are pure enough.
    labels:
        Fit on only so many labeled pairs, the first ones, to see what fewer would give. Nothing is
        learned from the others.
    seed:
        Random seed: same seed, same machine, same leverage. [default: 0]
    run:
        Name of the run. Without it, the estimator's name, numbered if it is taken.
    fitted:
        Use the estimator, pooling and scale of this run, [DATASET/]RUN, instead of fitting.
    """
    choices = {
        "estimator": estimator,
        "preset": preset,
        "pool": pool,
        "scale": scale,
        "expert-share": expert_share,
        "surprisal": surprisal,
        "scale-floor": scale_floor,
        "self-training": self_training,
        "labels": labels,
        "seed": seed,
    }
    with location.open().open_for_writing(name) as dataset, progress() as report:
        if fitted is not None:
            given = [f"--{choice}" for choice, value in choices.items() if value is not None]
            if given:
                raise InvalidInputError(
                    f"score: --fitted reuses the settings of a run; leave out {given}"
                )
            source, _, source_run = fitted.rpartition("/")
            other = location.open()[source] if source else dataset
            record = rescore(dataset, other, source_run, run=run, progress=report)
        else:
            recipe = recipe_of(preset or "default", estimator).with_options(
                scale=scale,
                surprisal=surprisal,
                pooling=pool,
                expert_share=_parse_share(expert_share),
            )
            if expert_share is not None and not isinstance(recipe.scale, Posterior):
                raise InvalidInputError(
                    "expert_share: only the posterior scale estimates one, the scale is "
                    f"{recipe.scale.kind}"
                )
            if scale_floor is not None:
                recipe = replace(recipe, scale_floor=scale_floor)
            if self_training is not None:
                recipe = replace(recipe, self_training=self_training)
            record = score_dataset(
                dataset, recipe, labels=labels, seed=seed or 0, run=run, progress=report
            )
    _print_run(record, json=json)


def report(
    name: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("report.html"),
    location: StoreOption = StoreLocation(),  # noqa: B008
) -> None:
    """Write one HTML page about the runs of a dataset, for any browser, without a network.

    Parameters
    ----------
    name:
        The dataset.
    output:
        The file to write.
    """
    with progress() as shown:
        write_report(location.open()[name], output, progress=shown)
    print(f"Report: {output}")


def _parse_share(text: str | None) -> float | None:
    """Return a number, or None to estimate the share; the scale says which numbers it takes."""
    if text is None or text == "auto":
        return None
    try:
        return float(text)
    except ValueError:
        raise InvalidInputError(
            f'expert_share: expected a number between 0 and 1 or "auto", found {text}'
        ) from None


def _print_run(run: Run, *, json: bool) -> None:
    """Print a run that was made, and how good it can be."""
    made = {"run": run.name, "estimator": run.estimator["kind"], "preset": run.preset}
    how = {"pooling": run.pooling["kind"], "scale": run.scale["kind"], "seed": run.seed}
    size = {"pairs": run.pairs, "labeled": run.labeled, "seconds": run.seconds}
    if not json:
        print_table(f"Scored {run.dataset}", [{**made, **how, **size}])
        for line in describe_health(run):
            print(line)
        return
    dataset = {"dataset": run.dataset, "dataset_version": run.dataset_version}
    settings = {
        "settings": dict(run.estimator),
        "scale_floor": run.scale_floor,
        "self_training": run.self_training,
        "self_trained": run.self_trained,
    }
    health = list_health(run)
    print_json({**made, **dataset, **how, **size, **health, "alpha": run.alpha, **settings})
