"""A dataset with fewer labels: its first labeled pairs, and everything unlabeled as it was."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ssil_data import scales
from ssil_data.client import RemoteDataset
from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.estimators import from_json
from ssil_data.scoring import Progress, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.runs import Run


def with_labels(store: Store, name: str, labels: int) -> Dataset:
    """Open what `name` is with fewer labels, or make it; with all labels, `name` itself.

    Its name ends in the source's version, so that one of another version is never taken for it.

    Its labeled pairs are the first `labels` of the source, the rest of the labeled ones is left
    out: the expert gave fewer demonstrations. Raises InvalidInputError if there are not so many.
    """
    source = store[name]
    found = int(source.per_pair("labeled").sum())
    if not 2 <= labels <= found:
        raise InvalidInputError(f"labels: expected 2 to {found} of {name}, found {labels}")
    if labels == found:
        return source
    fewer = f"{name}-{labels}-labels-{source.version}"
    if fewer in store:
        return store[fewer]
    card = f"# {fewer}\n\nThe first {labels} labeled pairs of `{name}`, version `{source.version}`"
    return store.create(
        fewer,
        _episodes(source, labels),
        state_names=source.state_names,
        action_names=source.action_names,
        card=f"{card}, and all its unlabeled ones.",
    )


def score_like(dataset: Dataset, source: Dataset, run: str, progress: Progress) -> str:
    """Return a run of `dataset` made as `run` of `source` was, fitted on its own labels.

    Raises ConflictError if `dataset` has a run of that name that was made otherwise.
    """
    if dataset.version == source.version:
        return run
    record = source.runs[run]
    if run in dataset.runs.names():
        _refuse_other(dataset, dataset.runs[run], record)
    else:
        score(
            dataset,
            from_json(record.estimator),
            scale=scales.settings_from_json(record.scale),
            labeled_is_one=record.labeled_is_one,
            seed=record.seed,
            run=run,
            progress=progress,
        )
    return run


def _refuse_other(dataset: Dataset, found: Run, expected: Run) -> None:
    for name in ("estimator", "scale", "labeled_is_one", "seed"):
        one, other = getattr(expected, name), getattr(found, name)
        if one != other:
            raise ConflictError(
                f"run {found.name!r} of {dataset.name}: expected {name} {one!r}, as the run of the "
                f"source has, found {other!r}"
            )


def _episodes(source: Dataset, labels: int) -> Iterator[Episode]:
    pairs, rewards = source.pairs(), source.read_recorded("reward")
    positions = source.read_recorded("position")
    start, missing = 0, labels
    for row in source.episodes.to_pylist():
        kept = min(row["length"], missing) if row["labeled"] else row["length"]
        missing -= kept if row["labeled"] else 0
        rows = slice(start, start + kept)
        start += row["length"]
        if kept:
            yield Episode(
                states=pairs.states[rows],
                actions=pairs.actions[rows],
                labeled=row["labeled"],
                source=row["source"],
                rewards=None if rewards is None else rewards[rows],
                positions=None if positions is None else positions[rows],
                score=row["score"],
                tier=row["tier"],
                ending=row["ending"] if kept == row["length"] else "cut",
            )


def expert_return(dataset: Dataset | RemoteDataset) -> float | None:
    """Return the expert's mean return: what a score of 1 is, told by whole scored episodes.

    For evaluation only. None where no reward or score is recorded, or no episode is whole.
    """
    rewards = dataset.read_recorded("reward")
    if rewards is None:
        return None
    lengths = dataset.episodes["length"].to_numpy()
    totals = np.add.reduceat(rewards.astype(np.float64), np.cumsum(lengths) - lengths)
    whole = [
        total / row["score"]
        for total, row in zip(totals, dataset.episodes.to_pylist(), strict=True)
        if row["score"] and row["ending"] != "cut"
    ]
    return float(np.median(whole)) if whole else None
