"""The command show: compare the runs of a dataset with each other, and with the truth if known."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ssil_data.commands.health import list_health, warn
from ssil_data.commands.output import (
    AsJson,
    StoreLocation,
    StoreOption,
    print_json,
    print_table,
)
from ssil_data.quality import measure_quality
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import UNCHECKED, Run


def show(
    name: str,
    /,
    *,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Compare the runs of a dataset: what each says of itself, and how well it ranks quality.

    Every run has the share of the expert's that it expects among the unlabeled pairs, with its
    90 % interval; how many unlabeled pairs its weights are worth; how much of the weight it
    expects on experts; what labeled pairs that were held out say of its calibration and ranking
    ("unchecked": none were held out, as with the preset paper); and reasons not to trust it, if
    there are any.

    Mean leverage by tier, AUROC, rank correlation and the columns "true" need true quality
    (`--score`, `--tier` at import). Higher AUROC and Spearman are better; .5 and 0 are chance.

    Parameters
    ----------
    name:
        The dataset.
    """
    dataset = location.open()[name]
    runs = list(dataset.runs)
    rows = [_compare(dataset, run) for run in runs]
    if json:
        print_json({"dataset": name, "dataset_version": dataset.version, "runs": rows})
        return
    outdated = len(dataset.runs.all()) - len(rows)
    if outdated:
        print(f"{outdated} runs belong to earlier versions of {name} and are not shown.")
    if not rows:
        print(f"No runs: ssil-data score {name}")
        return
    print_table(f"Runs of {name}", _drop_empty([_list_choices(row) for row in rows]))
    if any(row["mean_leverage_by_tier"] for row in rows):
        title = "Mean leverage of the unlabeled pairs by quality tier, and how it ranks quality"
        print_table(title, _drop_empty([_list_ranking(row) for row in rows]))
    title = "What each run says of its leverage as a chance"
    if any(row["true_expert_share"] is not None for row in rows):
        title += ", and what is true"
    print_table(title, _drop_empty([_list_chances(row) for row in rows]))
    for run in runs:
        for line in warn(run):
            print(line)


def _compare(dataset: Dataset, run: Run) -> dict[str, Any]:
    """Return what is known of a run's leverage, as one row of `show --json`."""
    leverage = dataset.leverage(run.name)
    labeled = dataset.per_pair("labeled").astype(bool)
    parts = {"labeled": leverage[labeled], "unlabeled": leverage[~labeled]}
    return {
        "run": run.name,
        "estimator": run.estimator["kind"],
        "preset": run.preset,
        **list_health(run),
        "mean_leverage": {k: float(v.mean()) if len(v) else None for k, v in parts.items()},
        **asdict(measure_quality(dataset, leverage)),
    }


def _list_choices(row: dict[str, Any]) -> dict[str, Any]:
    """Return how a run was made; without tiers with its mean leverage, for want of a table."""
    means = {} if row["mean_leverage_by_tier"] else row["mean_leverage"]
    return {
        "run": row["run"],
        "estimator": row["estimator"],
        "preset": row["preset"] or "own",
        "pooling": row["pooling"],
        "scale": row["scale"],
        "labels": row["labeled"],
        "laps": None if row["laps"] is None else f"{row['laps']:.2g}",
        **{f"leverage,\n{part}": mean for part, mean in means.items()},
        "trust": "weak" if row["weak"] else None,
    }


def _list_ranking(row: dict[str, Any]) -> dict[str, Any]:
    """Return mean leverage by tier and figures of rank; a tier's name never hides a column."""
    ranks = {
        "AUROC": row["auroc"],
        "same\nlength": row["auroc_length_matched"],
        "Spearman": row["spearman"],
        "given\nlength": row["spearman_given_length"],
    }
    tiers: dict[str, Any] = {}
    for tier, mean in row["mean_leverage_by_tier"].items():
        column = tier
        while column in {"run", *ranks, *tiers}:
            column = f"tier {column}"
        tiers[column] = mean
    return {"run": row["run"], **tiers, **ranks}


def _list_chances(row: dict[str, Any]) -> dict[str, Any]:
    """Return what a run says of its leverage as a chance, beside the truth."""
    interval = row["expert_share_interval"]
    effective = row["effective_pairs"]
    auroc = row["held_out_auroc"]
    return {
        "run": row["run"],
        "expert\nshare": row["expert_share"],
        "90 %\ninterval": None if interval is None else f"{interval[0]:.3f}–{interval[1]:.3f}",
        "true\nshare": row["true_expert_share"],
        "effec-\ntive\npairs": None if effective is None else round(effective),
        "weight\non ex-\nperts": row["weight_on_experts"],
        "true\nweight": row["true_weight_on_experts"],
        "cali-\nbra-\ntion\nerror": row["calibration_error"],
        "true\nerror": row["true_calibration_error"],
        "held-\nout\nAUROC": UNCHECKED if auroc is None else auroc,
    }


def _drop_empty(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Leave out the columns that no row has a value for."""
    kept = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    return [{name: row[name] for name in kept} for row in rows]
