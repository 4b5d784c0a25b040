"""Commands about leverage: score, show, lcor, report."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from ssil_data.commands.output import (
    AsJson,
    Place,
    StorePlace,
    console,
    print_json,
    print_table,
    progress,
)
from ssil_data.dataset import Dataset
from ssil_data.errors import InvalidInputError
from ssil_data.field import LCoR
from ssil_data.interop import read_states
from ssil_data.kernels import checked_alpha
from ssil_data.quality import quality
from ssil_data.report import write_report
from ssil_data.runs import Run
from ssil_data.scoring import preset as recipe_of
from ssil_data.scoring import rescore
from ssil_data.scoring import score as score_dataset

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
    dataset = place.open()[name]
    with progress() as report:
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
    rows = [_judged(dataset, run) for run in dataset.runs]
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


def lcor(
    name: str,
    /,
    *,
    run: str,
    states: Path | None = None,
    episode: int | None = None,
    alpha: str | None = None,
    contributors: int = 0,
    place: StorePlace = Place(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Ask how good the neighbourhood of states is: LCoR and how many states it rests on.

    Parameters
    ----------
    name:
        The dataset.
    run:
        The run whose leverage is asked.
    states:
        File of states in raw units: .npy, .npz, .csv or .parquet, one column per dimension.
    episode:
        Ask along this episode of the dataset instead of a file.
    alpha:
        Sharpness of the kernel, or "auto": the run's own, which rests on a tenth of the store.
    contributors:
        Also give the pairs that contributed most, this many per state.
    """
    dataset = place.open()[name]
    sharpness = _alpha(alpha)
    field = dataset.field(run, alpha=sharpness)
    if (states is None) == (episode is None):
        found = "neither" if states is None else "both"
        raise InvalidInputError(f"lcor: expected --states or --episode, found {found}")
    if contributors < 0:
        raise InvalidInputError(f"contributors: expected at least 0, found {contributors}")
    if episode is not None:
        asked = dataset.episode(episode).states
    else:
        assert states is not None
        asked = read_states(states, dataset.state_names)
    answer = field.lcor(asked, contributors=contributors)
    top = _contributors(dataset, answer) if contributors else None
    if json:
        result: dict[str, Any] = {
            "alpha": field.alpha,
            "lcor": answer.values.tolist(),
            "effective_sample_size": answer.effective_sample_size.tolist(),
        }
        print_json(result if top is None else {**result, "contributors": top})
    else:
        title = f"LCoR over {len(field.states):,} demonstration states, alpha {field.alpha:.4g}"
        _print_answer(answer, top, unit="state" if episode is None else "step", title=title)


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


def _alpha(text: str | None) -> float | None:
    if text is None or text == "auto":
        return None
    try:
        number = float(text)
    except ValueError:
        raise InvalidInputError(f'alpha: expected a number > 0 or "auto", found {text}') from None
    return checked_alpha(number)


def _summary(run: Run) -> dict[str, Any]:
    return {
        "run": run.run,
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


def _judged(dataset: Dataset, run: Run) -> dict[str, Any]:
    leverage = dataset.leverage(run.run)
    labeled = dataset.per_pair("labeled").astype(bool)
    parts = {"labeled": leverage[labeled], "unlabeled": leverage[~labeled]}
    return {
        "run": run.run,
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


def _contributors(dataset: Dataset, answer: LCoR) -> list[list[dict[str, Any]]]:
    place = np.concatenate([np.column_stack(batch.columns) for batch in dataset.index()])
    return [
        [
            {"episode": int(place[row, 0]), "step": int(place[row, 1]), "share": float(share)}
            for row, share in zip(rows, shares, strict=True)
        ]
        for rows, shares in zip(answer.contributors.row, answer.contributors.share, strict=True)
    ]


def _print_answer(
    answer: LCoR,
    top: list[list[dict[str, Any]]] | None,
    *,
    unit: str,
    title: str,
) -> None:
    shown = np.unique(np.linspace(0, len(answer.values) - 1, 25).astype(int))
    rows = []
    for index in map(int, shown):
        row: dict[str, Any] = {
            unit: index,
            "LCoR": float(answer.values[index]),
            "effective sample size": int(answer.effective_sample_size[index]),
        }
        if top is not None:
            row["contributors"] = ", ".join(
                f"{one['episode']}:{one['step']} {one['share']:.1%}" for one in top[index][:5]
            )
        rows.append(row)
    print_table(title, rows)
    values = answer.values
    console().print(
        f"{len(values):,} {unit}s: LCoR mean {values.mean():.3f}, "
        f"least {values.min():.3f} at {unit} {values.argmin()}, most {values.max():.3f}"
    )
