"""The commands score, show and report: make leverage, compare runs, write the report."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ssil_data.commands.output import (
    AsJson,
    StoreLocation,
    StoreOption,
    print_json,
    print_table,
    progress,
)
from ssil_data.errors import InvalidInputError
from ssil_data.quality import measure_quality
from ssil_data.report import write_report
from ssil_data.scoring import preset as recipe_of
from ssil_data.scoring import rescore
from ssil_data.scoring import score as score_dataset
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run

Kind = Literal["vae", "windowvae", "mdn", "gpr"]
"""The kinds in `ESTIMATORS`, for the types of the command line; a test compares the two."""
PresetName = Literal["default", "paper"]
"""The names in `PRESETS`; compared by the same test."""
ScaleKind = Literal["quantile", "minmax", "conformal"]
"""The kinds in `SCALES`; compared by the same test."""


def score(
    name: str,
    /,
    *,
    estimator: Kind | None = None,
    preset: PresetName | None = None,
    scale: ScaleKind | None = None,
    surprisal: bool | None = None,
    seed: int | None = None,
    run: str | None = None,
    fitted: str | None = None,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Fit an estimator on the labeled pairs and give every pair a leverage in [0, 1].

    Leverage near 1 means that a pair is like the expert's. The values are stored as a run.

    Parameters
    ----------
    name:
        The dataset.
    estimator:
        vae and windowvae judge states, mdn and gpr the actions expected in them.
    preset:
        `paper` has the paper's choices, `default` those that measured best. [default: default]
    scale:
        How uncertainty becomes leverage, instead of the preset's.
    surprisal:
        mdn and gpr: judge the action that was taken, instead of the preset's choice.
    seed:
        Random seed: same seed, same machine, same leverage. [default: 0]
    run:
        Name of the run. Without it, the estimator's name, numbered if it is taken.
    fitted:
        Use the estimator and scale of this run, [DATASET/]RUN, instead of fitting.
    """
    with location.open().open_for_writing(name) as dataset, progress() as report:
        if fitted is not None:
            fitting = {"estimator": estimator, "preset": preset, "scale": scale}
            fitting |= {"surprisal": surprisal, "seed": seed}
            given = [f"--{name}" for name, value in fitting.items() if value is not None]
            if given:
                raise InvalidInputError(
                    f"score: --fitted reuses the settings of a run; leave out {given}"
                )
            source, _, source_run = fitted.rpartition("/")
            other = location.open()[source] if source else dataset
            record = rescore(dataset, other, source_run, run=run, progress=report)
        elif estimator is None:
            raise InvalidInputError("score: give --estimator or --fitted; found neither")
        else:
            recipe = recipe_of(preset or "default", estimator).with_options(
                scale=scale, surprisal=surprisal
            )
            record = score_dataset(dataset, recipe, seed=seed or 0, run=run, progress=report)
    summary = _summarize_run(record)
    if json:
        print_json({**summary, "alpha": record.alpha, "settings": dict(record.estimator)})
    else:
        print_table(f"Scored {name}", [summary])


def show(
    name: str,
    /,
    *,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Compare the runs of a dataset: mean leverage by quality tier, and how well it ranks quality.

    Tiers, AUROC and rank correlation need true quality (`--score`, `--tier` at import); without it,
    the table has the mean leverage of labeled and unlabeled pairs. Higher AUROC and Spearman are
    better; .5 and 0 are chance.

    Parameters
    ----------
    name:
        The dataset.
    """
    dataset = location.open()[name]
    rows = [_measure_quality(dataset, run) for run in dataset.runs]
    if json:
        print_json({"dataset": name, "dataset_version": dataset.version, "runs": rows})
        return
    outdated = len(dataset.runs.all()) - len(rows)
    if outdated:
        print(f"{outdated} runs belong to earlier versions of {name} and are not shown.")
    if not rows:
        print(f"No runs: ssil-data score {name} --estimator windowvae")
        return
    title = f"Leverage of the unlabeled pairs of {name}, mean by quality tier"
    print_table(title, [_flatten(row) for row in rows])


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


def _summarize_run(run: Run) -> dict[str, Any]:
    """Return a run as the row that `score` prints."""
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


def _measure_quality(dataset: Dataset, run: Run) -> dict[str, Any]:
    """Return what is known of a run's leverage, as one row of `show --json`."""
    leverage = dataset.leverage(run.name)
    labeled = dataset.per_pair("labeled").astype(bool)
    parts = {"labeled": leverage[labeled], "unlabeled": leverage[~labeled]}
    return {
        "run": run.name,
        "estimator": run.estimator["kind"],
        "preset": run.preset,
        "mean_leverage": {k: float(v.mean()) if len(v) else None for k, v in parts.items()},
        **asdict(measure_quality(dataset, leverage)),
    }


def _flatten(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of `show --json` as cells of a table; a tier's name never hides a column."""
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
