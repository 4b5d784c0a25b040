"""A dataset with fewer labels: its first labeled pairs, and all unlabeled pairs as they are."""

from __future__ import annotations

from collections.abc import Iterator

from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.scoring import Progress, Recipe, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run


def limit_labels(store: Store, name: str, labels: int) -> Dataset:
    """Open the dataset with fewer labels, or make it.

    The labeled pairs beyond the first `labels` are left out: the expert gave fewer demonstrations.
    All unlabeled pairs stay. The new name ends in the version of its source, so that a dataset made
    from another version is never taken for it.

    Parameters
    ----------
    store:
        The store of the dataset.
    name:
        Name of the source.
    labels:
        Number of labeled pairs to keep, at least 2.

    Returns
    -------
    :
        The dataset with fewer labels; the source itself if it has just as many.

    Raises
    ------
    InvalidInputError
        If the source has fewer labeled pairs.

    Examples
    --------
    >>> fewer = limit_labels(store, "drives", 80)
    >>> int(fewer.per_pair("labeled").sum()), fewer.name.startswith("drives-80-labels-")
    (80, True)
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
        _limit_episodes(source, labels),
        state_names=source.state_names,
        action_names=source.action_names,
        card=f"{card}, and all its unlabeled ones.",
    )


def score_like(dataset: Dataset, source: Dataset, run: str, progress: Progress) -> str:
    """Score a dataset with the settings of a run on another dataset, unless that was done before.

    Parameters
    ----------
    dataset:
        The dataset to score; the estimator is fitted on its own labels.
    source:
        The dataset of the run to repeat.
    run:
        Name of that run, and of the one that is made.
    progress:
        Called as the scoring goes on.

    Returns
    -------
    :
        The name of the run.

    Raises
    ------
    ConflictError
        If `dataset` has a run of that name with other settings.

    Examples
    --------
    >>> fewer = limit_labels(store, "drives", 80)
    >>> score_like(fewer, dataset, "vae", lambda what, done, of: None)
    'vae'
    >>> fewer.runs["vae"].labeled
    80
    """
    if dataset.version == source.version:
        return run
    record = source.runs[run]
    if run in dataset.runs.names():
        _check_same_settings(dataset, dataset.runs[run], record)
    else:
        recipe = Recipe.of_run(record)
        score(dataset, recipe, seed=record.seed, run=run, progress=progress)
    return run


def _check_same_settings(dataset: Dataset, found: Run, expected: Run) -> None:
    """Raise ConflictError that names the first setting in which two runs differ."""
    for name in ("estimator", "scale", "labeled_is_one", "seed"):
        one = getattr(expected, name)
        other = getattr(found, name)
        if one != other:
            raise ConflictError(
                f"run {found.name!r} of {dataset.name}: expected {name} {one!r}, as the run of the "
                f"source has, found {other!r}"
            )


def _limit_episodes(source: Dataset, labels: int) -> Iterator[Episode]:
    """Yield the episodes of a dataset, the labeled ones cut after the first `labels` pairs."""
    pairs = source.pairs()
    rewards = source.read_recorded("reward")
    positions = source.read_recorded("position")
    start = 0
    missing = labels
    for row in source.episodes.to_pylist():
        kept = min(row["length"], missing) if row["labeled"] else row["length"]
        if row["labeled"]:
            missing -= kept
        rows = slice(start, start + kept)
        start += row["length"]
        if not kept:
            continue
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
