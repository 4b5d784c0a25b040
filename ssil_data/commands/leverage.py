"""Commands about leverage: score, show, report."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ssil_data.commands.output import (
    AsJson,
    Place,
    StorePlace,
    print_json,
    print_table,
    progress,
)
from ssil_data.errors import InvalidInputError
from ssil_data.quality import quality
from ssil_data.report import write_report
from ssil_data.scoring import preset as recipe_of
from ssil_data.scoring import rescore
from ssil_data.scoring import score as score_dataset
from ssil_data.store.dataset import Dataset
from ssil_data.store.runs import Run

Kind = Literal["vae", "windowvae", "mdn", "gpr"]


def score(
    name: str,
    /,
    *,
    estimator: Kind | None = None,
    preset: Literal["default", "paper"] | None = None,
    scale: Literal["quantile", "minmax", "conformal"] | None = None,
    surprisal: bool | None = None,
    seed: int | None = None,
    run: str | None = None,
    fitted: str | None = None,
    place: StorePlace = Place(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Fit an estimator on the labeled pairs and give every pair a leverage in [0, 1].

    Parameters
    ----------
    name:
        The dataset.
    estimator:
        vae and windowvae judge states, mdn and gpr the actions expected in them.
    preset:
        `paper` has the paper's choices, `default` the best ones measured. [default: default]
    scale:
        How uncertainty becomes leverage, instead of the preset's.
    surprisal:
        mdn and gpr: judge the action that was taken, instead of the preset's choice.
    seed:
        Same seed, same machine, same leverage. [default: 0]
    run:
        Name of the run; the estimator's name, numbered, unless given.
    fitted:
        Use the estimator and scale of this run, [DATASET/]RUN, instead of fitting.
    """
    with place.open().open_for_writing(name) as dataset, progress() as report:
        if fitted is not None:
            fitting = {"estimator": estimator, "preset": preset, "scale": scale}
            fitting |= {"surprisal": surprisal, "seed": seed}
            given = [f"--{name}" for name, value in fitting.items() if value is not None]
            if given:
                raise InvalidInputError(
                    f"score: expected --fitted alone, since nothing is fitted, found {given}"
                )
            source, _, source_run = fitted.rpartition("/")
            other = place.open()[source] if source else dataset
            record = rescore(dataset, other, source_run, run=run, progress=report)
        elif estimator is None:
            raise InvalidInputError("score: expected --estimator or --fitted, found neither")
        else:
            recipe = recipe_of(preset or "default", estimator).with_options(
                scale=scale, surprisal=surprisal
            )
            record = score_dataset(
                dataset,
                recipe.estimator,
                scale=recipe.scale,
                labeled_is_one=recipe.labeled_is_one,
                seed=seed or 0,
                run=run,
                progress=report,
            )
    summary = _summary(record)
    if json:
        print_json({**summary, "alpha": record.alpha, "settings": dict(record.estimator)})
    else:
        print_table(f"Scored {name}", [summary])


def show(
    name: str,
    /,
    *,
    place: StorePlace = Place(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Show the leverage of every run by quality tier, and how well it ranks quality.

    Parameters
    ----------
    name:
        The dataset.
    """
    dataset = place.open()[name]
    rows = [_quality_row(dataset, run) for run in dataset.runs]
    if json:
        print_json({"dataset": name, "dataset_version": dataset.version, "runs": rows})
        return
    others = len(dataset.runs.all()) - len(rows)
    if others:
        print(f"{others} runs belong to earlier versions of {name} and are not shown.")
    if not rows:
        print(f"No runs: ssil-data score {name} --estimator windowvae")
        return
    flat = [_flat(row) for row in rows]
    print_table(f"Leverage of the unlabeled pairs of {name}, mean by quality tier", flat)


def report(
    name: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("report.html"),
    place: StorePlace = Place(),  # noqa: B008
) -> None:
    """Write one offline HTML page about the runs of a dataset.

    Parameters
    ----------
    name:
        The dataset.
    output:
        The page.
    """
    with progress() as seen:
        write_report(place.open()[name], output, progress=seen)
    print(f"Report: {output}")


def _summary(run: Run) -> dict[str, Any]:
    return {
        "run": run.name,
        "dataset": run.dataset,
        "dataset_version": run.dataset_version,
        "estimator": run.estimator["kind"],
        "preset": run.preset,
        "scale": run.scale["kind"],
        "seed": run.seed,
        "pairs": run.pairs,
        "labeled": run.labeled,
        "seconds": run.seconds,
    }


def _quality_row(dataset: Dataset, run: Run) -> dict[str, Any]:
    leverage = dataset.leverage(run.name)
    labeled = dataset.per_pair("labeled").astype(bool)
    parts = {"labeled": leverage[labeled], "unlabeled": leverage[~labeled]}
    return {
        "run": run.name,
        "estimator": run.estimator["kind"],
        "preset": run.preset,
        "mean_leverage": {k: float(v.mean()) if len(v) else None for k, v in parts.items()},
        **asdict(quality(dataset, leverage)),
    }


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    made = {
        "run": row["run"],
        "estimator": row["estimator"],
        "preset": row["preset"] or "own",
    }
    ranks = {
        "AUROC": row["auroc"],
        "AUROC, length-matched": row["auroc_length_matched"],
        "Spearman": row["spearman"],
        "Spearman, given length": row["spearman_given_length"],
    }
    tiers: dict[str, Any] = {}
    means = row["mean_leverage_by_tier"] or row["mean_leverage"]
    for tier, mean in means.items():
        column = tier
        while column in {**made, **ranks, **tiers}:
            column = f"tier {column}"
        tiers[column] = mean
    return {**made, **tiers, **ranks}
